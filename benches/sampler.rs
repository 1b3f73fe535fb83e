//! Time of the numbers of one path of five bounces (2 + 2 for the camera, then 1 + 2 + 1 + 2 + 1 a bounce), and of one
//! direction to an emitter.
//!
//! `cargo bench --bench sampler`

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, Vec2, Vec3};
use quietlight::emitter::{BoundingSphere, Emitter, Emitters, Environment, EnvironmentMap};
use quietlight::geometry::{Mesh, Part};
use quietlight::math::Rgb;
use quietlight::sampler::{IndependentSampler, Sampler, SobolSampler};
use quietlight::texture::Texture;
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

fn emitters(criterion: &mut Criterion) {
    let corners = [Vec3::Z, Vec3::Z + Vec3::Y, Vec3::Z + Vec3::X + Vec3::Y, Vec3::Z + Vec3::X];
    let mesh = Mesh {
        positions: corners.to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let area = |part| Emitter::Area { part, radiance: Texture::Constant(Rgb::WHITE) };
    let sphere = Part::Sphere { center: Vec3::Z * 3.0, radius: 1.0, flip_normals: false };
    let texels =
        (0..512 * 256u32).map(|i| Rgb::splat((i.wrapping_mul(0x9e37_79b9) >> 20) as f32)).collect();
    let map = EnvironmentMap::new([512, 256], texels, 1.0, DMat3::IDENTITY).expect("the size fits");
    let mut group = criterion.benchmark_group("emitter");
    for (name, emitter) in [
        ("rectangle", area(Part::Mesh(mesh))),
        ("sphere", area(sphere)),
        ("map of 512 × 256", Emitter::Environment(Environment::from(map))),
    ] {
        let emitters =
            Emitters::new(vec![emitter], BoundingSphere { center: Vec3::ZERO, radius: 10.0 });
        let mut sampler = IndependentSampler::new(1, 2, 3);
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let u: Vec2 = sampler.next_2d();
                emitters.sample(black_box(Vec3::ZERO), u.y, u)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, samplers, emitters);
criterion_main!(benches);
