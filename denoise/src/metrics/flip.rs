//! LDR-FLIP: the difference that a viewer sees when flipping between two images (Andersson, Nilsson, Akenine-Möller,
//! Oskarsson, Åström and Fairchild 2020, "FLIP: A Difference Evaluator for Alternating Images").
//!
//! Two pipelines, combined per pixel. Colour: each image is blurred by the contrast sensitivity of the eye in an
//! opponent space, then compared in a perceptually uniform one. Feature: edges and points of the luminance are compared.
//! Constants and sections are those of the paper.

use ndarray::{Array2, Axis, Zip};
use rayon::prelude::*;

use super::check_colour;
use crate::error::Error;
use crate::layers::Image;

/// Pixels per degree of visual angle of the paper's viewer: 0.7 m from a 0.7 m wide display of 3840 pixels.
pub const DEFAULT_PIXELS_PER_DEGREE: f64 = 67.0;

/// Mean over the pixels of [`flip_map`], in `[0, 1]`.
///
/// # Errors
/// Those of [`flip_map`].
pub fn flip(image: &Image, reference: &Image, pixels_per_degree: f64) -> Result<f64, Error> {
    let map = flip_map(image, reference, pixels_per_degree)?;
    Ok(map.iter().map(|&value| f64::from(value)).sum::<f64>() / map.len() as f64)
}

/// Visible difference in each pixel, in `[0, 1]`, `[height, width]`; light is clamped to `[0, 1]`.
///
/// # Errors
/// [`Error::Shape`] where the shapes differ or have not three channels, [`Error::NonFinite`] where a pixel is NaN or
/// infinite, [`Error::Parameter`] where `pixels_per_degree` is not in `[1, 1000]`.
pub fn flip_map(
    image: &Image,
    reference: &Image,
    pixels_per_degree: f64,
) -> Result<Array2<f32>, Error> {
    check_colour(image, reference)?;
    if !(1.0..=1000.0).contains(&pixels_per_degree) {
        return Err(Error::Parameter {
            name: "pixels per degree".into(),
            value: pixels_per_degree.to_string(),
            expected: "1 to 1000",
        });
    }
    let space = Space::new();
    let [image, reference] = [image, reference].map(|image| opponent(image, &space));
    let colour = colour_difference(&image, &reference, pixels_per_degree, &space);
    let feature = feature_difference(&image[0], &reference[0], pixels_per_degree);
    // Section 4.3: a feature that differs lifts the colour difference.
    Ok(Zip::from(&colour)
        .and(&feature)
        .map_collect(|&colour, &feature| colour.powf(1.0 - feature) as f32))
}

type Plane = Array2<f64>;

/// Linear light to CIE XYZ and back, with the white of display white.
struct Space {
    to_xyz: [[f64; 3]; 3],
    from_xyz: [[f64; 3]; 3],
    white: [f64; 3],
}

impl Space {
    /// From the chromaticities of the primaries (ITU-R BT.709) and of the illuminant D65 to five digits.
    fn new() -> Self {
        const RED: [f64; 2] = [0.64, 0.33];
        const GREEN: [f64; 2] = [0.30, 0.60];
        const BLUE: [f64; 2] = [0.15, 0.06];
        const WHITE: [f64; 2] = [0.312_71, 0.329_02];
        let xyz = |[x, y]: [f64; 2]| [x / y, 1.0, (1.0 - x - y) / y];
        let (primaries, white) = ([RED, GREEN, BLUE].map(xyz), xyz(WHITE));
        let unscaled =
            std::array::from_fn(|row| std::array::from_fn(|column| primaries[column][row]));
        // The primaries are scaled so that their sum is white.
        let scale = transform(&invert(&unscaled), white);
        let to_xyz =
            unscaled.map(|row: [f64; 3]| std::array::from_fn(|column| row[column] * scale[column]));
        Self { from_xyz: invert(&to_xyz), to_xyz, white }
    }

    /// `YCxCz`, a linear form of CIELAB (section 4.1), of linear light.
    fn opponent(&self, rgb: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.relative_xyz(rgb);
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    /// Linear light of `YCxCz`.
    fn linear(&self, [y, cx, cz]: [f64; 3]) -> [f64; 3] {
        let y = (y + 16.0) / 116.0;
        let relative = [y + cx / 500.0, y, y - cz / 200.0];
        transform(&self.from_xyz, std::array::from_fn(|axis| relative[axis] * self.white[axis]))
    }

    /// CIELAB of linear light, its chroma scaled by the lightness (Hunt's effect: colours fade in the dark).
    fn hunt_lab(&self, rgb: [f64; 3]) -> [f64; 3] {
        const DELTA: f64 = 6.0 / 29.0;
        let [x, y, z] = self.relative_xyz(rgb).map(|ratio| {
            if ratio > DELTA * DELTA * DELTA {
                ratio.cbrt()
            } else {
                ratio / (3.0 * DELTA * DELTA) + 4.0 / 29.0
            }
        });
        let lightness = 116.0 * y - 16.0;
        [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
    }

    fn relative_xyz(&self, rgb: [f64; 3]) -> [f64; 3] {
        let xyz = transform(&self.to_xyz, rgb);
        std::array::from_fn(|axis| xyz[axis] / self.white[axis])
    }
}

fn transform(matrix: &[[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2])
}

/// Inverse by cofactors.
fn invert(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let cofactor = |row: usize, column: usize| {
        let [r0, r1, c0, c1] = [(row + 1) % 3, (row + 2) % 3, (column + 1) % 3, (column + 2) % 3];
        m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0]
    };
    let determinant: f64 = (0..3).map(|column| m[0][column] * cofactor(0, column)).sum();
    std::array::from_fn(|row| std::array::from_fn(|column| cofactor(column, row) / determinant))
}

/// The three planes of an image in `YCxCz`.
fn opponent(image: &Image, space: &Space) -> [Plane; 3] {
    let (_, height, width) = image.dim();
    let mut planes = [(); 3].map(|()| Plane::zeros((height, width)));
    for y in 0..height {
        for x in 0..width {
            let rgb =
                std::array::from_fn(|channel| f64::from(image[[channel, y, x]]).clamp(0.0, 1.0));
            let value = space.opponent(rgb);
            planes.iter_mut().zip(value).for_each(|(plane, value)| plane[[y, x]] = value);
        }
    }
    planes
}

/// Sections 4.1.1 to 4.1.3: what remains of a colour difference after the eye's blur, in `[0, 1]`.
fn colour_difference(
    image: &[Plane; 3],
    reference: &[Plane; 3],
    pixels_per_degree: f64,
    space: &Space,
) -> Plane {
    let [image, reference] = [image, reference].map(|planes| {
        let [y, cx, cz] = contrast_filters(pixels_per_degree);
        [y.apply(&planes[0]), cx.apply(&planes[1]), cz.apply(&planes[2])]
    });
    const EXPONENT: f64 = 0.7;
    // The largest difference there is, green against blue, maps to 1; the part below 40 % of it to [0, 0.95].
    let largest =
        hyab(space.hunt_lab([0.0, 1.0, 0.0]), space.hunt_lab([0.0, 0.0, 1.0])).powf(EXPONENT);
    const KNEE: f64 = 0.4;
    const KNEE_VALUE: f64 = 0.95;
    Plane::from_shape_fn(image[0].dim(), |pixel| {
        let lab = |planes: &[Plane; 3]| {
            let filtered = space.linear(std::array::from_fn(|channel| planes[channel][pixel]));
            space.hunt_lab(filtered.map(|value| value.clamp(0.0, 1.0)))
        };
        let share = hyab(lab(&image), lab(&reference)).powf(EXPONENT) / largest;
        if share < KNEE {
            share * KNEE_VALUE / KNEE
        } else {
            KNEE_VALUE + (share - KNEE) / (1.0 - KNEE) * (1.0 - KNEE_VALUE)
        }
    })
}

/// Distance that stays right for large differences (Abasi, Amani Tehran and Fairchild 2020).
fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Section 4.2: how much the edges or the points of the luminance differ, in `[0, 1]`.
fn feature_difference(image: &Plane, reference: &Plane, pixels_per_degree: f64) -> Plane {
    let [image, reference] = [image, reference].map(|plane| {
        let luminance = plane.mapv(|y| (y + 16.0) / 116.0);
        feature_filters(pixels_per_degree).map(|filter| {
            let across = filter.along_rows(&luminance);
            let down = filter.along_columns(&luminance);
            Zip::from(&across).and(&down).map_collect(|&x, &y| x.hypot(y))
        })
    });
    let [edges, points] = [0, 1].map(|kind: usize| {
        Zip::from(&image[kind])
            .and(&reference[kind])
            .map_collect(|&image, &reference| (image - reference).abs())
    });
    Zip::from(&edges)
        .and(&points)
        .map_collect(|&edge, &point| (edge.max(point) / 2_f64.sqrt()).sqrt())
}

/// A sum of two separable Gaussians, normalised.
struct ContrastFilter([(f64, Vec<f64>); 2]);

/// The contrast sensitivity of the three opponent channels: `a √(π/b) exp(−π² r²/b)`, `r` in degrees (table 1).
fn contrast_filters(pixels_per_degree: f64) -> [ContrastFilter; 3] {
    const TERMS: [[(f64, f64); 2]; 3] =
        [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];
    const WIDEST: f64 = 0.04;
    let pi2 = std::f64::consts::PI * std::f64::consts::PI;
    let radius = (3.0 * (WIDEST / (2.0 * pi2)).sqrt() * pixels_per_degree).ceil() as i64;
    TERMS.map(|terms| {
        let mut terms = terms.map(|(a, b)| {
            let tap = |offset: i64| (-pi2 * (offset as f64 / pixels_per_degree).powi(2) / b).exp();
            (a * (std::f64::consts::PI / b).sqrt(), (-radius..=radius).map(tap).collect::<Vec<_>>())
        });
        let sum: f64 =
            terms.iter().map(|(scale, taps)| scale * taps.iter().sum::<f64>().powi(2)).sum();
        terms.iter_mut().for_each(|(scale, _)| *scale /= sum);
        ContrastFilter(terms)
    })
}

impl ContrastFilter {
    fn apply(&self, plane: &Plane) -> Plane {
        let mut sum = Plane::zeros(plane.dim());
        for (scale, taps) in self.0.iter().filter(|(scale, _)| *scale != 0.0) {
            sum.scaled_add(*scale, &convolve(&convolve(plane, taps, Axis(1)), taps, Axis(0)));
        }
        sum
    }
}

/// A derivative in one direction and a blur in the other.
struct FeatureFilter {
    derivative: Vec<f64>,
    blur: Vec<f64>,
}

/// First (edges) and second (points) derivatives of a Gaussian as wide as the eye's feature detectors, with positive
/// and negative taps that each sum to one.
fn feature_filters(pixels_per_degree: f64) -> [FeatureFilter; 2] {
    const WIDTH_IN_DEGREES: f64 = 0.082;
    let deviation = 0.5 * WIDTH_IN_DEGREES * pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as i64;
    let offsets = || (-radius..=radius).map(|offset| offset as f64);
    let gauss = |x: f64| (-x * x / (2.0 * deviation * deviation)).exp();
    let blur: Vec<f64> = offsets().map(gauss).collect();
    let sum: f64 = blur.iter().sum();
    let blur: Vec<f64> = blur.into_iter().map(|tap| tap / sum).collect();
    let derivatives: [Vec<f64>; 2] = [
        offsets().map(|x| -x * gauss(x)).collect(),
        offsets().map(|x| (x * x / (deviation * deviation) - 1.0) * gauss(x)).collect(),
    ];
    derivatives.map(|taps| {
        let positive: f64 = taps.iter().filter(|&&tap| tap > 0.0).sum();
        let negative: f64 = -taps.iter().filter(|&&tap| tap < 0.0).sum::<f64>();
        let derivative = taps
            .into_iter()
            .map(|tap| if tap > 0.0 { tap / positive } else { tap / negative })
            .collect();
        FeatureFilter { derivative, blur: blur.clone() }
    })
}

impl FeatureFilter {
    fn along_rows(&self, plane: &Plane) -> Plane {
        convolve(&convolve(plane, &self.blur, Axis(0)), &self.derivative, Axis(1))
    }

    fn along_columns(&self, plane: &Plane) -> Plane {
        convolve(&convolve(plane, &self.blur, Axis(1)), &self.derivative, Axis(0))
    }
}

/// Weighs the neighbours along one axis by `taps`; the pixels at the border are repeated outside.
fn convolve(plane: &Plane, taps: &[f64], axis: Axis) -> Plane {
    let (height, width) = plane.dim();
    let radius = taps.len() / 2;
    let mut result = Plane::zeros((height, width));
    let inside = |index: usize, length: usize| index.saturating_sub(radius).min(length - 1);
    result.axis_iter_mut(Axis(0)).into_par_iter().enumerate().for_each(|(y, mut row)| {
        for (tap, &weight) in taps.iter().enumerate() {
            if axis == Axis(0) {
                row.scaled_add(weight, &plane.row(inside(y + tap, height)));
            } else {
                row.iter_mut()
                    .enumerate()
                    .for_each(|(x, sum)| *sum += weight * plane[[y, inside(x + tap, width)]]);
            }
        }
    });
    result
}

#[cfg(test)]
mod tests {
    use super::super::tests::golden_pair;
    use super::*;

    #[test]
    fn flip_equals_the_authors_evaluator() {
        // denoise/golden/make_golden.py: flip-evaluator 1.7, "LDR", inputsRGB=False, 67 pixels per degree, the map
        // averaged in double precision; the evaluator computes in single precision.
        for ((height, width), mean, corner, middle) in [
            ((32, 40), 0.149_212_998, 0.222_407_9, 0.117_618_2),
            ((11, 11), 0.150_666_827, 0.222_407_9, 0.078_733_9),
        ] {
            let (image, reference) = golden_pair(height, width);
            let map = flip_map(&image, &reference, DEFAULT_PIXELS_PER_DEGREE).unwrap();
            let value = flip(&image, &reference, DEFAULT_PIXELS_PER_DEGREE).unwrap();
            assert!((value - mean).abs() < 2e-5, "{value} instead of {mean}");
            for (found, expected) in [(map[[0, 0]], corner), (map[[height / 2, width / 2]], middle)]
            {
                assert!(
                    (f64::from(found) - expected).abs() < 2e-5,
                    "{found} instead of {expected}"
                );
            }
        }
    }

    #[test]
    fn black_against_white_is_the_largest_difference_of_flat_pictures() {
        let [black, white] = [0.0, 1.0].map(|value| Image::from_elem((3, 8, 8), value));
        let value = flip(&black, &white, DEFAULT_PIXELS_PER_DEGREE).unwrap();
        assert!((0.95..=1.0).contains(&value), "{value}");
    }

    #[test]
    fn the_opponent_space_and_back_is_the_identity() {
        let space = Space::new();
        for rgb in [[1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [0.2, 0.7, 0.05]] {
            let back = space.linear(space.opponent(rgb));
            assert!(rgb.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-12), "{rgb:?} {back:?}");
        }
        let white = space.opponent([1.0; 3]);
        assert!(
            (white[0] - 100.0).abs() < 1e-10 && white[1].abs() < 1e-10 && white[2].abs() < 1e-10,
            "{white:?}"
        );
    }

    #[test]
    fn a_senseless_viewer_is_refused() {
        let (image, reference) = golden_pair(3, 3);
        for pixels_per_degree in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                flip(&image, &reference, pixels_per_degree),
                Err(Error::Parameter { .. })
            ));
        }
    }
}
