//! Many views on one picture: would a stranger find them varied?

use super::manifest::{View, views};
use super::{Error, exposure};
use ndarray::s;
use quietlight_denoise::{Image, exr, png};
use std::path::Path;

/// Side of the square that each picture gets, in pixels.
const THUMBNAIL: usize = 128;

/// Writes a PNG of up to `most` complete views of the data set in `folder`, evenly spread over all: of each the first noisy
/// render and, to its right, the reference. Each pair has the exposure of its reference. Returns the ids, row by row.
///
/// # Errors
/// Where a view cannot be read, or the PNG not be written; [`Format`](quietlight_denoise::Error::Format) where there is no
/// view with pictures.
pub fn write(set: &Path, most: usize, output: &Path) -> Result<Vec<String>, Error> {
    let rendered = views(set)?;
    let count = rendered.len().min(most);
    if count == 0 {
        return Err(quietlight_denoise::Error::Format {
            path: set.to_path_buf(),
            found: "no complete view".to_owned(),
            expected: "at least one".to_owned(),
        }
        .into());
    }
    let columns = (count as f64).sqrt().ceil() as usize;
    let rows = count.div_ceil(columns);
    let mut sheet = Image::zeros((3, rows * THUMBNAIL, 2 * columns * THUMBNAIL));
    let chosen = (0..count).map(|place| &rendered[place * rendered.len() / count]);
    let mut ids = Vec::with_capacity(count);
    for (place, view) in chosen.enumerate() {
        let id = &view.identity.id;
        let read = |file: &str| -> Result<Image, Error> {
            let path = View::folder(set, id).join(file);
            let contents = exr::read(&path)?;
            let found = contents.picture.ok_or_else(|| quietlight_denoise::Error::Format {
                path,
                found: "no picture".to_owned(),
                expected: "the channels R, G and B".to_owned(),
            });
            Ok(found?)
        };
        let reference = read(&view.reference.file)?;
        let noisy = match view.noisy.first() {
            Some(noisy) => read(&noisy.file)?,
            None => reference.clone(),
        };
        let gain = exposure::gain(&reference);
        let (top, left) = (place / columns * THUMBNAIL, place % columns * 2 * THUMBNAIL);
        for (picture, left) in [(noisy, left), (reference, left + THUMBNAIL)] {
            let small = thumbnail(&picture, gain as f32);
            let (_, height, width) = small.dim();
            sheet.slice_mut(s![.., top..top + height, left..left + width]).assign(&small);
        }
        ids.push(id.clone());
    }
    png::write(output, &sheet, 0.0)?;
    Ok(ids)
}

/// The picture times `gain`, its highlights compressed, no larger than a thumbnail: blocks of pixels are averaged.
fn thumbnail(picture: &Image, gain: f32) -> Image {
    let (_, height, width) = picture.dim();
    let side = height.max(width).div_ceil(THUMBNAIL);
    Image::from_shape_fn((3, height / side, width / side), |(channel, y, x)| {
        let block = picture.slice(s![channel, y * side..(y + 1) * side, x * side..(x + 1) * side]);
        let shown = block.iter().map(|&light| tone_map(light * gain)).sum::<f32>();
        shown / (side * side) as f32
    })
}

/// The picture, no larger than `side` either way: blocks of pixels are averaged.
pub(crate) fn shrunk(picture: &Image, side: usize) -> Image {
    let (_, height, width) = picture.dim();
    let block = height.max(width).div_ceil(side).max(1);
    Image::from_shape_fn((3, height.div_ceil(block), width.div_ceil(block)), |(channel, y, x)| {
        let rows = y * block..((y + 1) * block).min(height);
        let columns = x * block..((x + 1) * block).min(width);
        picture.slice(s![channel, rows, columns]).mean().unwrap_or(0.0)
    })
}

/// Reinhard et al. 2002, "Photographic Tone Reproduction for Digital Images", equation 4, with 4 as the smallest value shown
/// white: middle grey stays about where it is.
pub(crate) fn tone_map(light: f32) -> f32 {
    const WHITE: f32 = 4.0;
    let light = if light > 0.0 { light.min(1e6) } else { 0.0 };
    (light * (1.0 + light / (WHITE * WHITE)) / (1.0 + light)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tones_rise_from_black_to_white() {
        assert_eq!(tone_map(0.0), 0.0);
        assert_eq!(tone_map(f32::NAN), 0.0);
        assert!((tone_map(4.0) - 1.0).abs() < 1e-6 && tone_map(f32::INFINITY) == 1.0);
        assert!((0..100).all(|i| tone_map(i as f32 * 0.04) < tone_map((i + 1) as f32 * 0.04)));
    }

    #[test]
    fn a_large_picture_is_averaged_and_a_small_one_kept() {
        let large = Image::from_shape_fn((3, 200, 256), |(_, _, x)| (x % 2) as f32);
        let small = thumbnail(&large, 1.0);
        assert_eq!(small.dim(), (3, 100, 128));
        let half = tone_map(1.0) / 2.0;
        assert!(small.iter().all(|&value| (value - half).abs() < 1e-6));
        assert_eq!(thumbnail(&Image::zeros((3, 20, 30)), 1.0).dim(), (3, 20, 30));
    }
}
