//! Rays per second, one thread: coherent rays from a camera, incoherent ones after a diffuse bounce, and shadow rays, among
//! 62 thousand and a million triangles; and the build of the larger tree.
//!
//! `cargo bench --bench traversal`; a time is that of the whole batch, whose length is the throughput's unit.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use quietlight::geometry::{Geometry, Mesh, Part, Ray};
use std::f32::consts::{PI, TAU};
use std::hint::black_box;

/// `SplitMix64` (Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number Generators").
struct Numbers(u64);

impl Numbers {
    /// In `[0, 1)`.
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// In the cube from -1 to 1.
    fn cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

/// A bumpy sphere of `4·rings²` triangles.
fn bumpy(rings: u32, radius: f32, center: Vec3, bump: f32) -> Mesh {
    let around = 2 * rings;
    let mut directions = vec![Vec3::Z, Vec3::NEG_Z];
    for ring in 1..rings {
        let (sin_theta, cos_theta) = (PI * ring as f32 / rings as f32).sin_cos();
        directions.extend((0..around).map(|step| {
            let (sin_phi, cos_phi) = (TAU * step as f32 / around as f32).sin_cos();
            Vec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
        }));
    }
    let height = |d: &Vec3| {
        (d.x * 23.0).sin() * (d.y * 19.0).sin() + 0.3 * (d.z * 71.0).sin() * (d.x * 67.0).cos()
    };
    let at = |ring: u32, step: u32| 2 + (ring - 1) * around + step % around;
    let mut triangles = Vec::new();
    for step in 0..around {
        triangles.push([0, at(1, step), at(1, step + 1)]);
        for ring in 1..rings - 1 {
            triangles.push([at(ring, step), at(ring + 1, step), at(ring + 1, step + 1)]);
            triangles.push([at(ring, step), at(ring + 1, step + 1), at(ring, step + 1)]);
        }
        triangles.push([at(rings - 1, step), 1, at(rings - 1, step + 1)]);
    }
    let positions =
        directions.iter().map(|d| center + *d * radius * (1.0 + bump * height(d))).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// 27 bumpy spheres, some through each other, inside a large one.
fn scene(rings: u32) -> Vec<Part> {
    let mut numbers = Numbers(7);
    let mut parts = vec![Part::Mesh(bumpy(rings, 6.0, Vec3::ZERO, 0.05))];
    for index in 0..27u32 {
        let cell = Vec3::new((index % 3) as f32, (index / 3 % 3) as f32, (index / 9) as f32);
        let center = cell * 2.0 - 2.0 + numbers.cube() * 0.4;
        parts.push(Part::Mesh(bumpy(rings, 0.5 + 0.6 * numbers.unit(), center, 0.15)));
    }
    parts
}

/// Through 256² pixels, in tiles of 16² as a renderer takes them.
fn primary_rays(numbers: &mut Numbers) -> Vec<Ray> {
    let eye = Vec3::new(4.9, 0.3, 0.5);
    let pixel = |index: u32| {
        let (tile, inside) = (index / 256, index % 256);
        let x = (tile % 16 * 16 + inside % 16) as f32 / 128.0 - 1.0;
        let y = (tile / 16 * 16 + inside / 16) as f32 / 128.0 - 1.0;
        Vec3::new(-1.0, 0.7 * x, 0.7 * y)
    };
    (0..256 * 256)
        .map(|index| Ray::new(eye, (pixel(index) + numbers.cube() * 0.002).normalize()))
        .collect()
}

/// From where `rays` end, in cosine-distributed directions.
fn bounced_rays(geometry: &Geometry, rays: &[Ray], numbers: &mut Numbers) -> Vec<Ray> {
    let mut bounce = |ray: &Ray| {
        let at = geometry.interaction(ray, &geometry.intersect(ray)?);
        let normal = if at.normal.dot(ray.direction) > 0.0 { -at.normal } else { at.normal };
        let (z, turn) = (2.0 * numbers.unit() - 1.0, TAU * numbers.unit());
        let on_sphere = Vec3::new(turn.cos(), turn.sin(), 0.0) * (1.0 - z * z).sqrt() + Vec3::Z * z;
        Some(at.spawn((normal + on_sphere * 0.999).normalize()))
    };
    rays.iter().filter_map(&mut bounce).collect()
}

fn traversal(criterion: &mut Criterion) {
    for (name, rings) in [("62k", 24), ("1M", 96)] {
        let geometry = Geometry::new(scene(rings));
        let mut numbers = Numbers(3);
        let primary = primary_rays(&mut numbers);
        let bounced = bounced_rays(&geometry, &primary, &mut numbers);
        let mut to_light = |ray: &Ray| {
            let light = Vec3::new(0.5, 3.0, 4.0) + numbers.cube() * 0.3;
            Ray { t_max: 0.9999, ..Ray::new(ray.origin, light - ray.origin) }
        };
        let shadow: Vec<Ray> = bounced.iter().map(&mut to_light).collect();
        let mut group = criterion.benchmark_group(name);
        group.sample_size(20);
        for (name, rays) in [("primary", &primary), ("bounce", &bounced)] {
            group.throughput(Throughput::Elements(rays.len() as u64));
            group.bench_function(name, |bencher| {
                bencher.iter(|| {
                    rays.iter().filter(|ray| geometry.intersect(black_box(ray)).is_some()).count()
                });
            });
        }
        group.throughput(Throughput::Elements(shadow.len() as u64));
        group.bench_function("shadow", |bencher| {
            bencher.iter(|| shadow.iter().filter(|ray| geometry.occluded(black_box(ray))).count());
        });
    }
}

fn build(criterion: &mut Criterion) {
    let parts = scene(96);
    let mut group = criterion.benchmark_group("1M");
    group.sample_size(10);
    group.bench_function("build", |bencher| {
        bencher.iter_with_large_drop(|| Geometry::new(black_box(parts.clone())));
    });
}

criterion_group!(benches, traversal, build);
criterion_main!(benches);
