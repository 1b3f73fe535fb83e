//! Energy redistribution path tracing.

use super::Splat;
use super::bdpt::{Bdpt, Workspace};
use super::changes::{Changes, Mutations, reach};
use super::mlt::{is_state, shortest, splat, walks};
use crate::mcmc::{Chain, Statistics};
use crate::sampler::{IndependentSampler, Sampler, SobolSampler, Stream};
use crate::scene::Scene;
use crate::transport::connect::{Contribution, Pair, Strategies};
use crate::transport::mis::Heuristic;
use crate::transport::path::Path;
use glam::Vec2;
use serde::{Deserialize, Serialize};

/// Energy redistribution path tracing (Cline, Talbot and Egbert 2005, "Energy Redistribution Path Tracing"): samples of path
/// tracing whose energy short chains of mutations spread over the film, in deposits of one size. Prefer it where path
/// tracing finds light now and then and a mutation finds more of it nearby; unlike Metropolis light transport it stays
/// stratified over the film.
///
/// Energy flows as often from a path to another as back, so that the mean of the picture is that of the samples for any
/// length of the chains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Erpt {
    /// What finds the paths that chains start with.
    pub seeds: Strategies,
    /// Which mutations there are; the bidirectional one is off, for chains need not reach everything.
    pub mutations: Mutations,
    /// Mutations of a chain.
    pub chain_length: u32,
    /// Mutations for each sample, on average over the picture: fewer where a pass over a large picture would take long.
    pub mutations_per_sample: u32,
    /// Most chains that one path may start. A path of more energy gets larger deposits instead, so that nothing is lost.
    pub most_chains: u32,
    /// Is light of at most one bounce, which path tracing finds easily, left to it?
    pub separate_direct: bool,
    /// Drops what a chain deposits on one path beyond so many deposits in a row, which takes spikes away, and energy with
    /// them: the picture gets darker, by as much as the report says.
    pub consecutive_limit: Option<u32>,
    /// Replaces pixels that are more than so many times the median of the proposals around them by it: biased, too.
    pub proposal_limit: Option<f32>,
}

impl Default for Erpt {
    fn default() -> Self {
        Self {
            seeds: Strategies::ToLens,
            mutations: Mutations { bidirectional: false, ..Mutations::default() },
            chain_length: 100,
            mutations_per_sample: 16,
            most_chains: 1000,
            separate_direct: true,
            consecutive_limit: None,
            proposal_limit: None,
        }
    }
}

/// What became of the energy of some samples. Energies are luminance in units of a pixel's value.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// Energy of all paths that samples found.
    pub found: f64,
    /// Energy of the chains started: that of the paths, in expectation.
    pub started: f64,
    /// Energy deposited on the film.
    pub deposited: f64,
    /// Energy dropped by the limit of consecutive deposits.
    pub lost: f64,
    /// Chains.
    pub chains: u64,
    /// Paths whose chains were limited in number.
    pub capped: u64,
    /// Paths whose energy was not a number.
    pub invalid: u64,
    /// How the mutations fared.
    pub statistics: Statistics,
}

impl Ledger {
    /// Adds another's entries.
    pub fn merge(&mut self, other: &Self) {
        self.found += other.found;
        self.started += other.started;
        self.deposited += other.deposited;
        self.lost += other.lost;
        self.chains += other.chains;
        self.capped += other.capped;
        self.invalid += other.invalid;
        self.statistics.merge(&other.statistics);
    }
}

/// What the samples of some pixels leave on the film.
#[derive(Clone, Debug, Default)]
pub struct Deposits {
    /// Energy, in units of a pixel's value for one sample per pixel.
    pub splats: Vec<Splat>,
    /// The same energy at every proposal, accepted or not; only for [`Erpt::proposal_limit`].
    pub proposals: Vec<Splat>,
    /// What became of it.
    pub ledger: Ledger,
}

/// What the energy of one path becomes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// Chains that start with it.
    pub chains: u64,
    /// What each of their mutations deposits.
    pub deposit: f64,
    /// Is that more than it should be, because the chains are limited in number?
    pub is_capped: bool,
}

/// One sample per pixel: which, and how much energy a deposit has.
#[derive(Clone, Copy, Debug)]
pub struct Pass {
    /// Seed of the whole picture.
    pub seed: u64,
    /// Which sample of each pixel.
    pub sample: u32,
    /// Luminance that a mutation deposits, in units of a pixel's value.
    pub deposit: f64,
}

impl Erpt {
    /// Names of the mutations.
    pub const NAMES: &'static [&'static str] = Changes::NAMES;

    /// Energy that a sample finds, by the draw of that index: its mean sets the size of deposits.
    pub fn probe(&self, scene: &Scene, seed: u64, index: u64) -> f64 {
        let mut workspace = Workspace::default();
        let numbers = IndependentSampler::stream(seed, Stream::Bootstrap, index);
        let mut found = Vec::new();
        walks(scene, self.seeds, numbers, &mut workspace).connect(max_depth(scene), &mut found);
        let energies = found
            .iter()
            .filter(|one| is_state(one, self.separate_direct))
            .map(Contribution::luminance);
        energies.filter(|energy| energy.is_finite()).sum()
    }

    /// Takes one sample of the pixel and spreads its energy.
    pub fn spread<'s>(
        &self,
        scene: &'s Scene,
        [x, y]: [u32; 2],
        pass: Pass,
        workspace: &mut Workspace<'s>,
        deposits: &mut Deposits,
    ) {
        let pixel = y * scene.film.width + x;
        let mut sampler = SobolSampler::new(pass.seed, pixel, pass.sample);
        let stream = u64::from(pass.sample) << 32 | u64::from(pixel);
        let mut numbers = IndependentSampler::stream(pass.seed, Stream::Chain, stream);
        let raster = Vec2::new(x as f32, y as f32) + sampler.next_2d();
        let lens = sampler.next_2d_if(scene.camera.has_lens());
        let bdpt = Bdpt { heuristic: Heuristic::Power, strategies: self.seeds };
        let pair = bdpt.walk(scene, raster, lens, &mut sampler, workspace);
        let mut found = Vec::new();
        pair.connect(max_depth(scene), &mut found);
        for one in found.iter().filter(|one| is_state(one, self.separate_direct)) {
            self.spread_one(scene, &pair, one, pass.deposit, &mut numbers, deposits);
        }
    }

    /// Equal deposition flow (Cline et al. 2005, section 4.3): a random number of chains whose deposits are, on average, the
    /// energy of the path.
    fn spread_one<'s>(
        &self,
        scene: &'s Scene,
        pair: &Pair<'_, 's>,
        found: &Contribution,
        deposit: f64,
        numbers: &mut IndependentSampler,
        deposits: &mut Deposits,
    ) {
        let energy = found.luminance();
        if !energy.is_finite() {
            deposits.ledger.invalid += 1;
            return;
        }
        deposits.ledger.found += energy;
        let Share { chains, deposit, is_capped } = self.share(energy, deposit, numbers.next_f64());
        if chains == 0 {
            return;
        }
        deposits.ledger.capped += u64::from(is_capped);
        deposits.ledger.chains += chains;
        deposits.ledger.started += chains as f64 * f64::from(self.chain_length) * deposit;
        let Some(path) = pair.path(found.s, found.t) else {
            // Rounding made a path of it that carries nothing: the energy stays where it was found.
            let all = chains as f64 * f64::from(self.chain_length) * deposit;
            let luminance = f64::from((found.diffuse + found.specular).luminance());
            deposits.splats.push(Splat::from(found).weighted(all / luminance));
            deposits.ledger.deposited += all;
            return;
        };
        for _ in 0..chains {
            self.run(scene, path.clone(), deposit, numbers, deposits);
        }
    }

    /// Divides that energy among chains whose mutations should deposit `deposit` each, by the number `u` in `[0, 1)`: over all
    /// `u` the chains carry as much as there is.
    pub fn share(&self, energy: f64, deposit: f64, u: f64) -> Share {
        let length = f64::from(self.chain_length);
        let most = f64::from(self.most_chains);
        let wanted = energy / (length * deposit);
        if wanted > most {
            let deposit = energy / (length * most);
            Share { chains: u64::from(self.most_chains), deposit, is_capped: true }
        } else {
            Share { chains: (u + wanted) as u64, deposit, is_capped: false }
        }
    }

    fn run<'s>(
        &self,
        scene: &'s Scene,
        path: Path<'s>,
        deposit: f64,
        numbers: &mut IndependentSampler,
        deposits: &mut Deposits,
    ) {
        let Deposits { splats, proposals, ledger } = deposits;
        let mut changes = Changes::new(scene, self.mutations, shortest(self.separate_direct));
        let mut chain = Chain::new(path, Changes::NAMES.len());
        let limit = self.consecutive_limit.map_or(f64::INFINITY, f64::from);
        let mut record = |path: &Path<'s>, weight: f64| {
            let kept = weight.min(limit);
            ledger.lost += (weight - kept) * deposit;
            ledger.deposited += kept * deposit;
            splats.push(splat(path).weighted(kept * deposit));
        };
        for _ in 0..self.chain_length {
            if self.proposal_limit.is_some() {
                changes.watch(chain.state());
            }
            chain.step(&mut changes, numbers, &mut record);
            proposals.extend(changes.proposed().map(|proposed| proposed.weighted(deposit)));
        }
        chain.flush(&mut record);
        ledger.statistics.merge(chain.statistics());
    }
}

fn max_depth(scene: &Scene) -> u32 {
    reach(scene, 1).max_edges
}

#[cfg(test)]
mod tests {
    use super::*;

    /// METHODS N.9: b = 0.5, one chain of 100 mutations a sample: deposits of 0.005.
    #[test]
    fn energy_makes_chains_as_in_the_worked_example() {
        let erpt = Erpt::default();
        // 5 makes 10 chains; for u just below 1 rounding may not make an eleventh.
        for u in [0.0, 0.5, 0.999_999] {
            assert_eq!(erpt.share(5.0, 0.005, u).chains, 10);
        }
        // 0.025 makes one chain in twenty.
        assert_eq!([0.94, 0.96].map(|u| erpt.share(0.025, 0.005, u).chains), [0, 1]);
    }

    #[test]
    fn chains_carry_the_energy_of_their_path_on_average() {
        let erpt = Erpt::default();
        let mut numbers = IndependentSampler::new(4, 0, 0);
        for wanted in [1e-3, 0.3, 7.5, 1e9, 1e12] {
            let (n, length) = (200_000, f64::from(erpt.chain_length));
            let mut carried = 0.0;
            for _ in 0..n {
                let share = erpt.share(wanted * length * 0.01, 0.01, numbers.next_f64());
                assert!(share.chains <= u64::from(erpt.most_chains));
                carried += share.chains as f64 * share.deposit / 0.01;
            }
            // The random part is a Bernoulli variable of the fraction; 4.5 standard errors.
            let fraction: f64 = wanted.fract();
            let error = (fraction * (1.0 - fraction) / f64::from(n)).sqrt() + 1e-9 * wanted;
            let mean = carried / f64::from(n);
            assert!((mean - wanted).abs() < 4.5 * error, "{wanted}: {mean}");
        }
    }
}
