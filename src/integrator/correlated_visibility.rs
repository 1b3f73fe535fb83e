//! Correlated visibility sampling of direct light (Ghosh and Heidrich 2006, "Correlated Visibility Sampling for Direct
//! Illumination").
//!
//! Light that a camera ray's first receiver (the first surface with a smooth lobe, seen through delta lobes only) gets straight
//! from area emitters and the environment is found in two passes. The first ([`sir`]) resamples many candidates of light ×
//! scattering and traces shadow rays to a few; it is nearly free of noise where nothing is in the way. Pixels that see light
//! partly occluded are [marked](marks), and in the second pass ([`exchange`]) Markov chains move the energy of their
//! visible samples between them, so that each profits from directions that its neighbours found open. Point, spot and
//! directional emitters get one shadow ray each. All other light, seen directly or indirect, is path-traced along the
//! same camera rays ([`PathTracing::trace_without_direct`]).
//!
//! Prefer it where direct light of a detailed environment on glossy surfaces is what makes the noise; where indirect light does, it
//! is path tracing at a higher price.
//!
//! *Bias.* Given the marks, the exchange keeps the expected picture; so it is unbiased if the marks do not depend on the
//! samples whose energy is exchanged. [`Pilot`](MarkSource::Pilot) marks come from samples of their own, and the picture has
//! the mean of path tracing. [`Same`](MarkSource::Same), the economical choice of the paper, is consistent but biased: partly lit
//! pixels that stay unmarked are just those that happened to see all or nothing.

mod exchange;
mod light;
pub mod marks;
pub mod sir;
#[cfg(test)]
mod tests;

use super::path_tracing::PathTracing;
use super::receiver::Receiver;
use crate::math::Rgb;
use crate::sampler::{IndependentSampler, Sampler, SobolSampler, hash};
use crate::scene::Scene;
use exchange::{Deposit, Exchange, Move, Seed};
use glam::Vec2;
use light::Lights;
use marks::{Marks, Seen};
use rayon::prelude::*;
use sir::{Chosen, Gathered, Resampler};
use std::ops::ControlFlow;

/// Where it is read off which pixels exchange energy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MarkSource {
    /// From camera rays and shadow rays that serve nothing else; unbiased.
    #[default]
    Pilot,
    /// From the samples themselves: no further rays; consistent, but biased towards too little or too much light at the edges of
    /// penumbras, the less so the more shadow rays a hit has.
    Same,
}

/// Direct light by resampling and energy exchange, all other light by path tracing; see the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CorrelatedVisibility {
    /// Shadow rays of a camera ray's receiver, `N ≥ 1`.
    pub shadow_rays: u32,
    /// Candidates that they are chosen from, `M ≥ 1`; each costs an evaluation of the surface and of the light, but no ray.
    pub candidates: u32,
    /// Camera rays of each pixel that exchange energy at a time, `K ≥ 1`: the memory for them is what limits it, some 350
    /// bytes for each one in a marked pixel.
    pub hits: u32,
    /// Where the marks come from.
    pub marks: MarkSource,
    /// Camera rays of each pixel in the pilot.
    pub pilot_hits: u32,
    /// Marks grow by so many pixels, so that energy may flow into the dark side of a shadow's edge.
    pub dilation: u32,
    /// Mutations for each camera ray of a marked pixel, at one shadow ray each, on average; 0 leaves the first pass as it is.
    pub mutations: u32,
    /// Mutations of one chain, `m ≥ 1`.
    pub steps: u32,
    /// The pixel mutation moves so many columns and rows at most.
    pub window: u32,
    /// Fewest chains from one sample; below it each carries less energy. 0 leaves it to chance whether a dim sample has one.
    pub min_chains: u32,
    /// Most chains from one sample; beyond it each carries more energy.
    pub max_chains: u32,
}

impl Default for CorrelatedVisibility {
    fn default() -> Self {
        Self {
            shadow_rays: 4,
            candidates: 32,
            hits: 8,
            marks: MarkSource::Pilot,
            pilot_hits: 4,
            dilation: 2,
            mutations: 4,
            steps: 1,
            window: 4,
            min_chains: 1,
            max_chains: 4096,
        }
    }
}

/// Sums over the camera rays of one pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelSums {
    /// Radiance scattered by a diffuse lobe at the first hit.
    pub diffuse: [f64; 3],
    /// All other radiance.
    pub specular: [f64; 3],
    /// Luminance that the resampled emitters would send if nothing were in the way.
    pub unshadowed: f64,
    /// Shadow rays of the first pass.
    pub seen: Seen,
}

impl PixelSums {
    fn add(&mut self, diffuse: Rgb, specular: Rgb, scale: f64) {
        for channel in 0..3 {
            self.diffuse[channel] += f64::from(diffuse[channel]) * scale;
            self.specular[channel] += f64::from(specular[channel]) * scale;
        }
    }

    fn merge(&mut self, other: &Self) {
        for channel in 0..3 {
            self.diffuse[channel] += other.diffuse[channel];
            self.specular[channel] += other.specular[channel];
        }
        self.unshadowed += other.unshadowed;
        self.seen.visible += other.seen.visible;
        self.seen.of += other.seen.of;
    }
}

/// What the two passes did. Energies are luminances summed over marked pixels and camera rays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ledger {
    /// Shadow rays of the pilot.
    pub pilot_rays: u64,
    /// Shadow rays of the first pass.
    pub shadow_rays: u64,
    /// Mutations; each traces one shadow ray at most.
    pub mutations: u64,
    /// Chains.
    pub chains: u64,
    /// Samples whose number of chains was limited.
    pub limited: u64,
    /// Energy that the first pass found in marked pixels.
    pub found: f64,
    /// Energy that chains were given: on average over their random numbers, what was found.
    pub given: f64,
    /// Energy that chains left in pixels: exactly what they were given.
    pub deposited: f64,
    /// Non-finite samples and candidates, dropped.
    pub invalid: u64,
}

/// A half of a picture that can go on: camera rays are taken in their order. Two halves of one seed are independent.
#[derive(Debug)]
pub struct VisibilityRendering<'a> {
    scene: &'a Scene,
    settings: CorrelatedVisibility,
    seed: u64,
    half: u32,
    lights: Lights<'a>,
    /// Those of the pilot; of the last round where the samples themselves are marked.
    marks: Option<Marks>,
    /// Unshadowed luminance of each pixel, as the pilot saw it.
    brightness: Vec<f64>,
    sums: Vec<PixelSums>,
    hits: u32,
    rounds: u32,
    ledger: Ledger,
}

/// What each use of random numbers is told apart by.
#[derive(Clone, Copy)]
enum Stream {
    /// Camera rays: the numbers of path tracing.
    Walk,
    Gather,
    PilotWalk,
    PilotGather,
    Chains,
    Moves,
}

impl<'a> VisibilityRendering<'a> {
    /// No camera rays yet; `half` is 0 or 1.
    pub fn new(scene: &'a Scene, settings: CorrelatedVisibility, seed: u64, half: u32) -> Self {
        let [_, _, columns, rows] = scene.film.crop;
        Self {
            scene,
            settings,
            seed,
            half,
            lights: Lights::new(scene),
            marks: None,
            brightness: Vec::new(),
            sums: vec![PixelSums::default(); columns as usize * rows as usize],
            hits: 0,
            rounds: 0,
            ledger: Ledger::default(),
        }
    }

    /// Camera rays of each pixel so far.
    pub fn hits(&self) -> u32 {
        self.hits
    }

    /// Sums over the camera rays so far, of the crop window's pixels row by row.
    pub fn sums(&self) -> &[PixelSums] {
        &self.sums
    }

    /// The pixels that exchange energy; `None` before the first camera ray.
    pub fn marks(&self) -> Option<&Marks> {
        self.marks.as_ref()
    }

    /// What was done so far.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Goes on until there are `hits` camera rays a pixel, on the threads of the current rayon pool. Rays of one call exchange
    /// energy in rounds of [`CorrelatedVisibility::hits`]; the last one may be shorter.
    pub fn advance(&mut self, hits: u32) {
        while self.hits < hits {
            let round = (hits - self.hits).min(self.settings.hits.max(1));
            self.round(round);
            self.hits += round;
            self.rounds += 1;
        }
    }

    /// `hits` camera rays of each pixel, and the exchange between them.
    fn round(&mut self, hits: u32) {
        let size = self.size();
        let (kept, marks) = match self.settings.marks {
            MarkSource::Pilot => {
                let marks = self.marks.take().unwrap_or_else(|| self.pilot());
                (marks.clone(), Some(marks))
            }
            MarkSource::Same => (Marks::new(size, 0, |_| true), None),
        };
        let rows: Vec<Row<'a>> =
            (0..size[1]).into_par_iter().map(|y| self.gather_row(y, hits, &kept)).collect();
        let mut first_pass = Vec::with_capacity(self.sums.len());
        let (mut receivers, mut seeds) = (Vec::new(), Vec::new());
        for row in rows {
            let start = first_pass.len();
            for (sums, other) in self.sums[start..].iter_mut().zip(&row.other) {
                sums.merge(other);
            }
            first_pass.extend(row.direct);
            receivers.extend(row.receivers);
            seeds.extend(row.seeds);
            self.ledger.shadow_rays += row.shadow_rays;
            self.ledger.invalid += row.invalid;
        }
        let marks = marks.unwrap_or_else(|| {
            let marks = Marks::new(size, self.settings.dilation, |pixel| {
                first_pass[pixel].seen.is_partial()
            });
            keep_marked(&marks, hits, &mut receivers, &mut seeds);
            marks
        });

        let is_exchanged = self.settings.mutations > 0;
        for (pixel, (sums, direct)) in self.sums.iter_mut().zip(&first_pass).enumerate() {
            if is_exchanged && marks.slot(pixel).is_some() {
                let (unshadowed, seen) = (direct.unshadowed, direct.seen);
                sums.merge(&PixelSums { unshadowed, seen, ..PixelSums::default() });
            } else {
                sums.merge(direct);
            }
        }
        if is_exchanged {
            self.exchange(&marks, hits, &receivers, &seeds);
        }
        self.marks = Some(marks);
    }

    /// Columns and rows of the crop window.
    fn size(&self) -> [u32; 2] {
        let [_, _, columns, rows] = self.scene.film.crop;
        [columns, rows]
    }

    /// The numbers of a camera ray: `ray` counts along this half of the pixel.
    fn sampler(&self, stream: Stream, pixel: [u32; 2], ray: u32) -> SobolSampler {
        let seed = match stream {
            Stream::Walk => self.seed,
            _ => self.stream(stream),
        };
        SobolSampler::new(seed, pixel[1] * self.scene.film.width + pixel[0], 2 * ray + self.half)
    }

    /// Pixels of one row of the crop window, counted in the whole film.
    fn film_pixels(&self, row: u32) -> impl Iterator<Item = [u32; 2]> + use<> {
        let [x0, y0, columns, _] = self.scene.film.crop;
        (x0..x0 + columns).map(move |x| [x, y0 + row])
    }

    /// Marks by samples that serve nothing else.
    fn pilot(&mut self) -> Marks {
        let [columns, rows] = self.size();
        let this = &*self;
        let seen: Vec<Look> = (0..rows)
            .into_par_iter()
            .flat_map_iter(|row| {
                let mut resampler = Resampler::default();
                this.film_pixels(row).map(move |pixel| this.look(pixel, &mut resampler))
            })
            .collect();
        self.ledger.pilot_rays += seen.iter().map(|look| look.rays).sum::<u64>();
        self.brightness = seen.iter().map(|look| look.brightness).collect();
        Marks::new([columns, rows], self.settings.dilation, |pixel| seen[pixel].seen.is_partial())
    }

    /// What the pilot sees at one pixel.
    fn look(&self, pixel: [u32; 2], resampler: &mut Resampler) -> Look {
        let (mut look, mut found) = (Look::default(), Vec::new());
        for ray in 0..self.settings.pilot_hits {
            let mut numbers = self.sampler(Stream::PilotGather, pixel, ray);
            let mut walk = self.sampler(Stream::PilotWalk, pixel, ray);
            self.trace(pixel, &mut walk, |receiver| {
                let gathered = self.gather(resampler, &receiver, &mut numbers, &mut found);
                look.seen.visible += gathered.visible;
                look.seen.of += gathered.chosen;
                look.brightness += gathered.unshadowed;
                look.rays += u64::from(gathered.shadow_rays);
                ControlFlow::Break(())
            });
        }
        look
    }

    /// The camera ray with these numbers, followed without direct light.
    fn trace(
        &self,
        [x, y]: [u32; 2],
        sampler: &mut SobolSampler,
        receive: impl FnMut(Receiver<'a>) -> ControlFlow<()>,
    ) -> (Rgb, Rgb) {
        let raster = Vec2::new(x as f32, y as f32) + sampler.next_2d();
        let camera = &self.scene.camera;
        let lens = if camera.aperture_radius() > 0.0 { sampler.next_2d() } else { Vec2::ZERO };
        let ray = camera.ray(raster, lens);
        let sample = PathTracing::default().trace_without_direct(self.scene, ray, sampler, receive);
        (sample.diffuse, sample.specular)
    }

    fn gather(
        &self,
        resampler: &mut Resampler,
        receiver: &Receiver<'_>,
        sampler: &mut SobolSampler,
        found: &mut Vec<Chosen>,
    ) -> Gathered {
        let counts = [self.settings.candidates.max(1), self.settings.shadow_rays.max(1)];
        resampler.gather(self.scene, &self.lights, receiver, counts, sampler, found)
    }

    /// The first pass over one row: `hits` camera rays of each pixel, kept where the pixel is in `kept`.
    fn gather_row(&self, row: u32, hits: u32, kept: &Marks) -> Row<'a> {
        let columns = self.size()[0] as usize;
        let mut gathered = Row::default();
        let (mut resampler, mut found) = (Resampler::default(), Vec::new());
        for (column, pixel) in self.film_pixels(row).enumerate() {
            let slot = kept.slot(row as usize * columns + column);
            let (mut other, mut direct) = (PixelSums::default(), PixelSums::default());
            for hit in 0..hits {
                let ray = self.hits + hit;
                let mut numbers = self.sampler(Stream::Gather, pixel, ray);
                let mut received = None;
                let (diffuse, specular) =
                    self.trace(pixel, &mut self.sampler(Stream::Walk, pixel, ray), |receiver| {
                        received = Some(receiver);
                        ControlFlow::Continue(())
                    });
                gathered.add(&mut other, diffuse, specular);
                if let Some(receiver) = &received {
                    found.clear();
                    let result = self.gather(&mut resampler, receiver, &mut numbers, &mut found);
                    direct.unshadowed += result.unshadowed;
                    direct.seen.visible += result.visible;
                    direct.seen.of += result.chosen;
                    gathered.shadow_rays += u64::from(result.shadow_rays);
                    gathered.invalid += u64::from(result.invalid);
                    for chosen in &found {
                        if !gathered.add(&mut direct, chosen.diffuse, chosen.specular) {
                            continue;
                        }
                        if let Some(slot) = slot {
                            gathered.seeds.push(Seed::new(slot as u32 * hits + hit, chosen));
                        }
                    }
                    for light in self.scene.emitters.delta_samples(receiver.at.position) {
                        let scattering = receiver.scatter(light.direction);
                        if (scattering.diffuse + scattering.specular).is_black() {
                            continue;
                        }
                        gathered.shadow_rays += 1;
                        let visibility =
                            receiver.visibility(self.scene, light.direction, light.distance);
                        let radiance = light.radiance * visibility;
                        let [diffuse, specular] =
                            [scattering.diffuse, scattering.specular].map(|part| part * radiance);
                        gathered.add(&mut other, diffuse, specular);
                    }
                }
                if slot.is_some() {
                    gathered.receivers.push(received);
                }
            }
            gathered.other.push(other);
            gathered.direct.push(direct);
        }
        gathered
    }

    /// The second pass: chains from the seeds, in their order.
    fn exchange(
        &mut self,
        marks: &Marks,
        hits: u32,
        receivers: &[Option<Receiver<'a>>],
        seeds: &[Seed],
    ) {
        let found: f64 = seeds.iter().map(|seed| seed.energy).sum();
        let steps = self.settings.steps.max(1);
        let mutations = f64::from(self.settings.mutations) * f64::from(hits) * marks.len() as f64;
        // A constant share of every sample's energy stays, as if its own shadow ray were one of the mutations.
        let rays = self.settings.shadow_rays.max(1);
        let moving = f64::from(self.settings.mutations) / f64::from(self.settings.mutations + rays);
        self.ledger.found += moving * found;
        if found <= 0.0 {
            return;
        }
        let chain_energy = moving * found / mutations * f64::from(steps);
        let u = self.chain_sampler(Stream::Chains, u32::MAX).next_1d();
        let limits = [self.settings.min_chains, self.settings.max_chains.max(1)];
        let batches = chains_of(seeds, moving, chain_energy, limits, f64::from(u));
        let mut most = 0;
        for batch in &batches {
            let chains = u64::from(batch.chains);
            self.ledger.chains += chains;
            self.ledger.mutations += chains * u64::from(steps);
            self.ledger.limited += u64::from(batch.energy > chain_energy);
            self.ledger.given += f64::from(batch.chains) * batch.energy;
            most = most.max(batch.chains);
        }
        let window = self.settings.window.max(1);
        let moves: Vec<Vec<Move>> = (0..most)
            .map(|chain| {
                let mut sampler = self.chain_sampler(Stream::Moves, chain);
                (0..steps).map(|_| Move::sample(window, hits, &mut sampler)).collect()
            })
            .collect();
        let pixels: Vec<u32> = marks.pixels().map(|pixel| pixel as u32).collect();
        let brightness: Vec<f64> = match self.settings.marks {
            MarkSource::Pilot => {
                pixels.iter().map(|&pixel| self.brightness[pixel as usize]).collect()
            }
            MarkSource::Same => Vec::new(),
        };
        let exchange = Exchange {
            scene: self.scene,
            lights: &self.lights,
            marks,
            pixels: &pixels,
            receivers,
            brightness: &brightness,
            hits,
        };
        let (mut sums, mut deposited) = (std::mem::take(&mut self.sums), 0.0);
        let mut leave = |deposit: &Deposit| {
            let Deposit { slot, energy, diffuse, specular } = *deposit;
            sums[pixels[slot as usize] as usize].add(diffuse, specular, energy);
        };
        for seed in seeds {
            leave(&exchange.stay(seed, (1.0 - moving) * seed.energy));
        }
        // Chains run in waves, so that what they leave is added up in their order and yet need not all be kept at once.
        for wave in batches.chunks(WAVE) {
            let deposits: Vec<Vec<Deposit>> = wave
                .par_chunks(64)
                .map(|batches| {
                    let mut deposits = Vec::new();
                    for batch in batches {
                        let energy = batch.energy / f64::from(steps);
                        for (chain, moves) in (0..batch.chains).zip(&moves) {
                            let number = batch.first.wrapping_add(chain);
                            let mut sampler = self.chain_sampler(Stream::Chains, number);
                            let seed = &seeds[batch.seed];
                            exchange.run(seed, moves, energy, &mut sampler, &mut deposits);
                        }
                    }
                    deposits
                })
                .collect();
            for deposit in deposits.iter().flatten() {
                deposited += deposit.energy;
                leave(deposit);
            }
        }
        self.sums = sums;
        self.ledger.deposited += deposited;
    }

    fn stream(&self, stream: Stream) -> u64 {
        hash::key(self.seed, stream as u32, 0)
    }

    /// The numbers of a chain, or of a number of chains, of this half and round.
    fn chain_sampler(&self, stream: Stream, chain: u32) -> IndependentSampler {
        IndependentSampler::new(self.stream(stream), chain, 2 * self.rounds + self.half)
    }
}

/// Samples whose chains run before their deposits are added up: some ten megabytes of deposits.
const WAVE: usize = 1 << 13;

/// What the pilot found at one pixel.
#[derive(Clone, Copy, Debug, Default)]
struct Look {
    seen: Seen,
    /// Sum of unshadowed luminances.
    brightness: f64,
    rays: u64,
}

/// What the first pass found in one row of pixels.
#[derive(Default)]
struct Row<'a> {
    /// Light that is not resampled.
    other: Vec<PixelSums>,
    /// Light that is.
    direct: Vec<PixelSums>,
    /// Of the pixels that are kept.
    receivers: Vec<Option<Receiver<'a>>>,
    seeds: Vec<Seed>,
    shadow_rays: u64,
    invalid: u64,
}

impl Row<'_> {
    /// Adds light to a pixel if it is finite, else counts it.
    fn add(&mut self, sums: &mut PixelSums, diffuse: Rgb, specular: Rgb) -> bool {
        let is_finite = (diffuse + specular).is_finite();
        if is_finite {
            sums.add(diffuse, specular, 1.0);
        } else {
            self.invalid += 1;
        }
        is_finite
    }
}

/// Leaves only what belongs to marked pixels of what was kept of all pixels.
fn keep_marked(
    marks: &Marks,
    hits: u32,
    receivers: &mut Vec<Option<Receiver<'_>>>,
    seeds: &mut Vec<Seed>,
) {
    let slot = |receiver: u32| marks.slot((receiver / hits) as usize);
    let mut index = 0;
    receivers.retain(|_| {
        index += 1;
        slot(index - 1).is_some()
    });
    seeds.retain_mut(|seed| match slot(seed.receiver) {
        Some(slot) => {
            seed.receiver = slot as u32 * hits + seed.receiver % hits;
            true
        }
        None => false,
    });
}

/// Chains that start from one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Batch {
    /// Which sample.
    seed: usize,
    /// Number of the first chain among all, modulo 2³².
    first: u32,
    chains: u32,
    /// What each chain leaves, over all its steps.
    energy: f64,
}

/// How many chains start from each sample: the share `moving` of its energy over `chain_energy`, rounded up or down so that
/// the expectation over `u` in `[0, 1)` is exact. The rounding is systematic, one `u` for all samples, which spreads the chains
/// as evenly as the energy (Cline et al. 2005 draw a number for each). Beyond the limits, the energy of a chain makes up for
/// what their number lacks.
fn chains_of(
    seeds: &[Seed],
    moving: f64,
    chain_energy: f64,
    [fewest, most]: [u32; 2],
    u: f64,
) -> Vec<Batch> {
    let (mut sum, mut done, mut first) = (u, 0.0, 0u32);
    let mut batches = Vec::new();
    for (index, seed) in seeds.iter().enumerate() {
        let wanted = moving * seed.energy / chain_energy;
        let limited = wanted.max(f64::from(fewest)).min(f64::from(most));
        sum += limited;
        let chains = (sum.floor() - done) as u32;
        if chains > 0 {
            let energy = chain_energy * (wanted / limited);
            batches.push(Batch { seed: index, first, chains, energy });
            done = sum.floor();
            first = first.wrapping_add(chains);
        }
    }
    batches
}
