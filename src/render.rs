//! Who runs where: passes over tiles, threads, progress, the replay of one sample.

use crate::film::Film;
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
    let start = Instant::now();
    let requirements = Requirements::of(scene);
    let mut film = Film::new(scene.film, &requirements);
    let done = AtomicU64::new(0);
    let mut samples = 0;
    while samples < settings.samples {
        let pass = next_pass(samples, settings, start.elapsed());
        let (tiles, kept) = film.tiles_mut();
        tiles.par_iter_mut().for_each(|tile| {
            for (index, pixel) in tile.film_pixels().enumerate() {
                for sample in samples..samples + pass {
                    let found = sample_pixel(scene, settings, pixel, sample, |_| {});
                    tile.add(index, (sample & 1) as usize, &found, kept);
                }
            }
            let added = tile.len() as u64 * u64::from(pass);
            progress(done.fetch_add(added, Ordering::Relaxed) + added);
        });
        samples += pass;
        if stop.load(Ordering::Relaxed) {
            break;
        }
    }
    let mut layers = film.layers(scene.origin);
    // The variance of independent samples is right, and of more degrees of freedom than that of the halves.
    if settings.sampler == SamplerKind::Sobol {
        variance::correct(&mut layers);
    }
    Rendered { layers, samples, invalid_samples: film.invalid_samples(), elapsed: start.elapsed() }
}

/// Samples per pixel of the next pass: about `settings.pass` long by the speed so far, and no more than are left. The
/// first pass is one sample. Only the clock decides the size, and the size does not change the picture.
fn next_pass(samples: u32, settings: &RenderSettings, elapsed: Duration) -> u32 {
    let left = settings.samples - samples;
    if samples == 0 {
        return 1.min(left);
    }
    let seconds_each = (elapsed.as_secs_f64() / f64::from(samples)).max(1e-9);
    let wanted = settings.pass.as_secs_f64() / seconds_each;
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
