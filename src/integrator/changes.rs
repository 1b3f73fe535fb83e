//! The mutations of a path as the kernels of a chain.

use super::Splat;
use super::mlt::splat;
use crate::mcmc::mutation::{Mutation, MutationSettings};
use crate::mcmc::{Failure, Kernels, Proposal};
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
    fn has(self, mutation: Mutation) -> bool {
        match mutation {
            Mutation::Bidirectional => self.bidirectional,
            Mutation::Lens => self.lens,
            Mutation::Caustic => self.caustic,
            Mutation::MultiChain => self.multi_chain,
        }
    }
}

/// The mutations in one scene.
pub(super) struct Changes<'s> {
    scene: &'s Scene,
    mutations: Mutations,
    settings: MutationSettings,
    /// Where the last proposal would have put its light, for those who want to know.
    proposed: Option<Splat>,
}

impl<'s> Changes<'s> {
    /// Names, in the order of [`Mutation::ALL`].
    pub(super) const NAMES: &'static [&'static str] =
        &["bidirectional", "lens", "caustic", "multi-chain"];

    /// Of paths of at least three edges if direct light is left to path tracing.
    pub(super) fn new(
        scene: &'s Scene,
        mutations: Mutations,
        reach: MutationSettings,
        separate_direct: bool,
    ) -> Self {
        let shortest = super::mlt::shortest(separate_direct);
        Self { scene, mutations, settings: reach.of_edges(scene, shortest), proposed: None }
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

impl<'s> Kernels for Changes<'s> {
    type State = Path<'s>;

    fn names(&self) -> &'static [&'static str] {
        Self::NAMES
    }

    fn selection(&self, kernel: usize, path: &Path<'s>) -> f64 {
        let mutation = Mutation::ALL[kernel];
        let is_possible =
            self.mutations.has(mutation) && mutation.is_suitable(path, &self.settings);
        f64::from(u8::from(is_possible))
    }

    fn propose(
        &mut self,
        kernel: usize,
        path: &Path<'s>,
        numbers: &mut IndependentSampler,
    ) -> Result<Proposal<Path<'s>>, Failure> {
        let proposal = Mutation::ALL[kernel].propose(self.scene, &self.settings, path, numbers)?;
        if let Some(proposed) = &mut self.proposed {
            *proposed = splat(&proposal.state);
        }
        Ok(proposal)
    }
}
