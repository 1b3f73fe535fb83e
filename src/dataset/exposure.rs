//! How bright a picture is, so that dark and bright ones can be treated alike.

use quietlight_denoise::{Image, LUMINANCE};

/// Middle grey: the reflectance that looks half as bright as white.
pub(super) const MIDDLE_GREY: f64 = 0.18;

/// Brightness of a linear picture `[3, height, width]`: the square of the mean square root of luminance, which a few very
/// bright pixels hardly change; 0 of a black one.
pub(super) fn brightness(picture: &Image) -> f64 {
    let (_, height, width) = picture.dim();
    let mut total = 0.0;
    for y in 0..height {
        for x in 0..width {
            let luminance: f32 = (0..3).map(|c| LUMINANCE[c] * picture[[c, y, x]]).sum();
            total += f64::from(luminance.max(0.0)).sqrt();
        }
    }
    (total / (height * width).max(1) as f64).powi(2)
}

/// What a picture is multiplied by to be as bright as middle grey; 1 of a black one.
pub(crate) fn gain(picture: &Image) -> f64 {
    let gain = MIDDLE_GREY / brightness(picture);
    if gain.is_finite() && gain > 0.0 { gain } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gain_makes_a_grey_picture_middle_grey() {
        let picture = Image::from_elem((3, 4, 5), 0.02);
        assert!((gain(&picture) - 9.0).abs() < 1e-5);
        // One pixel of 20 is a hundred times as bright: (19/20 + 10/20)² of the brightness.
        let mut spiky = picture.clone();
        for channel in 0..3 {
            spiky[[channel, 2, 2]] = 2.0;
        }
        assert!((brightness(&spiky) / brightness(&picture) - 1.45f64.powi(2)).abs() < 1e-5);
        assert_eq!(gain(&Image::zeros((3, 4, 5))), 1.0);
    }
}
