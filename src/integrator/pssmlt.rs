//! Metropolis sampling in primary sample space.

use super::{MarkovChains, PathTracing, Splat};
use crate::mcmc::{Chain, Failure, Kernels, LogUniform, Proposal, Statistics};
use crate::sampler::{IndependentSampler, PrimarySampler, Sampler, Stream};
use crate::scene::Scene;
use glam::Vec2;

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
    /// Samples that give the normalisation and the chains' seeds, both halves together.
    pub bootstrap_samples: u32,
}

/// What a point of primary sample space stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PrimaryPaths {
    /// A walk from the camera, with all the light found on it.
    Camera(PathTracing),
}

impl Default for Pssmlt {
    fn default() -> Self {
        Self {
            paths: PrimaryPaths::Camera(PathTracing::default()),
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
pub struct PrimaryWalker {
    chain: Chain<Found>,
    primary: PrimarySampler,
    /// For the decisions of the chain; the primary sampler has its own.
    numbers: IndependentSampler,
}

/// The two mutations, in the order of [`Pssmlt::names`].
struct Steps<'a> {
    settings: &'a Pssmlt,
    scene: &'a Scene,
    primary: &'a mut PrimarySampler,
}

/// Index of the mutation that makes all numbers new.
const LARGE: usize = 0;

impl Pssmlt {
    /// The sample that these numbers make. The first pair is the place on the film.
    fn find<S: Sampler>(&self, scene: &Scene, numbers: &mut S) -> Found {
        let raster = scene.film.crop_point(numbers.next_2d());
        let has_lens = scene.camera.aperture_radius() > 0.0;
        let lens = if has_lens { numbers.next_2d() } else { Vec2::ZERO };
        let splats = match self.paths {
            PrimaryPaths::Camera(path_tracing) => {
                let ray = scene.camera.ray(raster, lens);
                let sample = path_tracing.trace(scene, ray, numbers);
                vec![Splat { raster, diffuse: sample.diffuse, specular: sample.specular }]
            }
        };
        let luminance = |splat: &Splat| f64::from((splat.diffuse + splat.specular).luminance());
        Found { luminance: splats.iter().map(luminance).sum(), splats }
    }

    fn small_step(&self) -> LogUniform {
        LogUniform::new(self.shortest_step, self.longest_step)
    }
}

impl MarkovChains for Pssmlt {
    /// Index of the draw.
    type Seed = u64;
    type Walker<'s> = PrimaryWalker;

    fn names(&self) -> &'static [&'static str] {
        &["large step", "small step"]
    }

    fn draws(&self) -> u32 {
        self.bootstrap_samples
    }

    fn draw(&self, scene: &Scene, seed: u64, index: u64, found: &mut Vec<(u64, f64)>) {
        let mut numbers = IndependentSampler::stream(seed, Stream::Bootstrap, index);
        found.push((index, self.find(scene, &mut numbers).luminance));
    }

    fn start(&self, scene: &Scene, seed: u64, from: &u64, index: u64) -> Option<PrimaryWalker> {
        let first = IndependentSampler::stream(seed, Stream::Bootstrap, *from);
        let mut primary = PrimarySampler::new(first, self.small_step());
        let found = self.find(scene, &mut primary);
        if !(found.luminance.is_finite() && found.luminance > 0.0) {
            return None;
        }
        primary.change_by(IndependentSampler::stream(seed, Stream::Chain, 2 * index));
        Some(PrimaryWalker {
            chain: Chain::new(found, self.names().len()),
            primary,
            numbers: IndependentSampler::stream(seed, Stream::Chain, 2 * index + 1),
        })
    }

    fn mutate(
        &self,
        scene: &Scene,
        walker: &mut PrimaryWalker,
        mutations: u64,
        splats: &mut Vec<Splat>,
    ) {
        let PrimaryWalker { chain, primary, numbers } = walker;
        let mut record = |found: &Found, weight: f64| {
            let scale = weight / found.luminance;
            splats.extend(found.splats.iter().map(|splat| splat.weighted(scale)));
        };
        let mut steps = Steps { settings: self, scene, primary };
        for _ in 0..mutations {
            chain.step(&mut steps, numbers, &mut record);
        }
        chain.flush(&mut record);
    }

    fn statistics<'w>(&self, walker: &'w PrimaryWalker) -> &'w Statistics {
        walker.chain.statistics()
    }
}

impl Kernels for Steps<'_> {
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
        let found = self.settings.find(self.scene, self.primary);
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
