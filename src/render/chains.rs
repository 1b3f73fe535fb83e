//! Rounds of Markov chains.
//!
//! Chains run whole, one after another: what one leaves behind is on the film, so that a render that goes on, or one that
//! several machines share, needs no chain under way.

use super::method::{Found, Method, Report};
use super::sampled::Sampled;
use super::spread::{Moments, Spread};
use super::units::run_units;
use super::{Budget, RenderSettings, Shard};
use crate::film::{Scale, SplatFilm};
use crate::integrator::MarkovChains;
use crate::mcmc::{Bootstrap, Failure, Statistics};
use crate::sampler::{IndependentSampler, Stream};
use crate::scene::Scene;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Mutations that a chain should make. Seeds that stand for the light need no chain to wander far, and a chain that is caught
/// by one bright path makes a spike of its whole share of the light: in the caustic pool 256 chains of 250 000 mutations
/// left 80 times the squared error of energy redistribution, whose chains are of 100. (Mitsuba 0.6 takes 200 000.)
const MUTATIONS_PER_CHAIN: u64 = 10_000;

/// Fewest chains: enough for 64 threads and for two halves that each know how much their chains differ.
const FEWEST_CHAINS: u64 = 64;

/// Where only the time is known: about what a thread makes in a second, and fewest mutations of a chain.
const MUTATIONS_PER_SECOND: f64 = 1e5;
const SHORTEST_OF_TIME: u64 = 100;

/// Mutations in a round, of all chains together, unless there are many threads: below a second of two.
const ROUND: u64 = 1 << 17;

/// Fewest chains in a round for each thread, so that none waits long for the others.
const CHAINS_PER_THREAD: usize = 4;

/// Mutations for each draw of the bootstrap: a draw costs about three mutations, and thus a fifth of the time.
const MUTATIONS_PER_DRAW: u64 = 16;

/// The same where only the time is known, for each thread: about a tenth of what it could make.
const DRAWS_PER_SECOND: f64 = 1e4;

/// Most draws: what they leave in memory is some 130 MB.
const MOST_DRAWS: u64 = 1 << 22;

/// Draws of the bootstrap that a thread makes at once.
const DRAWS_AT_ONCE: u64 = 512;

/// Where the spread among chains is this many times that which each has within itself, they have not seen the same
/// (Gelman and Rubin 1992, "Inference from Iterative Simulation Using Multiple Sequences": 1.1 is their bound of concern for
/// the square root).
const DISAGREEMENT: f64 = 1.1;

/// A render by Markov chains under way. The halves are independent altogether: each has its own pool of candidates, and with
/// it its own normalisation and seeds.
#[derive(Debug)]
pub(super) struct Chains<'a, M: MarkovChains> {
    scene: &'a Scene,
    method: M,
    seed: u64,
    shard: Shard,
    /// Candidates of each half, and the number that the places of its seeds begin with.
    pools: [(Bootstrap<M::Seed>, f64); 2],
    /// Light that the chains leave to path tracing.
    direct: Option<Sampled<'a>>,
    found: Splats,
}

/// What chains have left behind.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Splats {
    film: SplatFilm,
    /// Pixels of the crop window.
    pixels: u64,
    /// Names of the mutations.
    names: Vec<String>,
    /// Draws of both pools.
    draws: u64,
    /// Mutations of a chain; the last one may have fewer.
    length: u64,
    /// Normalisation and its standard error, from each half's pool.
    normalisation: [(f64, f64); 2],
    /// The chain that comes next, and the mutations that all before it make together, also those of other shards. Chains of
    /// even index belong to half 0, those of odd index to half 1.
    next: u64,
    position: u64,
    /// Mutations due to the chains so far, and those made in each half: none where there is no candidate to start from.
    done: u64,
    mutations: [u64; 2],
    /// Chains that ran.
    chains: u64,
    statistics: Statistics,
    spread: Spread,
    /// Candidates whose weight was not finite.
    invalid: u64,
}

/// One chain.
#[derive(Clone, Debug)]
struct Unit {
    index: u64,
    mutations: u64,
    outcome: Option<(Statistics, Moments)>,
}

impl Unit {
    fn half(&self) -> usize {
        (self.index & 1) as usize
    }
}

impl<'a, M: MarkovChains> Chains<'a, M> {
    /// Makes the pools of candidates, on the threads of the current rayon pool; goes on from what was `found`.
    pub(super) fn new(
        scene: &'a Scene,
        method: M,
        settings: &RenderSettings,
        found: Option<(Splats, Option<Sampled<'a>>)>,
    ) -> Self {
        let pixels = scene.film.crop_pixels();
        let draws = match &found {
            Some((found, _)) => found.draws,
            None => draws(&method, settings.budget, pixels),
        };
        let pools = [0, 1].map(|half| {
            let mut numbers = IndependentSampler::stream(settings.seed, Stream::Seeds, half);
            (pool(scene, &method, settings.seed, half, draws), numbers.next_f64())
        });
        let (found, direct) = found.unwrap_or_else(|| {
            let found = Splats {
                // The squares are not the variance, but they have its shape from pixel to pixel; the halves give its size.
                film: SplatFilm::of_independent(scene.film),
                pixels,
                names: method.names().iter().map(|&name| name.to_owned()).collect(),
                draws,
                length: length(settings.budget, pixels),
                normalisation: [0, 1].map(|half: usize| {
                    let pool = &pools[half].0;
                    (pool.mean(), pool.error())
                }),
                next: 0,
                position: 0,
                done: 0,
                mutations: [0; 2],
                chains: 0,
                statistics: Statistics::new(method.names().len()),
                spread: Spread::default(),
                invalid: pools.iter().map(|(pool, _)| pool.invalid()).sum(),
            };
            (found, method.direct().then(|| Sampled::of_direct(scene, settings)))
        });
        let (seed, shard) = (settings.seed, settings.shard);
        Self { scene, method, seed, shard, pools, direct, found }
    }

    /// The chains of the next round, those of this shard only.
    fn take(&mut self, most: u32) -> Vec<Unit> {
        let found = &mut self.found;
        let total = found.pixels * u64::from(most);
        let wanted = ROUND.div_ceil(found.length) as usize;
        let wanted = wanted.max(CHAINS_PER_THREAD * rayon::current_num_threads());
        let mut units = Vec::new();
        while found.position < total && units.len() < wanted {
            let mutations = found.length.min(total - found.position);
            if self.shard.has(found.next) {
                units.push(Unit { index: found.next, mutations, outcome: None });
            }
            found.next += 1;
            found.position += mutations;
        }
        units
    }
}

/// Draws of the bootstrap: the error of the normalisation is one of brightness that no mutation makes smaller, so that longer
/// renders make more of them.
fn draws<M: MarkovChains>(method: &M, budget: Budget, pixels: u64) -> u64 {
    let affordable = match budget {
        Budget::Samples(samples) => pixels * u64::from(samples) / MUTATIONS_PER_DRAW,
        Budget::Time(time) => {
            (time.as_secs_f64() * DRAWS_PER_SECOND * rayon::current_num_threads() as f64) as u64
        }
    };
    affordable.clamp(u64::from(method.draws()), MOST_DRAWS.max(u64::from(method.draws())))
}

/// Mutations of a chain: as many as it should make, or fewer, so that there are enough chains, as many in both halves.
fn length(budget: Budget, pixels: u64) -> u64 {
    match budget {
        Budget::Samples(samples) => {
            let total = pixels * u64::from(samples);
            let chains = total.div_ceil(MUTATIONS_PER_CHAIN).max(FEWEST_CHAINS);
            total.div_ceil(chains.next_multiple_of(2)).max(1)
        }
        Budget::Time(time) => {
            let threads = rayon::current_num_threads() as f64;
            let total = time.as_secs_f64() * MUTATIONS_PER_SECOND * threads;
            ((total / FEWEST_CHAINS as f64) as u64).clamp(SHORTEST_OF_TIME, MUTATIONS_PER_CHAIN)
        }
    }
}

/// The candidates of one half.
fn pool<M: MarkovChains>(
    scene: &Scene,
    method: &M,
    seed: u64,
    half: u64,
    draws: u64,
) -> Bootstrap<M::Seed> {
    let draws = draws.div_ceil(2);
    let part = |first: u64| {
        let mut pool = Bootstrap::default();
        let mut found = Vec::new();
        for draw in first..(first + DRAWS_AT_ONCE).min(draws) {
            method.draw(scene, seed, 2 * draw + half, &mut found);
            pool.add_draw(found.drain(..));
        }
        pool
    };
    let starts: Vec<u64> = (0..draws).step_by(DRAWS_AT_ONCE as usize).collect();
    let parts: Vec<Bootstrap<M::Seed>> = starts.into_par_iter().map(part).collect();
    let mut pool = Bootstrap::default();
    parts.into_iter().for_each(|part| pool.append(part));
    pool
}

impl<M: MarkovChains> Method for Chains<'_, M> {
    fn round(&mut self, most: u32) {
        let mut units = self.take(most);
        let Self { scene, method, seed, pools, found, .. } = self;
        run_units(&mut units, &mut found.film, |unit, splats| {
            let half = unit.half();
            let (pool, u) = &pools[half];
            let Some(from) = pool.seed(unit.index / 2, *u) else { return half };
            let walker = method.start(scene, *seed, from, unit.index);
            debug_assert!(walker.is_some(), "a seed was not found again: {from:?}");
            if let Some(mut walker) = walker {
                method.mutate(scene, &mut walker, unit.mutations, splats);
                let mut place = Moments::default();
                splats.iter().for_each(|splat| place.add(splat));
                unit.outcome = Some((method.statistics(&walker).clone(), place));
            }
            half
        });
        for unit in units {
            found.done += unit.mutations;
            let half = unit.half();
            if let Some((statistics, place)) = unit.outcome {
                found.chains += 1;
                found.mutations[half] += unit.mutations;
                found.statistics.merge(&statistics);
                found.spread.add(&place);
            }
        }
        let samples = (found.position / found.pixels) as u32;
        if let Some(direct) = &mut self.direct {
            direct.keep_up(samples);
        }
    }

    fn is_complete(&self, most: u32) -> bool {
        self.found.position >= self.found.pixels * u64::from(most)
    }

    fn found(&self) -> Found<'_> {
        let direct = self.direct.as_ref().map(|direct| Cow::Borrowed(direct.taken()));
        Found::Chains(Cow::Borrowed(&self.found), direct)
    }
}

impl Splats {
    pub(super) fn film(&self) -> &SplatFilm {
        &self.film
    }

    /// What the film's sums must be multiplied by: `b · pixels / mutations` of each half.
    pub(super) fn scale(&self) -> Scale {
        let half = [0, 1].map(|half| {
            let mutations = self.mutations[half] as f64;
            let b = self.normalisation[half].0;
            if mutations > 0.0 { b * self.pixels as f64 / mutations } else { 0.0 }
        });
        let weight = match self.mutations {
            // So few that one half has none.
            [_, 0] => [1.0, 0.0],
            [0, _] => [0.0, 1.0],
            _ => [0.5; 2],
        };
        Scale { half, weight }
    }

    /// Mutations of the whole picture.
    pub(super) fn done(&self) -> u64 {
        self.done
    }

    pub(super) fn samples(&self) -> u32 {
        per_pixel(self.done, self.pixels)
    }

    pub(super) fn invalid(&self) -> u64 {
        let kernels = self.statistics.kernels.iter();
        let not_finite = kernels.map(|kernel| kernel.failures[Failure::NotFinite as usize]);
        self.film.invalid_splats() + self.invalid + not_finite.sum::<u64>()
    }

    /// Adds what other chains of the same picture left.
    pub(super) fn merge(&mut self, other: &Self) {
        self.film.merge(&other.film);
        self.next = self.next.max(other.next);
        self.position = self.position.max(other.position);
        self.done += other.done;
        self.mutations = [0, 1].map(|half: usize| self.mutations[half] + other.mutations[half]);
        self.chains += other.chains;
        self.statistics.merge(&other.statistics);
        self.spread.merge(&other.spread);
    }

    pub(super) fn report(&self) -> Report {
        let mut report = Report::default();
        let mut tell = |name: &str, value: String| report.facts.push((name.to_owned(), value));
        let [(a, error_a), (b, error_b)] = self.normalisation;
        let (mean, error) = (0.5 * (a + b), 0.5 * error_a.hypot(error_b));
        tell("normalisation", format!("{mean:.6e} ± {error:.1e}"));
        tell("chains", format!("{} of {} mutations", self.chains, self.length));
        let names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        for (name, line) in names.iter().zip(self.statistics.lines(&names)) {
            let line = line.strip_prefix(&format!("{name}: ")).unwrap_or(&line).to_owned();
            tell(&format!("mutation {name}"), line);
        }
        tell("longest_stay", format!("{} mutations", self.statistics.longest_stay));
        let disagreement = self.spread.disagreement();
        if let Some(disagreement) = disagreement {
            tell("chains_disagreement", format!("{disagreement:.3}"));
        }
        if self.chains == 0 {
            report
                .warnings
                .push(format!("no light found by {} samples: the picture is black", self.draws));
        }
        if disagreement.is_some_and(|disagreement| disagreement > DISAGREEMENT) {
            report.warnings.push(
                "the chains disagree about where the light is: expect blotches, or take more mutations"
                    .to_owned(),
            );
        }
        report
    }
}

/// Mutations per pixel, rounded down; the most that there may be where whole rounds of all chains went beyond it.
fn per_pixel(mutations: u64, pixels: u64) -> u32 {
    (mutations / pixels).try_into().unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::per_pixel;

    #[test]
    fn more_mutations_than_32_bits_hold_are_not_counted_from_0_again() {
        assert_eq!(per_pixel(1_000_000_000, 1), 1_000_000_000);
        assert_eq!(per_pixel(1 << 40, 65_536 * 65_536), 256);
        // 4096 chains of 2²⁰ mutations for one pixel: the time was longer than its counter.
        assert_eq!(per_pixel(1 << 32, 1), u32::MAX);
    }
}
