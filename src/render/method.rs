//! What every method but path tracing must offer to be run.

use super::RenderSettings;
use super::bidirectional::Bidirectional;
use super::chains::Chains;
use super::redistribution::Redistribution;
use super::visibility::Visibility;
use crate::integrator::Integrator;
use crate::scene::Scene;
use quietlight_denoise::{LayerKind, Layers};
use std::fmt::Debug;

/// A render under way by a method that makes its picture in rounds, from splats or otherwise. The feature layers come from
/// path tracing; the method gives the radiance.
pub(super) trait Method: Debug + Send {
    /// Does the next round, on the threads of the current rayon pool: about a second of work or less, so that the clock and
    /// Ctrl-C are heeded, and ending exactly at `most` samples or mutations per pixel if these are reached in it. What is
    /// in the picture depends on `most` and the number of rounds done and on nothing else: not on the clock, nor on the
    /// number of threads.
    fn round(&mut self, most: u32);

    /// Samples or mutations per pixel so far, rounded down; the last round makes it exactly what was asked for.
    fn samples(&self) -> u32;

    /// Samples or mutations of the whole picture so far, for progress.
    fn done(&self) -> u64;

    /// Puts the radiance into layers that have the features: beauty, diffuse and specular with their halves, and the
    /// variance where the method knows it.
    fn put_radiance(&self, layers: &mut Layers);

    /// Are its samples independent of each other, so that the variance it gives needs no correction by the halves?
    fn is_independent(&self) -> bool {
        true
    }

    /// Non-finite contributions dropped so far.
    fn invalid(&self) -> u64;

    /// What it found about itself.
    fn report(&self) -> Report;
}

/// What a method tells at the end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Names and values for the metadata of the file, such as `normalisation`: `0.31 ± 0.02`.
    pub facts: Vec<(String, String)>,
    /// What the user should know before trusting the picture.
    pub warnings: Vec<String>,
}

/// Puts the radiance that a film found in place of that of `layers`.
pub(super) fn replace_radiance(found: Layers, layers: &mut Layers) {
    let is_radiance =
        |kind| matches!(kind, LayerKind::Beauty | LayerKind::Diffuse | LayerKind::Specular);
    layers.layers.extend(found.layers.into_iter().filter(|&(kind, _)| is_radiance(kind)));
    layers.samples = found.samples;
    layers.invalid = found.invalid;
}

/// Starts the method of the settings; `None` for path tracing, whose radiance comes with the features.
pub(super) fn start<'a>(
    scene: &'a Scene,
    settings: &RenderSettings,
) -> Option<Box<dyn Method + 'a>> {
    match settings.integrator {
        Integrator::Path(_) => None,
        Integrator::Bdpt(bdpt) => Some(Box::new(Bidirectional::new(scene, bdpt, settings))),
        Integrator::Pssmlt(method) => Some(Box::new(Chains::new(scene, method, settings))),
        Integrator::Erpt(erpt) => Some(Box::new(Redistribution::new(scene, erpt, settings))),
        Integrator::Mlt(method) => Some(Box::new(Chains::new(scene, method, settings))),
        Integrator::Visibility(method) => Some(Box::new(Visibility::new(scene, method, settings))),
    }
}
