//! Adaptive sampling: path tracing that takes more samples where the denoised picture is worse.
//!
//! A pilot of the same number of samples in each pixel is denoised, and the map of its estimated error
//! (`quietlight_denoise::estimate`) says where the rest goes: a pixel whose squared error falls as `1/n` gets samples in
//! proportion to the root of its error, which makes the least of their sum.
//!
//! The rest is of another seed, and the mean of both has weights that do not depend on what was found: so it stays unbiased.
//! (Had the samples of a pixel been pooled, its weight would be smaller where the pilot was bright by chance and asked for more:
//! the picture would be too dark.)

use super::average::ADAPTIVE;
use super::sampled::Sampled;
use super::{Budget, RenderSettings, Rendered, Rendering, Report};
use crate::film::sum_to_beauty;
use crate::scene::Scene;
use quietlight_denoise::{Image, Layer, Layers, variance};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// The part of the samples, or of the time, that the pilot takes.
const PILOT: u32 = 4;

/// Fewest samples of a pilot whose error can be told, and of all where it pays.
const FEWEST_OF_PILOT: u32 = 4;

/// A pixel gets at most so many times the samples of the mean, and at least that part of it.
const MOST: f64 = 8.0;

/// Steps in which the rest is taken, between which the clock and Ctrl-C are heeded.
const STEPS: u32 = 64;

/// What the seed of the rest differs by.
const REST: u64 = 0x5eed_0000_ada9_71fe;

/// Renders by path tracing, adaptively; not to be called on the threads of `threads`. `judge` gets the layers of the pilot and
/// gives a map of its error, `[1, height, width]`; without one, the rest is spread evenly.
///
/// # Errors
/// Those of `judge`.
///
/// # Panics
/// If the map has not the size of the picture.
pub fn adaptive<E>(
    scene: &Scene,
    settings: &RenderSettings,
    threads: &rayon::ThreadPool,
    progress: &(dyn Fn(u64) + Sync),
    stop: &AtomicBool,
    judge: impl FnOnce(&Layers) -> Result<Option<Image>, E>,
) -> Result<Rendered, E> {
    let start = Instant::now();
    let mut pilot = Rendering::new(scene, settings);
    let of_pilot = match settings.budget {
        Budget::Samples(samples) => {
            Budget::Samples((samples / PILOT).max(FEWEST_OF_PILOT).min(samples))
        }
        Budget::Time(time) => Budget::Time(time / PILOT),
    };
    threads.install(|| pilot.run(of_pilot, progress, stop));
    let layers = threads.install(|| pilot.layers());
    let first = pilot.samples();
    let seconds_each = start.elapsed().as_secs_f64() / f64::from(first.max(1));
    let error = if stop.load(Ordering::Relaxed) { None } else { judge(&layers)? };
    let left = match settings.budget {
        Budget::Samples(samples) => samples - first,
        // More than there will be time for; the clock ends it.
        Budget::Time(time) => {
            let left = time.saturating_sub(start.elapsed()).as_secs_f64();
            (1.5 * left / seconds_each) as u32
        }
    };
    if left < 2 || stop.load(Ordering::Relaxed) {
        return Ok(threads.install(|| pilot.finish()));
    }

    let pixels = layers.width * layers.height;
    let counts = match &error {
        Some(error) => {
            assert_eq!(error.dim(), (1, layers.height, layers.width), "a map of the picture");
            let error: Vec<f64> = error.iter().map(|&error| f64::from(error)).collect();
            allocate(&error, left)
        }
        None => vec![left; pixels],
    };
    let settings_of_rest = RenderSettings { seed: settings.seed ^ REST, ..*settings };
    let mut rest = Sampled::new(scene, &settings_of_rest);
    let mut steps = 0;
    let is_over = || matches!(settings.budget, Budget::Time(time) if start.elapsed() >= time);
    while steps < STEPS && !(steps > 0 && (is_over() || stop.load(Ordering::Relaxed))) {
        let due = |count: u32, steps: u32| {
            // Always whole pairs, one for each half.
            2 * ((u64::from(count) * u64::from(steps)).div_ceil(2 * u64::from(STEPS)) as u32)
        };
        let taken = threads.install(|| {
            rest.pass_each(|pixel| due(counts[pixel], steps)..due(counts[pixel], steps + 1))
        });
        steps += 1;
        progress(u64::from(first) * pixels as u64 + taken);
    }

    Ok(threads.install(|| {
        let mut layers_of_rest = rest.taken().layers(scene.origin);
        layers_of_rest.layers.values_mut().for_each(variance::correct_variances);
        let taken = layers_of_rest.samples.as_ref().map_or(0.0, |samples| {
            samples.iter().map(|&count| f64::from(count)).sum::<f64>() / pixels as f64
        });
        let weight = f64::from(first) / (f64::from(first) + taken);
        let (fewest, most) = (counts.iter().min(), counts.iter().max());
        let spread = format!(
            "{first} samples per pixel, then {taken:.1} on average, planned from {} to {}",
            fewest.unwrap_or(&0),
            most.unwrap_or(&0)
        );
        Rendered {
            layers: weigh(layers, &layers_of_rest, weight as f32),
            samples: first + taken.round() as u32,
            invalid_samples: pilot.invalid_samples() + rest.taken().invalid(),
            elapsed: start.elapsed(),
            report: Report { facts: vec![(ADAPTIVE.to_owned(), spread)], ..Report::default() },
        }
    }))
}

/// Samples for each pixel, `mean` on average, in proportion to the root of its error between the bounds.
fn allocate(error: &[f64], mean: u32) -> Vec<u32> {
    let mean = f64::from(mean);
    let roots: Vec<f64> = error.iter().map(|error| error.max(0.0).sqrt()).collect();
    let bounded = |scale: f64, root: f64| (scale * root).clamp(mean / MOST, mean * MOST);
    let mean_of = |scale: f64| {
        roots.iter().map(|&root| bounded(scale, root)).sum::<f64>() / roots.len() as f64
    };
    // The mean grows with the scale: halve the interval, in the logarithm.
    let largest = roots.iter().copied().fold(0.0, f64::max);
    if largest <= 0.0 {
        return vec![mean as u32; error.len()];
    }
    let (mut low, mut high) = (mean / MOST / largest, 1e12 * mean / largest);
    for _ in 0..64 {
        let middle = (low * high).sqrt();
        if mean_of(middle) < mean { low = middle } else { high = middle }
    }
    roots.iter().map(|&root| bounded(low, root).round() as u32).collect()
}

/// The weighted mean of two independent pictures; `weight` is that of the first.
fn weigh(mut first: Layers, second: &Layers, weight: f32) -> Layers {
    let rest = 1.0 - weight;
    let mean = |a: &Image, b: &Image| a * weight + b * rest;
    for (kind, layer) in &mut first.layers {
        let Some(other) = second.layers.get(kind) else { continue };
        let variance = layer.variance.as_ref().zip(other.variance.as_ref());
        let halves = layer.halves.as_ref().zip(other.halves.as_ref());
        *layer = Layer {
            mean: mean(&layer.mean, &other.mean),
            variance: variance.map(|(a, b)| a * (weight * weight) + b * (rest * rest)),
            halves: halves.map(|([a, b], [c, d])| [mean(a, c), mean(b, d)]),
        };
    }
    sum_to_beauty(&mut first);
    let add = |a: &mut Option<Image>, b: &Option<Image>| {
        if let (Some(a), Some(b)) = (a, b) {
            *a += b;
        }
    };
    add(&mut first.samples, &second.samples);
    add(&mut first.invalid, &second.invalid);
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_go_by_the_root_of_the_error_within_bounds() {
        // Roots 1, 2, 3: of 60 on average 30, 60, 90.
        assert_eq!(allocate(&[1.0, 4.0, 9.0], 60), [30, 60, 90]);
        // An eighth and eight times at the ends; the others make up for it.
        let mut error = vec![1.0; 62];
        error.extend([0.0, 1e12]);
        let counts = allocate(&error, 64);
        assert_eq!((counts[62], counts[63]), (8, 512));
        let sum: u32 = counts.iter().sum();
        assert!(sum.abs_diff(64 * 64) <= 32, "{sum}");
        assert_eq!(allocate(&[0.0, 0.0], 7), [7, 7]);
    }
}
