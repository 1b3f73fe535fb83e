//! One shading step: a value and its density for a direction to a light, then a sampled direction, as a path tracer
//! takes them at every vertex. `cargo bench --bench shading`

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::{Vec2, Vec3};
use quietlight::bsdf::{Bsdf, Coat, Distribution, Glass, Metal, RoughCoat, metals};
use quietlight::math::Rgb;
use std::hint::black_box;

/// Pairs of directions, more than a branch predictor remembers.
const STEPS: usize = 4096;

struct Step {
    wo: Vec3,
    wi: Vec3,
    lobe: f32,
    u: Vec2,
}

/// Uniform on the upper half sphere.
fn upper(u: Vec2) -> Vec3 {
    let (sin, cos) = (std::f32::consts::TAU * u.x).sin_cos();
    let r = (1.0 - u.y * u.y).sqrt();
    Vec3::new(r * cos, r * sin, u.y)
}

/// The same pairs at every run: multiples of irrational numbers, whose fractions fill the unit cube evenly.
fn steps() -> Vec<Step> {
    let roots = [2.0f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0].map(f64::sqrt);
    (1..=STEPS)
        .map(|i| {
            let [a, b, c, d, lobe, x, y] = roots.map(|root| (root * i as f64).fract() as f32);
            Step {
                wo: upper(Vec2::new(a, b)),
                wi: upper(Vec2::new(c, d)),
                lobe,
                u: Vec2::new(x, y),
            }
        })
        .collect()
}

fn shading(criterion: &mut Criterion) {
    let colour = Rgb::new(0.8, 0.5, 0.1);
    let glass = Glass { eta: 1.5, reflectance: Rgb::WHITE, transmittance: Rgb::WHITE };
    let (eta, k) = metals::complex_index("Cu").expect("copper is known");
    let copper = Metal { eta, k, tint: Rgb::WHITE };
    let coat = RoughCoat::new(Distribution::Ggx, 0.1, 1.5, true);
    let alpha = Vec2::splat(0.2);
    let models = [
        ("diffuse", Bsdf::diffuse(colour)),
        ("rough conductor, GGX", Bsdf::rough_conductor(copper, Distribution::Ggx, alpha)),
        ("rough conductor, Beckmann", Bsdf::rough_conductor(copper, Distribution::Beckmann, alpha)),
        ("dielectric", Bsdf::dielectric(glass)),
        ("rough dielectric, GGX", Bsdf::rough_dielectric(glass, Distribution::Ggx, alpha)),
        ("plastic", Bsdf::plastic(colour, Rgb::WHITE, Coat::new(1.5, true))),
        ("rough plastic, GGX", Bsdf::rough_plastic(colour, Rgb::WHITE, &coat)),
    ];
    let steps = steps();
    let mut group = criterion.benchmark_group("shading");
    group.throughput(Throughput::Elements(STEPS as u64));
    for (name, bsdf) in &models {
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
            bencher.iter(|| steps.iter().for_each(|step| shade(bsdf, step)));
        });
    }
    group.bench_function("mix", |bencher| {
        bencher.iter(|| {
            let models = models.iter().map(|(_, bsdf)| bsdf).cycle();
            steps.iter().zip(models).for_each(|(step, bsdf)| shade(bsdf, step));
        });
    });
    group.finish();
}

fn shade(bsdf: &Bsdf<'_>, step: &Step) {
    if bsdf.has_smooth() {
        black_box(bsdf.eval(step.wo, step.wi));
    }
    black_box(bsdf.sample(step.wo, step.lobe, step.u));
}

criterion_group!(benches, shading);
criterion_main!(benches);
