//! What every method but path tracing must offer to be run, and what methods find.

use super::RenderSettings;
use super::adaptive::{Rest, Spread};
use super::bidirectional::{self, Bidirectional};
use super::chains::{self, Chains};
use super::redistribution::{self, Redistribution};
use super::sampled::{Sampled, Samples};
use super::visibility::{self, Visibility};
use crate::film::{Radiance, Scale};
use crate::integrator::{Integrator, MarkovChains};
use crate::scene::Scene;
use glam::DVec3;
use quietlight_denoise::Layers;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt::Debug;

/// A render under way by a method that makes its picture in rounds, from splats or otherwise. The feature layers come from
/// path tracing; the method gives the radiance.
pub(super) trait Method: Debug + Send + Sync {
    /// Does the next round, on the threads of the current rayon pool: about a second of work or less, so that the clock and
    /// Ctrl-C are heeded, and ending exactly at `most` samples or mutations per pixel if these are reached in it. What is
    /// in the picture then depends on `most` and on nothing else: not on the clock, nor on the number of threads, nor on
    /// where it halted and went on.
    fn round(&mut self, most: u32);

    /// Has it done all that is its own of `most` samples or mutations per pixel?
    fn is_complete(&self, most: u32) -> bool;

    /// What it found so far: all that it needs to go on.
    fn found(&self) -> Found<'_>;
}

/// What a method found: enough to make its layers of, to save, and to go on from.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) enum Found<'a> {
    Bidirectional(Cow<'a, bidirectional::Sums>),
    /// With the light that was left to path tracing.
    Chains(Cow<'a, chains::Splats>, Option<Cow<'a, Samples>>),
    /// With the light that was left to path tracing.
    Redistribution(Cow<'a, redistribution::Deposited>, Option<Cow<'a, Samples>>),
    Visibility(visibility::Halves<'a>),
    /// The samples of adaptive path tracing after its pilot.
    Spread(Cow<'a, Spread>, Cow<'a, Samples>),
}

/// What a method tells at the end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Names and values for the metadata of the file, such as `normalisation`: `0.31 ± 0.02`.
    pub facts: Vec<(String, String)>,
    /// What the user should know before trusting the picture.
    pub warnings: Vec<String>,
}

impl Found<'_> {
    /// Samples or mutations per pixel so far, rounded down; the last round makes it exactly what was asked for.
    pub(super) fn samples(&self) -> u32 {
        match self {
            Self::Bidirectional(sums) => sums.samples(),
            Self::Chains(splats, _) => splats.samples(),
            Self::Redistribution(deposited, _) => deposited.mutations(),
            Self::Visibility(halves) => halves.samples(),
            Self::Spread(spread, _) => spread.samples(),
        }
    }

    /// Samples or mutations of the whole picture so far, for progress.
    pub(super) fn done(&self) -> u64 {
        match self {
            Self::Bidirectional(sums) => sums.done(),
            Self::Chains(splats, _) => splats.done(),
            Self::Redistribution(deposited, _) => deposited.done(),
            Self::Visibility(halves) => halves.done(),
            Self::Spread(spread, _) => spread.all(),
        }
    }

    /// Puts the radiance into layers that have the features: beauty, diffuse and specular with their halves, and the
    /// variance where the method knows it. `origin` is what the scene was moved by.
    pub(super) fn put_radiance(&self, layers: &mut Layers, origin: DVec3) {
        let direct = match self {
            Self::Chains(_, direct) | Self::Redistribution(_, direct) => direct.as_ref(),
            Self::Bidirectional(_) | Self::Visibility(_) | Self::Spread(..) => None,
        };
        if let Some(direct) = direct {
            replace_radiance(direct.layers(origin), layers);
        }
        let radiance = if direct.is_some() { Radiance::Added } else { Radiance::Replaced };
        match self {
            Self::Bidirectional(sums) => {
                replace_radiance(sums.film().layers(origin), layers);
                let scale = Scale::of_samples(sums.samples());
                sums.splats().put_into(layers, &scale, Radiance::Added);
            }
            Self::Chains(splats, _) => splats.film().put_into(layers, &splats.scale(), radiance),
            Self::Redistribution(deposited, _) => {
                deposited.film().put_into(layers, &deposited.scale(), radiance);
            }
            Self::Visibility(halves) => {
                halves.film().put_into(layers, &Scale::of_samples(halves.samples()), radiance);
            }
            // Has all layers, and they are weighed.
            Self::Spread(..) => {}
        }
    }

    /// Are its samples independent of each other, so that the variance it gives needs no correction by the halves?
    pub(super) fn is_independent(&self) -> bool {
        matches!(self, Self::Bidirectional(_))
    }

    /// Non-finite contributions dropped so far.
    pub(super) fn invalid(&self) -> u64 {
        let of_direct = |direct: &Option<Cow<'_, Samples>>| {
            direct.as_ref().map_or(0, |direct| direct.invalid())
        };
        match self {
            Self::Bidirectional(sums) => sums.invalid(),
            Self::Chains(splats, direct) => splats.invalid() + of_direct(direct),
            Self::Redistribution(deposited, direct) => deposited.invalid() + of_direct(direct),
            Self::Visibility(halves) => halves.invalid(),
            Self::Spread(_, rest) => rest.invalid(),
        }
    }

    /// What it found about itself.
    pub(super) fn report(&self) -> Report {
        match self {
            Self::Bidirectional(_) => Report::default(),
            Self::Chains(splats, _) => splats.report(),
            Self::Redistribution(deposited, _) => deposited.report(),
            Self::Visibility(halves) => halves.report(),
            Self::Spread(spread, _) => spread.report(),
        }
    }

    /// Adds what another shard of the same picture found; false where it is of another method.
    #[must_use]
    pub(super) fn merge(&mut self, other: &Self) -> bool {
        let merge_direct = |direct: &mut Option<Cow<'_, Samples>>,
                            more: &Option<Cow<'_, Samples>>| {
            if let (Some(direct), Some(more)) = (direct, more) {
                direct.to_mut().merge(more);
            }
        };
        match (self, other) {
            (Self::Bidirectional(sums), Self::Bidirectional(more)) => sums.to_mut().merge(more),
            (Self::Chains(splats, direct), Self::Chains(more, more_direct)) => {
                splats.to_mut().merge(more);
                merge_direct(direct, more_direct);
            }
            (Self::Redistribution(deposited, direct), Self::Redistribution(more, more_direct)) => {
                deposited.to_mut().merge(more);
                merge_direct(direct, more_direct);
            }
            (Self::Visibility(halves), Self::Visibility(more)) => halves.merge(more),
            _ => return false,
        }
        true
    }
}

/// Puts the radiance that a film found in place of that of `layers`.
fn replace_radiance(found: Layers, layers: &mut Layers) {
    layers.layers.extend(found.layers.into_iter().filter(|&(kind, _)| kind.is_radiance()));
    layers.samples = found.samples;
    layers.invalid = found.invalid;
}

/// Starts the method of the settings, or goes on from what it found; `None` for path tracing, whose radiance comes with the
/// features, unless it was adaptive. What another method found is left.
pub(super) fn start<'a>(
    scene: &'a Scene,
    settings: &RenderSettings,
    found: Option<Found<'static>>,
) -> Option<Box<dyn Method + 'a>> {
    match settings.integrator {
        Integrator::Path(_) => match found {
            Some(Found::Spread(spread, taken)) => {
                let (spread, taken) = (spread.into_owned(), taken.into_owned());
                Some(Box::new(Rest::new(scene, settings, spread, Some(taken))))
            }
            _ => None,
        },
        Integrator::Bdpt(bdpt) => {
            let sums = match found {
                Some(Found::Bidirectional(sums)) => Some(sums.into_owned()),
                _ => None,
            };
            Some(Box::new(Bidirectional::new(scene, bdpt, settings, sums)))
        }
        Integrator::Pssmlt(method) => Some(start_chains(scene, method, settings, found)),
        Integrator::Mlt(method) => Some(start_chains(scene, method, settings, found)),
        Integrator::Erpt(erpt) => {
            let found = match found {
                Some(Found::Redistribution(deposited, direct)) => {
                    Some((deposited.into_owned(), direct_of(scene, settings, direct)))
                }
                _ => None,
            };
            Some(Box::new(Redistribution::new(scene, erpt, settings, found)))
        }
        Integrator::Visibility(method) => {
            let halves = match found {
                Some(Found::Visibility(halves)) => Some(halves),
                _ => None,
            };
            Some(Box::new(Visibility::new(scene, method, settings, halves)))
        }
    }
}

fn start_chains<'a, M: MarkovChains + 'a>(
    scene: &'a Scene,
    method: M,
    settings: &RenderSettings,
    found: Option<Found<'static>>,
) -> Box<dyn Method + 'a> {
    let found = match found {
        Some(Found::Chains(splats, direct)) => {
            Some((splats.into_owned(), direct_of(scene, settings, direct)))
        }
        _ => None,
    };
    Box::new(Chains::new(scene, method, settings, found))
}

/// Path tracing of direct light that goes on.
fn direct_of<'a>(
    scene: &'a Scene,
    settings: &RenderSettings,
    taken: Option<Cow<'static, Samples>>,
) -> Option<Sampled<'a>> {
    taken.map(|taken| Sampled::of_direct(scene, settings).with(taken.into_owned()))
}
