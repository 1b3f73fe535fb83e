//! Seeds: everything random about a view comes from the base seed of the set and the number of the view.

use crate::sampler::{IndependentSampler, Sampler, hash};

/// The seed of one attempt at one view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ViewSeed(pub(super) u64);

/// What a number derived from a [`ViewSeed`] is for. Different purposes of one view never get the same seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// The generated scene.
    Scene,
    /// Camera, lights and materials of a given scene.
    Variation,
    /// Size of the film of a given scene.
    Film,
    /// Crop window and sample counts.
    Choices,
    /// The few samples by which a view is judged.
    Pilot,
    /// The noisy render of that index.
    Noisy(u32),
    /// The converged render.
    Reference,
}

impl ViewSeed {
    /// The seed of attempt `attempt` at view `view`. For one base seed no two are the same.
    pub(super) fn new(base: u64, view: u32, attempt: u32) -> Self {
        Self(hash::key(base, view, attempt))
    }

    /// A seed for one purpose.
    pub(super) fn derive(self, purpose: Purpose) -> u64 {
        let [kind, index] = match purpose {
            Purpose::Scene => [0, 0],
            Purpose::Variation => [1, 0],
            Purpose::Choices => [2, 0],
            Purpose::Pilot => [3, 0],
            Purpose::Noisy(index) => [4, index],
            Purpose::Reference => [5, 0],
            Purpose::Film => [6, 0],
        };
        hash::key(self.0, kind, index)
    }
}

/// A stream of random choices.
pub(super) struct Dice(IndependentSampler);

impl Dice {
    /// The choices that belong to a seed.
    pub(super) fn new(seed: u64) -> Self {
        Self(IndependentSampler::new(seed, 0, 0))
    }

    /// Uniform in `[low, high)`.
    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.0.next_1d())
    }

    /// In `[low, high)`, its logarithm uniform; both positive.
    pub(super) fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    /// A whole number in `0..=most`.
    pub(super) fn up_to(&mut self, most: u32) -> u32 {
        (self.uniform(0.0, f64::from(most) + 1.0) as u32).min(most)
    }

    /// True with this probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.uniform(0.0, 1.0) < probability
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn no_two_renders_share_a_seed() {
        let mut seeds = HashSet::new();
        for view in 0..200 {
            for attempt in 0..3 {
                let seed = ViewSeed::new(7, view, attempt);
                let purposes = [
                    Purpose::Scene,
                    Purpose::Variation,
                    Purpose::Film,
                    Purpose::Choices,
                    Purpose::Pilot,
                    Purpose::Reference,
                ];
                for purpose in purposes.into_iter().chain((0..9).map(Purpose::Noisy)) {
                    assert!(seeds.insert(seed.derive(purpose)), "{view} {attempt} {purpose:?}");
                }
            }
        }
        assert_ne!(ViewSeed::new(7, 0, 0), ViewSeed::new(8, 0, 0));
    }

    #[test]
    fn choices_stay_in_their_ranges_and_reach_both_ends() {
        let mut dice = Dice::new(3);
        let mut found = [0; 4];
        for _ in 0..1000 {
            found[dice.up_to(3) as usize] += 1;
            let log = dice.log_uniform(1.0, 256.0);
            assert!((1.0..=256.0).contains(&log), "{log}");
        }
        // 250 ± 4 standard deviations of √(1000 · 3/16).
        assert!(found.iter().all(|&count: &i32| (count - 250).abs() < 55), "{found:?}");
        assert_eq!(Dice::new(1).up_to(0), 0);
    }
}
