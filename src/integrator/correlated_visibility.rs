//! Correlated visibility sampling of direct light (Ghosh and Heidrich 2006, "Correlated Visibility Sampling for Direct
//! Illumination").
//!
//! Light that a camera ray's first receiver (the first surface with a smooth lobe, seen through delta lobes only) gets straight
//! from area emitters and the environment is found in two passes. The first ([`sir`]) resamples many candidates of light ×
//! scattering and traces shadow rays to a few; it is nearly free of noise where nothing is in the way. Pixels that see light
//! partly occluded are [marked](marks), and in the second pass, the exchange, Markov chains move the energy of their
//! visible samples between them, so that each profits from directions that its neighbours found open. Point, spot and
//! directional emitters get one shadow ray each. All other light, seen directly or indirect, is path-traced along the
//! same camera rays ([`trace_without_direct`](super::PathTracing::trace_without_direct)).
//!
//! Use it where few camera rays are all there is: for equal numbers of them it has a fraction of the noise of path tracing. For
//! equal time do not: path tracing found direct light with less noise wherever the two were measured, see
//! [`CorrelatedVisibility`]; and where indirect light makes the noise, this is path tracing at a higher price.
//!
//! *Bias.* Given the marks, the exchange keeps the expected picture; so it is unbiased if the marks do not depend on the
//! samples whose energy is exchanged. [`Pilot`](MarkSource::Pilot) marks come from samples of their own, and the picture has
//! the mean of path tracing. [`Same`](MarkSource::Same), the economical choice of the paper, is consistent but biased: partly lit
//! pixels that stay unmarked are just those that happened to see all or nothing.

mod chains;
mod exchange;
mod first_pass;
mod light;
pub mod marks;
mod moves;
pub mod sir;
mod sums;
#[cfg(test)]
mod tests;

use crate::sampler::{IndependentSampler, SobolSampler, hash};
use crate::scene::Scene;
use first_pass::{Row, keep_marked};
use light::Lights;
use marks::Marks;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
pub use sums::{Ledger, PixelSums};

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
///
/// Measured with direct light alone on `scenes/blockers` (the same with two rectangle lamps instead of the environment in
/// brackets), 160 × 120 pixels, mean of `(a - r)² / (r² + 0.01)`, two seeds:
/// - one camera ray a pixel: path tracing 0.99 (0.17), resampling alone 0.12 (0.020), with exchange 0.082 (0.017);
/// - four: 0.21 (0.027), 0.026 (0.0033), 0.017 (0.0027);
/// - as long as exchange takes for four, about 1.3 s (0.9 s) of one processor: path tracing, with 64 camera rays, 0.0044
///   (0.0006). Resampling alone takes 0.75 s (0.40 s) for four and has 0.0047 (0.0007) for sixteen in 2.6 s (1.6 s).
///
/// So exchange takes a third (a fifth) off what resampling leaves at few camera rays, but time is better spent on more of them.
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
    /// Mutations of one chain, `m ≥ 1`. Short chains from many samples have less noise than long ones from few: at 16 mutations,
    /// chains of 4 had 1.2 to 1.3 times the squared error of chains of 1.
    pub steps: u32,
    /// The pixel mutation moves so many columns and rows at most.
    pub window: u32,
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
            pilot_hits: 1,
            dilation: 2,
            mutations: 16,
            steps: 1,
            window: 4,
            max_chains: 4096,
        }
    }
}

/// A half of a picture that can go on: camera rays are taken in their order. Two halves of one seed are independent.
#[derive(Debug)]
pub struct VisibilityRendering<'a> {
    scene: &'a Scene,
    settings: CorrelatedVisibility,
    seed: u64,
    half: u32,
    shard: Shard,
    lights: Lights<'a>,
    found: HalfFound,
}

/// What a half of a picture has found: all that it needs to go on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HalfFound {
    /// Those of the pilot; of the last round where the samples themselves are marked.
    marks: Option<Marks>,
    sums: Vec<PixelSums>,
    hits: u32,
    rounds: u32,
    ledger: Ledger,
}

/// Every so many rounds of both halves together, which begin in turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 0.
    pub index: u32,
    /// Of how many.
    pub count: u32,
}

impl HalfFound {
    /// Camera rays of each pixel so far, those of other shards included.
    pub fn hits(&self) -> u32 {
        self.hits
    }

    /// Sums over the camera rays so far, of the crop window's pixels row by row.
    pub fn sums(&self) -> &[PixelSums] {
        &self.sums
    }

    /// The pixels that exchange energy, none without mutations; `None` before the first camera ray.
    pub fn marks(&self) -> Option<&Marks> {
        self.marks.as_ref()
    }

    /// What was done so far.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Adds what other rounds found.
    pub fn merge(&mut self, other: &Self) {
        for (sums, more) in self.sums.iter_mut().zip(&other.sums) {
            sums.merge(more);
        }
        self.ledger.merge(&other.ledger);
        self.marks = self.marks.take().or_else(|| other.marks.clone());
    }
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
            shard: Shard { index: 0, count: 1 },
            lights: Lights::new(scene),
            found: HalfFound {
                marks: None,
                sums: vec![PixelSums::default(); columns as usize * rows as usize],
                hits: 0,
                rounds: 0,
                ledger: Ledger::default(),
            },
        }
    }

    /// The same for some of the rounds only: the others are passed over.
    #[must_use]
    pub fn of_shard(self, shard: Shard) -> Self {
        Self { shard, ..self }
    }

    /// The same after what was found before.
    #[must_use]
    pub fn with(self, found: HalfFound) -> Self {
        Self { found, ..self }
    }

    /// What was found so far.
    pub fn found(&self) -> &HalfFound {
        &self.found
    }

    /// Camera rays of each pixel so far.
    pub fn hits(&self) -> u32 {
        self.found.hits
    }

    /// Sums over the camera rays so far, of the crop window's pixels row by row.
    pub fn sums(&self) -> &[PixelSums] {
        &self.found.sums
    }

    /// The pixels that exchange energy, none without mutations; `None` before the first camera ray.
    pub fn marks(&self) -> Option<&Marks> {
        self.found.marks.as_ref()
    }

    /// What was done so far.
    pub fn ledger(&self) -> &Ledger {
        &self.found.ledger
    }

    /// Goes on until there are `hits` camera rays a pixel, on the threads of the current rayon pool. Rays of one call exchange
    /// energy in rounds of [`CorrelatedVisibility::hits`]; the last one may be shorter.
    pub fn advance(&mut self, hits: u32) {
        while self.found.hits < hits {
            let round = (hits - self.found.hits).min(self.settings.hits.max(1));
            if (2 * self.found.rounds + self.half) % self.shard.count == self.shard.index {
                self.round(round);
            }
            self.found.hits += round;
            self.found.rounds += 1;
        }
    }

    /// `hits` camera rays of each pixel, and the exchange between them.
    fn round(&mut self, hits: u32) {
        let size = self.size();
        let is_exchanged = self.settings.mutations > 0;
        let (kept, marks) = match self.settings.marks {
            _ if !is_exchanged => {
                let none = Marks::new(size, 0, |_| false);
                (none.clone(), Some(none))
            }
            MarkSource::Pilot => {
                let marks = self.found.marks.take().unwrap_or_else(|| self.pilot());
                (marks.clone(), Some(marks))
            }
            MarkSource::Same => (Marks::new(size, 0, |_| true), None),
        };
        let rows: Vec<Row<'a>> =
            (0..size[1]).into_par_iter().map(|y| self.gather_row(y, hits, &kept)).collect();
        let mut first_pass = Vec::with_capacity(self.found.sums.len());
        let (mut receivers, mut seeds) = (Vec::new(), Vec::new());
        for row in rows {
            let start = first_pass.len();
            for (sums, other) in self.found.sums[start..].iter_mut().zip(&row.other) {
                sums.merge(other);
            }
            first_pass.extend(row.direct);
            receivers.extend(row.receivers);
            seeds.extend(row.seeds);
            self.found.ledger.shadow_rays += row.shadow_rays;
            self.found.ledger.invalid += row.invalid;
        }
        let marks = marks.unwrap_or_else(|| {
            let marks = Marks::new(size, self.settings.dilation, |pixel| {
                first_pass[pixel].seen.is_partial()
            });
            keep_marked(&marks, hits, &mut receivers, &mut seeds);
            marks
        });

        for (pixel, (sums, direct)) in self.found.sums.iter_mut().zip(&first_pass).enumerate() {
            if marks.slot(pixel).is_some() {
                let (unshadowed, seen) = (direct.unshadowed, direct.seen);
                sums.merge(&PixelSums { unshadowed, seen, ..PixelSums::default() });
            } else {
                sums.merge(direct);
            }
        }
        if is_exchanged {
            self.exchange(&marks, hits, &receivers, &seeds);
        }
        self.found.marks = Some(marks);
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

    fn stream(&self, stream: Stream) -> u64 {
        hash::key(self.seed, stream as u32, 0)
    }

    /// The numbers of a chain, or of a number of chains, of this half and round.
    fn chain_sampler(&self, stream: Stream, chain: u32) -> IndependentSampler {
        IndependentSampler::new(self.stream(stream), chain, 2 * self.found.rounds + self.half)
    }
}
