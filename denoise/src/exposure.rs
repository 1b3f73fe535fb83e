//! How bright a picture is.

use crate::LUMINANCE;
use crate::layers::Image;
use crate::sanitize::LARGEST_VALUE;

/// A pixel whose root of luminance is so many times the mean says nothing of the others.
const FIREFLY: f64 = 1000.0;

/// Of so many pixels one may be a firefly; or one of all.
const PIXELS_PER_FIREFLY: usize = 10_000;

/// The factor `e = 1/m` that brings a picture near 1, `m = (mean over pixels of √max(0, luminance))²`; 1 for a black one. At
/// most [`LARGEST_VALUE`], so that products stay finite.
///
/// The square root keeps fireflies from deciding. One of 1e30 would all the same, so that a few pixels are left out where their
/// roots are beyond a thousand times the mean of the others'; but not where these are black.
pub(crate) fn exposure(beauty: &Image) -> f32 {
    let (_, height, width) = beauty.dim();
    let planes = LUMINANCE.into_iter().zip(beauty.outer_iter());
    let mut luminance = vec![0.0_f64; height * width];
    for (weight, plane) in planes {
        for (sum, value) in luminance.iter_mut().zip(plane) {
            *sum += f64::from(weight) * f64::from(*value);
        }
    }
    let mut roots: Vec<f64> = luminance.iter().map(|value| value.max(0.0).sqrt()).collect();
    let most = (roots.len() / PIXELS_PER_FIREFLY).max(1).min(roots.len().saturating_sub(1));
    if most > 0 {
        roots.select_nth_unstable_by(most, |a, b| b.total_cmp(a));
    }
    let (brightest, others) = roots.split_at_mut(most);
    brightest.sort_by(f64::total_cmp);
    let (mut sum, mut count) = (others.iter().sum::<f64>(), others.len() as f64);
    for &root in brightest.iter() {
        if sum > 0.0 && root > FIREFLY * sum / count {
            break;
        }
        (sum, count) = (sum + root, count + 1.0);
    }
    let mean = (sum / count).powi(2);
    if mean > 0.0 && mean.is_finite() {
        mean.recip().min(f64::from(LARGEST_VALUE)) as f32
    } else {
        1.0
    }
}

/// Largest exponent of [`binary_exposure`]: its square times the largest variance is not much beyond the numbers of f32.
const LARGEST_EXPONENT: f32 = 40.0;

/// The power of two next to the [`exposure`], by which multiplying changes no digit.
pub(crate) fn binary_exposure(beauty: &Image) -> f32 {
    exposure(beauty).log2().round().clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exposure_is_that_of_the_mean_root() {
        // Grey pixels of luminance 1, 4, 9 and 0: the mean root is 1.5.
        let grey = [1.0, 4.0, 9.0, -5.0];
        let image = Image::from_shape_fn((3, 2, 2), |(_, y, x)| grey[2 * y + x]);
        assert!((exposure(&image) - 1.0 / 2.25).abs() < 1e-6);
        assert_eq!(exposure(&Image::zeros((3, 2, 2))), 1.0);
        assert_eq!(exposure(&Image::from_elem((3, 1, 1), -1.0)), 1.0);
        assert_eq!(exposure(&Image::from_elem((3, 1, 1), 1e-30)), LARGEST_VALUE);
        assert!(exposure(&Image::from_elem((3, 1, 1), 1e30)) > 0.0);
    }

    #[test]
    fn a_firefly_does_not_decide_the_exposure() {
        let even = Image::from_elem((3, 20, 20), 0.25);
        assert!((exposure(&even) - 4.0).abs() < 1e-5);
        let mut hot = even.clone();
        hot.slice_mut(ndarray::s![.., 3, 4]).fill(1e15);
        assert!((exposure(&hot) - 4.0).abs() < 1e-5, "{}", exposure(&hot));
        // Four in a picture of 40 000 pixels.
        let mut large = Image::from_elem((3, 200, 200), 0.25);
        large.slice_mut(ndarray::s![.., 7, 3..7]).fill(1e15);
        assert!((exposure(&large) - 4.0).abs() < 1e-5, "{}", exposure(&large));
        // A lamp of 400 counts, and one that is all there is.
        let mut lamp = even;
        lamp.slice_mut(ndarray::s![.., 3, 4]).fill(400.0);
        let mean: f32 = (399.0 * 0.5 + 20.0) / 400.0;
        assert!((exposure(&lamp) * mean * mean - 1.0).abs() < 1e-5, "{}", exposure(&lamp));
        let mut alone = Image::zeros((3, 20, 20));
        alone[[1, 3, 4]] = 1.0;
        let expected = 1.0 / (0.7152_f32.sqrt() / 400.0).powi(2);
        assert!((exposure(&alone) / expected - 1.0).abs() < 1e-5);
    }

    #[test]
    fn a_picture_a_power_of_two_brighter_has_so_much_less_exposure() {
        let image = Image::from_shape_fn((3, 9, 7), |(c, y, x)| 0.1 * (c + 2 * y + x) as f32);
        for exponent in [-27, -1, 3, 27] {
            let factor = 2f32.powi(exponent);
            assert_eq!(binary_exposure(&(&image * factor)), binary_exposure(&image) / factor);
        }
        assert_eq!(binary_exposure(&Image::zeros((3, 1, 1))), 1.0);
    }
}
