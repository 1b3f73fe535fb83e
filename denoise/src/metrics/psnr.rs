//! Peak signal-to-noise ratio of what is shown.

use ndarray::Zip;

use super::check_colour;
use crate::error::Error;
use crate::layers::Image;
use crate::srgb::encode_f64;

/// `−10 log₁₀` of the mean squared difference of the display values (clamped to `[0, 1]`, sRGB curve), in decibels;
/// infinite for images that show the same.
///
/// # Errors
/// [`Error::Shape`] where the shapes differ or have not three channels, [`Error::NonFinite`] where a pixel is NaN or
/// infinite.
pub fn psnr(image: &Image, reference: &Image) -> Result<f64, Error> {
    check_colour(image, reference)?;
    let sum = Zip::from(image).and(reference).fold(0.0, |sum, &x, &r| {
        let difference = encode_f64(x.into()) - encode_f64(r.into());
        sum + difference * difference
    });
    Ok(-10.0 * (sum / image.len() as f64).log10())
}

#[cfg(test)]
mod tests {
    use super::super::tests::golden_pair;
    use super::*;

    #[test]
    fn psnr_equals_scikit_image() {
        // denoise/golden/make_golden.py: peak_signal_noise_ratio of scikit-image 0.26.0.
        for ((height, width), expected) in
            [((32, 40), 19.035_141_199_445), ((11, 11), 20.017_931_727_718)]
        {
            let (image, reference) = golden_pair(height, width);
            let value = psnr(&image, &reference).unwrap();
            assert!((value - expected).abs() < 1e-6, "{value} instead of {expected}");
        }
    }
}
