//! Metropolis light transport.

use super::bdpt::{Bdpt, Workspace};
use super::changes::{Changes, Mutations, reach};
use super::{MarkovChains, Splat};
use crate::mcmc::{Chain, Statistics};
use crate::sampler::{IndependentSampler, Sampler, Stream};
use crate::scene::Scene;
use crate::transport::connect::{Contribution, Pair, Strategies};
use crate::transport::mis::Heuristic;
use crate::transport::path::Path;

/// Metropolis light transport in path space (Veach and Guibas 1997, "Metropolis Light Transport"): chains of whole paths,
/// whose target density is the luminance that they bring. Prefer it where light is hard to find and, once found, near more of
/// it: through narrow openings, focused by glass or water. In an easy scene path tracing with Sobol points is far better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mlt {
    /// Which mutations there are.
    pub mutations: Mutations,
    /// Is light of at most one bounce, which path tracing finds easily, left to it?
    pub separate_direct: bool,
    /// Fewest pairs of walks that give the normalisation and the chains' seeds, both halves together (Mitsuba 0.6's number).
    pub bootstrap_pairs: u32,
}

impl Default for Mlt {
    fn default() -> Self {
        Self { mutations: Mutations::default(), separate_direct: true, bootstrap_pairs: 100_000 }
    }
}

/// A path as the bootstrap found it: which draw, and which strategy.
#[derive(Clone, Copy, Debug)]
pub struct PathSeed {
    draw: u64,
    s: u32,
    t: u32,
}

/// A chain of paths.
#[derive(Debug)]
pub struct PathWalker<'s> {
    chain: Chain<Path<'s>>,
    numbers: IndependentSampler,
}

/// Fewest edges of paths that chains of paths look for.
pub(super) fn shortest(separate_direct: bool) -> u32 {
    if separate_direct { 3 } else { 1 }
}

/// Is that path long enough for chains of paths?
pub(super) fn is_state(found: &Contribution, separate_direct: bool) -> bool {
    found.s + found.t > shortest(separate_direct)
}

/// Walks of one draw: the raster point is uniform over the crop window.
pub(super) fn walks<'a, 's>(
    scene: &'s Scene,
    strategies: Strategies,
    mut numbers: IndependentSampler,
    workspace: &'a mut Workspace<'s>,
) -> Pair<'a, 's> {
    let bdpt = Bdpt { heuristic: Heuristic::Power, strategies };
    let raster = scene.film.crop_point(numbers.next_2d());
    let lens = numbers.next_2d_if(scene.camera.has_lens());
    bdpt.walk(scene, raster, lens, &mut numbers, workspace)
}

impl MarkovChains for Mlt {
    type Seed = PathSeed;
    type Walker<'s> = PathWalker<'s>;

    fn names(&self) -> &'static [&'static str] {
        Changes::NAMES
    }

    fn draws(&self) -> u32 {
        self.bootstrap_pairs
    }

    fn direct(&self) -> bool {
        self.separate_direct
    }

    fn draw(&self, scene: &Scene, seed: u64, index: u64, found: &mut Vec<(PathSeed, f64)>) {
        let mut workspace = Workspace::default();
        let numbers = IndependentSampler::stream(seed, Stream::Bootstrap, index);
        let pair = walks(scene, Strategies::ToLens, numbers, &mut workspace);
        let mut contributions = Vec::new();
        pair.connect(reach(scene, 1).max_edges, &mut contributions);
        let states = || contributions.iter().filter(|one| is_state(one, self.separate_direct));
        let total: f64 = states().map(Contribution::luminance).sum();
        // One path stands for all of the pair, chosen by its share: a pool of as many candidates as pairs.
        let mut left = total * IndependentSampler::stream(seed, Stream::Choice, index).next_f64();
        let mut chosen = None;
        for one in states().filter(|one| one.luminance() > 0.0) {
            chosen = Some(PathSeed { draw: index, s: one.s, t: one.t });
            left -= one.luminance();
            if left < 0.0 {
                break;
            }
        }
        found.extend(chosen.map(|chosen| (chosen, total)));
    }

    fn start<'s>(
        &self,
        scene: &'s Scene,
        seed: u64,
        from: &PathSeed,
        index: u64,
    ) -> Option<PathWalker<'s>> {
        let mut workspace = Workspace::default();
        let numbers = IndependentSampler::stream(seed, Stream::Bootstrap, from.draw);
        let path =
            walks(scene, Strategies::ToLens, numbers, &mut workspace).path(from.s, from.t)?;
        Some(PathWalker {
            chain: Chain::new(path, Changes::NAMES.len()),
            numbers: IndependentSampler::stream(seed, Stream::Chain, index),
        })
    }

    fn mutate<'s>(
        &self,
        scene: &'s Scene,
        walker: &mut PathWalker<'s>,
        mutations: u64,
        splats: &mut Vec<Splat>,
    ) {
        let PathWalker { chain, numbers } = walker;
        let mut record = |path: &Path<'s>, weight: f64| splats.push(splat(path).weighted(weight));
        let mut changes = Changes::new(scene, self.mutations, shortest(self.separate_direct));
        for _ in 0..mutations {
            chain.step(&mut changes, numbers, &mut record);
        }
        chain.flush(&mut record);
    }

    fn statistics<'w>(&self, walker: &'w PathWalker<'_>) -> &'w Statistics {
        walker.chain.statistics()
    }
}

/// A path's light, of luminance 1, where it falls.
pub(super) fn splat(path: &Path<'_>) -> Splat {
    let [diffuse, specular] = path.colour();
    Splat { raster: path.lens().0, diffuse, specular }
}
