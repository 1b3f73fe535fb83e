//! Structural similarity (Wang, Bovik, Sheikh and Simoncelli 2004) of what is shown.

use ndarray::Axis;

use super::check_colour;
use crate::error::Error;
use crate::layers::Image;
use crate::srgb::encode_f64;

const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// One minus the mean structural similarity of the display values (clamped to `[0, 1]`, sRGB curve), in `[0, 2]`.
///
/// Per channel; Gaussian window of 11×11 pixels and σ 1.5; K₁ 0.01, K₂ 0.03 and L 1 in equation 13 of the paper; the
/// covariances are those of the population; the mean is over the pixels whose window lies inside (a border of 5 is left
/// out) and over the channels. An image lower or narrower than 11 pixels has the largest odd window that fits; `None`
/// below 3 pixels, where there is no structure to compare.
///
/// # Errors
/// [`Error::Shape`] where the shapes differ or have not three channels, [`Error::NonFinite`] where a pixel is NaN or
/// infinite.
pub fn one_minus_ssim(image: &Image, reference: &Image) -> Result<Option<f64>, Error> {
    check_colour(image, reference)?;
    let (_, height, width) = image.dim();
    let smaller = height.min(width).min(WINDOW);
    if smaller < 3 {
        return Ok(None);
    }
    let window = gaussian(smaller - (smaller + 1) % 2);

    let mut dissimilarity = 0.0;
    for (image, reference) in image.axis_iter(Axis(0)).zip(reference.axis_iter(Axis(0))) {
        let x: Vec<f64> = image.iter().map(|&value| encode_f64(value.into())).collect();
        let y: Vec<f64> = reference.iter().map(|&value| encode_f64(value.into())).collect();
        let moment = |product: fn(f64, f64) -> f64| {
            let plane: Vec<f64> = x.iter().zip(&y).map(|(&x, &y)| product(x, y)).collect();
            blur_inside(&plane, width, &window)
        };
        let moments = [
            moment(|x, _| x),
            moment(|_, y| y),
            moment(|x, _| x * x),
            moment(|_, y| y * y),
            moment(|x, y| x * y),
        ];
        let count = moments[0].len();
        let sum: f64 = (0..count)
            .map(|pixel| 1.0 - similarity(moments.each_ref().map(|moment| moment[pixel])))
            .sum();
        dissimilarity += sum / count as f64;
    }
    Ok(Some(dissimilarity / 3.0))
}

/// Equation 13, from the window's means of x, y, x², y² and xy.
fn similarity([x, y, xx, yy, xy]: [f64; 5]) -> f64 {
    let (variance_x, variance_y, covariance) = (xx - x * x, yy - y * y, xy - x * y);
    ((2.0 * x * y + C1) * (2.0 * covariance + C2))
        / ((x * x + y * y + C1) * (variance_x + variance_y + C2))
}

/// A normalised Gaussian of `size` taps.
fn gaussian(size: usize) -> Vec<f64> {
    let radius = (size / 2) as f64;
    let taps: Vec<f64> =
        (0..size).map(|tap| (-0.5 * ((tap as f64 - radius) / SIGMA).powi(2)).exp()).collect();
    let sum: f64 = taps.iter().sum();
    taps.into_iter().map(|tap| tap / sum).collect()
}

/// Blurs a plane of the given width by rows and by columns, keeping the pixels whose window lies inside.
fn blur_inside(plane: &[f64], width: usize, window: &[f64]) -> Vec<f64> {
    let weigh = |sample: &dyn Fn(usize) -> f64| {
        window.iter().enumerate().map(|(tap, weight)| weight * sample(tap)).sum()
    };
    let inner = width - window.len() + 1;
    let rows: Vec<f64> = plane
        .chunks_exact(width)
        .flat_map(|row| (0..inner).map(move |x| weigh(&|tap| row[x + tap])))
        .collect();
    let columns = rows.len() - (window.len() - 1) * inner;
    (0..columns).map(|pixel| weigh(&|tap| rows[pixel + tap * inner])).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::golden_pair;
    use super::*;

    #[test]
    fn ssim_equals_scikit_image() {
        // denoise/golden/make_golden.py: structural_similarity(gaussian_weights=True, sigma=1.5,
        // use_sample_covariance=False, data_range=1, channel_axis=2) of scikit-image 0.26.0.
        for ((height, width), expected) in
            [((32, 40), 0.140_618_561_788), ((11, 11), 0.116_053_585_597)]
        {
            let (image, reference) = golden_pair(height, width);
            let value = one_minus_ssim(&image, &reference).unwrap().unwrap();
            assert!((value - expected).abs() < 1e-6, "{value} instead of {expected}");
        }
    }

    #[test]
    fn a_small_image_has_the_largest_odd_window_that_fits() {
        // By the definition, the window's sums written out: one window of 3×3 in a picture of 3×4.
        let (image, reference) = golden_pair(3, 4);
        let weights = gaussian(3);
        let mut expected = 0.0;
        for channel in 0..3 {
            for left in 0..2 {
                let mut moments = [0.0; 5];
                for (dy, dx) in (0..3).flat_map(|dy| (0..3).map(move |dx| (dy, dx))) {
                    let value = |image: &Image| encode_f64(image[[channel, dy, left + dx]].into());
                    let (x, y) = (value(&image), value(&reference));
                    let weight = weights[dy] * weights[dx];
                    for (moment, product) in moments.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                        *moment += weight * product;
                    }
                }
                expected += (1.0 - similarity(moments)) / 6.0;
            }
        }
        let value = one_minus_ssim(&image, &reference).unwrap().unwrap();
        assert!((value - expected).abs() < 1e-12, "{value} instead of {expected}");
    }

    #[test]
    fn below_three_pixels_there_is_no_structure() {
        let (image, reference) = golden_pair(2, 40);
        assert_eq!(one_minus_ssim(&image, &reference).unwrap(), None);
    }
}
