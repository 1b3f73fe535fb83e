//! Passes of energy redistribution.

use super::RenderSettings;
use super::method::{Method, Report, replace_radiance};
use super::sampled::Sampled;
use crate::film::{Radiance, Scale, SplatFilm};
use crate::integrator::bdpt::Workspace;
use crate::integrator::erpt::{Deposits, Erpt, Ledger, Pass};
use crate::scene::Scene;
use quietlight_denoise::Layers;
use rayon::prelude::*;

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
    /// Mean energy of a sample.
    energy: f64,
    film: SplatFilm,
    /// Proposals, where pixels are limited by them.
    proposals: Option<SplatFilm>,
    direct: Option<Sampled<'s>>,
    passes: u32,
    /// Mutations per pixel so far.
    mutations: u32,
    ledger: Ledger,
}

impl<'s> Redistribution<'s> {
    pub(super) fn new(scene: &'s Scene, erpt: Erpt, settings: &RenderSettings) -> Self {
        let energies: Vec<f64> = (0..PROBES)
            .into_par_iter()
            .map(|index| erpt.probe(scene, settings.seed, index))
            .collect();
        Self {
            scene,
            erpt,
            seed: settings.seed,
            energy: energies.iter().sum::<f64>() / PROBES as f64,
            // The squares are not the variance, but they have its shape from pixel to pixel; the halves give its size.
            film: SplatFilm::of_independent(scene.film),
            proposals: erpt.proposal_limit.map(|_| SplatFilm::new(scene.film)),
            direct: erpt.separate_direct.then(|| Sampled::of_direct(scene, settings)),
            passes: 0,
            mutations: 0,
            ledger: Ledger::default(),
        }
    }

    /// The film with its spikes taken away, if they are to be.
    fn limited(&self) -> Option<SplatFilm> {
        let proposals = self.proposals.as_ref()?;
        Some(self.film.limited_by(proposals, f64::from(self.erpt.proposal_limit?)))
    }

    /// One sample per pixel, and so many mutations per pixel on average.
    fn pass(&mut self, mutations: u32) {
        let Self { scene, erpt, film, proposals, ledger, .. } = self;
        // Fixed before the samples are drawn, as it must be.
        let deposit = self.energy / f64::from(mutations);
        let pass = Pass { seed: self.seed, sample: self.passes, deposit };
        let half = (self.passes & 1) as usize;
        let [left, top, columns, rows] = scene.film.crop;
        let pixels: Vec<[u32; 2]> =
            (top..top + rows).flat_map(|y| (left..left + columns).map(move |x| [x, y])).collect();
        for shares in pixels.chunks(SHARE * SHARES) {
            let found: Vec<Deposits> = shares
                .par_chunks(SHARE)
                .map_init(Workspace::default, |workspace, share| {
                    let mut deposits = Deposits::default();
                    for &pixel in share {
                        erpt.spread(scene, pixel, pass, workspace, &mut deposits);
                    }
                    deposits
                })
                .collect();
            for deposits in &found {
                film.add_all(half, &deposits.splats);
                if let Some(proposals) = proposals {
                    proposals.add_all(half, &deposits.proposals);
                }
                ledger.merge(&deposits.ledger);
            }
        }
    }
}

impl Method for Redistribution<'_> {
    fn round(&mut self, most: u32) {
        let left = most - self.mutations;
        let affordable = (PASS / self.scene.film.crop_pixels().max(1)) as u32;
        // Both halves want a pass.
        let mutations = affordable.clamp(1, self.erpt.mutations_per_sample.max(1));
        let mutations = mutations.min((most / 2).max(1)).min(left);
        if self.energy > 0.0 {
            self.pass(mutations);
        }
        self.passes += 1;
        self.mutations += mutations;
        if let Some(direct) = &mut self.direct {
            direct.keep_up(self.mutations);
        }
    }

    fn samples(&self) -> u32 {
        self.mutations
    }

    fn done(&self) -> u64 {
        u64::from(self.mutations) * self.scene.film.crop_pixels()
    }

    fn put_radiance(&self, layers: &mut Layers) {
        let scale = Scale::of_samples(self.passes);
        if let Some(direct) = &self.direct {
            replace_radiance(direct.layers(), layers);
        }
        let radiance = if self.direct.is_some() { Radiance::Added } else { Radiance::Replaced };
        match self.limited() {
            Some(limited) => limited.put_into(layers, &scale, radiance),
            None => self.film.put_into(layers, &scale, radiance),
        }
    }

    fn is_independent(&self) -> bool {
        false
    }

    fn invalid(&self) -> u64 {
        let direct = self.direct.as_ref().map_or(0, Sampled::invalid_samples);
        self.film.invalid_splats() + self.ledger.invalid + direct
    }

    fn report(&self) -> Report {
        let mut report = Report::default();
        let mut tell = |name: &str, value: String| report.facts.push((name.to_owned(), value));
        let ledger = &self.ledger;
        tell("energy_per_sample", format!("{:.6e}", self.energy));
        tell("chains", format!("{} of {} mutations", ledger.chains, self.erpt.chain_length));
        tell("capped_paths", ledger.capped.to_string());
        for (name, line) in Erpt::NAMES.iter().zip(ledger.statistics.lines(Erpt::NAMES)) {
            let line = line.strip_prefix(&format!("{name}: ")).unwrap_or(&line).to_owned();
            tell(&format!("mutation {name}"), line);
        }
        if self.erpt.consecutive_limit.is_some() && ledger.started > 0.0 {
            let lost = 100.0 * ledger.lost / ledger.started;
            tell("energy_lost", format!("{lost:.3} % by the limit of consecutive deposits"));
        }
        if let Some(limited) = self.limited() {
            let lost = 100.0 * (1.0 - limited.total() / self.film.total());
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
