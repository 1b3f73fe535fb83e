//! Relative L2, the error that the denoisers are trained and judged by.

use ndarray::{Array2, Zip};

use super::check;
use crate::error::Error;
use crate::layers::Image;

/// Added to the squared reference, so that black pixels count and do not rule: an error of 0.1 in the dark weighs as
/// much as one of 100 % in the light (Rousselle, Knaus and Zwicker 2011; the value used by Bako et al. 2017).
pub const RELATIVE_L2_EPSILON: f64 = 0.01;

/// Mean over pixels and channels of `(x − r)² / (r² + 0.01)`, `r` the reference; in double precision.
///
/// # Errors
/// [`Error::Shape`] where the shapes differ or are empty, [`Error::NonFinite`] where a pixel is NaN or infinite.
pub fn relative_l2(image: &Image, reference: &Image) -> Result<f64, Error> {
    check(image, reference)?;
    let sum = Zip::from(image).and(reference).fold(0.0, |sum, &x, &r| sum + error(x, r));
    Ok(sum / image.len() as f64)
}

/// The terms of [`relative_l2`], averaged over the channels: `[height, width]`, whose mean is the metric.
///
/// # Errors
/// Those of [`relative_l2`].
pub fn relative_l2_map(image: &Image, reference: &Image) -> Result<Array2<f32>, Error> {
    check(image, reference)?;
    let (channels, height, width) = image.dim();
    Ok(Array2::from_shape_fn((height, width), |(y, x)| {
        let sum: f64 = (0..channels).map(|c| error(image[[c, y, x]], reference[[c, y, x]])).sum();
        (sum / channels as f64) as f32
    }))
}

fn error(x: f32, r: f32) -> f64 {
    let (x, r) = (f64::from(x), f64::from(r));
    (x - r) * (x - r) / (r * r + RELATIVE_L2_EPSILON)
}

#[cfg(test)]
mod tests {
    use super::super::tests::golden_pair;
    use super::*;

    #[test]
    fn relative_l2_equals_numpy() {
        // denoise/golden/make_golden.py, numpy 2.4.6.
        for ((height, width), expected) in GOLDEN {
            let (image, reference) = golden_pair(height, width);
            let value = relative_l2(&image, &reference).unwrap();
            assert!((value - expected).abs() < 1e-6, "{value} instead of {expected}");
            let map = relative_l2_map(&image, &reference).unwrap();
            let mean = map.iter().map(|&value| f64::from(value)).sum::<f64>() / map.len() as f64;
            assert!((mean - expected).abs() < 1e-6, "{mean} instead of {expected}");
        }
    }

    const GOLDEN: [((usize, usize), f64); 2] =
        [((32, 40), 0.184_315_906_966), ((11, 11), 0.135_424_240_895)];

    #[test]
    fn the_reference_is_the_one_in_the_denominator() {
        let [one, three] = [1.0, 3.0].map(|value| Image::from_elem((1, 1, 1), value));
        assert!((relative_l2(&three, &one).unwrap() - 4.0 / 1.01).abs() < 1e-12);
        assert!((relative_l2(&one, &three).unwrap() - 4.0 / 9.01).abs() < 1e-12);
    }

    #[test]
    fn huge_light_stays_finite() {
        let [zero, huge] = [0.0, 1e38].map(|value| Image::from_elem((3, 1, 1), value));
        assert!((relative_l2(&huge, &zero).unwrap() / 1e78 - 1.0).abs() < 1e-6);
    }
}
