//! Time of the numbers of one path of five bounces: 2 + 2 for the camera, then 1 + 2 + 1 + 2 + 1 a bounce.
//!
//! `cargo bench --bench sampler`

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use quietlight::sampler::{IndependentSampler, Sampler, SobolSampler};
use std::hint::black_box;

const BOUNCES: u64 = 5;

fn path(sampler: &mut impl Sampler) -> f32 {
    let mut sum = sampler.next_2d().element_sum() + sampler.next_2d().element_sum();
    for _ in 0..BOUNCES {
        sum += sampler.next_1d() + sampler.next_2d().element_sum();
        sum += sampler.next_1d() + sampler.next_2d().element_sum() + sampler.next_1d();
    }
    sum
}

fn samplers(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sampler");
    group.throughput(Throughput::Elements(4 + 7 * BOUNCES));
    let mut sample = 0;
    group.bench_function("independent", |bencher| {
        bencher.iter(|| {
            sample += 1;
            path(&mut IndependentSampler::new(1, black_box(12_345), sample))
        });
    });
    group.bench_function("sobol", |bencher| {
        bencher.iter(|| {
            sample += 1;
            path(&mut SobolSampler::new(1, black_box(12_345), sample))
        });
    });
    group.finish();
}

criterion_group!(benches, samplers);
criterion_main!(benches);
