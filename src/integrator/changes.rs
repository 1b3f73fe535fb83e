//! The mutations of a path as the kernels of a chain.

use super::Splat;
use super::mlt::splat;
use crate::mcmc::mutation::{Mutation, MutationSettings, Mutations as Kernels};
use crate::mcmc::{self, Failure, Proposal};
use crate::sampler::IndependentSampler;
use crate::scene::Scene;
use crate::transport::path::Path;

/// Which mutations a chain of paths has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mutations {
    /// Takes out a part of the path and walks anew, from both ends: reaches every path there is.
    pub bidirectional: bool,
    /// Moves the place on the film a little.
    pub lens: bool,
    /// Moves a direction of the light a little.
    pub caustic: bool,
    /// Moves the place on the film, and every direction between two mirrors.
    pub multi_chain: bool,
}

impl Default for Mutations {
    fn default() -> Self {
        Self { bidirectional: true, lens: true, caustic: true, multi_chain: true }
    }
}

impl Mutations {
    /// How readily each of [`Mutation::ALL`] is chosen.
    fn weights(self) -> [f64; 4] {
        let Self { bidirectional, lens, caustic, multi_chain } = self;
        [bidirectional, lens, caustic, multi_chain].map(|is_on| f64::from(u8::from(is_on)))
    }
}

/// Settings of the mutations of paths of at least `shortest` edges.
pub(super) fn reach(scene: &Scene, shortest: u32) -> MutationSettings {
    let settings = MutationSettings::of(scene);
    MutationSettings { min_edges: settings.min_edges.max(shortest), ..settings }
}

/// The mutations in one scene, which can be watched.
pub(super) struct Changes<'s> {
    kernels: Kernels<'s>,
    /// Where the last proposal would have put its light, for those who want to know.
    proposed: Option<Splat>,
}

impl<'s> Changes<'s> {
    /// Names, in the order of [`Mutation::ALL`].
    pub(super) const NAMES: &'static [&'static str] = &Mutation::NAMES;

    /// Of paths of at least `shortest` edges.
    pub(super) fn new(scene: &'s Scene, mutations: Mutations, shortest: u32) -> Self {
        let settings = reach(scene, shortest);
        Self { kernels: Kernels { scene, settings, weights: mutations.weights() }, proposed: None }
    }

    /// Before a step: notes where a proposal that fails leaves the light, which is where it is.
    pub(super) fn watch(&mut self, path: &Path<'s>) {
        self.proposed = Some(splat(path));
    }

    /// After a step that was watched: where the proposal would have put the light.
    pub(super) fn proposed(&mut self) -> Option<Splat> {
        self.proposed.take()
    }
}

impl<'s> mcmc::Kernels for Changes<'s> {
    type State = Path<'s>;

    fn names(&self) -> &'static [&'static str] {
        Self::NAMES
    }

    fn selection(&self, kernel: usize, path: &Path<'s>) -> f64 {
        self.kernels.selection(kernel, path)
    }

    fn propose(
        &mut self,
        kernel: usize,
        path: &Path<'s>,
        numbers: &mut IndependentSampler,
    ) -> Result<Proposal<Path<'s>>, Failure> {
        let proposal = self.kernels.propose(kernel, path, numbers)?;
        if let Some(proposed) = &mut self.proposed {
            *proposed = splat(&proposal.state);
        }
        Ok(proposal)
    }
}
