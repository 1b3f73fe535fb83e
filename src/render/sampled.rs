//! Samples that belong to pixels: passes over tiles, and the replay of one sample.

use super::{RenderSettings, SamplerKind, Shard};
use crate::film::{Film, Tile};
use crate::geometry::Ray;
use crate::integrator::{Batch, PathSample, PathTracing, Vertex};
use crate::sampler::{IndependentSampler, Sampler, SobolSampler};
use crate::scene::{FilmSettings, Requirements, Scene};
use glam::{DVec3, Vec2};
use quietlight_denoise::Layers;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Mutations for each sample of direct light, where chains leave that to path tracing: a sample costs a tenth of a mutation,
/// and Sobol points are good at it.
const MUTATIONS_PER_DIRECT: u32 = 4;

/// Edges of the paths of light of at most one bounce.
const DIRECT: u32 = 2;

/// Samples that are traced together. Of the Cornell box 1 took 12 % longer, 32 to 512 within 3 % the same.
const BATCH: usize = 128;

/// A film under way that path tracing fills, sample after sample.
#[derive(Debug)]
pub(super) struct Sampled<'a> {
    scene: &'a Scene,
    path_tracing: PathTracing,
    seed: u64,
    sampler: SamplerKind,
    shard: Shard,
    taken: Samples,
}

/// Samples that were taken: numbers 0, 1, 2 ... of each pixel, or every so many of a shard's.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Samples {
    film: Film,
    /// Samples per pixel so far.
    samples: u32,
}

impl Samples {
    /// Samples per pixel so far.
    pub(super) fn samples(&self) -> u32 {
        self.samples
    }

    /// The layers as the samples so far give them; `origin` is what the scene was moved by.
    pub(super) fn layers(&self, origin: DVec3) -> Layers {
        self.film.layers(origin)
    }

    /// Non-finite samples dropped so far.
    pub(super) fn invalid(&self) -> u64 {
        self.film.invalid_samples()
    }

    /// Adds the samples of another shard.
    pub(super) fn merge(&mut self, other: &Self) {
        self.film.merge(&other.film);
        self.samples += other.samples;
    }
}

impl<'a> Sampled<'a> {
    pub(super) fn new(scene: &'a Scene, settings: &RenderSettings) -> Self {
        Self::on(scene, settings, Film::new(scene.film, &Requirements::of(scene)))
    }

    /// A part of the picture alone: first column and row in the whole film, columns and rows.
    pub(super) fn of_crop(scene: &'a Scene, settings: &RenderSettings, crop: [u32; 4]) -> Self {
        let film = FilmSettings { crop, ..scene.film };
        Self::on(scene, settings, Film::new(film, &Requirements::of(scene)))
    }

    fn on(scene: &'a Scene, settings: &RenderSettings, film: Film) -> Self {
        Self {
            scene,
            path_tracing: settings.integrator.features(),
            seed: settings.seed,
            sampler: settings.sampler,
            shard: settings.shard,
            taken: Samples { film, samples: 0 },
        }
    }

    /// Light of at most one bounce alone, for methods that leave it to path tracing; without features.
    pub(super) fn of_direct(scene: &'a Scene, settings: &RenderSettings) -> Self {
        Self {
            path_tracing: PathTracing { max_depth: DIRECT, ..settings.integrator.path_tracing() },
            ..Self::on(scene, settings, Film::of_radiance(scene.film, &Requirements::of(scene)))
        }
    }

    /// The same with the samples that were taken before.
    pub(super) fn with(self, taken: Samples) -> Self {
        Self { taken, ..self }
    }

    /// The layers as the samples so far give them.
    pub(super) fn layers(&self) -> Layers {
        self.taken.layers(self.scene.origin)
    }

    /// What was taken so far.
    pub(super) fn taken(&self) -> &Samples {
        &self.taken
    }

    /// Samples per pixel so far.
    pub(super) fn samples(&self) -> u32 {
        self.taken.samples
    }

    /// Takes the samples that are due after so many mutations per pixel; at least one a half.
    pub(super) fn keep_up(&mut self, mutations: u32) {
        let due = self.shard.share((mutations / MUTATIONS_PER_DIRECT).max(2));
        if self.samples() < due {
            self.pass(due - self.samples(), &|_| {});
        }
    }

    /// Takes so many more samples in each pixel. `progress` is called with the number of samples of the whole picture
    /// so far.
    pub(super) fn pass(&mut self, count: u32, progress: &(dyn Fn(u64) + Sync)) {
        let Self { scene, path_tracing, seed, sampler, ref shard, ref mut taken } = *self;
        let Samples { film, samples } = taken;
        let numbers = Numbers { seed, sampler };
        let (tiles, kept) = film.tiles_mut();
        let pixels: usize = tiles.iter().map(Tile::len).sum();
        let done = AtomicU64::new(u64::from(*samples) * pixels as u64);
        tiles.par_iter_mut().for_each(|tile| {
            let wanted = tile.film_pixels().enumerate().flat_map(|(index, pixel)| {
                (*samples..*samples + count).map(move |own| (index, pixel, shard.number(own)))
            });
            numbers.fill(scene, &path_tracing, tile, kept, wanted);
            let added = tile.len() as u64 * u64::from(count);
            progress(done.fetch_add(added, Ordering::Relaxed) + added);
        });
        *samples += count;
    }
}

impl Sampled<'_> {
    /// Takes other samples in each pixel of the crop window, by its index row after row: those of these numbers.
    pub(super) fn pass_each(&mut self, numbers_of: impl Fn(usize) -> Range<u32> + Sync) {
        let Self { scene, path_tracing, seed, sampler, taken, .. } = self;
        let numbers = Numbers { seed: *seed, sampler: *sampler };
        let width = scene.film.crop[2] as usize;
        let (tiles, kept) = taken.film.tiles_mut();
        tiles.par_iter_mut().for_each(|tile| {
            let places = tile.pixels().zip(tile.film_pixels()).enumerate();
            let wanted = places.flat_map(|(index, ([x, y], pixel))| {
                let samples = numbers_of(y as usize * width + x as usize);
                samples.map(move |sample| (index, pixel, sample))
            });
            numbers.fill(scene, path_tracing, tile, kept, wanted);
        });
    }
}

/// Samples per pixel of the next pass: about `pass` long by the speed of the `samples` so far, and no more than are `left`.
/// The first pass is one sample. Only the clock decides the size, and the size does not change the picture.
pub(super) fn next_pass(samples: u32, left: u32, pass: Duration, elapsed: Duration) -> u32 {
    if samples == 0 {
        return 1.min(left);
    }
    let seconds_each = (elapsed.as_secs_f64() / f64::from(samples)).max(1e-9);
    let wanted = pass.as_secs_f64() / seconds_each;
    // Not more than doubling guards against a first pass that was lucky.
    (wanted as u32).clamp(1, samples.max(1)).min(left)
}

/// Renders one sample again by path tracing and reports each hit of its walk: `pixel` counts from the upper left corner of
/// the whole film.
pub fn replay(
    scene: &Scene,
    settings: &RenderSettings,
    pixel: [u32; 2],
    sample: u32,
    observe: impl FnMut(Vertex),
) -> PathSample {
    let (seed, index) = (settings.seed, pixel[1] * scene.film.width + pixel[0]);
    let path_tracing = settings.integrator.path_tracing();
    match settings.sampler {
        SamplerKind::Sobol => {
            let mut sampler = SobolSampler::new(seed, index, sample);
            let ray = camera_ray(scene, pixel, &mut sampler);
            path_tracing.trace_observed(scene, ray, &mut sampler, observe)
        }
        SamplerKind::Independent => {
            let mut sampler = IndependentSampler::new(seed, index, sample);
            let ray = camera_ray(scene, pixel, &mut sampler);
            path_tracing.trace_observed(scene, ray, &mut sampler, observe)
        }
    }
}

/// Where samples' random numbers come from.
#[derive(Clone, Copy)]
struct Numbers {
    seed: u64,
    sampler: SamplerKind,
}

/// A sample to take: the index of its pixel in the tile, the pixel in the whole film, the sample's number.
type Wanted = (usize, [u32; 2], u32);

impl Numbers {
    /// Takes samples and adds them to the tile, in their order.
    fn fill(
        self,
        scene: &Scene,
        path_tracing: &PathTracing,
        tile: &mut Tile,
        kept: &[usize],
        wanted: impl Iterator<Item = Wanted>,
    ) {
        let Self { seed, sampler } = self;
        match sampler {
            SamplerKind::Sobol => {
                let new = |pixel, sample| SobolSampler::new(seed, pixel, sample);
                fill(scene, path_tracing, tile, kept, wanted, new);
            }
            SamplerKind::Independent => {
                let new = |pixel, sample| IndependentSampler::new(seed, pixel, sample);
                fill(scene, path_tracing, tile, kept, wanted, new);
            }
        }
    }
}

/// Takes samples with the random numbers that `new` gives for a pixel's index in the whole film and a sample's number.
fn fill<S: Sampler>(
    scene: &Scene,
    path_tracing: &PathTracing,
    tile: &mut Tile,
    kept: &[usize],
    mut wanted: impl Iterator<Item = Wanted>,
    new: impl Fn(u32, u32) -> S,
) {
    let mut batch = Batch::new(path_tracing, scene);
    let mut places = Vec::with_capacity(BATCH);
    loop {
        for (index, pixel, sample) in wanted.by_ref().take(BATCH) {
            let mut sampler = new(pixel[1] * scene.film.width + pixel[0], sample);
            let ray = camera_ray(scene, pixel, &mut sampler);
            batch.push(ray, sampler);
            places.push((index, (sample & 1) as usize));
        }
        if batch.is_empty() {
            return;
        }
        for ((index, half), found) in places.drain(..).zip(batch.trace()) {
            tile.add(index, half, &found, kept);
        }
    }
}

/// The ray of a sample through a uniformly chosen point of the pixel (a box filter).
#[inline]
fn camera_ray<S: Sampler>(scene: &Scene, [x, y]: [u32; 2], sampler: &mut S) -> Ray {
    let raster = Vec2::new(x as f32, y as f32) + sampler.next_2d();
    // A pinhole leaves the pair to the first bounce.
    let lens = sampler.next_2d_if(scene.camera.has_lens());
    scene.camera.ray(raster, lens)
}
