//! The variance of a layer's mean, made fit for the filters.
//!
//! The film gives the variance among samples over their number, which is right for independent samples and too large
//! for stratified ones. The two halves give an estimate that is right for both, but of one degree of freedom. Their
//! ratio, smoothed, corrects the first by the second (Rousselle, Knaus and Zwicker 2012; Kalantari, Bako and Sen 2015).

use ndarray::Zip;
use rayon::prelude::*;

use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::metrics::RELATIVE_L2_EPSILON;
use crate::window::{box_mean, neighbourhood};

/// Radius of the window over which the two estimates are compared, 21×21 pixels: a single pixel's half-buffer variance is
/// off by a factor of √2 of itself, the mean of 441 by 7 %.
const RADIUS: usize = 10;

/// Unbiased variance of the mean of two independent halves, `(A − B)² / 4`, one value per pixel.
pub fn half_buffer_variance([a, b]: &[Image; 2]) -> Image {
    Zip::from(a).and(b).map_collect(|&a, &b| 0.25 * (a - b) * (a - b))
}

/// Corrects the variance of a layer by its halves: `σ² · box(σ²_halves) / box(σ²)`. (The paper's authors add 1e-10 to the
/// denominator, which takes the variance away from pictures darker than about 1e-5; here only 0 is left as it is.)
///
/// A layer with halves and no variance gets the smoothed variance of the halves; one without halves stays as it is.
pub fn correct_variances(layer: &mut Layer) {
    let Some(halves) = &layer.halves else { return };
    let from_halves = box_mean(&half_buffer_variance(halves), RADIUS);
    match &mut layer.variance {
        Some(variance) => {
            let from_samples = box_mean(variance, RADIUS);
            Zip::from(variance).and(&from_halves).and(&from_samples).par_for_each(
                |variance, &halves, &samples| {
                    if samples > 0.0 {
                        *variance *= halves / samples;
                    }
                },
            );
        }
        None => layer.variance = Some(from_halves),
    }
}

/// Variance among the 3×3 neighbours of each pixel (`n − 1` in the denominator), where the samples say nothing.
pub fn spatial_variance(image: &Image) -> Image {
    Image::from_shape_fn(image.dim(), |(channel, y, x)| {
        let values = || neighbourhood(image, channel, y, x).map(f64::from);
        let count = values().count() as f64;
        let mean = values().sum::<f64>() / count;
        let squares: f64 = values().map(|value| (value - mean) * (value - mean)).sum();
        if count > 1.0 { (squares / (count - 1.0)) as f32 } else { 0.0 }
    })
}

/// Corrects the variances of all layers by their halves; to be done once, where samples were added up.
pub fn correct(layers: &mut Layers) {
    layers.layers.par_iter_mut().for_each(|(_, layer)| correct_variances(layer));
}

/// Gives a variance to every layer and pixel that has none: that of the halves, or the spatial one where there are no
/// halves either or where a pixel has a single sample. Returns the layers that got a spatial one.
pub fn complete(layers: &mut Layers) -> Vec<LayerKind> {
    let single =
        layers.samples.as_ref().filter(|samples| samples.iter().any(|&samples| samples < 2.0));
    layers
        .layers
        .par_iter_mut()
        .filter_map(|(&kind, layer)| complete_layer(layer, single).then_some(kind))
        .collect()
}

/// Completes one layer; `single` are the sample counts where some are below 2. Returns whether it got a spatial variance.
fn complete_layer(layer: &mut Layer, single: Option<&Image>) -> bool {
    if layer.variance.is_none() {
        correct_variances(layer);
    }
    match (&mut layer.variance, single) {
        (None, _) => layer.variance = Some(spatial_variance(&layer.mean)),
        (Some(variance), Some(samples)) => {
            let around = spatial_variance(&layer.mean);
            for ((channel, y, x), variance) in variance.indexed_iter_mut() {
                if samples[[0, y, x]] < 2.0 {
                    *variance = around[[channel, y, x]];
                }
            }
        }
        (Some(_), None) => return false,
    }
    true
}

/// Relative L2 of the noise of a layer against its own truth, from its variance: the mean over pixels and channels of
/// `σ² / (x² + ε)`. `None` where there is no variance. The mean stands in for the truth in the denominator, which is good
/// while the noise is small against it.
pub fn estimated_relative_l2(layer: &Layer) -> Option<f64> {
    let variance = layer.variance.as_ref()?;
    let terms = layer.mean.iter().zip(variance).map(|(&mean, &variance)| {
        f64::from(variance) / (f64::from(mean) * f64::from(mean) + RELATIVE_L2_EPSILON)
    });
    Some(terms.sum::<f64>() / layer.mean.len() as f64)
}

/// [`estimated_relative_l2`] of the picture; `None` also where a pixel has a single sample, which tells nothing of its noise.
pub fn estimated_noise(layers: &Layers) -> Option<f64> {
    let is_single = layers.samples.iter().flatten().any(|&samples| samples == 1.0);
    layers.layers.get(&LayerKind::Beauty).filter(|_| !is_single).and_then(estimated_relative_l2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Repeatable uniform numbers in `[0, 1)`.
    fn uniform(state: &mut u64) -> f64 {
        *state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / 9_007_199_254_740_992.0
    }

    /// A layer of 100×100 pixels, each of two halves of `n` samples of a function whose variance is 1/12: independent
    /// or one in each of `n` strata.
    fn layer(n: usize, stratified: bool, seed: u64) -> Layer {
        let mut state = seed;
        let shape = (1, 100, 100);
        let mut halves = [Image::zeros(shape), Image::zeros(shape)];
        let mut variance = Image::zeros(shape);
        for index in ndarray::indices(shape) {
            let mut samples = Vec::new();
            for half in &mut halves {
                let values: Vec<f64> = (0..n)
                    .map(|k| {
                        let u = uniform(&mut state);
                        if stratified { (k as f64 + u) / n as f64 } else { u }
                    })
                    .collect();
                half[index] = (values.iter().sum::<f64>() / n as f64) as f32;
                samples.extend(values);
            }
            let count = samples.len() as f64;
            let mean = samples.iter().sum::<f64>() / count;
            let squares: f64 = samples.iter().map(|value| (value - mean) * (value - mean)).sum();
            variance[index] = (squares / (count * (count - 1.0))) as f32;
        }
        Layer {
            mean: (&halves[0] + &halves[1]) * 0.5,
            variance: Some(variance),
            halves: Some(halves),
        }
    }

    fn average(image: &Image) -> f64 {
        image.iter().map(|&value| f64::from(value)).sum::<f64>() / image.len() as f64
    }

    #[test]
    fn two_halves_of_the_worked_example_differ_by_their_variance() {
        // METHODS N.14.
        let halves = [1.2, 0.8].map(|value| Image::from_elem((1, 1, 1), value));
        assert!((half_buffer_variance(&halves)[[0, 0, 0]] - 0.04).abs() < 1e-7);
    }

    #[test]
    fn the_half_buffer_variance_is_unbiased() {
        // 10⁴ pixels; the mean of 8 + 8 uniform samples has the variance 1/12/16. A variance of one degree of freedom has
        // a standard deviation of √2 of itself (a little less for these short tails), so that the mean of 10⁴ is good to
        // 1.4 %; 4 standard deviations.
        let layer = layer(8, false, 1);
        let expected = 1.0 / 12.0 / 16.0;
        let ratio = average(&half_buffer_variance(layer.halves.as_ref().unwrap())) / expected;
        assert!((ratio - 1.0).abs() < 4.0 * 0.0142, "{ratio}");
    }

    #[test]
    fn the_corrected_variance_is_that_of_the_mean() {
        // Independent samples: 1/12 over their number. Stratified ones: each of n strata has (1/n)²/12, the mean of both
        // halves v = 1/(12 n² · 2 n), which the film takes for (1/12 − v) / (2 n − 1). The bounds are as above; the box's
        // clipped borders weigh a few pixels more, for which a fifth is added.
        for (n, stratified) in [(8, false), (8, true), (2, true)] {
            let mut layer = layer(n, stratified, 5);
            let independent = 1.0 / 12.0 / (2.0 * n as f64);
            let expected = if stratified { independent / (n * n) as f64 } else { independent };
            let before = average(layer.variance.as_ref().unwrap());
            let film = (1.0 / 12.0 - expected) / (2.0 * n as f64 - 1.0);
            assert!(
                (before / film - 1.0).abs() < 0.02,
                "{n} {stratified}: {before} instead of {film}"
            );
            correct_variances(&mut layer);
            let ratio = average(layer.variance.as_ref().unwrap()) / expected;
            assert!((ratio - 1.0).abs() < 1.2 * 4.0 * 0.0142, "{n} {stratified}: {ratio}");
        }
    }

    #[test]
    fn the_correction_equals_its_formula() {
        let mut layer = layer(3, false, 9);
        let before = layer.variance.clone().unwrap();
        let halves = half_buffer_variance(layer.halves.as_ref().unwrap());
        correct_variances(&mut layer);
        let after = layer.variance.unwrap();
        for (y, x) in [(0, 0), (3, 99), (50, 50), (99, 7)] {
            let mean = |image: &Image| {
                let (rows, columns) =
                    (crate::window::clipped(y, 10, 100), crate::window::clipped(x, 10, 100));
                let count = (rows.len() * columns.len()) as f64;
                let pixels = rows.flat_map(|y| columns.clone().map(move |x| (y, x)));
                pixels.map(|(y, x)| f64::from(image[[0, y, x]])).sum::<f64>() / count
            };
            let expected = f64::from(before[[0, y, x]]) * mean(&halves) / mean(&before);
            assert!((f64::from(after[[0, y, x]]) / expected - 1.0).abs() < 1e-5, "({x}, {y})");
        }
    }

    #[test]
    fn the_spatial_variance_is_that_of_nine_neighbours() {
        let image = Image::from_shape_fn((1, 3, 3), |(_, y, x)| (y * 3 + x) as f32);
        let variance = spatial_variance(&image);
        // Nine consecutive integers: (9² − 1) / 12 · 9 / 8; the corner sees 0, 1, 3 and 4.
        assert!((variance[[0, 1, 1]] - 7.5).abs() < 1e-6);
        assert!((variance[[0, 0, 0]] - 10.0 / 3.0).abs() < 1e-6);
        assert_eq!(spatial_variance(&Image::from_elem((1, 1, 1), 4.0))[[0, 0, 0]], 0.0);
    }

    #[test]
    fn pixels_of_one_sample_get_the_spatial_variance() {
        let mean = Image::from_shape_fn((3, 3, 3), |(_, y, x)| (y * 3 + x) as f32);
        let layer =
            Layer { variance: Some(Image::from_elem(mean.dim(), 0.25)), mean, halves: None };
        let mut samples = Image::from_elem((1, 3, 3), 4.0);
        samples[[0, 1, 1]] = 1.0;
        let mut layers =
            Layers { width: 3, height: 3, samples: Some(samples), ..Default::default() };
        layers.layers.insert(LayerKind::Beauty, layer);
        assert_eq!(complete(&mut layers), [LayerKind::Beauty]);
        let variance = layers.layers[&LayerKind::Beauty].variance.as_ref().unwrap();
        assert_eq!((variance[[0, 0, 0]], variance[[2, 1, 1]]), (0.25, 7.5));
    }
}
