//! Makes layers safe to compute with, before anything else is done to them.

use std::ops::Add;

use rayon::prelude::*;

use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::window::{median, neighbourhood};

/// Largest magnitude of a value, 1e15: its square over the smallest variance is then a rare overflow to infinity, which
/// is a weight of 0, and its sums over a window are not. Brighter light is clamped to it.
pub const LARGEST_VALUE: f32 = 1e15;

/// Largest variance: that of two values of [`LARGEST_VALUE`].
pub const LARGEST_VARIANCE: f32 = LARGEST_VALUE * LARGEST_VALUE;

/// How many values were replaced, over all channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sanitised {
    /// Radiance that was NaN or infinite, or beyond [`LARGEST_VALUE`].
    pub radiance: usize,
    /// Variances that were NaN, infinite or negative, or beyond [`LARGEST_VARIANCE`].
    pub variance: usize,
    /// Features that were NaN or infinite, or beyond [`LARGEST_VALUE`].
    pub features: usize,
}

impl Add for Sanitised {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            radiance: self.radiance + other.radiance,
            variance: self.variance + other.variance,
            features: self.features + other.features,
        }
    }
}

impl Sanitised {
    /// All of them.
    pub fn total(&self) -> usize {
        self.radiance + self.variance + self.features
    }
}

/// Replaces what no filter can compute with: radiance that is not finite by the median of the finite values among its
/// 3×3 neighbours (0 if there is none), a variance that is not finite or negative by the largest good one among them, a
/// feature by 0. Values too large are clamped. Negative radiance stays.
pub fn sanitise(layers: &mut Layers) -> Sanitised {
    let layers: Vec<(&LayerKind, &mut Layer)> = layers.layers.iter_mut().collect();
    layers
        .into_par_iter()
        .map(|(kind, layer)| sanitise_layer(*kind, layer))
        .reduce(Sanitised::default, Sanitised::add)
}

/// Whether [`sanitise`] would leave the mean and the variance of a layer as they are.
pub(crate) fn is_sane(layer: &Layer) -> bool {
    let in_range = |value: &f32| value.abs() <= LARGEST_VALUE;
    let is_variance = |value: &f32| (0.0..=LARGEST_VARIANCE).contains(value);
    layer.mean.iter().all(in_range) && layer.variance.iter().flatten().all(is_variance)
}

fn sanitise_layer(kind: LayerKind, layer: &mut Layer) -> Sanitised {
    let mut counts = Sanitised::default();
    for mean in [&mut layer.mean].into_iter().chain(layer.halves.iter_mut().flatten()) {
        if kind.is_radiance() {
            counts.radiance += replace(mean, f32::is_finite, |values| {
                median(values.filter(|value| value.is_finite())).unwrap_or(0.0)
            });
            counts.radiance += clamp(mean, LARGEST_VALUE);
        } else {
            counts.features += replace(mean, f32::is_finite, |_| 0.0);
            counts.features += clamp(mean, LARGEST_VALUE);
        }
    }
    if let Some(variance) = &mut layer.variance {
        let good = |value: f32| value.is_finite() && value >= 0.0;
        counts.variance += replace(variance, good, |values| {
            values.filter(|&value| good(value)).fold(0.0, f32::max)
        });
        counts.variance += clamp(variance, LARGEST_VARIANCE);
    }
    counts
}

/// Replaces every bad value by what `mend` makes of its 3×3 neighbours as they were; returns how many there were.
fn replace(
    image: &mut Image,
    good: impl Fn(f32) -> bool,
    mend: impl Fn(&mut dyn Iterator<Item = f32>) -> f32,
) -> usize {
    // Nearly always nothing is bad, which a plain pass over the numbers tells faster.
    if image.iter().all(|&value| good(value)) {
        return 0;
    }
    let bad = image.indexed_iter().filter(|(_, value)| !good(**value));
    let mended: Vec<_> = bad
        .map(|((channel, y, x), _)| {
            ([channel, y, x], mend(&mut neighbourhood(image, channel, y, x)))
        })
        .collect();
    for &(index, value) in &mended {
        image[index] = value;
    }
    mended.len()
}

fn clamp(image: &mut Image, largest: f32) -> usize {
    let mut count = 0;
    for value in image.iter_mut().filter(|value| value.abs() > largest) {
        *value = value.clamp(-largest, largest);
        count += 1;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(kind: LayerKind, mean: [f32; 9], variance: [f32; 9]) -> Layers {
        let image = |values: [f32; 9]| Image::from_shape_vec((1, 3, 3), values.to_vec()).unwrap();
        let layer = Layer { mean: image(mean), variance: Some(image(variance)), halves: None };
        Layers { width: 3, height: 3, layers: [(kind, layer)].into(), ..Default::default() }
    }

    const NAN: f32 = f32::NAN;
    const INF: f32 = f32::INFINITY;

    #[test]
    fn radiance_becomes_the_median_of_its_finite_neighbours() {
        let mut layers =
            layers(LayerKind::Beauty, [1.0, 5.0, 2.0, INF, NAN, 4.0, -3.0, 8.0, 1e30], [1.0; 9]);
        let counts = sanitise(&mut layers);
        // The middle sees 1, 5, 2, 4, −3, 8 and 1e30, whose median is 4; the left one sees 1, 5, −3 and 8.
        let mended = layers.layers[&LayerKind::Beauty].mean.iter().copied().collect::<Vec<_>>();
        assert_eq!(mended, [1.0, 5.0, 2.0, 3.0, 4.0, 4.0, -3.0, 8.0, LARGEST_VALUE]);
        assert_eq!(counts, Sanitised { radiance: 3, variance: 0, features: 0 });
    }

    #[test]
    fn a_variance_becomes_the_largest_good_one_around() {
        let variance = [NAN, 1.0, 2.0, 3.0, -1.0, 4.0, INF, 6.0, 0.0];
        let mut layers = layers(LayerKind::Diffuse, [0.0; 9], variance);
        let counts = sanitise(&mut layers);
        let mended = layers.layers[&LayerKind::Diffuse]
            .variance
            .iter()
            .flatten()
            .copied()
            .collect::<Vec<_>>();
        assert_eq!(mended, [3.0, 1.0, 2.0, 3.0, 6.0, 4.0, 6.0, 6.0, 0.0]);
        assert_eq!(counts, Sanitised { radiance: 0, variance: 3, features: 0 });
    }

    #[test]
    fn a_feature_becomes_zero() {
        let mean = [NAN, 1.0, -INF, 0.5, 2.0, -1.0, 0.0, 1e20, 3.0];
        let mut layers = layers(LayerKind::Depth, mean, [0.0; 9]);
        let counts = sanitise(&mut layers);
        let mended = layers.layers[&LayerKind::Depth].mean.iter().copied().collect::<Vec<_>>();
        assert_eq!(mended, [0.0, 1.0, 0.0, 0.5, 2.0, -1.0, 0.0, LARGEST_VALUE, 3.0]);
        assert_eq!(counts, Sanitised { radiance: 0, variance: 0, features: 3 });
    }

    #[test]
    fn sane_layers_are_those_that_nothing_changes() {
        let numbers = [0.0, 1.0, -3.0, LARGEST_VALUE, -LARGEST_VALUE, 1e30, NAN, INF, -INF];
        for (mean, variance) in numbers.iter().flat_map(|&a| numbers.map(|b| (a, b))) {
            let mut layers = layers(LayerKind::Diffuse, [mean; 9], [variance; 9]);
            let sane = is_sane(&layers.layers[&LayerKind::Diffuse]);
            assert_eq!(sane, sanitise(&mut layers) == Sanitised::default(), "{mean} {variance}");
        }
    }

    #[test]
    fn where_nothing_is_finite_there_is_black() {
        let mut layers = layers(LayerKind::Beauty, [NAN; 9], [NAN; 9]);
        assert_eq!(sanitise(&mut layers).radiance, 9);
        let layer = &layers.layers[&LayerKind::Beauty];
        assert!(
            layer.mean.iter().chain(layer.variance.iter().flatten()).all(|&value| value == 0.0)
        );
    }
}
