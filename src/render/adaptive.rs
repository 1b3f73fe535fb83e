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
use super::method::{Found, Method, Report};
use super::sampled::{Sampled, Samples};
use super::{Budget, RenderSettings};
use crate::film::sum_to_beauty;
use crate::scene::Scene;
use quietlight_denoise::{Image, Layer, Layers};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// The part of the samples, or of the time, that the pilot takes.
const PILOT: u32 = 4;

/// Fewest samples of a pilot whose error can be told, and of all where it pays.
const FEWEST_OF_PILOT: u32 = 4;

/// A pixel gets at most so many times the samples of the mean, and at least that part of it.
const MOST: f64 = 8.0;

/// Fewest rounds in which the rest is taken.
const ROUNDS: u32 = 64;

/// What the seed of the rest differs by.
const REST: u64 = 0x5eed_0000_ada9_71fe;

/// What the pilot may spend of a budget.
pub(super) fn pilot(budget: Budget) -> Budget {
    match budget {
        Budget::Samples(samples) => {
            Budget::Samples((samples / PILOT).max(FEWEST_OF_PILOT).min(samples))
        }
        Budget::Time(time) => Budget::Time(time / PILOT),
    }
}

/// How the samples after the pilot are spread, and how many of them are taken.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Spread {
    /// Samples per pixel of the pilot.
    pilot: u32,
    /// Those of the rest for each pixel, row after row.
    counts: Vec<u32>,
    /// Rounds that take them, and those done.
    rounds: u32,
    done: u32,
}

impl Spread {
    /// `rest` samples per pixel on average, by the error of the `pilot`, `[1, height, width]`; evenly without one.
    /// `seconds` is about how long they will take, so that rounds are of a second or less.
    ///
    /// # Panics
    /// If the error has not the size of the picture.
    pub(super) fn new(
        scene: &Scene,
        pilot: u32,
        rest: u32,
        error: Option<&Image>,
        seconds: f64,
    ) -> Self {
        let [_, _, width, height] = scene.film.crop.map(|number| number as usize);
        let counts = match error {
            Some(error) => {
                assert_eq!(error.dim(), (1, height, width), "a map of the picture");
                let error: Vec<f64> = error.iter().map(|&error| f64::from(error)).collect();
                allocate(&error, rest)
            }
            None => vec![rest; width * height],
        };
        let rounds = (seconds.min(1e6) as u32).max(ROUNDS);
        Self { pilot, counts, rounds, done: 0 }
    }

    /// Samples of the rest that a pixel has, by its index, after so many rounds: always whole pairs, one for each half.
    fn due(&self, pixel: usize, rounds: u32) -> u32 {
        let pairs = u64::from(self.counts[pixel]) * u64::from(rounds);
        2 * (pairs.div_ceil(2 * u64::from(self.rounds)) as u32)
    }

    /// Samples of the rest so far, of the whole picture.
    fn taken(&self) -> u64 {
        (0..self.counts.len()).map(|pixel| u64::from(self.due(pixel, self.done))).sum()
    }

    /// The same per pixel, on average.
    fn mean(&self) -> f64 {
        self.taken() as f64 / self.counts.len() as f64
    }

    /// Samples per pixel so far, those of the pilot included.
    pub(super) fn samples(&self) -> u32 {
        self.pilot + self.mean().round() as u32
    }

    /// The same of the whole picture.
    pub(super) fn all(&self) -> u64 {
        u64::from(self.pilot) * self.counts.len() as u64 + self.taken()
    }

    /// The mean of the layers of the pilot and those of the rest, both with their variances corrected.
    pub(super) fn weigh(&self, pilot: Layers, rest: &Layers) -> Layers {
        let weight = f64::from(self.pilot) / (f64::from(self.pilot) + self.mean());
        if self.done == 0 { pilot } else { weigh(pilot, rest, weight as f32) }
    }

    /// How samples were spread, in words.
    pub(super) fn report(&self) -> Report {
        let (fewest, most) = (self.counts.iter().min(), self.counts.iter().max());
        let spread = format!(
            "{} samples per pixel, then {:.1} on average, planned from {} to {}",
            self.pilot,
            self.mean(),
            fewest.unwrap_or(&0),
            most.unwrap_or(&0)
        );
        Report { facts: vec![(ADAPTIVE.to_owned(), spread)], ..Report::default() }
    }
}

/// The rest under way.
#[derive(Debug)]
pub(super) struct Rest<'a> {
    spread: Spread,
    sampled: Sampled<'a>,
}

impl<'a> Rest<'a> {
    /// Goes on from samples that were taken before, or begins without any.
    pub(super) fn new(
        scene: &'a Scene,
        settings: &RenderSettings,
        spread: Spread,
        taken: Option<Samples>,
    ) -> Self {
        let settings = RenderSettings { seed: settings.seed ^ REST, ..*settings };
        let sampled = Sampled::new(scene, &settings);
        let sampled = match taken {
            Some(taken) => sampled.with(taken),
            None => sampled,
        };
        Self { spread, sampled }
    }
}

impl Method for Rest<'_> {
    /// However many samples there are to be: they were spread before.
    fn round(&mut self, _most: u32) {
        let Self { spread, sampled } = self;
        let done = spread.done;
        sampled.pass_each(|pixel| spread.due(pixel, done)..spread.due(pixel, done + 1));
        spread.done += 1;
    }

    fn is_complete(&self, _most: u32) -> bool {
        self.spread.done >= self.spread.rounds
    }

    fn found(&self) -> Found<'_> {
        Found::Spread(Cow::Borrowed(&self.spread), Cow::Borrowed(self.sampled.taken()))
    }
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
