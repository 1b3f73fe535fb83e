//! What was found, out of the folder of a measurement.

use super::curve::{Curve, Place, Reach, pareto_front};
use super::settings::{Filter, Method, Settings, write_json};
use super::statistics::{Estimate, Reference};
use super::unit::{ReferenceHalf, Run, Unit};
use super::verdict::Verdict;
use super::{Error, JSON};
use quietlight_denoise::metrics::{DEFAULT_PIXELS_PER_DEGREE, flip, one_minus_ssim, psnr};
use quietlight_denoise::picture::read_picture;
use rayon::prelude::*;
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
    /// What `auto` takes on this scene.
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

/// One replicate of a point.
struct Replicate {
    seed: u64,
    render_seconds: f64,
    denoise_seconds: f64,
    cpu_seconds: Option<f64>,
    invalid_samples: u64,
    picture: PathBuf,
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
    /// [`Error::Image`] where the folder cannot be written.
    pub fn write_json(&self, folder: &Path) -> Result<(), Error> {
        write_json(&folder.join(JSON), self)
    }
}

struct Scene<'a> {
    folder: &'a Path,
    name: &'a str,
    size: [u32; 2],
}

impl Scene<'_> {
    fn judge(
        &self,
        [first, second]: [(ReferenceHalf, PathBuf); 2],
        runs: Vec<(Run, PathBuf)>,
        heard: &(dyn Fn(usize) + Sync),
    ) -> Result<SceneScores, Error> {
        let pictures = [ReferenceHalf::picture(&first.1)?, ReferenceHalf::picture(&second.1)?];
        let reference = Reference::new(pictures);
        let groups: Vec<_> = group(runs).into_iter().collect();
        let points = groups
            .into_par_iter()
            .map(|((combination, samples), replicates)| {
                let judged = replicates.len();
                let point = self.point(combination, samples, replicates, &reference)?;
                heard(judged);
                Ok(point)
            })
            .collect::<Result<Vec<Point>, Error>>()?;
        let noise = reference.noise;
        let known: Vec<Place> = points
            .iter()
            .map(|point| match point.is_known {
                true => Place { seconds: point.seconds.mean, error: point.error.mean },
                false => Place { seconds: f64::NAN, error: f64::NAN },
            })
            .collect();
        let curves = curves(&points, noise);
        let targets = targets(&points);
        let of_curve = |(&combination, curve): (&Combination, &Curve)| CurveScores {
            combination,
            reach: targets
                .iter()
                .map(|&target| if target < noise { None } else { curve.reach(target) })
                .collect(),
        };
        let auto = Combination {
            integrator: first.0.integrator.parse().unwrap_or(Method::Path),
            denoiser: default_denoiser(&points),
        };
        let reference = ReferenceScores {
            integrator: first.0.integrator,
            reason: first.0.reason,
            samples: [first.0.samples, second.0.samples],
            seconds: first.0.seconds + second.0.seconds,
            noise,
        };
        Ok(SceneScores {
            name: self.name.to_owned(),
            size: self.size,
            front: pareto_front(&known),
            curves: curves.iter().map(of_curve).collect(),
            verdict: Verdict::of(&curves, &points, auto, &reference),
            reference,
            auto,
            targets,
            points,
        })
    }

    fn point(
        &self,
        combination: Combination,
        samples: u32,
        mut replicates: Vec<Replicate>,
        reference: &Reference,
    ) -> Result<Point, Error> {
        replicates.sort_by_key(|replicate| replicate.seed);
        let pictures = replicates
            .iter()
            .map(|one| Ok(read_picture(&one.picture)?))
            .collect::<Result<Vec<_>, Error>>()?;
        let split = reference.split(&pictures);
        let (mut ssims, mut psnrs, mut flips) = (Vec::new(), Vec::new(), Vec::new());
        for picture in &pictures {
            ssims.extend(one_minus_ssim(picture, &reference.mean)?);
            psnrs.push(psnr(picture, &reference.mean)?);
            flips.push(flip(picture, &reference.mean, DEFAULT_PIXELS_PER_DEGREE)?);
        }
        let over = |value: fn(&Replicate) -> f64| {
            Estimate::of(&replicates.iter().map(value).collect::<Vec<f64>>())
        };
        let cpu: Option<Vec<f64>> = replicates.iter().map(|one| one.cpu_seconds).collect();
        let error = Estimate::of(&split.errors);
        let picture = replicates[0].picture.strip_prefix(self.folder);
        Ok(Point {
            combination,
            samples,
            seeds: replicates.len(),
            render_seconds: over(|one| one.render_seconds),
            denoise_seconds: over(|one| one.denoise_seconds),
            seconds: over(|one| one.render_seconds + one.denoise_seconds),
            cpu_seconds: cpu.map(|cpu| Estimate::of(&cpu).mean),
            is_known: error.mean >= reference.noise,
            error,
            bias2: split.bias2,
            variance: split.variance,
            one_minus_ssim: (!ssims.is_empty()).then(|| Estimate::of(&ssims)),
            psnr: Estimate::of(&psnrs),
            flip: Estimate::of(&flips),
            invalid_samples: replicates.iter().map(|one| one.invalid_samples).sum(),
            picture: picture.unwrap_or(&replicates[0].picture).to_path_buf(),
        })
    }
}

/// The replicates of each integrator, denoiser and sample count.
fn group(runs: Vec<(Run, PathBuf)>) -> BTreeMap<(Combination, u32), Vec<Replicate>> {
    let mut groups: BTreeMap<_, Vec<Replicate>> = BTreeMap::new();
    for (run, folder) in runs {
        for measure in &run.measures {
            for picture in &measure.pictures {
                let combination =
                    Combination { integrator: run.integrator, denoiser: picture.denoiser };
                let without = picture.denoiser == Filter::None;
                let denoising = if without { Some(0.0) } else { picture.cpu_seconds };
                groups.entry((combination, measure.samples)).or_default().push(Replicate {
                    seed: run.seed,
                    render_seconds: measure.render_seconds,
                    denoise_seconds: picture.seconds,
                    cpu_seconds: measure.render_cpu_seconds.zip(denoising).map(|(a, b)| a + b),
                    invalid_samples: measure.invalid_samples,
                    picture: folder.join(&picture.file),
                });
            }
        }
    }
    groups
}

/// The curve of each combination. What is not known counts as the reference's noise.
fn curves(points: &[Point], noise: f64) -> BTreeMap<Combination, Curve> {
    let mut places: BTreeMap<Combination, Vec<Place>> = BTreeMap::new();
    for point in points {
        let place = Place { seconds: point.seconds.mean, error: point.error.mean };
        places.entry(point.combination).or_default().push(place);
    }
    // Errors need a logarithm, and a reference without noise gives no floor.
    let floor = noise.max(f64::MIN_POSITIVE);
    places.into_iter().map(|(combination, all)| (combination, Curve::new(all, floor))).collect()
}

/// What `render` takes by default of what was measured.
fn default_denoiser(points: &[Point]) -> Filter {
    let is_there = |filter| points.iter().any(|point| point.combination.denoiser == filter);
    [Filter::KpcnBalanced, Filter::Bilateral]
        .into_iter()
        .find(|&filter| is_there(filter))
        .unwrap_or(Filter::None)
}

/// Round errors, 1 and 3 times powers of ten, within what was measured: at most six, the largest first.
fn targets(points: &[Point]) -> Vec<f64> {
    let errors = || points.iter().filter(|point| point.is_known).map(|point| point.error.mean);
    let (least, most) = errors().fold((f64::INFINITY, 0f64), |(a, b), e| (a.min(e), b.max(e)));
    let round = (-12..=6).rev().flat_map(|power| [3, 1].map(|one| decimal(one, power)));
    let mut targets: Vec<f64> = round.filter(|&target| (least..=most).contains(&target)).collect();
    // The hard ones tell the methods apart.
    targets.drain(..targets.len().saturating_sub(6));
    targets
}

/// `digit` times ten to the `power`, the nearest number there is.
pub(super) fn decimal(digit: u8, power: i32) -> f64 {
    format!("{digit}e{power}").parse().unwrap_or(f64::NAN)
}
