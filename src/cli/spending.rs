//! Budgets of `quietlight render`: samples, time with all that comes after rendering, or an error.

use super::args::Render;
use super::keep::Keeper;
use super::progress::Progress;
use super::render::STOP;
use super::{Failure, denoising};
use crate::render::probe;
use crate::render::{Budget, Ending, RenderSettings, Rendered, Rendering, Target};
use crate::scene::Scene;
use anyhow::Context;
use quietlight_denoise::exr::{self, WriteOptions};
use quietlight_denoise::variance::estimated_noise;
use quietlight_denoise::{Denoised, Denoiser, ErrorEstimate, Image, Layers};
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The most that `--target-error` spends where nothing else is said.
const MOST_SAMPLES: u32 = 1 << 16;

/// What methods prepare for, where nobody knows how many samples it will be.
const USUAL_SAMPLES: u32 = 256;

/// The part of a budget of time that estimating the error may take; where it would take more, it is left out.
const SHARE_OF_ESTIMATE: f64 = 0.2;

/// The least part of a budget of time that is left for rendering.
const SHARE_OF_RENDERING: f64 = 0.1;

/// Side of the square that writing is tried with.
const SIDE: u32 = 256;

/// What is to be rendered, and what is asked of it.
pub(super) struct Spending<'a> {
    pub(super) scene: &'a Scene,
    pub(super) settings: RenderSettings,
    pub(super) threads: &'a rayon::ThreadPool,
    pub(super) arguments: &'a Render,
    pub(super) output: &'a Path,
    pub(super) keeper: &'a Keeper,
}

/// What came of it.
pub(super) struct Spent {
    pub(super) rendered: Rendered,
    pub(super) finished: Finished,
    /// What the user should know of the budget.
    pub(super) note: Option<String>,
}

/// What is made of layers.
#[derive(Default)]
pub(super) struct Finished {
    /// `None` where the noise was left in.
    pub(super) denoised: Option<Denoised>,
    /// What denoising took.
    pub(super) denoising: Option<Duration>,
    /// The error of the denoised picture, where it was asked for and is known.
    pub(super) error: Option<ErrorEstimate>,
}

/// What has to be done after rendering, in seconds.
struct Afterwards {
    denoising: f64,
    writing: f64,
}

impl Spending<'_> {
    /// Renders and denoises; `start` is when the program began.
    pub(super) fn spend(
        &self,
        denoiser: Option<&Denoiser>,
        start: Instant,
    ) -> Result<Spent, Failure> {
        let estimates = !self.arguments.finish.no_estimate;
        if let Some(error) = self.arguments.target_error {
            return self.reach(error, denoiser, start);
        }
        let Budget::Time(time) = self.settings.budget else {
            let rendered = self.render(self.settings, denoiser)?;
            let finished = self.finish(denoiser, &rendered.layers, estimates)?;
            return Ok(Spent { rendered, finished, note: None });
        };
        let after = self.afterwards(denoiser)?;
        let total = time.as_secs_f64();
        let estimates = estimates && 2.0 * after.denoising <= SHARE_OF_ESTIMATE * total;
        let looks = if estimates { 3.0 } else { 1.0 };
        let left = total - start.elapsed().as_secs_f64() - looks * after.denoising - after.writing;
        let least = SHARE_OF_RENDERING * total;
        let note = if left < least {
            let taken = total - left;
            Some(format!(
                "warning: what is done beside rendering takes {taken:.1} s: {total:.1} s are not enough"
            ))
        } else if !estimates && !self.arguments.finish.no_estimate {
            Some("the error is not estimated: that would take too much of the time".to_owned())
        } else {
            None
        };
        let budget = Budget::Time(Duration::from_secs_f64(left.max(least)));
        let rendered = self.render(RenderSettings { budget, ..self.settings }, denoiser)?;
        let finished = self.finish(denoiser, &rendered.layers, estimates)?;
        Ok(Spent { rendered, finished, note })
    }

    /// Renders a part of the picture's samples into a file for `quietlight merge`.
    pub(super) fn render_part(&self) -> Result<(), Failure> {
        if self.keeper.is_part_done(self.scene, &self.settings)? {
            return Ok(());
        }
        let rendering = self.run(self.settings)?;
        self.keeper.finish_part(&rendering)
    }

    fn render(
        &self,
        settings: RenderSettings,
        denoiser: Option<&Denoiser>,
    ) -> Result<Rendered, Failure> {
        let mut rendering = self.run(settings)?;
        if rendering.is_pilot() && !STOP.load(Ordering::Relaxed) {
            let start = Instant::now();
            let error = self.error_of(&rendering, denoiser)?;
            self.threads.install(|| rendering.spread(error.as_ref()));
            let budget = match settings.budget {
                Budget::Time(time) => Budget::Time(time.saturating_sub(start.elapsed())),
                samples => samples,
            };
            self.go_on(&mut rendering, budget);
        }
        Ok(self.threads.install(|| rendering.finish()))
    }

    /// The map of the error of what is denoised so far; `None` where it cannot be told.
    fn error_of(
        &self,
        rendering: &Rendering<'_>,
        denoiser: Option<&Denoiser>,
    ) -> Result<Option<Image>, Failure> {
        let Some(denoiser) = denoiser else { return Ok(None) };
        let layers = self.threads.install(|| rendering.layers());
        let denoised = denoising::run(denoiser, &layers, self.threads)?;
        let error = denoising::estimate(&denoised, denoiser, &layers, self.threads)?;
        Ok(error.map(|error| error.map))
    }

    fn run(&self, settings: RenderSettings) -> Result<Rendering<'_>, Failure> {
        let mut rendering = self.keeper.begin(self.scene, &settings, self.threads)?;
        self.go_on(&mut rendering, settings.budget);
        Ok(rendering)
    }

    fn go_on(&self, rendering: &mut Rendering<'_>, budget: Budget) {
        let progress = self.progress(budget);
        let show = shown(&progress, budget);
        self.keeper.run(rendering, budget, self.threads, &show);
        progress.finish();
    }

    fn progress(&self, budget: Budget) -> Progress {
        match budget {
            Budget::Samples(samples) => {
                let total = self.scene.film.crop_pixels() * u64::from(samples);
                let total = total.div_ceil(u64::from(self.settings.shard.count()));
                Progress::new("render", "samples", total)
            }
            Budget::Time(time) => Progress::new("render", "ms", time.as_millis() as u64),
        }
    }

    /// Denoises the layers and estimates the error, unless the user stopped.
    fn finish(
        &self,
        denoiser: Option<&Denoiser>,
        layers: &Layers,
        estimates: bool,
    ) -> Result<Finished, Failure> {
        let Some(denoiser) = denoiser.filter(|_| !STOP.load(Ordering::Relaxed)) else {
            return Ok(Finished::default());
        };
        let start = Instant::now();
        let denoised = denoising::run(denoiser, layers, self.threads).map_err(Failure::Failed)?;
        let denoising = start.elapsed();
        let error = match estimates {
            true => denoising::estimate(&denoised, denoiser, layers, self.threads)?,
            false => None,
        };
        Ok(Finished { denoised: Some(denoised), denoising: Some(denoising), error })
    }

    /// Predicts what comes after rendering, by doing it with a part of the picture.
    fn afterwards(&self, denoiser: Option<&Denoiser>) -> Result<Afterwards, Failure> {
        let Self { scene, settings, threads, output, .. } = self;
        let pixels = scene.film.crop_pixels();
        let denoising = match denoiser {
            Some(denoiser) => {
                let cost = probe::denoising(scene, settings, denoiser, threads)
                    .context("cannot denoise")
                    .map_err(Failure::Failed)?;
                // Networks are ready from now on.
                cost.seconds_per_pixel * pixels as f64
            }
            None => 0.0,
        };
        let layers = threads.install(|| probe::middle(scene, settings, SIDE));
        let folder = match output.parent() {
            Some(parent) if parent != Path::new("") => parent,
            _ => Path::new("."),
        };
        let start = Instant::now();
        let folder =
            tempfile::tempdir_in(folder).context("cannot write").map_err(Failure::Failed)?;
        let options = WriteOptions { halves: self.arguments.halves, ..WriteOptions::default() };
        exr::write(&folder.path().join("trial.exr"), &layers, &options)
            .context("cannot write")
            .map_err(Failure::Failed)?;
        let part = (layers.width * layers.height) as f64 / pixels as f64;
        Ok(Afterwards { denoising, writing: start.elapsed().as_secs_f64() / part })
    }

    /// Renders until the estimated error is small enough.
    fn reach(
        &self,
        error: f64,
        denoiser: Option<&Denoiser>,
        start: Instant,
    ) -> Result<Spent, Failure> {
        let most = match (self.settings.budget, self.arguments.spp) {
            (Budget::Time(time), _) => {
                let after = self.afterwards(denoiser)?;
                let left = time.saturating_sub(start.elapsed());
                Budget::Time(left.saturating_sub(Duration::from_secs_f64(after.writing)))
            }
            (_, samples) => Budget::Samples(samples.unwrap_or(MOST_SAMPLES)),
        };
        let usual = match most {
            Budget::Samples(samples) => Budget::Samples(samples.min(USUAL_SAMPLES)),
            time => time,
        };
        let settings = RenderSettings { budget: usual, ..self.settings };
        let mut rendering = self.keeper.begin(self.scene, &settings, self.threads)?;
        let mut finished = Finished::default();
        let progress = self.progress(Budget::Samples(match most {
            Budget::Samples(samples) => samples,
            Budget::Time(_) => MOST_SAMPLES,
        }));
        let judge = |samples: u32, layers: &Layers| -> Result<Option<f64>, Failure> {
            finished = self.finish(denoiser, layers, true)?;
            let estimate = match denoiser {
                Some(_) => finished.error.as_ref().map(|error| error.relative_l2),
                None => estimated_noise(layers),
            };
            if let Some(estimate) = estimate {
                eprintln!(
                    "error: estimated relative L2 {estimate:.3e} at {samples} samples per pixel"
                );
            }
            Ok(estimate)
        };
        let target = Target { error, most };
        let show = |done| progress.at(done);
        let advance = |rendering: &mut Rendering<'_>, samples| {
            self.keeper.run(rendering, Budget::Samples(samples), self.threads, &show);
        };
        let ending = target.reach(&mut rendering, self.threads, advance, &STOP, judge)?;
        progress.finish();
        let rendered = self.threads.install(|| rendering.finish());
        if ending == Ending::Stopped {
            finished = Finished::default();
        }
        let note = match ending {
            Ending::Reached | Ending::Stopped => None,
            Ending::Spent => Some(format!(
                "warning: the target of {error} was not reached: all that may be spent was spent"
            )),
            Ending::Unknown => Some(
                "warning: the error cannot be estimated, so that it is not known whether the target was reached"
                    .to_owned(),
            ),
        };
        Ok(Spent { rendered, finished, note })
    }
}

/// Shows progress from now on: samples as they are told, or the time.
fn shown(progress: &Progress, budget: Budget) -> impl Fn(u64) + Sync {
    let start = Instant::now();
    move |done| match budget {
        Budget::Samples(_) => progress.at(done),
        Budget::Time(time) => progress.at(start.elapsed().min(time).as_millis() as u64),
    }
}
