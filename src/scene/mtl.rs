//! MTL, the material files of Wavefront OBJ, and what their materials mean here.
//!
//! | statement | becomes |
//! |---|---|
//! | `Kd`, `map_Kd` | diffuse reflectance; the map replaces the number |
//! | `Ks` with `Ns` | a rough coat over the diffuse base, of index `Ni` (1.5 if `Ni` is not above 1); metal where `Kd` is 0 |
//! | `illum 3`, `5`, `8` with `Ks` | the same, perfectly smooth |
//! | `illum 4`, `6`, `7`, `9` | glass of index `Ni`, tinted by `Tf` |
//! | `d`, `Tr`, `map_d` with another `illum` | a mask: light passes straight with the rest |
//! | `Ke` | emitted radiance, on the side that the winding says |
//! | `map_Bump`, `bump`, `norm` | bump map (heights times `-bm`), normal map |
//!
//! The roughness of `Ns` is `α = √(2 / (Ns + 2))` (Walter et al. 2007, section 5.2, the Beckmann width of a Phong
//! exponent). `illum 0` and `1` have no highlights. Everything but glass is two-sided: windings of OBJ files are not to
//! be relied on. `Ka` has no meaning where light is computed; it is passed over in silence, other statements with a count.

use super::material::{Material, Model, NestingError, Roughness};
use super::mesh_file::MeshError;
use super::obj::read_text;
use crate::bsdf::{Coat, Distribution, RoughCoat};
use crate::math::Rgb;
use crate::texture::{Bitmap, Filter, ImageCache, ImageError, Texture, Wrap};
use glam::{Affine2, Vec2};
use std::collections::BTreeMap;
use std::path::Path;

/// The refractive index where a file gives none that refracts.
const DEFAULT_INDEX: f32 = 1.5;

/// Reads a material library, and counts the statements that have no effect.
///
/// # Errors
/// The file cannot be read, or a statement with an effect cannot be parsed.
pub(super) fn read(
    path: &Path,
    warnings: &mut Vec<String>,
) -> Result<tobj::MTLLoadResult, MeshError> {
    let text = regular(path, &read_text(path)?, warnings)?;
    match tobj::load_mtl_buf(&mut text.as_bytes()) {
        Err(error) => Err(MeshError::malformed(path, None, error.to_string())),
        library => Ok(library),
    }
}

/// The text with every number that `tobj` reads checked, which gives errors their line.
fn regular(path: &Path, text: &str, warnings: &mut Vec<String>) -> Result<String, MeshError> {
    let mut regular = String::with_capacity(text.len());
    let mut unknown = BTreeMap::<&str, usize>::new();
    for (line, number) in text.lines().zip(1..) {
        let fail = |expected: &str| {
            let message = format!("expected {expected}, found '{}'", line.trim());
            Err(MeshError::malformed(path, Some(number), message))
        };
        let mut words = line.split_whitespace();
        let Some(keyword) = words.next() else { continue };
        let words: Vec<&str> = words.collect();
        match keyword {
            "newmtl" | "map_Kd" | "map_d" | "map_Bump" | "map_bump" | "bump" | "norm" => {
                if words.is_empty() {
                    return fail(&format!("a name after {keyword}"));
                }
                regular += line.trim();
            }
            "Kd" | "Ks" | "Ke" | "Tf" => {
                // Comments may follow.
                let values: Vec<f32> = words.iter().map_while(|word| positive(word)).collect();
                match values[..] {
                    [r, g, b, ..] => regular += &format!("{keyword} {r} {g} {b}"),
                    [gray] => regular += &format!("{keyword} {gray} {gray} {gray}"),
                    _ => {
                        return fail(&format!(
                            "one number or three, none negative, after {keyword}"
                        ));
                    }
                }
            }
            "Ns" | "Ni" | "d" | "Tr" => {
                // "d -halo 0.5" fades with the angle; here it does not.
                let word = words.iter().find(|word| !word.starts_with("-halo"));
                let Some(value) = word.and_then(|word| positive(word)) else {
                    return fail(&format!("a number, not negative, after {keyword}"));
                };
                match keyword {
                    "Tr" => regular += &format!("d {}", 1.0 - value),
                    _ => regular += &format!("{keyword} {value}"),
                }
            }
            "illum" => match words.first().and_then(|word| word.parse::<u8>().ok()) {
                Some(model @ 0..=10) => regular += &format!("illum {model}"),
                _ => return fail("a number from 0 to 10 after illum"),
            },
            "Ka" | "map_Ka" => {}
            _ if keyword.starts_with('#') => {}
            _ => *unknown.entry(keyword).or_default() += 1,
        }
        regular.push('\n');
    }
    warnings.extend(unknown.into_iter().map(|(word, count)| {
        format!("{}: {count} statements '{word}' have no effect", path.display())
    }));
    Ok(regular)
}

fn positive(word: &str) -> Option<f32> {
    word.parse().ok().filter(|value: &f32| value.is_finite() && *value >= 0.0)
}

/// Why a material of a library cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum MaterialError {
    /// An image that it names.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// More reliefs than one.
    #[error("material '{name}': {source}")]
    Nesting {
        /// Its name.
        name: String,
        /// Why.
        source: NestingError,
    },
}

/// What a material of a library means, and the radiance that it sends, if it does. Images lie beside the library.
///
/// # Errors
/// An image cannot be read, or there is more than one relief.
pub(super) fn material(
    mtl: &tobj::Material,
    folder: &Path,
    images: &mut ImageCache,
) -> Result<(Material, Option<Texture>), MaterialError> {
    let reflectance = |value: Option<[f64; 3]>, default: f32| match value {
        Some(value) => rgb(value).clamp(0.0, 1.0),
        None => Rgb::splat(default),
    };
    let mut texture = |name: &str, raw| Map::parse(name).texture(folder, raw, images);

    let diffuse = match &mtl.diffuse_texture {
        Some(name) => texture(name, false)?,
        None => reflectance(mtl.diffuse, 0.5).into(),
    };
    let illumination = mtl.illumination_model.unwrap_or(2);
    let index = mtl.optical_density.map_or(1.0, |index| index as f32);
    let model = match illumination {
        4 | 6 | 7 | 9 => Model::Dielectric {
            eta: if index > 0.0 { index } else { DEFAULT_INDEX },
            reflectance: 1.0.into(),
            transmittance: mtl
                .unknown_param
                .get("Tf")
                .map_or(Rgb::WHITE, |text| colour(text))
                .into(),
            roughness: None,
        },
        0 | 1 => Model::Diffuse(diffuse),
        _ => {
            let is_smooth = matches!(illumination, 3 | 5 | 8);
            let exponent = mtl.shininess.unwrap_or(0.0) as f32;
            let alpha = if is_smooth { 0.0 } else { (2.0 / (exponent + 2.0)).sqrt() };
            let index = if index > 1.0 { index } else { DEFAULT_INDEX };
            coated(diffuse, reflectance(mtl.specular, 0.0), alpha, index)
        }
    };
    let is_glass = matches!(model, Model::Dielectric { .. });
    let mut material = Material::from(model);
    if !is_glass {
        material = material.with_two_sides();
    }

    let nesting = |source| MaterialError::Nesting { name: mtl.name.clone(), source };
    if let (Some(opacity), false) = (mtl.dissolve, is_glass) {
        material = material.masked((opacity as f32).clamp(0.0, 1.0).into());
    }
    if let (Some(name), false) = (&mtl.dissolve_texture, is_glass) {
        material = material.masked(texture(name, true)?);
    }
    if let Some(name) = &mtl.normal_texture {
        material = material.bumped(texture(name, true)?, Map::parse(name).bump).map_err(nesting)?;
    }
    if let Some(name) = mtl.unknown_param.get("norm") {
        material = material.normal_mapped(texture(name, true)?).map_err(nesting)?;
    }
    let radiance = mtl.emissive.map(rgb).filter(|radiance| !radiance.is_black());
    Ok((material, radiance.map(Texture::from)))
}

/// A diffuse base that also reflects `specular` at its surface.
fn coated(diffuse: Texture, specular: Rgb, alpha: f32, index: f32) -> Model {
    if specular.is_black() {
        return Model::Diffuse(diffuse);
    }
    if diffuse.constant().is_some_and(Rgb::is_black) {
        // The index of a perfect mirror: the tint alone is what it reflects.
        return Model::Conductor {
            eta: Rgb::BLACK,
            k: Rgb::WHITE,
            tint: specular.into(),
            roughness: (alpha > 0.0).then(|| Roughness::isotropic(Distribution::Beckmann, alpha)),
        };
    }
    let specular = specular.into();
    if alpha == 0.0 {
        Model::Plastic { diffuse, specular, coat: Coat::new(index, false) }
    } else {
        let coat = Box::new(RoughCoat::new(Distribution::Beckmann, alpha, index, false));
        Model::RoughPlastic { diffuse, specular, coat }
    }
}

fn rgb(value: [f64; 3]) -> Rgb {
    Rgb::from(value.map(|value| value as f32))
}

/// Three numbers that [`regular`] has checked.
fn colour(text: &str) -> Rgb {
    let mut values = text.split_whitespace().filter_map(positive);
    let mut next = || values.next().unwrap_or(1.0).min(1.0);
    Rgb::new(next(), next(), next())
}

/// A texture as MTL names it: options, then a file name, which may hold spaces.
#[derive(Debug, PartialEq)]
struct Map<'a> {
    file: &'a str,
    scale: Vec2,
    offset: Vec2,
    wrap: Wrap,
    /// Factor of bump heights.
    bump: f32,
}

impl<'a> Map<'a> {
    fn parse(text: &'a str) -> Self {
        let mut map = Self {
            file: text.trim(),
            scale: Vec2::ONE,
            offset: Vec2::ZERO,
            wrap: Wrap::Repeat,
            bump: 1.0,
        };
        while let Some((option, rest)) =
            first_word(map.file).filter(|(word, _)| word.starts_with('-'))
        {
            let (arguments, rest) = match option {
                "-s" | "-o" | "-t" => numbers(rest, 3),
                "-mm" => numbers(rest, 2),
                "-bm" | "-boost" | "-texres" => numbers(rest, 1),
                "-clamp" | "-blendu" | "-blendv" | "-cc" | "-imfchan" | "-type" => {
                    let (word, rest) = first_word(rest).unwrap_or(("", ""));
                    if option == "-clamp" && word == "on" {
                        map.wrap = Wrap::Clamp;
                    }
                    (Vec::new(), rest)
                }
                // Not an option: a file name that starts with a hyphen.
                _ => break,
            };
            let pair = |default: Vec2| match arguments[..] {
                [] => default,
                [u] => Vec2::new(u, default.y),
                [u, v, ..] => Vec2::new(u, v),
            };
            match option {
                "-s" => map.scale = pair(Vec2::ONE),
                "-o" => map.offset = pair(Vec2::ZERO),
                "-bm" => map.bump = arguments.first().copied().unwrap_or(1.0),
                _ => {}
            }
            map.file = rest.trim_start();
        }
        map
    }

    fn texture(
        &self,
        folder: &Path,
        raw: bool,
        images: &mut ImageCache,
    ) -> Result<Texture, ImageError> {
        // Files written elsewhere separate folders by backslashes.
        let image = images.load(&folder.join(self.file.replace('\\', "/")), raw)?;
        // Options count v upwards, coordinates were turned downwards when the mesh was read: v' = 1 − (s (1 − v) + o).
        let offset = Vec2::new(self.offset.x, 1.0 - self.scale.y - self.offset.y);
        let to_uv = Affine2::from_scale_angle_translation(self.scale, 0.0, offset);
        Ok(Texture::Bitmap(Bitmap { image, wrap: self.wrap, filter: Filter::Bilinear, to_uv }))
    }
}

fn first_word(text: &str) -> Option<(&str, &str)> {
    let text = text.trim_start();
    let end = text.find(char::is_whitespace).unwrap_or(text.len());
    (end > 0).then(|| text.split_at(end))
}

/// At most `most` numbers at the start, and what follows them.
fn numbers(mut text: &str, most: usize) -> (Vec<f32>, &str) {
    let mut values = Vec::new();
    while values.len() < most {
        let Some((word, rest)) = first_word(text) else { break };
        let Ok(value) = word.parse::<f32>() else { break };
        values.push(value);
        text = rest;
    }
    (values, text)
}

#[cfg(test)]
mod tests;
