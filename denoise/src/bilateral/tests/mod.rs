//! Proofs of the filter: what all of them use.

mod extremes;
mod filter;
mod fixture;
mod prefilter;
mod secondary;
mod whole;

use super::*;

/// Repeatable noise in `[−0.5, 0.5)`.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 16_777_216.0 - 0.5
    }

    fn image(&mut self, shape: (usize, usize, usize), centre: f32, width: f32) -> Image {
        Image::from_shape_simple_fn(shape, || centre + width * self.next())
    }
}

/// Layers of noise with everything there is; variances vary from pixel to pixel.
fn noisy_layers(width: usize, height: usize, seed: u32) -> Layers {
    let mut noise = Noise(seed);
    let mut layers = Layers { width, height, ..Default::default() };
    for kind in [LayerKind::Beauty].into_iter().chain(GROUPS) {
        let shape = (kind.components().len(), height, width);
        let halves = [noise.image(shape, 0.5, 1.0), noise.image(shape, 0.5, 1.0)];
        let mean = (&halves[0] + &halves[1]) * 0.5;
        let variance = Some(noise.image(shape, 0.05, 0.09));
        layers.layers.insert(kind, Layer { mean, variance, halves: Some(halves) });
    }
    layers
}

/// Parameters without spike removal, which is no part of the filter proper.
fn plain(lambda: [f32; 6]) -> Parameters {
    Parameters {
        lambda: Lambda::Constant(lambda),
        variance_spikes: None,
        result_spikes: None,
        ..Parameters::constant()
    }
}

fn beauty_only(mean: Image, variance: f32) -> Layers {
    let (_, height, width) = mean.dim();
    let variance = Some(Image::from_elem(mean.dim(), variance));
    let layer = Layer { mean, variance, halves: None };
    Layers { width, height, layers: [(LayerKind::Beauty, layer)].into(), ..Default::default() }
}

fn run(layers: &Layers, parameters: &Parameters) -> Image {
    denoise(layers, parameters, &|_| ()).unwrap().image
}

fn assert_close(found: &Image, expected: &Image, tolerance: f32) {
    assert_eq!(found.dim(), expected.dim());
    for ((index, &found), &expected) in found.indexed_iter().zip(expected) {
        assert!(
            (found - expected).abs() <= tolerance,
            "{found} instead of {expected} at {index:?}"
        );
    }
}
