//! Judging the pictures of one scene by its reference.

use super::Error;
use super::curve::{Curve, Place, pareto_front};
use super::scores::{Combination, CurveScores, Point, ReferenceScores, SceneScores};
use super::settings::{Filter, Method};
use super::statistics::{Estimate, Reference};
use super::unit::{ReferenceHalf, Run};
use super::verdict::Verdict;
use super::words::decimal;
use crate::integrator::{Choice, Effort, Purpose};
use quietlight_denoise::metrics::{DEFAULT_PIXELS_PER_DEGREE, flip, one_minus_ssim, psnr};
use quietlight_denoise::picture::read_picture;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// One replicate of a point.
struct Replicate {
    seed: u64,
    render_seconds: f64,
    denoise_seconds: f64,
    cpu_seconds: Option<f64>,
    invalid_samples: u64,
    picture: PathBuf,
}

/// A scene of a measurement.
pub(super) struct Scene<'a> {
    /// Folder of the measurement.
    pub(super) folder: &'a Path,
    /// Its name.
    pub(super) name: &'a str,
    /// Pixels across and down.
    pub(super) size: [u32; 2],
}

impl Scene<'_> {
    /// Judges its runs by the halves of its reference, each record with its folder; `heard` is told of so many more pictures.
    pub(super) fn judge(
        &self,
        [first, second]: [(ReferenceHalf, PathBuf); 2],
        runs: Vec<(Run, PathBuf)>,
        heard: &(dyn Fn(usize) + Sync),
    ) -> Result<SceneScores, Error> {
        let pictures = [ReferenceHalf::picture(&first.1)?, ReferenceHalf::picture(&second.1)?];
        let reference = Reference::new(pictures);
        let threads = runs.iter().map(|(run, _)| run.threads).max().unwrap_or(1);
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
        let denoisers: Vec<Filter> =
            points.iter().map(|point| point.combination.denoiser).collect();
        let denoiser = default_denoiser(&denoisers);
        let pixels = f64::from(self.size[0]) * f64::from(self.size[1]);
        let auto = |seconds: f64| {
            let effort = Some(Effort::Seconds(seconds * threads as f64 / pixels));
            let purpose = Purpose { is_denoised: denoiser != Filter::None, effort };
            let choice = Choice::by(&first.0.light, purpose);
            let integrator = choice.integrator.name().parse().unwrap_or(Method::Path);
            Combination { integrator, denoiser }
        };
        let reference = ReferenceScores {
            integrator: first.0.integrator,
            reason: first.0.reason,
            samples: [first.0.samples, second.0.samples],
            seconds: first.0.seconds + second.0.seconds,
            noise,
        };
        let verdict = Verdict::of(&curves, &points, &auto, &reference);
        let longest = verdict.choices.last().map_or(f64::INFINITY, |choice| choice.seconds);
        Ok(SceneScores {
            name: self.name.to_owned(),
            size: self.size,
            front: pareto_front(&known),
            curves: curves.iter().map(of_curve).collect(),
            verdict,
            reference,
            auto: auto(longest),
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

/// What `render` takes by default of what was measured; where only others were, what it would have taken. None where nothing
/// was denoised.
fn default_denoiser(measured: &[Filter]) -> Filter {
    let defaults = [Filter::KpcnBalanced, Filter::Bilateral];
    match defaults.into_iter().find(|one| measured.contains(one)) {
        Some(one) => one,
        None if measured.iter().all(|&one| one == Filter::None) => Filter::None,
        None => defaults[0],
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_denoiser_is_that_of_render_where_it_or_only_others_were_measured() {
        for (measured, expected) in [
            (&[Filter::None, Filter::Bilateral, Filter::KpcnBalanced][..], Filter::KpcnBalanced),
            (&[Filter::KpcnFast, Filter::Bilateral], Filter::Bilateral),
            (&[Filter::None, Filter::KpcnFast], Filter::KpcnBalanced),
            (&[Filter::None], Filter::None),
        ] {
            assert_eq!(default_denoiser(measured), expected, "{measured:?}");
        }
    }
}
