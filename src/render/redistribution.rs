//! Passes of energy redistribution.

use super::method::{Found, Method, Report};
use super::sampled::Sampled;
use super::{RenderSettings, Shard};
use crate::film::{Scale, SplatFilm};
use crate::integrator::bdpt::Workspace;
use crate::integrator::erpt::{Deposits, Erpt, Ledger, Pass};
use crate::scene::Scene;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Samples that set the size of a deposit: it is right to a few percent, which is enough for what only trades work
/// against noise.
const PROBES: u64 = 1 << 14;

/// Mutations of a pass over the whole picture, about: a second or two.
const PASS: u64 = 1 << 20;

/// Pixels that one worker takes at a time, and workers' shares between two visits to the film: what waits there takes some
/// hundred megabytes at most.
const SHARE: usize = 64;
const SHARES: usize = 256;

/// A render by energy redistribution under way. Passes, one sample per pixel each, belong to the halves in turns.
#[derive(Debug)]
pub(super) struct Redistribution<'s> {
    scene: &'s Scene,
    erpt: Erpt,
    seed: u64,
    shard: Shard,
    direct: Option<Sampled<'s>>,
    found: Deposited,
}

/// What redistributed samples left behind.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Deposited {
    film: SplatFilm,
    /// Proposals, and how many times their median a pixel may be, where pixels are limited by them.
    proposals: Option<(SplatFilm, f32)>,
    /// Mean energy of a sample.
    energy: f64,
    chain_length: u32,
    /// Is energy dropped by a limit of consecutive deposits?
    is_limited: bool,
    passes: u32,
    /// Mutations per pixel so far, those of other shards included.
    mutations: u32,
    /// Mutations of the whole picture so far.
    done: u64,
    ledger: Ledger,
}

impl<'s> Redistribution<'s> {
    /// Measures the energy, on the threads of the current rayon pool; goes on from what was `found`.
    pub(super) fn new(
        scene: &'s Scene,
        erpt: Erpt,
        settings: &RenderSettings,
        found: Option<(Deposited, Option<Sampled<'s>>)>,
    ) -> Self {
        let (found, direct) = found.unwrap_or_else(|| {
            let energies: Vec<f64> = (0..PROBES)
                .into_par_iter()
                .map(|index| erpt.probe(scene, settings.seed, index))
                .collect();
            let found = Deposited {
                // The squares are not the variance, but they have its shape from pixel to pixel; the halves give its size.
                film: SplatFilm::of_independent(scene.film),
                proposals: erpt.proposal_limit.map(|limit| (SplatFilm::new(scene.film), limit)),
                energy: energies.iter().sum::<f64>() / PROBES as f64,
                chain_length: erpt.chain_length,
                is_limited: erpt.consecutive_limit.is_some(),
                passes: 0,
                mutations: 0,
                done: 0,
                ledger: Ledger::default(),
            };
            (found, erpt.separate_direct.then(|| Sampled::of_direct(scene, settings)))
        });
        Self { scene, erpt, seed: settings.seed, shard: settings.shard, direct, found }
    }

    /// One sample per pixel, and so many mutations per pixel on average. Shards divide the pixels of each pass.
    fn pass(&mut self, mutations: u32) {
        let Self { scene, erpt, seed, shard, found, .. } = self;
        let Deposited { film, proposals, ledger, energy, passes, done, .. } = found;
        // Fixed before the samples are drawn, as it must be.
        let deposit = *energy / f64::from(mutations);
        let pass = Pass { seed: *seed, sample: *passes, deposit };
        let half = (*passes & 1) as usize;
        let [left, top, columns, rows] = scene.film.crop;
        let pixels: Vec<[u32; 2]> =
            (top..top + rows).flat_map(|y| (left..left + columns).map(move |x| [x, y])).collect();
        let own: Vec<&[[u32; 2]]> = pixels
            .chunks(SHARE)
            .zip(u64::from(*passes)..)
            .filter(|&(_, number)| shard.has(number))
            .map(|(share, _)| share)
            .collect();
        for shares in own.chunks(SHARES) {
            let found: Vec<Deposits> = shares
                .par_iter()
                .with_max_len(1)
                .map_init(Workspace::default, |workspace, share| {
                    let mut deposits = Deposits::default();
                    for &pixel in *share {
                        erpt.spread(scene, pixel, pass, workspace, &mut deposits);
                    }
                    deposits
                })
                .collect();
            for deposits in &found {
                film.add_all(half, &deposits.splats);
                if let Some((proposals, _)) = proposals {
                    proposals.add_all(half, &deposits.proposals);
                }
                ledger.merge(&deposits.ledger);
            }
            let taken: usize = shares.iter().map(|share| share.len()).sum();
            *done += taken as u64 * u64::from(mutations);
        }
    }
}

impl Method for Redistribution<'_> {
    fn round(&mut self, most: u32) {
        let pixels = self.scene.film.crop_pixels();
        let left = most - self.found.mutations;
        let affordable = (PASS / pixels.max(1)) as u32;
        // Both halves want a pass.
        let mutations = affordable.clamp(1, self.erpt.mutations_per_sample.max(1));
        let mutations = mutations.min((most / 2).max(1)).min(left);
        if self.found.energy > 0.0 {
            self.pass(mutations);
        }
        self.found.passes += 1;
        self.found.mutations += mutations;
        if let Some(direct) = &mut self.direct {
            direct.keep_up(self.found.mutations);
        }
    }

    fn is_complete(&self, most: u32) -> bool {
        self.found.mutations >= most
    }

    fn found(&self) -> Found<'_> {
        let direct = self.direct.as_ref().map(|direct| Cow::Borrowed(direct.taken()));
        Found::Redistribution(Cow::Borrowed(&self.found), direct)
    }
}

impl Deposited {
    /// The film, with its spikes taken away if they are to be.
    pub(super) fn film(&self) -> Cow<'_, SplatFilm> {
        match &self.proposals {
            Some((proposals, limit)) => {
                Cow::Owned(self.film.limited_by(proposals, f64::from(*limit)))
            }
            None => Cow::Borrowed(&self.film),
        }
    }

    pub(super) fn scale(&self) -> Scale {
        Scale::of_samples(self.passes)
    }

    /// Mutations per pixel.
    pub(super) fn mutations(&self) -> u32 {
        self.mutations
    }

    /// Mutations of the whole picture.
    pub(super) fn done(&self) -> u64 {
        self.done
    }

    pub(super) fn invalid(&self) -> u64 {
        self.film.invalid_splats() + self.ledger.invalid
    }

    /// Adds what was left by the samples of other pixels in the same passes.
    pub(super) fn merge(&mut self, other: &Self) {
        self.film.merge(&other.film);
        if let (Some((proposals, _)), Some((more, _))) = (&mut self.proposals, &other.proposals) {
            proposals.merge(more);
        }
        self.done += other.done;
        self.ledger.merge(&other.ledger);
    }

    pub(super) fn report(&self) -> Report {
        let mut report = Report::default();
        let mut tell = |name: &str, value: String| report.facts.push((name.to_owned(), value));
        let ledger = &self.ledger;
        tell("energy_per_sample", format!("{:.6e}", self.energy));
        tell("chains", format!("{} of {} mutations", ledger.chains, self.chain_length));
        tell("capped_paths", ledger.capped.to_string());
        for (name, line) in Erpt::NAMES.iter().zip(ledger.statistics.lines(Erpt::NAMES)) {
            let line = line.strip_prefix(&format!("{name}: ")).unwrap_or(&line).to_owned();
            tell(&format!("mutation {name}"), line);
        }
        if self.is_limited && ledger.started > 0.0 {
            let lost = 100.0 * ledger.lost / ledger.started;
            tell("energy_lost", format!("{lost:.3} % by the limit of consecutive deposits"));
        }
        if self.proposals.is_some() {
            let lost = 100.0 * (1.0 - self.film().total() / self.film.total());
            tell("energy_lost_to_medians", format!("{lost:.3} %"));
        }
        if self.energy == 0.0 {
            report.warnings.push(format!(
                "no light beyond what is direct was found by {PROBES} samples: only direct light is in the picture"
            ));
        }
        report
    }
}
