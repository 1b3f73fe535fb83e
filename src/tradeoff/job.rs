//! Measuring: which units are missing, and one after the other until they are there.

use super::Error;
use super::request::{REFERENCE_FACTOR, Request};
use super::settings::{Filter, ReferenceBudget, Settings};
use super::unit::Unit;
use super::workshop::Workshop;
use crate::dataset::Shard;
use crate::folder::at;
use crate::render::{Budget, RenderSettings, render};
use crate::scene::Scene;
use quietlight_denoise::Denoiser;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

/// Which part of which measurement to make.
#[derive(Clone, Debug)]
pub struct Job {
    /// Folder of the measurement; made if it is not there.
    pub folder: PathBuf,
    /// What to measure.
    pub request: Request,
    /// Which of the units this process makes.
    pub shard: Shard,
}

/// What there is to do.
#[derive(Debug)]
pub struct Plan {
    folder: PathBuf,
    /// What was asked for.
    settings: Settings,
    /// The same with what the folder has beside it.
    joined: Settings,
    scenes: Vec<Scene>,
    denoisers: Vec<(Filter, Option<Denoiser>)>,
    /// Denoisers that cannot run, and why.
    pub left_out: Vec<(Filter, String)>,
    missing: Vec<Unit>,
    /// Units of the shard that are there already.
    pub complete: usize,
}

/// What was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Units made.
    pub made: usize,
    /// Was the work stopped before all of them were there?
    pub is_interrupted: bool,
}

impl Job {
    /// Loads the scenes and compares with what is in the folder; changes nothing.
    ///
    /// # Errors
    /// [`Settings`](crate::folder::Error::Settings) where the folder has a measurement of other settings, [`Error::Scene`] where a scene cannot be
    /// loaded, [`Error::Nothing`] where no denoiser asked for can run.
    pub fn plan(self) -> Result<Plan, Error> {
        let (settings, scenes) = self.request.load()?;
        let joined = if Settings::path(&self.folder).exists() {
            settings.clone().join(&Settings::read(&self.folder)?, &self.folder)?
        } else {
            settings.clone()
        };
        let (mut denoisers, mut left_out) = (Vec::new(), Vec::new());
        for &filter in &settings.denoisers {
            match filter.denoiser() {
                Ok(denoiser) => denoisers.push((filter, denoiser)),
                Err(error) => left_out.push((filter, error.to_string())),
            }
        }
        if denoisers.is_empty() {
            let reasons = left_out.iter().map(|(filter, why)| format!("{}: {why}", filter.name()));
            return Err(Error::Nothing(reasons.collect::<Vec<_>>().join("; ")));
        }
        let units = units(&settings);
        let is_done = |unit: &Unit| {
            let scene = &settings.scenes[unit.scene()].name;
            unit.is_done(&unit.folder(&self.folder, scene), &denoisers)
        };
        let (complete, missing): (Vec<Unit>, Vec<Unit>) = self
            .shard
            .views(units.len() as u32)
            .map(|index| units[index as usize])
            .partition(is_done);
        let complete = complete.len();
        let folder = self.folder;
        Ok(Plan { folder, settings, joined, scenes, denoisers, left_out, missing, complete })
    }
}

/// All units: the references first, for nothing can be told without; then one replicate after the other, so that an
/// interrupted measurement has something of everything.
fn units(settings: &Settings) -> Vec<Unit> {
    let scenes = || 0..settings.scenes.len();
    let mut units: Vec<Unit> =
        scenes().flat_map(|scene| [0, 1].map(|half| Unit::Reference { scene, half })).collect();
    for replicate in 0..u64::from(settings.seeds) {
        let seed = settings.seed.wrapping_add(replicate);
        for scene in scenes() {
            let run = |&method: &_| Unit::Run { scene, method, seed };
            units.extend(settings.integrators.iter().map(run));
        }
    }
    units
}

impl Plan {
    /// How many units are to be made.
    pub fn len(&self) -> usize {
        self.missing.len()
    }

    /// Is there nothing to do?
    pub fn is_empty(&self) -> bool {
        self.missing.is_empty()
    }

    /// Samples that all missing units take together, for progress; of a reference by the clock as many as by default.
    pub fn work(&self) -> u64 {
        self.missing.iter().map(|&unit| self.work_of(unit)).sum()
    }

    fn work_of(&self, unit: Unit) -> u64 {
        let scene = &self.settings.scenes[unit.scene()];
        let most = self.settings.samples.last().copied().unwrap_or(1);
        let samples = match (unit, self.settings.reference) {
            (Unit::Run { .. }, _) => most,
            (Unit::Reference { .. }, ReferenceBudget::Samples(samples)) => samples,
            (Unit::Reference { .. }, ReferenceBudget::Seconds(_)) => {
                most.saturating_mul(REFERENCE_FACTOR / 2)
            }
        };
        u64::from(scene.width) * u64::from(scene.height) * u64::from(samples)
    }

    /// Makes the missing units, one at a time, so that their times are those of a render that has the machine to itself.
    ///
    /// `progress` is called, also from workers, with the samples done so far of [`Plan::work`]. When `stop` becomes true the
    /// unit under way is dropped.
    ///
    /// # Errors
    /// Where files cannot be written or a denoiser fails; units made until then stay.
    pub fn run(
        &self,
        threads: &rayon::ThreadPool,
        progress: &(dyn Fn(u64) + Sync),
        stop: &AtomicBool,
    ) -> Result<Outcome, Error> {
        fs::create_dir_all(&self.folder).map_err(at(&self.folder))?;
        self.joined.write(&self.folder)?;
        self.warm_up(threads)?;
        let mut before = 0;
        let mut outcome = Outcome::default();
        for &unit in &self.missing {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let work = self.work_of(unit);
            let heard = |done: u64| progress(before + done.min(work));
            let workshop = Workshop {
                scene: &self.scenes[unit.scene()],
                samples: &self.settings.samples,
                denoisers: &self.denoisers,
                left_out: &self.left_out,
                reference: self.settings.reference,
                threads,
                progress: &heard,
                stop,
            };
            let folder = unit.folder(&self.folder, &self.settings.scenes[unit.scene()].name);
            if !unit.make(&folder, self.settings.seed, &workshop)? {
                break;
            }
            outcome.made += 1;
            before += work;
            progress(before);
        }
        outcome.is_interrupted = outcome.made < self.missing.len();
        Ok(outcome)
    }

    /// Lets the networks denoise every scene once: loading their weights is no part of what is measured.
    fn warm_up(&self, threads: &rayon::ThreadPool) -> Result<(), Error> {
        let settings = RenderSettings { budget: Budget::Samples(2), ..RenderSettings::default() };
        for (index, scene) in self.scenes.iter().enumerate() {
            let is_run = |unit: &Unit| matches!(*unit, Unit::Run { scene, .. } if scene == index);
            let networks = || {
                let all = self.denoisers.iter().filter_map(|(_, denoiser)| denoiser.as_ref());
                all.filter(|denoiser| matches!(denoiser, Denoiser::Kpcn { .. }))
            };
            if networks().next().is_none() || !self.missing.iter().any(is_run) {
                continue;
            }
            let rendered =
                threads.install(|| render(scene, &settings, &|_| {}, &AtomicBool::new(false)));
            for denoiser in networks() {
                denoiser.denoise(&rendered.layers, threads, &|_| {})?;
            }
        }
        Ok(())
    }
}
