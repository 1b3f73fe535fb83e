//! Which method a scene requires.

use super::bdpt::{Bdpt, Workspace};
use super::mlt::walks;
use super::{Erpt, Integrator, PathTracing};
use crate::sampler::{IndependentSampler, Stream};
use crate::scene::Scene;
use crate::transport::connect::Strategies;
use glam::Vec2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Pairs of walks that the choice rests on: about a tenth of a second of one thread.
const PAIRS: u64 = 1 << 14;

/// Pairs that a thread takes at a time; fixed, so that the sums have the same bits on any number of threads.
const SHARE: u64 = 1 << 10;

/// Cells along the longer side of the picture whose brightness noise is compared with.
const CELLS: u32 = 16;

/// What one sample of bidirectional path tracing costs, in samples of path tracing: measured in the Cornell box, with a mirror
/// and glass, and at the ajar door, 2.9 to 3.3.
const COST_OF_PAIR: f64 = 3.2;

/// Noise of a bidirectional sample from which on energy redistribution, whose chains stay where light was found, is better: in
/// 60 s of two threads at the ajar door (noise 13) it left 0.22 of the squared error of bidirectional path tracing and 0.07 of
/// that of path tracing, in the caustic pool (15) 0.25 and 0.24; in the Cornell box (0.7) three times both.
const CHAINS_FROM: f64 = 10.0;

/// Seconds of one thread on a pixel up to which bidirectional path tracing leaves less error there, too, once the noise is taken
/// out: that of chains is correlated from pixel to pixel, and more of it stays. `quietlight tradeoff` found both alike at 0.8 ms
/// in the caustic pool and at 1.8 ms at the ajar door (relative L2 at 0.4 ms: 0.052 and 0.066, 7.7e-3 and 9.7e-3; at 1.8 ms:
/// 0.025 and 0.019, 2.9e-3 and 2.9e-3; two seeds, 128×96).
const SHORT_SECONDS: f64 = 1e-3;

/// The same in samples: 256 leave less error than as many mutations in both, 1024 at the ajar door only.
const SHORT_SAMPLES: u32 = 512;

/// What a picture is for, as far as the choice of its method depends on it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Purpose {
    /// Will the noise be taken out?
    pub is_denoised: bool,
    /// What may be spent; `None` for as much as it takes.
    pub effort: Option<Effort>,
}

/// What may be spent on each pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// So many samples.
    Samples(u32),
    /// So many seconds of one thread.
    Seconds(f64),
}

impl Effort {
    fn is_short(self) -> bool {
        match self {
            Self::Samples(samples) => samples <= SHORT_SAMPLES,
            Self::Seconds(seconds) => seconds <= SHORT_SECONDS,
        }
    }
}

/// What some pairs of walks tell of a scene's light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightProbe {
    /// Variance of one sample of path tracing, relative to the squared brightness around it.
    pub noise_of_path: f64,
    /// The same of bidirectional path tracing.
    pub noise_of_bdpt: f64,
    /// Part of the light that path tracing cannot find at all.
    pub unseen: f64,
}

/// A method, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The method.
    pub integrator: Integrator,
    /// What was found of the scene's light, and what follows from it, in words.
    pub reason: String,
}

/// One path that a pair found.
#[derive(Clone, Copy, Debug)]
struct Found {
    cell: usize,
    /// Its share of the picture's light.
    value: f64,
    /// What path tracing would have found in its place, seldom: the value over its density; infinite for never.
    of_path: f64,
}

impl LightProbe {
    /// Sends pairs of walks into the scene, on the threads of the current rayon pool.
    ///
    /// A path found with the contribution `C = w f / p` has in path tracing, which finds it with the density `q`, the second
    /// moment `∫ f² / q`, of which `C · f / q` is an estimate: noise is told of light that path tracing itself would not have
    /// met in so short a time.
    pub fn of(scene: &Scene) -> Self {
        let shares: Vec<Vec<Vec<Found>>> = (0..PAIRS / SHARE)
            .into_par_iter()
            .map(|share| {
                let mut workspace = Workspace::default();
                let pairs = share * SHARE..(share + 1) * SHARE;
                pairs.map(|index| pair(scene, index, &mut workspace)).collect()
            })
            .collect();
        let pairs: Vec<Vec<Found>> = shares.into_iter().flatten().collect();
        let (mut brightness, mut counts) = (vec![0.0; cells(scene)], 0.0);
        for found in pairs.iter().flatten() {
            brightness[found.cell] += found.value;
        }
        let per_cell = PAIRS as f64 / brightness.len() as f64;
        brightness.iter_mut().for_each(|sum| *sum /= per_cell);
        // As in the relative L2, whose ε keeps darkness from deciding.
        let scale = |cell: usize| 1.0 / (brightness[cell] * brightness[cell] + 0.01);
        let (mut of_path, mut of_bdpt, mut unseen, mut all) = (0.0, 0.0, 0.0, 0.0);
        for pair in &pairs {
            counts += 1.0;
            let mut sample = 0.0;
            for found in pair {
                all += found.value;
                if found.of_path.is_finite() {
                    of_path += found.value * found.of_path * scale(found.cell);
                } else {
                    unseen += found.value;
                }
                sample += found.value * scale(found.cell).sqrt();
            }
            of_bdpt += sample * sample;
        }
        Self {
            noise_of_path: of_path / counts,
            noise_of_bdpt: of_bdpt / counts,
            unseen: if all > 0.0 { unseen / all } else { 0.0 },
        }
    }
}

fn grid(scene: &Scene) -> [u32; 2] {
    let [_, _, columns, rows] = scene.film.crop;
    let side = columns.max(rows).div_ceil(CELLS).max(1);
    [columns.div_ceil(side), rows.div_ceil(side)]
}

fn cells(scene: &Scene) -> usize {
    let [columns, rows] = grid(scene);
    (columns * rows) as usize
}

/// What one pair of walks finds, of paths of two edges and more: what is seen directly is without noise for both.
fn pair<'s>(scene: &'s Scene, index: u64, workspace: &mut Workspace<'s>) -> Vec<Found> {
    let numbers = IndependentSampler::stream(0, Stream::Bootstrap, index);
    let walks = walks(scene, Strategies::ToLens, numbers, workspace);
    let mut found = Vec::new();
    walks.connect(scene.limits.max_depth.unwrap_or(u32::MAX), &mut found);
    let [left, top, columns, rows] = scene.film.crop;
    let side = columns.max(rows).div_ceil(CELLS).max(1);
    let cell = |raster: Vec2| {
        let place = |at: f32, start: u32, count: u32| {
            ((at as u32).clamp(start, start + count - 1) - start) / side
        };
        (place(raster.y, top, rows) * grid(scene)[0] + place(raster.x, left, columns)) as usize
    };
    found
        .iter()
        .filter(|one| one.s + one.t > 2 && one.luminance().is_finite())
        .filter_map(|one| {
            let path = walks.path(one.s, one.t)?;
            // f / (q_0 + q_1), from f / q_0 and f / q_1; −∞ stands for a strategy that there is not.
            let density: f64 = [0, 1]
                .map(|s| path.ln_contribution(s))
                .iter()
                .filter(|ln| ln.is_finite())
                .map(|ln| (-ln).exp())
                .sum();
            // What the walks survived of roulette; path tracing would have had to, as well.
            let survival =
                one.luminance() / one.weight * (-path.ln_contribution(one.s as usize)).exp();
            let of_path = if density > 0.0 { survival / density } else { f64::INFINITY };
            Some(Found { cell: cell(one.raster), value: one.luminance(), of_path })
        })
        .collect()
}

impl Choice {
    /// The method for a scene, from what its light is like and what the picture is for.
    pub fn of(scene: &Scene, purpose: Purpose) -> Self {
        Self::by(&LightProbe::of(scene), purpose)
    }

    /// The same where its light is known.
    pub fn by(probe: &LightProbe, purpose: Purpose) -> Self {
        let LightProbe { noise_of_path, noise_of_bdpt, unseen } = *probe;
        let facts = format!(
            "one sample has a relative variance of {noise_of_path:.3} by path tracing and {noise_of_bdpt:.3} by \
             bidirectional path tracing, which costs {COST_OF_PAIR} times as much"
        );
        let hidden = if unseen > 0.001 {
            format!(", and path tracing misses {:.1} % of the light", 100.0 * unseen)
        } else {
            String::new()
        };
        let is_unseen = unseen > 0.001;
        let is_short = purpose.is_denoised && purpose.effort.is_some_and(Effort::is_short);
        let (integrator, verdict): (Integrator, _) = if noise_of_bdpt > CHAINS_FROM && is_short {
            (
                Integrator::Bdpt(Bdpt::default()),
                "light is hard to find for both, and chains that are so short leave noise that denoising does not take out",
            )
        } else if noise_of_bdpt > CHAINS_FROM {
            (
                Integrator::Erpt(Erpt::default()),
                "light is hard to find for both, and chains stay where it is",
            )
        } else if is_unseen || noise_of_bdpt * COST_OF_PAIR < noise_of_path {
            (
                Integrator::Bdpt(Bdpt::default()),
                "walks of light find what walks of the camera do not",
            )
        } else {
            (PathTracing::default().into(), "walks from the camera find it")
        };
        Self { integrator, reason: format!("{verdict}: {facts}{hidden}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hard_light_is_for_chains_unless_a_denoised_picture_must_be_soon_there() {
        let light = |noise_of_path, noise_of_bdpt, unseen| {
            move |is_denoised, effort| {
                let light = LightProbe { noise_of_path, noise_of_bdpt, unseen };
                Choice::by(&light, Purpose { is_denoised, effort }).integrator.name()
            }
        };
        let hard = light(50.0, 13.0, 0.0);
        for short in [Effort::Seconds(SHORT_SECONDS), Effort::Samples(SHORT_SAMPLES)] {
            assert_eq!(hard(true, Some(short)), "bdpt");
            assert_eq!(hard(false, Some(short)), "erpt");
        }
        for long in [Effort::Seconds(1.01 * SHORT_SECONDS), Effort::Samples(SHORT_SAMPLES + 1)] {
            assert_eq!(hard(true, Some(long)), "erpt");
        }
        assert_eq!(hard(true, None), "erpt");
        // A sample of bidirectional path tracing costs as much as 3.2 of path tracing.
        for purpose in [(true, None), (false, Some(Effort::Samples(1)))] {
            let name = |light: &dyn Fn(_, _) -> &'static str| light(purpose.0, purpose.1);
            assert_eq!(name(&light(1.0, 0.5, 0.0)), "path");
            assert_eq!(name(&light(1.0, 0.3, 0.0)), "bdpt");
            assert_eq!(name(&light(1.0, 0.5, 0.01)), "bdpt");
        }
    }
}
