//! Who runs where: passes over tiles, threads, progress, the replay of one sample.

use crate::film::{Film, Tile};
use crate::integrator::{PathSample, PathTracing, Vertex};
use crate::sampler::{IndependentSampler, Sampler, SobolSampler};
use crate::scene::{Requirements, Scene};
use glam::Vec2;
use quietlight_denoise::{Layers, variance};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Where random numbers come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SamplerKind {
    /// Owen-scrambled Sobol points: lower error at the same count.
    #[default]
    Sobol,
    /// Independent numbers.
    Independent,
}

/// How to render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderSettings {
    /// Samples per pixel.
    pub samples: u32,
    /// The same seed gives the same bits, at any number of threads.
    pub seed: u64,
    /// Where random numbers come from.
    pub sampler: SamplerKind,
    /// What a sample estimates.
    pub integrator: PathTracing,
    /// Length of a pass: how often progress is whole and a stop is heeded.
    pub pass: Duration,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            samples: 64,
            seed: 0,
            sampler: SamplerKind::default(),
            integrator: PathTracing::default(),
            pass: Duration::from_secs(1),
        }
    }
}

/// A picture with its layers, and what it took.
#[derive(Debug)]
pub struct Rendered {
    /// All layers; the halves have corrected the variances of means of stratified samples.
    pub layers: Layers,
    /// Samples per pixel taken; fewer than asked for when stopped.
    pub samples: u32,
    /// Non-finite samples dropped.
    pub invalid_samples: u64,
    /// Wall time.
    pub elapsed: Duration,
}

/// Renders `scene` on the threads of the current rayon pool.
///
/// `progress` is called from the workers with the number of camera samples done so far, out of
/// `samples × pixels`. When `stop` becomes true the pass under way is finished and what there is comes back.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    progress: &(dyn Fn(u64) + Sync),
    stop: &AtomicBool,
) -> Rendered {
    let mut rendering = Rendering::new(scene, settings);
    rendering.advance(settings.samples, progress, stop);
    rendering.finish()
}

/// A render that can go on: samples are taken in their order, so that how many at a time does not change the picture.
#[derive(Debug)]
pub struct Rendering<'a> {
    scene: &'a Scene,
    settings: RenderSettings,
    film: Film,
    samples: u32,
    elapsed: Duration,
}

impl<'a> Rendering<'a> {
    /// A render without samples; `settings.samples` has no meaning here.
    pub fn new(scene: &'a Scene, settings: &RenderSettings) -> Self {
        let film = Film::new(scene.film, &Requirements::of(scene));
        Self { scene, settings: *settings, film, samples: 0, elapsed: Duration::ZERO }
    }

    /// Samples per pixel taken so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Goes on until there are `samples` per pixel, on the threads of the current rayon pool; `progress` and `stop` are as
    /// for [`render`].
    pub fn advance(&mut self, samples: u32, progress: &(dyn Fn(u64) + Sync), stop: &AtomicBool) {
        let start = Instant::now();
        let before = self.elapsed;
        let Self { scene, settings, film, .. } = self;
        let (tiles, kept) = film.tiles_mut();
        let pixels: usize = tiles.iter().map(Tile::len).sum();
        let done = AtomicU64::new(u64::from(self.samples) * pixels as u64);
        while self.samples < samples {
            let first = self.samples;
            let pass = next_pass(first, samples - first, settings.pass, before + start.elapsed());
            tiles.par_iter_mut().for_each(|tile| {
                for (index, pixel) in tile.film_pixels().enumerate() {
                    for sample in first..first + pass {
                        let found = sample_pixel(scene, settings, pixel, sample, |_| {});
                        tile.add(index, (sample & 1) as usize, &found, kept);
                    }
                }
                let added = tile.len() as u64 * u64::from(pass);
                progress(done.fetch_add(added, Ordering::Relaxed) + added);
            });
            self.samples += pass;
            if stop.load(Ordering::Relaxed) {
                break;
            }
        }
        self.elapsed = before + start.elapsed();
    }

    /// The layers as the samples so far give them, with corrected variances.
    pub fn layers(&self) -> Layers {
        let mut layers = self.film.layers(self.scene.origin);
        // The variance of independent samples is right, and of more degrees of freedom than that of the halves.
        if self.settings.sampler == SamplerKind::Sobol {
            variance::correct(&mut layers);
        }
        layers
    }

    /// The picture.
    pub fn finish(self) -> Rendered {
        let start = Instant::now();
        Rendered {
            layers: self.layers(),
            samples: self.samples,
            invalid_samples: self.film.invalid_samples(),
            elapsed: self.elapsed + start.elapsed(),
        }
    }
}

/// Samples per pixel of the next pass: about `pass` long by the speed of the `samples` so far, and no more than are `left`.
/// The first pass is one sample. Only the clock decides the size, and the size does not change the picture.
fn next_pass(samples: u32, left: u32, pass: Duration, elapsed: Duration) -> u32 {
    if samples == 0 {
        return 1.min(left);
    }
    let seconds_each = (elapsed.as_secs_f64() / f64::from(samples)).max(1e-9);
    let wanted = pass.as_secs_f64() / seconds_each;
    // Not more than doubling guards against a first pass that was lucky.
    (wanted as u32).clamp(1, samples.max(1)).min(left)
}

/// Renders one sample again and reports each hit of its walk: `pixel` counts from the upper left corner of the whole film.
pub fn replay(
    scene: &Scene,
    settings: &RenderSettings,
    pixel: [u32; 2],
    sample: u32,
    observe: impl FnMut(Vertex),
) -> PathSample {
    sample_pixel(scene, settings, pixel, sample, observe)
}

/// One camera sample through a uniformly chosen point of the pixel (a box filter).
#[inline]
fn sample_pixel(
    scene: &Scene,
    settings: &RenderSettings,
    [x, y]: [u32; 2],
    sample: u32,
    observe: impl FnMut(Vertex),
) -> PathSample {
    let index = y * scene.film.width + x;
    match settings.sampler {
        SamplerKind::Sobol => walk(
            scene,
            settings,
            [x, y],
            &mut SobolSampler::new(settings.seed, index, sample),
            observe,
        ),
        SamplerKind::Independent => walk(
            scene,
            settings,
            [x, y],
            &mut IndependentSampler::new(settings.seed, index, sample),
            observe,
        ),
    }
}

fn walk<S: Sampler>(
    scene: &Scene,
    settings: &RenderSettings,
    [x, y]: [u32; 2],
    sampler: &mut S,
    observe: impl FnMut(Vertex),
) -> PathSample {
    let raster = Vec2::new(x as f32, y as f32) + sampler.next_2d();
    // A pinhole leaves the pair to the first bounce.
    let lens = if scene.camera.aperture_radius() > 0.0 { sampler.next_2d() } else { Vec2::ZERO };
    let ray = scene.camera.ray(raster, lens);
    settings.integrator.trace_observed(scene, ray, sampler, observe)
}
