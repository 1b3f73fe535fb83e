//! Random choices of a scene.

use crate::sampler::{IndependentSampler, Sampler};
use glam::DVec3;
use std::f64::consts::TAU;

/// Random choices, the same for the same seed and stream.
#[derive(Clone, Debug)]
pub(super) struct Random(IndependentSampler);

impl Random {
    /// Choices of one attempt at the scene of `seed`.
    pub(super) fn new(seed: u64, attempt: u32) -> Self {
        Self(IndependentSampler::new(seed, 0, attempt))
    }

    /// A number in `[0, 1)`.
    pub(super) fn unit(&mut self) -> f64 {
        f64::from(self.0.next_1d())
    }

    /// A number in `[low, high)`.
    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A number in `[low, high)` whose logarithm is uniform; both positive.
    pub(super) fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }

    /// An integer from `low` to `high`, both included.
    pub(super) fn integer(&mut self, low: usize, high: usize) -> usize {
        let count = (high - low + 1) as f64;
        low + ((self.unit() * count) as usize).min(high - low)
    }

    /// `true` with this probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// One of `choices`, which are not none.
    pub(super) fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.integer(0, choices.len() - 1)]
    }

    /// One of `choices`, each as likely as its weight.
    pub(super) fn weighted<T: Copy>(&mut self, choices: &[(f64, T)]) -> T {
        let total: f64 = choices.iter().map(|(weight, _)| weight).sum();
        let mut left = self.unit() * total;
        for &(weight, choice) in choices {
            left -= weight;
            if left < 0.0 {
                return choice;
            }
        }
        choices[choices.len() - 1].1
    }

    /// An angle in `[0, 2π)`.
    pub(super) fn angle(&mut self) -> f64 {
        self.uniform(0.0, TAU)
    }

    /// A unit vector, uniform over all directions.
    pub(super) fn direction(&mut self) -> DVec3 {
        let (y, phi) = (self.uniform(-1.0, 1.0), self.angle());
        let radius = (1.0 - y * y).max(0.0).sqrt();
        DVec3::new(radius * phi.cos(), y, radius * phi.sin())
    }

    /// A point of the box between two corners.
    pub(super) fn point(&mut self, low: DVec3, high: DVec3) -> DVec3 {
        DVec3::new(
            self.uniform(low.x, high.x),
            self.uniform(low.y, high.y),
            self.uniform(low.z, high.z),
        )
    }

    /// A seed for what is random by itself, such as a noise.
    pub(super) fn seed(&mut self) -> u32 {
        (self.unit() * f64::from(u32::MAX)) as u32
    }
}
