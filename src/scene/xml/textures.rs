//! Textures: constants, images, checkerboards.

use super::document::{Document, PluginId};
use super::properties::{Properties, TextureValue, rgb};
use crate::math::Rgb;
use crate::scene::error::SceneError;
use crate::texture::{Bitmap, Checkerboard, Filter, ImageCache, Texture, Wrap};
use glam::{Affine2, DMat4, DVec3, Mat2};

/// The texture plugins known; `uniform` and `srgb` (or `rgb`) are spectra in Mitsuba.
const KNOWN: [&str; 5] = ["bitmap", "checkerboard", "rgb", "srgb", "uniform"];

/// What values a texture may have, as far as the scene file itself says them; texels of images are not looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Range {
    /// Reflectances, opacities, weights.
    UnitInterval,
    /// Radiances, roughnesses, heights.
    Positive,
}

impl Range {
    fn contains(self, value: DVec3) -> bool {
        value.min_element() >= 0.0 && (self == Self::Positive || value.max_element() <= 1.0)
    }

    fn expected(self) -> &'static str {
        match self {
            Self::UnitInterval => "values from 0 to 1",
            Self::Positive => "no negative value",
        }
    }
}

/// The texture that a property holds, or the `default` everywhere.
///
/// # Errors
/// A value out of range, an unknown plugin, a property that does not fit, or an image that cannot be read.
pub(super) fn texture(
    properties: &mut Properties<'_>,
    name: &'static str,
    default: f32,
    range: Range,
    images: &mut ImageCache,
) -> Result<Texture, SceneError> {
    let value = match properties.texture(name)? {
        None => return Ok(default.into()),
        Some(TextureValue::Plugin(id)) => return plugin(properties.document, id, range, images),
        Some(TextureValue::Number(value)) => DVec3::splat(value),
        Some(TextureValue::Color(color)) => color,
    };
    if range.contains(value) {
        Ok(rgb(value).into())
    } else {
        Err(properties.wrong(name, value.to_string(), range.expected()))
    }
}

/// The texture that a plugin means.
///
/// # Errors
/// As [`texture`].
pub(super) fn plugin(
    document: &Document,
    id: PluginId,
    range: Range,
    images: &mut ImageCache,
) -> Result<Texture, SceneError> {
    let mut properties = Properties::new(document, id);
    let texture = match properties.name() {
        "bitmap" => bitmap(&mut properties, images)?,
        "checkerboard" => {
            let first = texture(&mut properties, "color0", 0.4, range, images)?;
            let second = texture(&mut properties, "color1", 0.2, range, images)?;
            Texture::Checkerboard(Checkerboard {
                textures: Box::new([first, second]),
                to_uv: to_uv(&mut properties)?,
            })
        }
        "uniform" => texture(&mut properties, "value", 1.0, range, images)?,
        // Version 2 calls the value `color`, version 3 too in some places.
        "rgb" | "srgb" if properties.has("color") => {
            texture(&mut properties, "color", 1.0, range, images)?
        }
        "rgb" | "srgb" => texture(&mut properties, "value", 1.0, range, images)?,
        _ => return Err(properties.unknown_plugin(&KNOWN)),
    };
    properties.finish()?;
    Ok(texture)
}

fn bitmap(properties: &mut Properties<'_>, images: &mut ImageCache) -> Result<Texture, SceneError> {
    let path = properties.file()?;
    // Version 0.6 filtered over an area by default; over many samples a pixel the result is the same.
    let filters = [
        ("bilinear", Filter::Bilinear),
        ("nearest", Filter::Nearest),
        ("ewa", Filter::Bilinear),
        ("trilinear", Filter::Bilinear),
    ];
    let filter = properties.choice("filter_type", &filters)?;
    let wraps = [("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)];
    let wrap = properties.choice("wrap_mode", &wraps)?;
    let mut raw = properties.boolean("raw", false)?;
    // Version 0.6 said with a gamma of 1 what `raw` says; -1 left the choice to the file.
    match properties.float("gamma")? {
        None | Some(-1.0) => {}
        Some(1.0) => raw = true,
        Some(gamma) => return Err(properties.wrong("gamma", gamma.to_string(), "1 or -1")),
    }
    let to_uv = to_uv(properties)?;
    // How Mitsuba stores and filters texels.
    properties.ignore(&["accel", "cache", "format", "max_anisotropy"]);
    let image = images
        .load(&path, raw)
        .map_err(|error| SceneError::asset(properties.location_of("filename"), error))?;
    Ok(Texture::Bitmap(Bitmap { image, wrap, filter, to_uv }))
}

/// The transform of surface coordinates: what the matrix does in the plane.
fn to_uv(properties: &mut Properties<'_>) -> Result<Affine2, SceneError> {
    let DMat4 { x_axis, y_axis, w_axis, .. } = properties.transform("to_uv")?;
    let plane = |column: glam::DVec4| column.truncate().truncate().as_vec2();
    Ok(Affine2::from_mat2_translation(Mat2::from_cols(plane(x_axis), plane(y_axis)), plane(w_axis)))
}

/// A colour that may not vary over the surface.
///
/// # Errors
/// A texture, or a negative value.
pub(super) fn color(
    properties: &mut Properties<'_>,
    name: &'static str,
    default: f32,
    images: &mut ImageCache,
) -> Result<Rgb, SceneError> {
    let texture = texture(properties, name, default, Range::Positive, images)?;
    let varying = || properties.wrong(name, "a texture", "the same value everywhere");
    texture.constant().ok_or_else(varying)
}
