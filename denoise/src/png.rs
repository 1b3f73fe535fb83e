//! A picture to look at: linear light through an exposure and the sRGB curve into 8 bits.

use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use ndarray::Array2;

use crate::error::Error;
use crate::layers::Image;
use crate::srgb;

/// Writes `picture`, linear Rec. 709 of shape `[3, height, width]`, as an 8-bit sRGB PNG, whole or not at all.
///
/// Light is multiplied by `2^exposure`, clamped to `[0, 1]` and encoded; NaN shows as black.
///
/// # Errors
/// [`Error::Shape`] where the picture has not three channels; [`Error::Io`] and [`Error::Format`] where the file cannot
/// be written.
pub fn write(path: &Path, picture: &Image, exposure: f32) -> Result<(), Error> {
    let (channels, height, width) = picture.dim();
    if channels != 3 {
        let expected = [3, height, width];
        return Err(Error::Shape {
            what: "picture".into(),
            found: [channels, height, width],
            expected,
        });
    }
    encode(path, &tone_map(picture, exposure), width, height)
}

/// The bytes of a PNG as [`write()`] makes it, packed as small as may be.
///
/// # Errors
/// [`Error::Shape`] where the picture has not three channels; [`Error::Format`] where a PNG cannot hold it.
pub fn to_bytes(picture: &Image, exposure: f32) -> Result<Vec<u8>, Error> {
    let (channels, height, width) = picture.dim();
    if channels != 3 {
        let (found, expected) = ([channels, height, width], [3, height, width]);
        return Err(Error::Shape { what: "picture".into(), found, expected });
    }
    pack(&tone_map(picture, exposure), width, height)
}

/// Five colours of the map "magma" of matplotlib, evenly spaced: brightness grows evenly with the error.
pub const MAGMA: [[f32; 3]; 5] = [
    [0.0, 0.0, 4.0],
    [81.0, 18.0, 124.0],
    [183.0, 55.0, 121.0],
    [252.0, 137.0, 97.0],
    [252.0, 253.0, 191.0],
];

/// Writes an error of each pixel, `[height, width]`, in false colour from black (0) to pale yellow (1 and more).
///
/// # Errors
/// [`Error::Io`] and [`Error::Format`] where the file cannot be written.
pub fn write_map(path: &Path, errors: &Array2<f32>) -> Result<(), Error> {
    let bytes: Vec<u8> = errors.iter().flat_map(|&error| false_colour(error)).collect();
    let (height, width) = errors.dim();
    encode(path, &bytes, width, height)
}

/// The bytes of a PNG as [`write_map`] makes it, packed as small as may be.
///
/// # Errors
/// [`Error::Format`] where a PNG cannot hold it.
pub fn map_to_bytes(errors: &Array2<f32>) -> Result<Vec<u8>, Error> {
    let bytes: Vec<u8> = errors.iter().flat_map(|&error| false_colour(error)).collect();
    let (height, width) = errors.dim();
    pack(&bytes, width, height)
}

/// The colour of an error; NaN is black.
fn false_colour(error: f32) -> [u8; 3] {
    let error = if error.is_nan() { 0.0 } else { error.clamp(0.0, 1.0) };
    let place = error * (MAGMA.len() - 1) as f32;
    let below = (place as usize).min(MAGMA.len() - 2);
    let part = place - below as f32;
    std::array::from_fn(|c| {
        (MAGMA[below][c] * (1.0 - part) + MAGMA[below + 1][c] * part).round() as u8
    })
}

/// Writes bytes, row after row of red, green and blue, as a PNG.
fn encode(path: &Path, bytes: &[u8], width: usize, height: usize) -> Result<(), Error> {
    let (width, height) = (width as u32, height as u32);
    crate::atomic::write(path, |file| {
        PngEncoder::new(file).write_image(bytes, width, height, ExtendedColorType::Rgb8).map_err(
            |error| match error {
                image::ImageError::IoError(source) => Error::Io { path: path.into(), source },
                error => Error::Format {
                    path: path.into(),
                    found: format!("a picture of {width}x{height} ({error})"),
                    expected: "one that a PNG can hold".into(),
                },
            },
        )
    })
}

/// A PNG in memory.
fn pack(bytes: &[u8], width: usize, height: usize) -> Result<Vec<u8>, Error> {
    let mut packed = Vec::new();
    PngEncoder::new_with_quality(&mut packed, CompressionType::Best, FilterType::Adaptive)
        .write_image(bytes, width as u32, height as u32, ExtendedColorType::Rgb8)
        .map_err(|error| Error::Format {
            path: "a picture in memory".into(),
            found: format!("{width}x{height} ({error})"),
            expected: "what a PNG can hold".into(),
        })?;
    Ok(packed)
}

/// The bytes of the PNG: row after row, red, green, blue.
fn tone_map(picture: &Image, exposure: f32) -> Vec<u8> {
    let (_, height, width) = picture.dim();
    let gain = exposure.exp2();
    let mut bytes = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            bytes.extend((0..3).map(|channel| {
                let display = srgb::encode(picture[[channel, y, x]] * gain);
                (display * 255.0).round() as u8
            }));
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_png_reads_back_as_the_light_it_shows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        let picture =
            Image::from_shape_fn((3, 2, 5), |(c, y, x)| (c + 3 * y + 2 * x) as f32 / 14.0);
        write(&path, &picture, 0.0).unwrap();
        let read = crate::picture::read_picture(&path).unwrap();
        assert_eq!(read.dim(), picture.dim());
        // In memory, packed otherwise, it is the same.
        std::fs::write(&path, to_bytes(&picture, 0.0).unwrap()).unwrap();
        assert_eq!(crate::picture::read_picture(&path).unwrap(), read);
        for (index, &value) in picture.indexed_iter() {
            // Half a step of 1/255 in display values.
            assert!(
                (srgb::encode(read[index]) - srgb::encode(value)).abs() <= 0.5 / 255.0 + 1e-6,
                "{index:?}"
            );
        }
    }

    #[test]
    fn extreme_light_is_clamped_and_exposure_doubles() {
        let picture =
            Image::from_shape_vec((3, 1, 2), vec![f32::NAN, 1e30, -1.0, f32::INFINITY, 0.25, 0.0])
                .unwrap();
        assert_eq!(tone_map(&picture, 0.0), [0, 0, 137, 255, 255, 0]);
        assert_eq!(tone_map(&picture, 2.0)[2], 255);
    }
}
