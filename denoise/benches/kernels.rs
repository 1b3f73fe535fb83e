//! Time of applying predicted kernels: `cargo bench -p quietlight-denoise --bench kernels`.
//!
//! Random numbers for the networks' outputs on a tile of 256×256 pixels, six channels as in a denoised picture (light and
//! noise), pyramids of networks with 32, 64 and 96 features; throughput is in pixels. Set `RAYON_NUM_THREADS=1` for the
//! time of one core.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use quietlight_denoise::kpcn::{
    PYRAMID_FINEST_OUTPUTS, PYRAMID_OUTPUTS, apply_kernel, apply_pyramid,
};

const SIDE: usize = 256;
const CHANNELS: usize = 6;

/// Numbers in `±range`.
fn random(count: usize, range: f32) -> Vec<f32> {
    let mut state = 1_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 8_388_608.0 - 1.0
    };
    (0..count).map(|_| range * next()).collect()
}

fn kernels(criterion: &mut Criterion) {
    let signal = random(SIDE * CHANNELS * SIDE, 1.0);
    let mut group = criterion.benchmark_group("kernels");
    group.throughput(Throughput::Elements((SIDE * SIDE) as u64));
    group.sample_size(20);

    for features in [32, 64, 96] {
        let image = |channels: usize, halvings: usize, range| {
            random(channels * (SIDE >> halvings) * (SIDE >> halvings), range)
        };
        let mut outputs = vec![image(features, 1, 1.0)];
        outputs.extend(
            PYRAMID_OUTPUTS.into_iter().map(|(channels, halvings)| image(channels, halvings, 4.0)),
        );
        outputs.push(random(PYRAMID_FINEST_OUTPUTS * features, 0.5));
        outputs.push(random(PYRAMID_FINEST_OUTPUTS, 1.0));
        let outputs: Vec<&[f32]> = outputs.iter().map(Vec::as_slice).collect();
        group.bench_function(format!("pyramid/{features}"), |bencher| {
            bencher.iter(|| {
                apply_pyramid::<CHANNELS>(
                    black_box(&outputs),
                    [SIDE, SIDE],
                    [SIDE, SIDE],
                    &[0..SIDE, 0..SIDE],
                    &signal,
                )
            });
        });
    }
    for size in [5, 21] {
        let logits = random(size * size * SIDE * SIDE, 4.0);
        group.bench_function(format!("{size}x{size}"), |bencher| {
            bencher
                .iter(|| apply_kernel::<CHANNELS>(black_box(&logits), [SIDE, SIDE], size, &signal));
        });
    }
    group.finish();
}

criterion_group!(benches, kernels);
criterion_main!(benches);
