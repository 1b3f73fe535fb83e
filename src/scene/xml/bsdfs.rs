//! Materials: nested `bsdf` plugins become one flat [`Material`].

use super::document::{Document, PluginId};
use super::properties::Properties;
use super::textures::{self, Range};
use crate::bsdf::{Coat, Distribution, RoughCoat, media, metals};
use crate::math::Rgb;
use crate::scene::error::SceneError;
use crate::scene::material::{Material, Model, NestingError, Roughness};
use crate::texture::{ImageCache, Texture};

/// By which Mitsuba 3 turns tilted normals that look away from the viewer and darkens what is lit from behind them. Here
/// such normals scatter nothing, and nothing is darkened: at grazing light a relief is brighter here, by a sixth at 17° and a
/// tilt of 37°.
const RELIEF_CORRECTIONS: [&str; 2] = ["flip_invalid_normals", "use_shadowing_function"];

/// The material plugins known.
const KNOWN: [&str; 14] = [
    "blendbsdf",
    "bumpmap",
    "conductor",
    "dielectric",
    "diffuse",
    "mask",
    "normalmap",
    "null",
    "plastic",
    "roughconductor",
    "roughdielectric",
    "roughplastic",
    "thindielectric",
    "twosided",
];

/// The material that a `bsdf` plugin means, with all that is nested in it.
///
/// # Errors
/// An unknown plugin, a property that does not fit, a nesting that has no meaning, or an image that cannot be read.
pub(super) fn material(
    document: &Document,
    id: PluginId,
    images: &mut ImageCache,
) -> Result<Material, SceneError> {
    let mut properties = Properties::new(document, id);
    let material = match properties.name() {
        "twosided" => two_sided(&mut properties, images)?,
        "mask" => {
            let opacity =
                textures::texture(&mut properties, "opacity", 0.5, Range::UnitInterval, images)?;
            let nested = nested(&mut properties, images)?;
            nested.masked(opacity)
        }
        "bumpmap" => {
            properties.ignore(&RELIEF_CORRECTIONS);
            let scale = properties.float("scale")?.unwrap_or(1.0) as f32;
            let height = any_texture(&mut properties, images)?;
            let nested = nested(&mut properties, images)?;
            nested.bumped(height, scale).map_err(|error| refuse(&properties, error))?
        }
        "normalmap" => {
            properties.ignore(&RELIEF_CORRECTIONS);
            let normals = any_texture(&mut properties, images)?;
            let nested = nested(&mut properties, images)?;
            nested.normal_mapped(normals).map_err(|error| refuse(&properties, error))?
        }
        "blendbsdf" => {
            let weight =
                textures::texture(&mut properties, "weight", 0.5, Range::UnitInterval, images)?;
            let [first, second] = properties.plugins("bsdf")[..] else {
                return Err(SceneError::missing(
                    properties.location(),
                    "one of the two bsdfs to blend",
                ));
            };
            let [first, second] =
                [material(document, first, images)?, material(document, second, images)?];
            Material::blend(weight, first, second).map_err(|error| refuse(&properties, error))?
        }
        _ => model(&mut properties, images)?.into(),
    };
    properties.finish()?;
    Ok(material)
}

fn refuse(properties: &Properties<'_>, source: NestingError) -> SceneError {
    SceneError::Nesting { location: properties.location().clone(), source }
}

/// The material inside an adapter.
fn nested(
    properties: &mut Properties<'_>,
    images: &mut ImageCache,
) -> Result<Material, SceneError> {
    let document = properties.document;
    let id = properties.plugin("bsdf")?;
    let missing = || {
        SceneError::missing(properties.location(), format!("the bsdf of {}", properties.title()))
    };
    material(document, id.ok_or_else(missing)?, images)
}

fn any_texture(
    properties: &mut Properties<'_>,
    images: &mut ImageCache,
) -> Result<Texture, SceneError> {
    let document = properties.document;
    let id = properties.plugin("texture")?;
    let missing = || {
        SceneError::missing(properties.location(), format!("the texture of {}", properties.title()))
    };
    textures::plugin(document, id.ok_or_else(missing)?, Range::Positive, images)
}

fn two_sided(
    properties: &mut Properties<'_>,
    images: &mut ImageCache,
) -> Result<Material, SceneError> {
    let document = properties.document;
    let sides = properties.plugins("bsdf");
    if let [first, second, ..] = sides[..]
        && (first != second || sides.len() > 2)
    {
        let expected = "one bsdf, the same for both sides";
        return Err(SceneError::value(
            &document[second].location,
            format!("what {} holds", properties.title()),
            format!("{} bsdfs", sides.len()),
            expected,
        ));
    }
    let Some(side) = sides.first() else {
        return Err(SceneError::missing(
            properties.location(),
            format!("the bsdf of {}", properties.title()),
        ));
    };
    let nested = material(document, *side, images)?;
    // A mask lets light pass from both sides alike, but glass has an inside.
    if nested.is_opaque() && nested.may_pass_light() {
        let found = format!("a bsdf \"{}\"", document[*side].name);
        return Err(SceneError::value(
            &document[*side].location,
            format!("what {} holds", properties.title()),
            found,
            "a bsdf that lets no light through",
        ));
    }
    Ok(nested.with_two_sides())
}

fn model(properties: &mut Properties<'_>, images: &mut ImageCache) -> Result<Model, SceneError> {
    let unit = Range::UnitInterval;
    Ok(match properties.name() {
        "null" => Model::Null,
        "diffuse" => {
            Model::Diffuse(textures::texture(properties, "reflectance", 0.5, unit, images)?)
        }
        "conductor" => conductor(properties, None, images)?,
        "roughconductor" => {
            let roughness = roughness(properties, images)?;
            conductor(properties, Some(roughness), images)?
        }
        "dielectric" => dielectric(properties, None, images)?,
        "roughdielectric" => {
            let roughness = roughness(properties, images)?;
            dielectric(properties, Some(roughness), images)?
        }
        "thindielectric" => Model::ThinDielectric {
            eta: relative_index(properties, "bk7")?,
            reflectance: textures::texture(properties, "specular_reflectance", 1.0, unit, images)?,
            transmittance: textures::texture(
                properties,
                "specular_transmittance",
                1.0,
                unit,
                images,
            )?,
        },
        "plastic" | "roughplastic" => {
            let eta = relative_index(properties, "polypropylene")?;
            if eta == 1.0 {
                return Err(properties.wrong(
                    "int_ior",
                    "equal to ext_ior",
                    "another index: nothing would reflect",
                ));
            }
            let diffuse = textures::texture(properties, "diffuse_reflectance", 0.5, unit, images)?;
            let specular =
                textures::texture(properties, "specular_reflectance", 1.0, unit, images)?;
            let is_nonlinear = properties.boolean("nonlinear", false)?;
            if properties.name() == "plastic" {
                Model::Plastic { diffuse, specular, coat: Coat::new(eta, is_nonlinear) }
            } else {
                let distribution = distribution(properties)?;
                let alpha = properties.float_in("alpha", 0.1, "0 or more", |alpha| alpha >= 0.0)?;
                let coat = Box::new(RoughCoat::new(distribution, alpha as f32, eta, is_nonlinear));
                Model::RoughPlastic { diffuse, specular, coat }
            }
        }
        _ => return Err(properties.unknown_plugin(&KNOWN)),
    })
}

fn conductor(
    properties: &mut Properties<'_>,
    roughness: Option<Roughness>,
    images: &mut ImageCache,
) -> Result<Model, SceneError> {
    let name = properties.string("material")?.unwrap_or("none");
    let given = properties.has("eta") || properties.has("k");
    let (eta, k) = match metals::complex_index(name) {
        Some(_) if given && name != "none" => {
            return Err(properties.wrong("material", "given beside eta or k", "one of them"));
        }
        // What is left out makes a perfect mirror, as does the metal "none".
        _ if given => (
            textures::color(properties, "eta", 0.0, images)?,
            textures::color(properties, "k", 1.0, images)?,
        ),
        Some(index) => index,
        None => {
            let kind = format!("material of {}", properties.title());
            return Err(SceneError::unknown(
                properties.location_of("material"),
                kind,
                name,
                metals::names(),
            ));
        }
    };
    // Of version 0.6: the index of what is around the metal.
    let outside = index(properties, "ext_eta", "vacuum")?;
    let tint =
        textures::texture(properties, "specular_reflectance", 1.0, Range::UnitInterval, images)?;
    let [eta, k]: [Rgb; 2] = [eta / outside, k / outside];
    Ok(Model::Conductor { eta, k, tint, roughness })
}

fn dielectric(
    properties: &mut Properties<'_>,
    roughness: Option<Roughness>,
    images: &mut ImageCache,
) -> Result<Model, SceneError> {
    let eta = relative_index(properties, "bk7")?;
    if roughness.is_some() && eta == 1.0 {
        return Err(properties.wrong(
            "int_ior",
            "equal to ext_ior",
            "another index, or bsdf \"null\"",
        ));
    }
    let unit = Range::UnitInterval;
    Ok(Model::Dielectric {
        eta,
        reflectance: textures::texture(properties, "specular_reflectance", 1.0, unit, images)?,
        transmittance: textures::texture(properties, "specular_transmittance", 1.0, unit, images)?,
        roughness,
    })
}

fn distribution(properties: &mut Properties<'_>) -> Result<Distribution, SceneError> {
    // Visible normals are always sampled.
    properties.ignore(&["sample_visible"]);
    properties
        .choice("distribution", &[("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)])
}

fn roughness(
    properties: &mut Properties<'_>,
    images: &mut ImageCache,
) -> Result<Roughness, SceneError> {
    let distribution = distribution(properties)?;
    let mut alpha = |name| textures::texture(properties, name, 0.1, Range::Positive, images);
    let (both, along, across) = (alpha("alpha")?, alpha("alpha_u")?, alpha("alpha_v")?);
    match ["alpha", "alpha_u", "alpha_v"].map(|name| properties.has(name)) {
        [_, false, false] => Ok(Roughness { distribution, alpha: Box::new([both.clone(), both]) }),
        [false, true, true] => Ok(Roughness { distribution, alpha: Box::new([along, across]) }),
        [true, ..] => {
            Err(properties.wrong("alpha", "given beside alpha_u or alpha_v", "one or the others"))
        }
        [_, true, _] => Err(properties.wrong("alpha_u", "given alone", "alpha_v beside it")),
        [..] => Err(properties.wrong("alpha_v", "given alone", "alpha_u beside it")),
    }
}

/// `int_ior` over `ext_ior`.
fn relative_index(properties: &mut Properties<'_>, inside: &str) -> Result<f32, SceneError> {
    Ok(index(properties, "int_ior", inside)? / index(properties, "ext_ior", "air")?)
}

/// A refractive index as a number or as the name of a medium.
fn index(
    properties: &mut Properties<'_>,
    name: &'static str,
    default: &str,
) -> Result<f32, SceneError> {
    let medium = if properties.is_string(name) { properties.string(name)? } else { None };
    if let Some(medium) = medium {
        return media::index(medium).ok_or_else(|| {
            let kind = format!("{name} of {}", properties.title());
            SceneError::unknown(properties.location_of(name), kind, medium, media::names())
        });
    }
    let default = media::index(default).map_or(1.0, f64::from);
    properties.float_in(name, default, "more than 0", |index| index > 0.0).map(|index| index as f32)
}
