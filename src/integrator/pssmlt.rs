//! Metropolis sampling in primary sample space.

use super::bdpt::{Bdpt, Workspace};
use super::{MarkovChains, PathTracing, Splat};
use crate::mcmc::{Chain, Failure, Kernels, LogUniform, Proposal, Statistics};
use crate::sampler::{IndependentSampler, PrimarySampler, Sampler, Stream};
use crate::scene::Scene;

/// Kelemen's method (Kelemen et al. 2002, "A Simple and Robust Mutation Strategy for the Metropolis Light Transport
/// Algorithm"): another sampler's random numbers are the state of the chain, and the luminance of the sample that they make
/// is its target. Prefer it where paths are hard to find but stay found when changed a little, and to check the other
/// methods by: it knows nothing of paths. In an easy scene it only makes the noise uglier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pssmlt {
    /// What makes a sample out of the numbers.
    pub paths: PrimaryPaths,
    /// Probability of making all numbers new: often enough to find what small steps cannot reach, seldom enough to stay
    /// where light was found. Kelemen et al. take 0.1 to 0.5. Must be in `(0, 1]`.
    pub large_step: f64,
    /// Shortest small step of a number. The picture is 1 wide, so that this is a pixel of 1024.
    pub shortest_step: f64,
    /// Longest small step of a number.
    pub longest_step: f64,
    /// Fewest samples that give the normalisation and the chains' seeds, both halves together.
    pub bootstrap_samples: u32,
}

/// What a point of primary sample space stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PrimaryPaths {
    /// A walk from the camera, with all the light found on it: one splat for each mutation, and cheap.
    Camera(PathTracing),
    /// Two walks, with everything that joins them: many splats for each mutation, also where the walk from the camera did
    /// not go.
    Bidirectional(Bdpt),
}

impl Default for Pssmlt {
    fn default() -> Self {
        Self {
            paths: PrimaryPaths::Bidirectional(Bdpt::default()),
            large_step: 0.3,
            shortest_step: 1.0 / 1024.0,
            longest_step: 1.0 / 64.0,
            bootstrap_samples: 100_000,
        }
    }
}

/// All light that one point of primary sample space stands for.
#[derive(Clone, Debug)]
pub struct Found {
    /// As much as one sample of a uniform draw of the crop window adds to the sum over its pixels.
    splats: Vec<Splat>,
    /// Luminance of all splats: the target density.
    luminance: f64,
}

/// A chain in primary sample space.
#[derive(Debug)]
pub struct PrimaryWalker<'s> {
    chain: Chain<Found>,
    workspace: Workspace<'s>,
    primary: PrimarySampler,
    /// For the decisions of the chain; the primary sampler has its own.
    numbers: IndependentSampler,
}

/// The two mutations, in the order of [`Pssmlt::names`].
struct Steps<'a, 's> {
    settings: &'a Pssmlt,
    scene: &'s Scene,
    primary: &'a mut PrimarySampler,
    workspace: &'a mut Workspace<'s>,
}

/// Index of the mutation that makes all numbers new.
const LARGE: usize = 0;

impl Pssmlt {
    /// The sample that these numbers make. The first pair is the place on the film. Light outside of the crop window is
    /// none, so that chains do not go there.
    fn find<'s, S: Sampler>(
        &self,
        scene: &'s Scene,
        numbers: &mut S,
        workspace: &mut Workspace<'s>,
    ) -> Found {
        let raster = scene.film.crop_point(numbers.next_2d());
        let lens = numbers.next_2d_if(scene.camera.has_lens());
        let mut found = Found { splats: Vec::new(), luminance: 0.0 };
        match self.paths {
            PrimaryPaths::Camera(path_tracing) => {
                let ray = scene.camera.ray(raster, lens);
                let sample = path_tracing.trace(scene, ray, numbers);
                let (diffuse, specular) = (sample.diffuse, sample.specular);
                found.add(scene, Splat { raster, diffuse, specular }, 1.0);
            }
            PrimaryPaths::Bidirectional(bdpt) => {
                let mut contributions = Vec::new();
                bdpt.trace(scene, raster, lens, numbers, workspace, &mut contributions);
                for one in contributions {
                    found.add(scene, Splat::from(&one), one.weight);
                }
            }
        }
        found
    }

    fn small_step(&self) -> LogUniform {
        LogUniform::new(self.shortest_step, self.longest_step)
    }
}

impl Found {
    /// Adds light of that weight. What is not finite makes the luminance so, too, and the chain does not go there.
    fn add(&mut self, scene: &Scene, splat: Splat, weight: f64) {
        let luminance = f64::from((splat.diffuse + splat.specular).luminance()) * weight;
        let is_seen = !splat.raster.is_finite() || scene.film.crop_pixel(splat.raster).is_some();
        if is_seen && luminance != 0.0 {
            self.luminance += luminance;
            self.splats.push(splat.weighted(weight));
        }
    }
}

impl MarkovChains for Pssmlt {
    /// Index of the draw.
    type Seed = u64;
    type Walker<'s> = PrimaryWalker<'s>;

    fn names(&self) -> &'static [&'static str] {
        &["large step", "small step"]
    }

    fn draws(&self) -> u32 {
        self.bootstrap_samples
    }

    fn draw(&self, scene: &Scene, seed: u64, index: u64, found: &mut Vec<(u64, f64)>) {
        let mut numbers = IndependentSampler::stream(seed, Stream::Bootstrap, index);
        let workspace = &mut Workspace::default();
        found.push((index, self.find(scene, &mut numbers, workspace).luminance));
    }

    fn start<'s>(
        &self,
        scene: &'s Scene,
        seed: u64,
        from: &u64,
        index: u64,
    ) -> Option<PrimaryWalker<'s>> {
        let mut workspace = Workspace::default();
        let first = IndependentSampler::stream(seed, Stream::Bootstrap, *from);
        let mut primary = PrimarySampler::new(first, self.small_step());
        let found = self.find(scene, &mut primary, &mut workspace);
        if !(found.luminance.is_finite() && found.luminance > 0.0) {
            return None;
        }
        primary.change_by(IndependentSampler::stream(seed, Stream::Chain, 2 * index));
        Some(PrimaryWalker {
            chain: Chain::new(found, self.names().len()),
            workspace,
            primary,
            numbers: IndependentSampler::stream(seed, Stream::Chain, 2 * index + 1),
        })
    }

    fn mutate<'s>(
        &self,
        scene: &'s Scene,
        walker: &mut PrimaryWalker<'s>,
        mutations: u64,
        splats: &mut Vec<Splat>,
    ) {
        let PrimaryWalker { chain, workspace, primary, numbers } = walker;
        let mut record = |found: &Found, weight: f64| {
            let scale = weight / found.luminance;
            splats.extend(found.splats.iter().map(|splat| splat.weighted(scale)));
        };
        let mut steps = Steps { settings: self, scene, primary, workspace };
        for _ in 0..mutations {
            chain.step(&mut steps, numbers, &mut record);
        }
        chain.flush(&mut record);
    }

    fn statistics<'w>(&self, walker: &'w PrimaryWalker<'_>) -> &'w Statistics {
        walker.chain.statistics()
    }
}

impl Kernels for Steps<'_, '_> {
    type State = Found;

    fn names(&self) -> &'static [&'static str] {
        self.settings.names()
    }

    fn selection(&self, kernel: usize, _: &Found) -> f64 {
        let large = self.settings.large_step;
        if kernel == LARGE { large } else { 1.0 - large }
    }

    fn propose(
        &mut self,
        kernel: usize,
        state: &Found,
        _: &mut IndependentSampler,
    ) -> Result<Proposal<Found>, Failure> {
        self.primary.mutate(kernel == LARGE);
        let found = self.settings.find(self.scene, self.primary, self.workspace);
        let target = [state.luminance, found.luminance];
        Ok(Proposal::symmetric(found, target))
    }

    fn settle(&mut self, is_accepted: bool) {
        if is_accepted {
            self.primary.accept();
        } else {
            self.primary.reject();
        }
    }
}
