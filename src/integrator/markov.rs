//! What a Markov-chain method must offer for [`crate::render`] to run its chains.

use super::Splat;
use crate::mcmc::Statistics;
use crate::scene::Scene;
use std::fmt::Debug;

/// A method whose picture is what many independent Markov chains visit. Their target density is the luminance of a path's
/// contribution, or of a whole sample's, in a measure in which a uniform draw of the crop window has density 1: its
/// integral `b` is the mean luminance of the pixels to render.
pub trait MarkovChains: Copy + Debug + Send + Sync {
    /// What a candidate of the bootstrap is found again by: the draw's index, or the path itself.
    type Seed: Clone + Debug + Send + Sync;
    /// A chain with its random numbers.
    type Walker<'s>: Debug + Send + Sync;

    /// Names of the mutations, in the order of the statistics.
    fn names(&self) -> &'static [&'static str];

    /// Fewest draws that give the normalisation and the seeds, both halves together; long renders make more.
    fn draws(&self) -> u32;

    /// Is light of at most one bounce left to path tracing? Then the target is that of all other light.
    fn direct(&self) -> bool {
        false
    }

    /// Makes draw `index` of the bootstrap, appending its candidates with their weights: target density over the density of
    /// being drawn, so that the mean of the sum of a draw's weights is `b`. A weight that is not finite is counted.
    fn draw(&self, scene: &Scene, seed: u64, index: u64, found: &mut Vec<(Self::Seed, f64)>);

    /// The chain of that index, in the state that `from` stands for. `None` where that cannot be found again, which would be
    /// an error of the method.
    fn start<'s>(
        &self,
        scene: &'s Scene,
        seed: u64,
        from: &Self::Seed,
        index: u64,
    ) -> Option<Self::Walker<'s>>;

    /// Goes on by so many mutations, appending what they record: for each mutation splats whose luminance sums to 1, in
    /// expectation over the two states that it weighs. All weight is recorded by the end of the call.
    fn mutate<'s>(
        &self,
        scene: &'s Scene,
        walker: &mut Self::Walker<'s>,
        mutations: u64,
        splats: &mut Vec<Splat>,
    );

    /// How a chain fared.
    fn statistics<'w>(&self, walker: &'w Self::Walker<'_>) -> &'w Statistics;
}
