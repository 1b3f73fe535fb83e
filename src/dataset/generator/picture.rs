//! Textures and environment maps as image files.

use super::error::Error;
use super::pattern::Field;
use glam::DVec3;
use image::{ExtendedColorType, ImageEncoder};
use std::path::Path;

/// Writes a field as colours: `colour` maps each value to linear components, which are stored by the sRGB curve.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write_colours(
    path: &Path,
    field: &Field,
    colour: impl Fn(f64) -> DVec3,
) -> Result<(), Error> {
    // Fields have few more distinct values than 8 bits hold.
    let table: Vec<[u8; 3]> =
        (0..=1023).map(|i| colour(f64::from(i) / 1023.0).to_array().map(encode)).collect();
    let texels = field.values.iter().flat_map(|value| table[(value * 1023.0 + 0.5) as usize]);
    write_png(path, field.size, &texels.collect::<Vec<u8>>(), ExtendedColorType::Rgb8)
}

/// Writes a field as numbers from `low` (value 0) to `high` (value 1), both in `[0, 1]`, to be read raw.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write_numbers(path: &Path, field: &Field, low: f64, high: f64) -> Result<(), Error> {
    let byte = |value: &f32| quantise(low + (high - low) * f64::from(*value));
    let texels: Vec<u8> = field.values.iter().map(byte).collect();
    write_png(path, field.size, &texels, ExtendedColorType::L8)
}

/// Writes the normals of a relief whose heights are the field times `height` (in units of its side), each component stored
/// as `(n + 1) / 2`, to be read raw.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write_normals(path: &Path, field: &Field, height: f64) -> Result<(), Error> {
    let size = field.size as i64;
    let mut texels = Vec::with_capacity(3 * field.values.len());
    for (row, column) in (0..size * size).map(|i| (i / size, i % size)) {
        // Central differences; rows run downward but v upward.
        let slope = |dx: i64, dy: i64| {
            let (after, before) =
                (field.at(column + dx, row + dy), field.at(column - dx, row - dy));
            f64::from(after - before) * 0.5 * size as f64 * height
        };
        let normal = DVec3::new(-slope(1, 0), slope(0, 1), 1.0).normalize();
        texels.extend(normal.to_array().map(|component| quantise(0.5 + 0.5 * component)));
    }
    write_png(path, field.size, &texels, ExtendedColorType::Rgb8)
}

/// Writes radiance, row by row from the top, as an EXR file of three floats a texel.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write_radiance(path: &Path, width: usize, texels: &[DVec3]) -> Result<(), Error> {
    use exr::prelude::{Image, SpecificChannels, WritableImage};
    let height = texels.len() / width;
    let channels = SpecificChannels::rgb(|position: exr::math::Vec2<usize>| {
        let texel = texels[position.y() * width + position.x()].as_vec3();
        (texel.x, texel.y, texel.z)
    });
    let image = Image::from_channels((width, height), channels);
    image.write().non_parallel().to_file(path).map_err(|error| Error::image(path, error))
}

fn write_png(
    path: &Path,
    size: usize,
    texels: &[u8],
    kind: ExtendedColorType,
) -> Result<(), Error> {
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(texels, size as u32, size as u32, kind)
        .map_err(|error| Error::image(path, error))?;
    std::fs::write(path, bytes).map_err(|source| Error::io(path, source))
}

/// The inverse of the sRGB transfer curve, IEC 61966-2-1, as a byte.
fn encode(linear: f64) -> u8 {
    let encoded =
        if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    quantise(encoded)
}

fn quantise(value: f64) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}
