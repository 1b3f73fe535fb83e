//! Rounds of Markov chains.

use super::method::{Method, Report, replace_radiance};
use super::sampled::Sampled;
use super::units::run_units;
use super::{Budget, RenderSettings};
use crate::film::{Radiance, Scale, SplatFilm};
use crate::integrator::{MarkovChains, Splat};
use crate::mcmc::{Bootstrap, Failure, Statistics};
use crate::sampler::{IndependentSampler, Stream};
use crate::scene::Scene;
use quietlight_denoise::Layers;
use rayon::prelude::*;

/// Mutations that a chain should make. Seeds that stand for the light need no chain to wander far, and a chain that is caught
/// by one bright path makes a spike of its whole share of the light: in the caustic pool 256 chains of 250 000 mutations
/// left 80 times the squared error of energy redistribution, whose chains are of 100. (Mitsuba 0.6 takes 200 000.)
const MUTATIONS_PER_CHAIN: u64 = 10_000;

/// Fewest chains: enough for 64 threads and for two halves that each know how much their chains differ.
const FEWEST_CHAINS: u64 = 64;

/// Chains where only the time is known.
const CHAINS_OF_TIME: u64 = 4096;

/// Mutations in a round, of all chains together: below a second of two threads, while a thread's share is well above what it
/// costs to hand it out.
const ROUND: u64 = 1 << 17;

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
    film: SplatFilm,
    /// Light that the chains leave to path tracing.
    direct: Option<Sampled<'a>>,
    /// Chains of even index belong to half 0, those of odd index to half 1.
    chains: Vec<Unit<M::Walker<'a>>>,
    /// Draws of both pools.
    draws: u64,
    /// Normalisation and its standard error, from each half's pool.
    normalisation: [(f64, f64); 2],
    /// Chains in each half, of those that could start.
    counts: [usize; 2],
    /// Mutations that each chain has made.
    mutations: u64,
    /// Candidates whose weight was not finite.
    invalid: u64,
}

/// One chain.
#[derive(Debug)]
struct Unit<W> {
    half: usize,
    walker: W,
    place: Moments,
}

impl<'a, M: MarkovChains> Chains<'a, M> {
    /// Makes the pools of candidates and starts the chains, on the threads of the current rayon pool.
    pub(super) fn new(scene: &'a Scene, method: M, settings: &RenderSettings) -> Self {
        let pixels = scene.film.crop_pixels();
        let count = match settings.budget {
            Budget::Samples(samples) => {
                (pixels * u64::from(samples)).div_ceil(MUTATIONS_PER_CHAIN).max(FEWEST_CHAINS)
            }
            Budget::Time(_) => CHAINS_OF_TIME,
        };
        let in_half = count.div_ceil(2);
        let draws = draws(&method, settings.budget, pixels);
        let pools = [0, 1].map(|half| pool(scene, &method, settings.seed, half, draws));

        let mut seeds = Vec::new();
        for (half, pool) in pools.iter().enumerate() {
            let mut numbers = IndependentSampler::stream(settings.seed, Stream::Seeds, half as u64);
            let of_half = pool.seeds(in_half as usize, numbers.next_f64());
            seeds.extend(of_half.zip(0..).map(|(seed, k)| (2 * k + half as u64, half, seed)));
        }
        seeds.sort_by_key(|&(index, ..)| index);
        let start = |(index, half, seed): (u64, usize, &M::Seed)| {
            let walker = method.start(scene, settings.seed, seed, index);
            debug_assert!(walker.is_some(), "a seed was not found again: {seed:?}");
            walker.map(|walker| Unit { half, walker, place: Moments::default() })
        };
        let chains: Vec<Unit<M::Walker<'a>>> =
            seeds.into_par_iter().map(start).collect::<Vec<_>>().into_iter().flatten().collect();
        let counts = [0, 1].map(|half| chains.iter().filter(|unit| unit.half == half).count());
        Self {
            scene,
            method,
            // The squares are not the variance, but they have its shape from pixel to pixel; the halves give its size.
            film: SplatFilm::of_independent(scene.film),
            direct: method.direct().then(|| Sampled::of_direct(scene, settings)),
            chains,
            draws,
            normalisation: [0, 1].map(|half| (pools[half].mean(), pools[half].error())),
            counts,
            mutations: 0,
            invalid: pools.iter().map(Bootstrap::invalid).sum(),
        }
    }

    /// What the film's sums must be multiplied by: `b · pixels / mutations` of each half.
    fn scale(&self) -> Scale {
        let pixels = self.scene.film.crop_pixels() as f64;
        let half = [0, 1].map(|half| {
            let mutations = self.counts[half] as f64 * self.mutations as f64;
            if mutations > 0.0 { self.normalisation[half].0 * pixels / mutations } else { 0.0 }
        });
        Scale { half, weight: [0.5; 2] }
    }

    fn statistics(&self) -> Statistics {
        let mut all = Statistics::new(self.method.names().len());
        for unit in &self.chains {
            all.merge(self.method.statistics(&unit.walker));
        }
        all
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
        let Self { scene, method, film, chains, .. } = self;
        let count = self.counts.iter().sum::<usize>().max(1) as u64;
        let whole = (scene.film.crop_pixels() * u64::from(most)).div_ceil(count);
        let mutations = ROUND.div_ceil(count).min(whole.saturating_sub(self.mutations));
        run_units(chains, film, |unit, splats| {
            method.mutate(scene, &mut unit.walker, mutations, splats);
            splats.iter().for_each(|splat| unit.place.add(splat));
            unit.half
        });
        self.mutations += mutations;
        let samples = self.samples();
        if let Some(direct) = &mut self.direct {
            direct.keep_up(samples);
        }
    }

    fn samples(&self) -> u32 {
        per_pixel(self.done(), self.scene.film.crop_pixels())
    }

    fn done(&self) -> u64 {
        self.mutations * self.counts.iter().sum::<usize>().max(1) as u64
    }

    fn put_radiance(&self, layers: &mut Layers) {
        let radiance = match &self.direct {
            Some(direct) => {
                replace_radiance(direct.layers(), layers);
                Radiance::Added
            }
            None => Radiance::Replaced,
        };
        self.film.put_into(layers, &self.scale(), radiance);
    }

    fn is_independent(&self) -> bool {
        false
    }

    fn invalid(&self) -> u64 {
        let failures = self.statistics().kernels;
        let not_finite = failures.iter().map(|kernel| kernel.failures[Failure::NotFinite as usize]);
        let direct = self.direct.as_ref().map_or(0, Sampled::invalid_samples);
        self.film.invalid_splats() + self.invalid + not_finite.sum::<u64>() + direct
    }

    fn report(&self) -> Report {
        let mut report = Report::default();
        let mut tell = |name: &str, value: String| report.facts.push((name.to_owned(), value));
        let [(a, error_a), (b, error_b)] = self.normalisation;
        let (mean, error) = (0.5 * (a + b), 0.5 * error_a.hypot(error_b));
        tell("normalisation", format!("{mean:.6e} ± {error:.1e}"));
        tell("chains", format!("{} of {} mutations", self.chains.len(), self.mutations));
        let statistics = self.statistics();
        let lines = statistics.lines(self.method.names());
        for (name, line) in self.method.names().iter().zip(lines) {
            let line = line.strip_prefix(&format!("{name}: ")).unwrap_or(&line).to_owned();
            tell(&format!("mutation {name}"), line);
        }
        tell("longest_stay", format!("{} mutations", statistics.longest_stay));
        let places: Vec<Moments> = self.chains.iter().map(|unit| unit.place).collect();
        let disagreement = disagreement(&places);
        if let Some(disagreement) = disagreement {
            tell("chains_disagreement", format!("{disagreement:.3}"));
        }
        if self.chains.is_empty() {
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

/// Where a chain was on the film, by luminance.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    weight: f64,
    sum: [f64; 2],
    squares: [f64; 2],
}

impl Moments {
    fn add(&mut self, splat: &Splat) {
        let weight = f64::from((splat.diffuse + splat.specular).luminance());
        if !(weight.is_finite() && splat.raster.is_finite()) {
            return;
        }
        self.weight += weight;
        for (axis, place) in splat.raster.as_dvec2().to_array().into_iter().enumerate() {
            self.sum[axis] += weight * place;
            self.squares[axis] += weight * place * place;
        }
    }
}

/// The ratio `√((W + B) / W)` of the spread of the chains' mean places (variance `B`) to that within the chains (mean
/// variance `W`), for the axis where it is larger: 1 where chains have all been everywhere, large where each stayed around
/// its seed. `None` for fewer than two chains, or where nothing moves.
fn disagreement(chains: &[Moments]) -> Option<f64> {
    let chains: Vec<&Moments> = chains.iter().filter(|chain| chain.weight > 0.0).collect();
    let count = chains.len() as f64;
    if count < 2.0 {
        return None;
    }
    let of_axis = |axis: usize| {
        let means = || chains.iter().map(|chain| chain.sum[axis] / chain.weight);
        let mean = means().sum::<f64>() / count;
        let between = means().map(|m| (m - mean) * (m - mean)).sum::<f64>() / (count - 1.0);
        let squares = chains.iter().map(|chain| chain.squares[axis] / chain.weight);
        let within = squares.zip(means()).map(|(s, m)| (s - m * m).max(0.0)).sum::<f64>() / count;
        (within > 0.0).then(|| ((within + between) / within).sqrt())
    };
    of_axis(0).into_iter().chain(of_axis(1)).reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;
    use glam::Vec2;

    fn chain(places: &[f32]) -> Moments {
        let mut moments = Moments::default();
        for &x in places {
            let raster = Vec2::new(x, 1.0);
            moments.add(&Splat { raster, diffuse: Rgb::WHITE, specular: Rgb::BLACK });
        }
        moments
    }

    #[test]
    fn more_mutations_than_32_bits_hold_are_not_counted_from_0_again() {
        assert_eq!(per_pixel(1_000_000_000, 1), 1_000_000_000);
        assert_eq!(per_pixel(1 << 40, 65_536 * 65_536), 256);
        // 4096 chains of 2²⁰ mutations for one pixel: the time was longer than its counter.
        assert_eq!(per_pixel(1 << 32, 1), u32::MAX);
    }

    #[test]
    fn chains_that_stay_apart_disagree() {
        let alike = [chain(&[0.0, 2.0, 4.0]), chain(&[4.0, 2.0, 0.0])];
        assert!((disagreement(&alike).unwrap() - 1.0).abs() < 1e-9);
        // Means 1 and 9: variance 32 between, 1 within.
        let apart = [chain(&[0.0, 2.0]), chain(&[8.0, 10.0])];
        assert!((disagreement(&apart).unwrap() - 33f64.sqrt()).abs() < 1e-6);
        assert_eq!(disagreement(&apart[..1]), None);
        assert_eq!(disagreement(&[chain(&[1.0]), chain(&[1.0]), chain(&[])]), None);
    }
}
