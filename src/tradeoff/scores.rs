//! What was found, out of the folder of a measurement.

use super::curve::Reach;
use super::judge::Scene;
use super::settings::{Filter, Method, Settings};
use super::statistics::Estimate;
use super::unit::{ReferenceHalf, Run, Unit};
use super::verdict::Verdict;
use super::{Error, JSON};
use crate::folder::write_json;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Everything that was found.
#[derive(Clone, Debug, Serialize)]
pub struct Scores {
    /// What was measured.
    pub settings: Settings,
    /// Units that are there, and units that the settings ask for.
    pub units: [usize; 2],
    /// Threads that the runs ran on; more than one number means that their times cannot be compared.
    pub threads: Vec<usize>,
    /// Processors that they ran on; the same holds.
    pub processors: Vec<String>,
    /// Denoisers that could not run, and why.
    pub left_out: Vec<(Filter, String)>,
    /// Scenes with a reference and at least one run.
    pub scenes: Vec<SceneScores>,
}

/// One scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneScores {
    /// Its name.
    pub name: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// What the errors are measured against.
    pub reference: ReferenceScores,
    /// What `auto` takes on this scene, at the longest budget.
    pub auto: Combination,
    /// Every integrator, denoiser and sample count.
    pub points: Vec<Point>,
    /// Indices of the points that no other one beats in both seconds and error, the fastest first.
    pub front: Vec<usize>,
    /// Errors, and when each integrator and denoiser reaches them.
    pub targets: Vec<f64>,
    /// One row for each integrator and denoiser.
    pub curves: Vec<CurveScores>,
    /// What to choose, and why.
    pub verdict: Verdict,
}

/// An integrator with a denoiser.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
pub struct Combination {
    /// The integrator.
    pub integrator: Method,
    /// The denoiser.
    pub denoiser: Filter,
}

impl std::fmt::Display for Combination {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.denoiser {
            Filter::None => write!(out, "{}, not denoised", self.integrator.name()),
            denoiser => write!(out, "{} + {}", self.integrator.name(), denoiser.name()),
        }
    }
}

/// The reference of a scene: two independent halves.
#[derive(Clone, Debug, Serialize)]
pub struct ReferenceScores {
    /// The integrator that made it.
    pub integrator: String,
    /// Why.
    pub reason: String,
    /// Samples or mutations per pixel of each half.
    pub samples: [u32; 2],
    /// Wall time of both halves.
    pub seconds: f64,
    /// Relative L2 of its own noise; an error below it is not known.
    pub noise: f64,
}

/// When a combination reaches the targets of its scene.
#[derive(Clone, Debug, Serialize)]
pub struct CurveScores {
    /// Which.
    pub combination: Combination,
    /// One for each target; `None` where the reference's noise is above the target.
    pub reach: Vec<Option<Reach>>,
}

/// One integrator, denoiser and sample count, over all seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// The integrator and the denoiser.
    pub combination: Combination,
    /// Samples or mutations per pixel.
    pub samples: u32,
    /// How many replicates there are.
    pub seeds: usize,
    /// Wall time of the render, in seconds.
    pub render_seconds: Estimate,
    /// Wall time of the denoiser, in seconds.
    pub denoise_seconds: Estimate,
    /// Both together.
    pub seconds: Estimate,
    /// Time of all threads in both, in seconds, where the system tells.
    pub cpu_seconds: Option<f64>,
    /// Relative L2 against the truth: the reference's noise is taken out.
    pub error: Estimate,
    /// Is the error above the reference's noise?
    pub is_known: bool,
    /// The part of the error that more seeds do not take away; may be below zero by chance. `None` of one seed.
    pub bias2: Option<f64>,
    /// The part that differs from seed to seed.
    pub variance: Option<f64>,
    /// Against the mean of the reference, as are the next two; `None` of a picture that is too small.
    pub one_minus_ssim: Option<Estimate>,
    /// In decibels.
    pub psnr: Estimate,
    /// Mean FLIP.
    pub flip: Estimate,
    /// Non-finite samples dropped, of all seeds together.
    pub invalid_samples: u64,
    /// The picture of the first seed, in the folder of the measurement.
    pub picture: PathBuf,
}

impl Scores {
    /// Reads a measurement, on the threads of the current rayon pool. `progress` hears how many of how many pictures have
    /// been judged.
    ///
    /// # Errors
    /// Where the folder holds no measurement or a file of it cannot be read.
    pub fn of(folder: &Path, progress: &(dyn Fn(u64, u64) + Sync)) -> Result<Self, Error> {
        let settings = Settings::read(folder)?;
        let mut found = Vec::new();
        let mut units = [0, 0];
        for (index, scene) in settings.scenes.iter().enumerate() {
            let halves = [0, 1].map(|half| {
                let folder = Unit::Reference { scene: index, half }.folder(folder, &scene.name);
                ReferenceHalf::read(&folder).ok().map(|record| (record, folder))
            });
            let mut runs = Vec::new();
            for &method in &settings.integrators {
                for replicate in 0..u64::from(settings.seeds) {
                    let seed = settings.seed.wrapping_add(replicate);
                    let unit = Unit::Run { scene: index, method, seed };
                    let folder = unit.folder(folder, &scene.name);
                    runs.extend(Run::read(&folder).ok().map(|run| (run, folder)));
                }
            }
            units[0] += halves.iter().flatten().count() + runs.len();
            units[1] += 2 + settings.integrators.len() * settings.seeds as usize;
            found.push((scene, halves, runs));
        }
        let count = |(_, _, runs): &(_, _, Vec<(Run, PathBuf)>)| {
            let of = |(run, _): &(Run, _)| -> usize {
                run.measures.iter().map(|one| one.pictures.len()).sum()
            };
            runs.iter().map(of).sum::<usize>()
        };
        let (total, done) = (found.iter().map(count).sum::<usize>() as u64, AtomicU64::new(0));
        let heard = |judged: usize| {
            let before = done.fetch_add(judged as u64, Ordering::Relaxed);
            progress(before + judged as u64, total);
        };
        let mut scores = Self {
            units,
            threads: Vec::new(),
            processors: Vec::new(),
            left_out: Vec::new(),
            scenes: Vec::new(),
            settings: settings.clone(),
        };
        let (mut threads, mut processors, mut left_out) =
            (BTreeSet::new(), BTreeSet::new(), BTreeMap::new());
        for (scene, halves, runs) in found {
            for (run, _) in &runs {
                threads.insert(run.threads);
                processors.insert(run.processor.clone());
                left_out.extend(run.left_out.iter().cloned());
            }
            if let [Some(first), Some(second)] = halves
                && !runs.is_empty()
            {
                let size = [scene.width, scene.height];
                let of_scene = Scene { folder, name: &scene.name, size };
                scores.scenes.push(of_scene.judge([first, second], runs, &heard)?);
            }
        }
        scores.threads = threads.into_iter().collect();
        scores.processors = processors.into_iter().collect();
        scores.left_out = left_out.into_iter().collect();
        Ok(scores)
    }

    /// Writes `scores.json`.
    ///
    /// # Errors
    /// [`Error::Folder`] where the folder cannot be written.
    pub fn write_json(&self, folder: &Path) -> Result<(), Error> {
        Ok(write_json(&folder.join(JSON), self)?)
    }
}
