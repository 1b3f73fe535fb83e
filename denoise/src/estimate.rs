//! The error of a denoised picture, without a reference.
//!
//! A render comes in two halves of independent samples, `A = r + a` and `B = r + b` around the true picture `r`, and so do
//! their denoised pictures `D_A` and `D_B`. Each denoised half is judged by the noisy other one, whose noise it has not seen
//! (Rousselle, Knaus and Zwicker 2012, "Adaptive Rendering with Non-Local Means Filtering", compare halves crosswise to
//! their filter's parameters; here it is for the size of the error). Its squared error falls apart into
//!
//! ```text
//! variance  E (D_A − E D_A)² = E ½ (D_A − D_B)²
//! bias²     (E D_A − r)²     = E (D_A − A) (D_B − B)
//! ```
//!
//! both without bias, whatever the denoiser: the products of the second are of independent errors. They need no variance of
//! the noise, and a firefly of one half is multiplied by the other half, which has it not.
//!
//! The picture that is shown is made from all samples. Its variance is about half of that of the halves, and its bias is
//! less, by how much denoising depends on the number of samples: `x − ½ (D_A + D_B)` tells. So its squared error is
//! `k_v V + k_x X + k_b B` with `V = ½ (D_A − D_B)²`, `X = (x − ½ (D_A + D_B))²` and `B` the bias² of the halves; the factors
//! were fitted to renders with known references (`examples/calibration.rs`, which also prints how often the truth lies
//! in the interval). What is known of `B` by itself, with a standard error from the products, is weighed against what
//! variance and bias are like to each other in those renders, by their precisions; noise in which no bias can be seen
//! leaves the latter.
//!
//! Relative errors need `r² + ε` in the denominator. `x² + ε` in its place would make too much of all that is too dark, by
//! orders of magnitude; as `E r² = x² + E (x − r)²` for an unbiased `x`, the squared error itself, smoothed, is added.

use rayon::prelude::*;

use crate::denoiser::Denoiser;
use crate::error::Error;
use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::metrics::RELATIVE_L2_EPSILON;
use crate::window::fold;

/// What the error of a kind of denoiser is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factors {
    /// `k_v`, of the variance of a denoised half; 1/2 for a filter whose weights do not depend on the samples.
    pub variance: f64,
    /// `k_x`, of the squared change from denoised halves to the denoised whole.
    pub change: f64,
    /// `k_b`, of the squared bias of a denoised half; 1 for such a filter.
    pub bias: f64,
    /// Standard deviation of the logarithm of truth over estimate, where products tell the bias exactly.
    pub spread: f64,
}

impl Factors {
    /// Those of the networks, fitted to renders of 182 generated scenes that they were not trained on, of 4 to 256 samples.
    pub const NETWORKS: Self = Self { variance: 0.42, change: 3.4, bias: 0.39, spread: 0.35 };

    /// Those of the bilateral filter, fitted likewise.
    pub const BILATERAL: Self = Self { variance: 0.74, change: 0.65, bias: 0.81, spread: 1.05 };

    /// Those of a denoiser.
    pub fn of(denoiser: &Denoiser) -> Self {
        match denoiser {
            Denoiser::Kpcn { .. } => Self::NETWORKS,
            Denoiser::Bilateral { .. } => Self::BILATERAL,
        }
    }
}

/// The squared bias that goes with a variance of 1, in the median.
const BIAS_OF_VARIANCE: f64 = 1.5;

/// Standard deviations on each side that hold 90 %.
const NINETY_PERCENT: f64 = 1.645;

/// Radii of the windows over which squared errors are smoothed: of those without much noise, and of products of noise.
const NARROW: usize = 2;
const WIDE: usize = 8;

/// How wrong a denoised picture is.
#[derive(Clone, Debug)]
pub struct ErrorEstimate {
    /// Relative L2 against the true picture.
    pub relative_l2: f64,
    /// It lies between these with a probability of about 90 %; `models/README.md` tells how often it did.
    pub interval: [f64; 2],
    /// Smooth map of it, `[1, height, width]`, whose mean is [`Self::relative_l2`].
    pub map: Image,
}

impl ErrorEstimate {
    /// Estimates the error of `denoised`, which `denoiser` made of `layers`, by denoising both halves too: twice the work of
    /// denoising. `None` where the beauty layer has no halves or both are the same, as those of one sample per pixel.
    ///
    /// # Errors
    /// As [`Denoiser::denoise`]; [`Error::Shape`] where the picture has not the size of the layers.
    pub fn of(
        denoised: &Image,
        denoiser: &Denoiser,
        layers: &Layers,
        threads: &rayon::ThreadPool,
        progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Option<Self>, Error> {
        if halves_of(layers).is_none() {
            return Ok(None);
        }
        let denoise = |index: usize| {
            let part = |done: f32| progress(0.5 * (index as f32 + done));
            denoiser.denoise(&half(layers, index), threads, &part)
        };
        let (first, second) = (denoise(0)?.image, denoise(1)?.image);
        threads.install(|| {
            Self::from_halves(denoised, [&first, &second], layers, Factors::of(denoiser))
        })
    }

    /// The same where the denoised halves are there. `None` as for [`Self::of`].
    ///
    /// # Errors
    /// [`Error::Shape`] where a picture has not the size of the layers.
    pub fn from_halves(
        denoised: &Image,
        denoised_halves: [&Image; 2],
        layers: &Layers,
        factors: Factors,
    ) -> Result<Option<Self>, Error> {
        let expected = [3, layers.height, layers.width];
        for (what, image) in [
            ("denoised picture", denoised),
            ("denoised first half", denoised_halves[0]),
            ("denoised second half", denoised_halves[1]),
        ] {
            let (channels, height, width) = image.dim();
            let found = [channels, height, width];
            if found != expected {
                return Err(Error::Shape { what: what.into(), found, expected });
            }
        }
        let found =
            halves_of(layers).map(|noisy| estimate(denoised, denoised_halves, noisy, factors));
        // Of pictures that are not finite nothing can be said.
        Ok(found.filter(|found| found.relative_l2.is_finite()))
    }
}

/// The halves of the beauty layer; `None` where there are none or they do not differ.
fn halves_of(layers: &Layers) -> Option<[&Image; 2]> {
    let [a, b] = layers.layers.get(&LayerKind::Beauty)?.halves.as_ref()?;
    (a != b).then_some([a, b])
}

/// One half of the samples as a picture of its own, with its halves unknown and twice the variance.
pub fn half(layers: &Layers, index: usize) -> Layers {
    let of_half = |layer: &Layer| Layer {
        mean: layer.halves.as_ref().map_or_else(|| layer.mean.clone(), |half| half[index].clone()),
        variance: layer.variance.as_ref().map(|variance| variance * 2.0),
        halves: None,
    };
    Layers {
        width: layers.width,
        height: layers.height,
        layers: layers.layers.iter().map(|(&kind, layer)| (kind, of_half(layer))).collect(),
        samples: layers.samples.as_ref().map(|samples| samples * 0.5),
        ..Layers::default()
    }
}

/// What is summed up of one pixel: over the channels, each over its denominator.
#[derive(Clone, Copy, Debug, Default)]
struct Terms {
    /// `k_v V + k_x X`.
    spread: f64,
    variance: f64,
    bias: f64,
}

fn estimate(
    x: &Image,
    [da, db]: [&Image; 2],
    [a, b]: [&Image; 2],
    factors: Factors,
) -> ErrorEstimate {
    let (channels, height, width) = x.dim();
    let (plane, count) = (height * width, x.len() as f64);
    let [x, da, db, a, b] = [x, da, db, a, b].map(|image| image.as_standard_layout());
    let [x, da, db, a, b] =
        [&x, &da, &db, &a, &b].map(|image| image.as_slice().unwrap_or_default());
    let pixel = |index: usize| {
        let [x, da, db, a, b] = [x, da, db, a, b].map(|image| f64::from(image[index]));
        let (difference, change) = (da - db, x - 0.5 * (da + db));
        Pixel {
            denoised: x,
            variance: 0.5 * difference * difference,
            change: change * change,
            bias: (da - a) * (db - b),
        }
    };
    let mut terms = vec![Terms::default(); plane];
    for channel in 0..channels {
        let pixels: Vec<Pixel> =
            (channel * plane..(channel + 1) * plane).into_par_iter().map(pixel).collect();
        let certain =
            smooth(&pixels, width, NARROW, |p| 2.0 * factors.variance * p.variance + p.change);
        let vague = smooth(&pixels, width, WIDE, |p| p.bias);
        terms.par_iter_mut().zip(&pixels).enumerate().for_each(|(index, (terms, pixel))| {
            let error = certain[index] + vague[index].max(0.0);
            let each =
                1.0 / (pixel.denoised * pixel.denoised + error + RELATIVE_L2_EPSILON) / count;
            terms.spread +=
                each * (factors.variance * pixel.variance + factors.change * pixel.change);
            terms.variance += each * pixel.variance;
            terms.bias += each * pixel.bias;
        });
    }
    let spread: f64 = terms.iter().map(|terms| terms.spread).sum();
    let variance: f64 = terms.iter().map(|terms| terms.variance).sum();
    let (bias, error) = posterior_bias(
        terms.iter().map(|terms| terms.bias).sum(),
        terms.iter().map(|terms| terms.bias * terms.bias).sum(),
        variance,
    );
    let relative_l2 = spread + factors.bias * bias;
    let interval = interval(relative_l2, factors.bias * error, factors.spread);

    // Where the bias is: where its products, smoothed, are positive, and the variance is.
    let products = smooth(&terms, width, WIDE, |terms| terms.bias);
    let place: Vec<f64> = products.iter().map(|&product| product.max(0.0)).collect();
    let total: f64 = place.iter().sum();
    let share = |index: usize| if total > 0.0 { place[index] / total } else { 1.0 / plane as f64 };
    let local: Vec<f64> = (0..plane)
        .map(|index| (terms[index].spread + factors.bias * bias * share(index)) * plane as f64)
        .collect();
    let map = smooth(&local, width, 2 * NARROW, |&value| value);
    let mean = map.iter().sum::<f64>() / plane as f64;
    let scale = if mean > 0.0 { relative_l2 / mean } else { 0.0 };
    let map = map.iter().map(|value| (value * scale) as f32).collect();
    let map = Image::from_shape_vec((1, height, width), map).expect("a value for each pixel");
    ErrorEstimate { relative_l2, interval, map }
}

/// What is known of one channel of a pixel.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    denoised: f64,
    variance: f64,
    change: f64,
    bias: f64,
}

/// Bias² and its standard error, from the sum of the products, the sum of their squares (the variance of the sum, as its mean
/// is small against it) and the variance that it usually goes with. The usual bias is as uncertain as it is large, or as the
/// products show it to be wrong.
fn posterior_bias(sum: f64, squares: f64, variance: f64) -> (f64, f64) {
    let usual = BIAS_OF_VARIANCE * variance;
    let prior = (usual * usual).max(sum * sum - squares);
    let part = if squares > 0.0 { prior / (prior + squares) } else { 1.0 };
    let mean = part * sum + (1.0 - part) * usual;
    (mean.max(0.0), (part * squares).sqrt())
}

/// Between what the truth is with 90 %, for an estimate, its standard error and the spread of the model.
fn interval(estimate: f64, error: f64, spread: f64) -> [f64; 2] {
    if estimate <= 0.0 {
        return [0.0, 0.0];
    }
    let factor = (NINETY_PERCENT * spread.hypot(error / estimate)).exp();
    [estimate / factor, estimate * factor]
}

/// Mean of a number over the window of `radius` around each pixel.
fn smooth<T: Sync>(
    pixels: &[T],
    width: usize,
    radius: usize,
    number: impl Fn(&T) -> f64 + Send + Sync,
) -> Vec<f64> {
    let values: Vec<f64> = pixels.par_iter().map(number).collect();
    let counts = fold(&vec![1.0; values.len()], width, radius, |a: f64, b| a + b);
    let mut sums = fold(&values, width, radius, |a, b| a + b);
    sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum /= count);
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::box_mean;

    const SIZE: usize = 96;
    /// What holds for a filter of fixed weights.
    const LINEAR: Factors = Factors { variance: 0.5, change: 0.0, bias: 1.0, spread: 0.1 };

    /// Repeatable noise of variance 1, the sum of twelve uniform numbers less 6.
    fn noise(seed: u64) -> Image {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        Image::from_shape_simple_fn((3, SIZE, SIZE), || {
            let mut sum = -6.0;
            for _ in 0..12 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 40) as f32 / 16_777_216.0;
            }
            sum
        })
    }

    /// Waves, which a wide filter flattens.
    fn truth() -> Image {
        Image::from_shape_fn((3, SIZE, SIZE), |(channel, y, x)| {
            1.0 + 0.2 * (0.4 * x as f32 + channel as f32).sin() * (0.3 * y as f32).cos()
        })
    }

    /// A render of that truth, its noise of this standard deviation in each half, and what a box filter makes of it.
    fn render(deviation: f32, radius: usize, seed: u64) -> (Layers, Image, [Image; 2]) {
        let halves = [seed, seed + 1].map(|seed| truth() + noise(seed) * deviation);
        let mean = (&halves[0] + &halves[1]) * 0.5;
        let denoised = box_mean(&mean, radius);
        let of_halves = [0, 1].map(|index| box_mean(&halves[index], radius));
        let mut layers = Layers { width: SIZE, height: SIZE, ..Layers::default() };
        let layer = Layer { mean, variance: None, halves: Some(halves) };
        layers.layers.insert(LayerKind::Beauty, layer);
        (layers, denoised, of_halves)
    }

    fn estimated(deviation: f32, radius: usize, seed: u64) -> (ErrorEstimate, f64) {
        let (layers, denoised, [a, b]) = render(deviation, radius, seed);
        let found = ErrorEstimate::from_halves(&denoised, [&a, &b], &layers, LINEAR);
        let true_error = crate::metrics::relative_l2(&denoised, &truth()).unwrap();
        (found.unwrap().unwrap(), true_error)
    }

    #[test]
    fn the_error_of_a_linear_filter_is_found_whether_it_is_noise_or_blur() {
        // Noise rules at radius 1, blur at radius 4. The bias is seen through 27 648 products of noise, each of which has the
        // standard deviation 0.01: 6e-5; three of these, and a tenth for r² in the denominator, which is not quite that of
        // the model where a filter flattens waves.
        for (radius, seed) in [(1, 1), (2, 5), (4, 9)] {
            let (found, expected) = estimated(0.1, radius, seed);
            let difference = (found.relative_l2 - expected).abs();
            assert!(
                difference < 3.0 * 6e-5 + 0.1 * expected,
                "radius {radius}: {} for {expected}",
                found.relative_l2
            );
            assert!(found.interval[0] < expected && expected < found.interval[1], "{found:?}");
        }
    }

    #[test]
    fn the_map_has_the_mean_of_the_estimate_and_is_large_where_the_error_is() {
        let (mut layers, mut denoised, mut halves) = render(0.1, 1, 3);
        // A quarter of the picture is filtered to nothing: an error of 100 %.
        for image in [&mut denoised].into_iter().chain(&mut halves) {
            image.slice_mut(ndarray::s![.., ..SIZE / 2, ..SIZE / 2]).fill(0.0);
        }
        let found =
            ErrorEstimate::from_halves(&denoised, [&halves[0], &halves[1]], &layers, LINEAR);
        let found = found.unwrap().unwrap();
        let mean = f64::from(found.map.sum()) / found.map.len() as f64;
        assert!((mean / found.relative_l2 - 1.0).abs() < 1e-4, "{mean} {}", found.relative_l2);
        let [inside, outside] = [found.map[[0, 20, 20]], found.map[[0, 75, 75]]];
        assert!(inside > 20.0 * outside, "{inside} {outside}");
        layers.error = Some(found.map);
        layers.check_shapes().unwrap();
    }

    #[test]
    fn a_firefly_of_one_half_is_no_error_of_a_filter_that_took_it_out() {
        let (mut layers, denoised, [a, b]) = render(0.1, 1, 3);
        let before = ErrorEstimate::from_halves(&denoised, [&a, &b], &layers, LINEAR);
        let beauty = layers.layers.get_mut(&LayerKind::Beauty).unwrap();
        beauty.halves.as_mut().unwrap()[0][[1, 40, 40]] = 1e3;
        let after = ErrorEstimate::from_halves(&denoised, [&a, &b], &layers, LINEAR);
        let [before, after] = [before, after].map(|found| found.unwrap().unwrap().relative_l2);
        // Its product with the error of the other half, 0.1, is 100 at one of 27 648 values: 3.6e-3 for an error of 6.5e-4,
        // and its square 0.01 of the squared picture. The product is not believed; what stays is the usual bias of a
        // variance of 1.1e-3.
        assert!(after < 4.0 * before, "{before} {after}");
    }

    #[test]
    fn bias_that_noise_hides_is_taken_for_the_usual() {
        // Precisions 1/4 and 1/9: (2/4 + 3/9)/(1/4 + 1/9) and 1/√(1/4 + 1/9).
        let (mean, error) = posterior_bias(2.0, 4.0, 2.0);
        assert!((mean - (0.5 + 3.0 / 9.0) / (0.25 + 1.0 / 9.0)).abs() < 1e-12);
        assert!((error - (0.25_f64 + 1.0 / 9.0).sqrt().recip()).abs() < 1e-12);
        // Products that say more than the usual are believed: 1 − 1/100 of 10, and 1/100 of 0.15.
        assert!((posterior_bias(10.0, 1.0, 0.1).0 - (9.9 + 0.0015)).abs() < 1e-12);
        assert!((posterior_bias(5.0, 1e12, 2.0).0 - 3.0).abs() < 1e-5);
        assert_eq!(posterior_bias(-5.0, 1e-9, 2.0).0, 0.0);
    }

    #[test]
    fn nothing_is_said_where_nothing_is_known() {
        let (mut layers, denoised, [a, b]) = render(0.1, 1, 3);
        let wrong = Image::zeros((3, 1, 1));
        assert!(ErrorEstimate::from_halves(&wrong, [&a, &b], &layers, LINEAR).is_err());
        let of = |layers: &Layers, picture: &Image| {
            ErrorEstimate::from_halves(picture, [&a, &b], layers, LINEAR).unwrap().is_none()
        };
        let mut broken = denoised.clone();
        broken[[0, 3, 3]] = f32::NAN;
        assert!(!of(&layers, &denoised) && of(&layers, &broken));
        let beauty = layers.layers.get_mut(&LayerKind::Beauty).unwrap();
        let same = beauty.mean.clone();
        beauty.halves = Some([same.clone(), same]);
        assert!(of(&layers, &denoised));
        layers.layers.clear();
        assert!(of(&layers, &denoised));
    }

    #[test]
    fn a_half_is_a_picture_of_half_the_samples() {
        let (mut layers, ..) = render(0.1, 1, 3);
        layers.samples = Some(Image::from_elem((1, SIZE, SIZE), 8.0));
        let beauty = layers.layers.get_mut(&LayerKind::Beauty).unwrap();
        beauty.variance = Some(Image::from_elem((3, SIZE, SIZE), 0.005));
        let halves = beauty.halves.clone().unwrap();
        for (index, expected) in halves.iter().enumerate() {
            let one = half(&layers, index);
            let beauty = &one.layers[&LayerKind::Beauty];
            assert_eq!(&beauty.mean, expected);
            assert_eq!(beauty.variance.as_ref().unwrap()[[0, 0, 0]], 0.01);
            assert!(beauty.halves.is_none());
            assert_eq!(one.samples.unwrap()[[0, 0, 0]], 4.0);
        }
    }
}
