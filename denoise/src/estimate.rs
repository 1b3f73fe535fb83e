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
//! Noise that neighbours share, as that of Markov chains, looks like texture to a denoiser, which keeps more of it the longer
//! it reaches; the estimate grows with its correlation (`estimate/correlation.rs`).
//!
//! Relative errors need `r² + ε` in the denominator. `x² + ε` in its place would make too much of all that is too dark, by
//! orders of magnitude; as `E r² = x² + E (x − r)²` for an unbiased `x`, the squared error itself, smoothed, is added.

mod correlation;

use rayon::prelude::*;

use crate::denoiser::Denoiser;
use crate::error::Error;
use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::metrics::RELATIVE_L2_EPSILON;
use crate::window::fold;
use correlation::correlation;

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
    /// By how much that logarithm, and its standard deviation, grow with the correlation of the noise, from 0 to 1.
    pub correlated: [f64; 2],
}

impl Factors {
    /// Those of the networks, fitted to renders of 182 generated scenes that they were not trained on, of 4 to 256 samples;
    /// what they keep of correlated noise, to renders of seven of our own scenes by Markov chains.
    pub const NETWORKS: Self =
        Self { variance: 0.42, change: 3.4, bias: 0.39, spread: 0.35, correlated: [4.0, 0.3] };

    /// Those of the bilateral filter, fitted likewise.
    pub const BILATERAL: Self =
        Self { variance: 0.74, change: 0.65, bias: 0.81, spread: 1.05, correlated: [0.0, 0.0] };

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
            let half = half(layers, index, |kind| denoiser.uses(kind));
            denoiser.denoise(&half, threads, &part)
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

/// One half of the samples as a picture of its own, with its halves unknown and twice the variance; of the layers that are
/// wanted.
pub fn half(layers: &Layers, index: usize, is_wanted: impl Fn(LayerKind) -> bool) -> Layers {
    let of_half = |layer: &Layer| Layer {
        mean: layer.halves.as_ref().map_or_else(|| layer.mean.clone(), |half| half[index].clone()),
        variance: layer.variance.as_ref().map(|variance| variance * 2.0),
        halves: None,
    };
    Layers {
        width: layers.width,
        height: layers.height,
        layers: (layers.layers.iter())
            .filter(|(kind, _)| is_wanted(**kind))
            .map(|(&kind, layer)| (kind, of_half(layer)))
            .collect(),
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
    let correlation = correlation([a, b], width, plane);
    let [by_correlation, spread_by_correlation] = factors.correlated.map(|by| by * correlation);
    let excess = by_correlation.exp();
    let relative_l2 = excess * (spread + factors.bias * bias);
    let interval = interval(
        relative_l2,
        excess * factors.bias * error,
        factors.spread.hypot(spread_by_correlation),
    );

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
mod tests;
