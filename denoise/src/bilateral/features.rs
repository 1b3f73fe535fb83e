//! The feature groups of the filter: what the surfaces seen look like, on comparable scales.

use ndarray::{Axis, Zip};

use crate::layers::{Image, Layer, LayerKind, Layers};

/// The layers that the filter compares, in the order of its parameters λ₁ to λ₅.
pub const GROUPS: [LayerKind; 5] = [
    LayerKind::Position,
    LayerKind::Normal,
    LayerKind::Albedo,
    LayerKind::Texture2,
    LayerKind::Visibility,
];

/// One group: means and variances of the mean, `[channels, height, width]` each, in the standard layout.
#[derive(Clone, Debug)]
pub(super) struct Feature {
    /// Index of the group in [`GROUPS`].
    pub(super) group: usize,
    pub(super) mean: Image,
    pub(super) variance: Image,
}

/// The groups that `layers` has, position normalised. Every layer must have its variance.
pub(super) fn features(layers: &Layers) -> Vec<Feature> {
    let group = |(group, kind): (usize, LayerKind)| {
        let Layer { mean, variance, .. } = layers.layers.get(&kind)?;
        let standard = |image: &Image| image.as_standard_layout().into_owned();
        let (mut mean, mut variance) = (standard(mean), standard(variance.as_ref()?));
        if kind == LayerKind::Position {
            normalise_position(&mut mean, &mut variance);
        }
        Some(Feature { group, mean, variance })
    };
    GROUPS.into_iter().enumerate().filter_map(group).collect()
}

/// Maps positions into `[0, 1]³` by the box of what is seen, the same scale on all three axes: its longest side
/// becomes 1. Pixels that see nothing (position exactly 0) do not count for the box and are clamped to it.
fn normalise_position(mean: &mut Image, variance: &mut Image) {
    let seen: Vec<bool> = mean
        .lanes(Axis(0))
        .into_iter()
        .map(|point| point.iter().any(|&value| value != 0.0))
        .collect();
    let bounds = |plane: ndarray::ArrayView2<'_, f32>| {
        let values = plane
            .into_iter()
            .zip(&seen)
            .filter(|(_, seen)| **seen)
            .map(|(&value, _)| f64::from(value));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        })
    };
    let bounds: Vec<(f64, f64)> = mean.axis_iter(Axis(0)).map(bounds).collect();
    let side = bounds.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
    // A box that is a point (or empty) says nothing: all distances are 0.
    let scale = if side > 0.0 { 1.0 / side } else { 0.0 };
    for ((mut mean, mut variance), (low, _)) in
        mean.axis_iter_mut(Axis(0)).zip(variance.axis_iter_mut(Axis(0))).zip(bounds)
    {
        Zip::from(&mut mean).and(&mut variance).for_each(|mean, variance| {
            let relative = if scale > 0.0 { (f64::from(*mean) - low) * scale } else { 0.0 };
            *mean = relative.clamp(0.0, 1.0) as f32;
            *variance = (f64::from(*variance) * scale * scale) as f32;
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_lie_in_the_unit_box_wherever_the_scene_is() {
        for (offset, size) in [(0.5, 1.0), (1e4, 20.0), (-3e6, 1e5), (1e-5, 1e-5)] {
            let mut mean = Image::from_shape_fn((3, 4, 5), |(axis, y, x)| {
                let seen = if (y, x) == (0, 0) { 0.0 } else { 1.0 };
                seen * (offset + size * [x as f32 / 4.0, y as f32 / 6.0, 0.25][axis])
            });
            let mut variance = Image::from_elem((3, 4, 5), 0.01 * size * size);
            normalise_position(&mut mean, &mut variance);
            assert!(mean.iter().all(|value| (0.0..=1.0).contains(value)), "{offset}");
            // Two pixels a quarter of the longest side apart; the f32 coordinates themselves carry 6e-8 of the offset.
            let error = 4.0 * f32::EPSILON * (1.0 + (offset / size).abs());
            assert!(((mean[[0, 2, 3]] - mean[[0, 2, 2]]) - 0.25).abs() < error, "{offset}");
            assert!((variance[[1, 1, 1]] - 0.01).abs() < 1e-6, "{offset}");
        }
    }

    #[test]
    fn a_scene_of_one_point_has_no_distances() {
        let mut mean = Image::from_elem((3, 2, 2), 7.0);
        let mut variance = Image::from_elem((3, 2, 2), 1.0);
        normalise_position(&mut mean, &mut variance);
        assert!(mean.iter().chain(&variance).all(|&value| value == 0.0));
    }
}
