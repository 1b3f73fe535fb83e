//! How far an image is from its reference.
//!
//! Every metric takes the image first and the reference second, both linear Rec. 709 of one shape. A pixel that is NaN
//! or infinite in either makes the metric an error: left out, it would make the number better than it is.

mod flip;
mod psnr;
mod relative_l2;
mod ssim;

pub use flip::{DEFAULT_PIXELS_PER_DEGREE, flip, flip_map};
pub use psnr::psnr;
pub use relative_l2::{RELATIVE_L2_EPSILON, relative_l2, relative_l2_map};
pub use ssim::one_minus_ssim;

use crate::error::Error;
use crate::layers::Image;

/// Checks that a metric of `image` against `reference` means something.
fn check(image: &Image, reference: &Image) -> Result<(), Error> {
    let shape = |image: &Image| <[usize; 3]>::from(image.dim());
    let [channels, height, width] = shape(reference);
    if shape(image) != shape(reference) {
        return Err(Error::Shape {
            what: "image".into(),
            found: shape(image),
            expected: shape(reference),
        });
    }
    if channels * height * width == 0 {
        let expected = [channels.max(1), height.max(1), width.max(1)];
        return Err(Error::Shape { what: "image".into(), found: shape(image), expected });
    }
    for (what, image) in [("image", image), ("reference", reference)] {
        if let Some(((channel, y, x), &value)) =
            image.indexed_iter().find(|(_, value)| !value.is_finite())
        {
            return Err(Error::NonFinite { what: what.into(), channel, x, y, value });
        }
    }
    Ok(())
}

/// Like [`check`], for the metrics of what people see, which are defined for three channels.
fn check_colour(image: &Image, reference: &Image) -> Result<(), Error> {
    check(image, reference)?;
    let (channels, height, width) = image.dim();
    if channels == 3 {
        return Ok(());
    }
    Err(Error::Shape {
        what: "image".into(),
        found: [channels, height, width],
        expected: [3, height, width],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Image and reference of `denoise/golden/make_golden.py`.
    pub(super) fn golden_pair(height: usize, width: usize) -> (Image, Image) {
        let reference = Image::from_shape_fn((3, height, width), |(c, y, x)| {
            let wave = 0.5 + 0.5 * (0.3 * ((c + 1) * x) as f64 + 0.2 * y as f64).sin();
            let tile = ((x / 5 + y / 7) % 2) as f64 * (0.1 + 0.15 * c as f64);
            (0.8 * wave * wave + tile) as f32
        });
        let image = Image::from_shape_fn((3, height, width), |(c, y, x)| {
            let noise = ((73 * x + 151 * y + 57 * c + 3 * x * y) % 101) as f64 / 101.0 - 0.5;
            (f64::from(reference[[c, y, x]]) + 0.3 * noise) as f32
        });
        (image, reference)
    }

    type Metric = fn(&Image, &Image) -> Result<f64, Error>;
    const METRICS: [(&str, Metric); 4] = [
        ("relative L2", relative_l2),
        ("1 - SSIM", |image, reference| {
            one_minus_ssim(image, reference).map(|value| value.unwrap_or(0.0))
        }),
        ("PSNR", psnr),
        ("FLIP", |image, reference| flip(image, reference, DEFAULT_PIXELS_PER_DEGREE)),
    ];

    #[test]
    fn an_image_equals_itself() {
        let (image, _) = golden_pair(13, 12);
        let values = METRICS.map(|(_, metric)| metric(&image, &image).unwrap());
        assert_eq!(values, [0.0, 0.0, f64::INFINITY, 0.0]);
    }

    #[test]
    fn a_pixel_that_is_not_finite_is_an_error_in_either_image() {
        let (image, reference) = golden_pair(12, 12);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut broken = image.clone();
            broken[[2, 3, 4]] = bad;
            for (name, metric) in METRICS {
                for result in [metric(&broken, &reference), metric(&reference, &broken)] {
                    assert!(
                        matches!(result, Err(Error::NonFinite { channel: 2, x: 4, y: 3, .. })),
                        "{name} of {bad} gave {result:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn shapes_must_match_and_hold_a_pixel() {
        let (image, _) = golden_pair(12, 12);
        let (other, _) = golden_pair(12, 11);
        let empty = Image::zeros((3, 0, 4));
        for (name, metric) in METRICS {
            assert!(matches!(metric(&image, &other), Err(Error::Shape { .. })), "{name}");
            assert!(matches!(metric(&empty, &empty), Err(Error::Shape { .. })), "{name}");
        }
    }

    #[test]
    fn the_smallest_images_have_finite_metrics() {
        for (height, width) in [(1, 1), (1, 9), (2, 2)] {
            let (image, reference) = golden_pair(height, width);
            for (name, metric) in METRICS {
                assert!(
                    metric(&image, &reference).unwrap().is_finite(),
                    "{name} of {width}x{height}"
                );
            }
        }
    }
}
