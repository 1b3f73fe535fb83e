//! A mutation of a path against a whole sample, in the Cornell box: a mutation must be the cheaper one.
//! `cargo bench --bench mutation`

use criterion::{Criterion, criterion_group, criterion_main};
use glam::Vec2;
use quietlight::integrator::PathTracing;
use quietlight::integrator::bdpt::{Bdpt, Workspace};
use quietlight::mcmc::mutation::{Mutation, MutationSettings};
use quietlight::sampler::{IndependentSampler, Sampler};
use quietlight::scene::{LoadOptions, Scene};
use quietlight::transport::Path;
use std::hint::black_box;

/// Paths as bidirectional path tracing finds them, at most one of a sample.
fn paths(scene: &Scene) -> Vec<Path<'_>> {
    let mut found = Vec::new();
    (0..20_000)
        .filter_map(|index| {
            let mut sampler = IndependentSampler::new(1, index, 0);
            let (raster, lens) = (raster(scene, &mut sampler), sampler.next_2d());
            let mut workspace = Workspace::default();
            let pair = Bdpt::default().walk(scene, raster, lens, &mut sampler, &mut workspace);
            found.clear();
            pair.connect(8, &mut found);
            let one = found.get(index as usize % found.len().max(1))?;
            pair.path(one.s, one.t)
        })
        .collect()
}

/// Anywhere on the film.
fn raster(scene: &Scene, sampler: &mut IndependentSampler) -> Vec2 {
    sampler.next_2d() * Vec2::new(scene.film.width as f32, scene.film.height as f32)
}

fn mutations(criterion: &mut Criterion) {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box/scene.xml");
    let scene = Scene::load(file.as_ref(), &LoadOptions::default()).expect("the scene loads");
    let mut group = criterion.benchmark_group("mutation");
    let mut sampler = IndependentSampler::new(1, 2, 3);

    let (mut workspace, mut found) = (Workspace::default(), Vec::new());
    group.bench_function("bidirectional sample", |bencher| {
        bencher.iter(|| {
            let (raster, lens) = (raster(&scene, &mut sampler), sampler.next_2d());
            found.clear();
            let bdpt = Bdpt::default();
            bdpt.trace(&scene, raster, lens, &mut sampler, &mut workspace, &mut found);
            found.len()
        });
    });
    group.bench_function("path sample", |bencher| {
        bencher.iter(|| {
            let ray = scene.camera.ray(raster(&scene, &mut sampler), sampler.next_2d());
            PathTracing::default().trace(&scene, ray, &mut sampler)
        });
    });

    let settings = MutationSettings::of(&scene);
    let paths = paths(&scene);
    for (mutation, name) in Mutation::ALL.into_iter().zip(Mutation::NAMES) {
        let suitable: Vec<&Path<'_>> =
            paths.iter().filter(|path| mutation.is_suitable(path)).collect();
        if suitable.is_empty() {
            continue;
        }
        let mut index = 0;
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                index = (index + 1) % suitable.len();
                let path = black_box(suitable[index]);
                mutation.propose(&scene, &settings, path, &mut sampler).is_ok()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, mutations);
criterion_main!(benches);
