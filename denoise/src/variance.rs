//! The variance of a layer's mean, made fit for the filters.
//!
//! The film gives the variance among samples over their number, which is right for independent samples and too large
//! for stratified ones. The two halves give an estimate that is right for both, but of one degree of freedom. Their
//! ratio, smoothed, corrects the first by the second (Rousselle, Knaus and Zwicker 2012; Kalantari, Bako and Sen 2015).

use ndarray::Zip;

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
            Zip::from(variance)
                .and(&from_halves)
                .and(&from_samples)
                .par_for_each(|variance, &halves, &samples| {
                    if samples > 0.0 {
                        *variance *= halves / samples;
                    }
                });
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
    layers.layers.values_mut().for_each(correct_variances);
}

/// Gives a variance to every layer and pixel that has none: the spatial one where there are no halves either, or where
/// a pixel has a single sample. Returns the layers that got a spatial one.
pub fn complete(layers: &mut Layers) -> Vec<LayerKind> {
    let mut spatial = Vec::new();
    for (&kind, layer) in &mut layers.layers {
        let single = layers.samples.as_ref().filter(|samples| samples.iter().any(|&samples| samples < 2.0));
        if layer.variance.is_none() {
            correct_variances(layer);
        }
        match (&mut layer.variance, single) {
            (None, _) => {
                layer.variance = Some(spatial_variance(&layer.mean));
                spatial.push(kind);
            }
            (Some(variance), Some(samples)) => {
                let around = spatial_variance(&layer.mean);
                for ((channel, y, x), variance) in variance.indexed_iter_mut() {
                    if samples[[0, y, x]] < 2.0 {
                        *variance = around[[channel, y, x]];
                    }
                }
                spatial.push(kind);
            }
            (Some(_), None) => {}
        }
    }
    spatial
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
