//! What a render will cost, from a short part of it.

use super::memory;
use super::method;
use super::sampled::Sampled;
use super::{Budget, FEATURE_SAMPLES, RenderSettings};
use crate::film::Film;
use crate::scene::{Requirements, Scene};
use quietlight_denoise::{Denoiser, Error, Layers};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Pixels along the side of a patch of the picture that is tried: a tile of the film.
const SIDE: u32 = 16;

/// Patches that are tried, or eight for each thread if that is more: enough that they stand for the picture, and that no
/// thread waits long for the last.
const PATCHES: usize = 64;

/// The least uncertainty of a prediction: that of a machine which does other things, too.
const LEAST_UNCERTAINTY: f64 = 0.1;

/// Bytes a pixel beside film and layers: counts, and what is copied while layers are made and written. The Cornell box took
/// 983 bytes a pixel in all, at 512×512 as at 1536×1024.
const BESIDE: u64 = 42;

/// Bytes that the balanced networks take, by tile and pixel of it, in pixels of at most so large a tile, and by pixel of the
/// picture. Fits the peaks of the Cornell box at 256×256 to 1024×1024 to within 20 %: onnxruntime keeps more or less.
const NETWORKS: [u64; 4] = [90_000_000, 850, 1 << 20, 100];

/// Bytes a pixel that the cross-bilateral filter takes: 732 and 756 in the Cornell box at 768×768 and 1536×1024.
const BILATERAL: u64 = 745;

/// The uncertainty where there is one measurement only.
const UNKNOWN: f64 = 0.5;

/// What a render costs in wall time, on the threads that the probe ran on, and in memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Seconds whatever the number of samples: what a method prepares once, and the layers at the end.
    pub fixed_seconds: f64,
    /// Seconds of one sample (or mutation) in one pixel, its share of preparations that grow with the samples included.
    pub seconds_per_sample_per_pixel: f64,
    /// Seconds of one of path tracing's samples for the feature layers of another method, in one pixel; 0 for path tracing.
    pub seconds_per_feature_per_pixel: f64,
    /// Pixels of the picture.
    pub pixels: u64,
    /// Most bytes at once while it renders: of films, and of the layers made of them.
    pub bytes: u64,
    /// Bytes of the layers, which stay.
    pub layer_bytes: u64,
    /// Two standard errors of the seconds, relative; at least a tenth.
    pub uncertainty: f64,
}

impl Cost {
    /// Seconds of a render of so many samples per pixel.
    pub fn seconds(&self, samples: u32) -> f64 {
        let features = f64::from(samples.min(FEATURE_SAMPLES)) * self.seconds_per_feature_per_pixel;
        let radiance = f64::from(samples) * self.seconds_per_sample_per_pixel;
        self.fixed_seconds + self.pixels as f64 * (radiance + features)
    }

    /// The samples per pixel that so many seconds are enough for; 0 where they are not enough for one.
    pub fn samples(&self, seconds: f64) -> u32 {
        let pixels = (self.pixels as f64).max(1.0);
        let after = |features: u32| {
            let features = f64::from(features) * self.seconds_per_feature_per_pixel;
            let left = (seconds - self.fixed_seconds) / pixels - features;
            (left / self.seconds_per_sample_per_pixel.max(1e-15)) as u32
        };
        // Where not all features are taken, each sample comes with its own.
        let each = self.seconds_per_sample_per_pixel + self.seconds_per_feature_per_pixel;
        let few = ((seconds - self.fixed_seconds) / pixels / each.max(1e-15)) as u32;
        if few < FEATURE_SAMPLES { few } else { after(FEATURE_SAMPLES).max(FEATURE_SAMPLES) }
    }
}

/// Predicts what `settings` cost in `scene`, by trying for about `length`, and at least one sample in some patches of the
/// picture, on the threads of the current rayon pool. Methods other than path tracing are tried on the whole picture, one
/// round at least, after their preparations: for large pictures that takes longer.
///
/// Memory of the method's own that does not grow with the picture is not counted.
pub fn cost(scene: &Scene, settings: &RenderSettings, length: Duration) -> Cost {
    let pixels = scene.film.crop_pixels();
    let bytes = memory::bytes(scene, settings) + BESIDE * pixels;
    let layers = Film::layer_bytes(scene.film, &Requirements::of(scene));
    if settings.integrator.is_path() {
        let Patches { per_sample, per_pixel, uncertainty } = patches(scene, settings, length);
        return Cost {
            fixed_seconds: per_pixel * pixels as f64,
            seconds_per_sample_per_pixel: per_sample,
            seconds_per_feature_per_pixel: 0.0,
            pixels,
            bytes,
            layer_bytes: layers,
            uncertainty,
        };
    }
    let features = patches(scene, settings, length / 4);
    let rounds = rounds(scene, settings, length);
    Cost {
        fixed_seconds: rounds.fixed + features.per_pixel * pixels as f64,
        seconds_per_sample_per_pixel: rounds.per_sample,
        seconds_per_feature_per_pixel: features.per_sample,
        pixels,
        bytes,
        layer_bytes: layers,
        uncertainty: rounds.uncertainty,
    }
}

/// What taking the noise out costs in wall time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DenoisingCost {
    /// Seconds before the first pixel: networks are made ready.
    pub fixed_seconds: f64,
    /// Seconds of a pixel.
    pub seconds_per_pixel: f64,
    /// Bytes beside the layers, for the whole picture.
    pub bytes: u64,
}

impl DenoisingCost {
    /// Seconds for so many pixels.
    pub fn seconds(&self, pixels: u64) -> f64 {
        self.fixed_seconds + self.seconds_per_pixel * pixels as f64
    }
}

/// Denoises a small and a larger part of the middle of the picture, at two samples per pixel. Like
/// [`Denoiser::denoise`], it must not be called by one of rayon's workers.
///
/// # Errors
/// As [`Denoiser::denoise`].
pub fn denoising(
    scene: &Scene,
    settings: &RenderSettings,
    denoiser: &Denoiser,
    threads: &rayon::ThreadPool,
) -> Result<DenoisingCost, Error> {
    let time = |layers: &Layers| -> Result<f64, Error> {
        let start = Instant::now();
        denoiser.denoise(layers, threads, &|_| {})?;
        Ok(start.elapsed().as_secs_f64())
    };
    let of = |side: u32| threads.install(|| middle(scene, settings, side));
    let (small, large) = (of(32), of(256));
    // Once cold, once warm.
    let (cold, warm, longer) = (time(&small)?, time(&small)?, time(&large)?);
    let pixels = |layers: &Layers| (layers.width * layers.height) as f64;
    let more = pixels(&large) - pixels(&small);
    let seconds_per_pixel =
        if more > 0.0 { (longer - warm).max(0.0) / more } else { longer / pixels(&large) };
    let fixed_seconds = (cold - seconds_per_pixel * pixels(&small)).max(0.0);
    let pixels = scene.film.crop_pixels();
    let bytes = match denoiser {
        Denoiser::Bilateral { .. } => BILATERAL * pixels,
        Denoiser::Kpcn { .. } => {
            let [fixed, of_tile, tile, of_picture] = NETWORKS;
            fixed + of_tile * pixels.min(tile) + of_picture * pixels
        }
    };
    Ok(DenoisingCost { fixed_seconds, seconds_per_pixel, bytes })
}

/// The layers of a square in the middle of the picture, or of all of a smaller one, at two samples per pixel.
pub fn middle(scene: &Scene, settings: &RenderSettings, side: u32) -> Layers {
    let [left, top, width, height] = scene.film.crop;
    let size = [width.min(side), height.min(side)];
    let crop = [left + (width - size[0]) / 2, top + (height - size[1]) / 2, size[0], size[1]];
    let mut sampled = Sampled::of_crop(scene, settings, crop);
    sampled.pass(2, &|_| {});
    sampled.layers()
}

/// What patches of the picture take by path tracing, in seconds.
struct Patches {
    per_sample: f64,
    /// For making the layers.
    per_pixel: f64,
    uncertainty: f64,
}

/// A small part of the picture, and the time it took.
struct Patch<'a> {
    sampled: Sampled<'a>,
    pixels: u64,
    time: Duration,
}

fn patches(scene: &Scene, settings: &RenderSettings, length: Duration) -> Patches {
    let [left, top, width, height] = scene.film.crop;
    let size = [width.min(SIDE), height.min(SIDE)];
    let of_picture = (u64::from(width / size[0]) * u64::from(height / size[1])) as usize;
    let count = PATCHES.max(8 * rayon::current_num_threads()).min(of_picture);
    let mut patches: Vec<Patch<'_>> = (0..count)
        .map(|index| {
            // The additive recurrence of the plastic number (Roberts 2018, "The Unreasonable Effectiveness of
            // Quasirandom Sequences"): any number of its points is spread evenly.
            let place = |start: u32, room: u32, step: f64| {
                let at = (0.5 + index as f64 * step).fract() * f64::from(room + 1);
                start + (at as u32).min(room)
            };
            let column = place(left, width - size[0], 0.754_877_666_246_692_8);
            let row = place(top, height - size[1], 0.569_840_290_998_053_3);
            let crop = [column, row, size[0], size[1]];
            Patch {
                sampled: Sampled::of_crop(scene, settings, crop),
                pixels: u64::from(size[0]) * u64::from(size[1]),
                time: Duration::ZERO,
            }
        })
        .collect();

    let start = Instant::now();
    let mut pass = |samples: u32| {
        let start = Instant::now();
        patches.par_iter_mut().with_max_len(1).for_each(|patch| {
            let start = Instant::now();
            patch.sampled.pass(samples, &|_| {});
            patch.time += start.elapsed();
        });
        start.elapsed()
    };
    // The first pass fetches the scene into the caches; it counts only where there is no time for another.
    let mut wall = pass(1);
    let (mut samples, mut next) = (1, 1);
    if start.elapsed() < length {
        (wall, samples) = (Duration::ZERO, 0);
    }
    while start.elapsed() < length {
        wall += pass(next);
        samples += next;
        next = next.saturating_mul(2).min(samples + 1);
    }
    let all: u64 = patches.iter().map(|patch| patch.pixels).sum();
    let making = Instant::now();
    patches.par_iter().for_each(|patch| drop(patch.sampled.layers()));
    let making = making.elapsed().as_secs_f64() * rayon::current_num_threads() as f64;
    let times: Vec<f64> = patches.iter().map(|patch| patch.time.as_secs_f64()).collect();
    Patches {
        per_sample: wall.as_secs_f64() / (all * u64::from(samples)).max(1) as f64,
        per_pixel: making / all.max(1) as f64,
        uncertainty: two_standard_errors(&times, count as f64 / of_picture as f64),
    }
}

/// What a method's rounds take, in seconds.
struct Rounds {
    fixed: f64,
    per_sample: f64,
    uncertainty: f64,
}

fn rounds(scene: &Scene, settings: &RenderSettings, length: Duration) -> Rounds {
    let prepare = |samples: u32| {
        let settings = RenderSettings { budget: Budget::Samples(samples), ..*settings };
        let start = Instant::now();
        let method = method::start(scene, &settings, None);
        (method, start.elapsed().as_secs_f64())
    };
    // What is prepared grows with the samples in some methods.
    let (method, first) = prepare(1);
    drop(method);
    let (few, many) = (1, 4);
    let (method, second) = prepare(many);
    let growth = ((second - first) / f64::from(many - few)).max(0.0);
    let Some(mut method) = method else {
        return Rounds { fixed: 0.0, per_sample: 0.0, uncertainty: UNKNOWN };
    };
    let start = Instant::now();
    // Seconds and samples of each round.
    let mut rounds: Vec<(f64, f64)> = Vec::new();
    let mut done = 0;
    while rounds.len() < 3 || start.elapsed() < length {
        let round = Instant::now();
        // Never the last one, which may end elsewhere than the others.
        method.round(u32::MAX / 2);
        rounds.push((round.elapsed().as_secs_f64(), (method.found().done() - done) as f64));
        done = method.found().done();
        if start.elapsed() > 4 * length {
            break;
        }
    }
    // The first round may begin with what is done once.
    let (once, rest) = match &rounds[..] {
        [first, rest @ ..] if !rest.is_empty() => (Some(first), rest),
        all => (None, all),
    };
    let rates: Vec<f64> = rest.iter().map(|(time, samples)| time / samples.max(1.0)).collect();
    let per_sample = rates.iter().sum::<f64>() / rates.len() as f64;
    let once = once.map_or(0.0, |(time, samples)| (time - per_sample * samples).max(0.0));
    Rounds {
        fixed: (first - growth).max(0.0) + once,
        per_sample: per_sample + growth / scene.film.crop_pixels().max(1) as f64,
        uncertainty: two_standard_errors(&rates, 0.0).max(2.0 * LEAST_UNCERTAINTY),
    }
}

/// Two standard errors of the mean of `values`, relative to it, where they are this part of all that there are.
fn two_standard_errors(values: &[f64], part: f64) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count.max(1.0);
    if values.len() < 2 || mean <= 0.0 {
        return UNKNOWN;
    }
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let error = (variance / count * (1.0 - part).max(0.0)).sqrt();
    (2.0 * error / mean).max(LEAST_UNCERTAINTY)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COST: Cost = Cost {
        fixed_seconds: 2.0,
        seconds_per_sample_per_pixel: 1e-6,
        seconds_per_feature_per_pixel: 5e-7,
        pixels: 1_000_000,
        bytes: 0,
        layer_bytes: 0,
        uncertainty: 0.1,
    };

    #[test]
    fn seconds_and_samples_are_each_others_inverse() {
        for samples in [1, 3, 15, 16, 17, 1000] {
            // A millionth more, for what rounding takes away.
            let seconds = COST.seconds(samples) + 1e-6;
            assert_eq!(COST.samples(seconds), samples, "{seconds}");
            assert_eq!(COST.samples(seconds - 0.01), samples - 1, "{seconds}");
        }
        assert_eq!(COST.seconds(100), 2.0 + 100.0 + 8.0);
        assert_eq!(COST.samples(1.0), 0);
    }

    #[test]
    fn the_error_of_a_mean_is_of_what_was_not_measured() {
        // 1 and 3: mean 2, standard deviation √2, standard error 1, twice that relative to the mean 1.
        assert_eq!(two_standard_errors(&[1.0, 3.0], 0.0), 1.0);
        assert_eq!(two_standard_errors(&[1.0, 3.0], 0.75), 0.5);
        assert_eq!(two_standard_errors(&[1.0, 3.0], 1.0), LEAST_UNCERTAINTY);
        assert_eq!(two_standard_errors(&[1.0], 0.0), UNKNOWN);
    }
}
