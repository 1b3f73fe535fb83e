//! Time of the cross-bilateral filter, all five feature groups present: `cargo bench -p quietlight-denoise`.
//!
//! One tile each, 64×64 pixels with its surroundings; throughput is in pixels, so that 1 megapixel per second and core is
//! 1 Melem/s. Set `RAYON_NUM_THREADS=1` for the time of one core.

use std::collections::BTreeMap;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use quietlight_denoise::bilateral::{Parameters, Prepared};
use quietlight_denoise::{Image, Layer, LayerKind, Layers};

/// Smooth surfaces with an edge in the middle and noise on everything.
fn noisy_layers(width: usize, height: usize) -> Layers {
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0 - 0.5
    };
    let mut layers = BTreeMap::new();
    for kind in LayerKind::ALL {
        let channels = kind.components().len();
        let mut image = |noise: f32| {
            Image::from_shape_fn((channels, height, width), |(c, y, x)| {
                let edge = if 2 * x > width + y { 0.5 } else { 0.0 };
                0.3 + edge + 0.001 * (c + y) as f32 + noise * random()
            })
        };
        let halves = [image(0.2), image(0.2)];
        let mean = (&halves[0] + &halves[1]) * 0.5;
        let variance = Some(Image::from_elem((channels, height, width), 0.2 * 0.2 / 24.0));
        layers.insert(kind, Layer { mean, variance, halves: Some(halves) });
    }
    Layers { width, height, layers, ..Default::default() }
}

fn filter_tile(criterion: &mut Criterion) {
    let prepared = Prepared::new(&noisy_layers(64, 64)).expect("the layers are whole");
    let parameters = Parameters::constant();
    let mut group = criterion.benchmark_group("bilateral");
    group.throughput(Throughput::Elements(64 * 64));
    group.sample_size(20);
    group.bench_function("filter", |bencher| {
        bencher.iter(|| prepared.filter(black_box(&parameters), &|_| ()));
    });
    group.finish();
}

fn prefilter_tile(criterion: &mut Criterion) {
    let layers = noisy_layers(64, 64);
    let mut group = criterion.benchmark_group("bilateral");
    group.throughput(Throughput::Elements(64 * 64));
    group.sample_size(20);
    group.bench_function("prefilter", |bencher| bencher.iter(|| Prepared::new(black_box(&layers))));
    group.finish();
}

criterion_group!(benches, filter_tile, prefilter_tile);
criterion_main!(benches);
