//! One walk, in stages: each is one function, which does not know what other walks are under way.
//!
//! From edge to edge they are [`Walk::intersect`]; [`Walk::escape`] where nothing was hit; [`Walk::interact`] and
//! [`Walk::arrive`], which finds emission and makes ready to scatter; [`Walk::light`], [`Walk::shadow`] and
//! [`Walk::collect`] for direct light; and [`Walk::scatter`], which chooses the next ray.

mod stages;

use super::features::FeatureWalk;
use super::{PathSample, PathTracing, Strategy};
use crate::bsdf::BsdfEval;
use crate::geometry::{Hit, Interaction, Ray};
use crate::math::Rgb;
use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::transport::shading::Shading;
use glam::{Vec2, Vec3};

/// What is the same for all walks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rules<'a> {
    pub(super) scene: &'a Scene,
    strategy: Strategy,
    /// Longest path in edges.
    max_depth: u32,
}

impl<'a> Rules<'a> {
    pub(super) fn new(settings: &PathTracing, scene: &'a Scene) -> Self {
        let max_depth = scene.limits.max_depth.unwrap_or(u32::MAX).min(settings.max_depth);
        Self { scene, strategy: settings.strategy, max_depth }
    }
}

/// A walk under way. Stages write what they find into their place, since copies of so much cost as much as the finding.
#[derive(Debug)]
pub(super) struct Walk<'a, S> {
    sampler: S,
    ray: Ray,
    departure: Departure,
    throughput: Rgb,
    /// The weight of the first scattering is kept apart, in its two parts: all light found after it is summed up in
    /// `indirect` and split by them at the end.
    first: [Rgb; 2],
    first_weight: Rgb,
    indirect: Rgb,
    scatterings: u32,
    depth: u32,
    eta_squared: f32,
    features: FeatureWalk,
    /// Is the receiver of a walk without direct light still to come?
    awaits_receiver: bool,
    /// Of a walk without direct light: did the receiver's smooth lobe scatter last?
    is_left_out: bool,
    sample: PathSample,
    /// Where the ray ended, by [`Walk::intersect`] and [`Walk::interact`].
    hit: Hit,
    at: Interaction,
    /// By [`Walk::arrive`].
    shading: Shading<'a>,
    /// Radiance that the surface itself sends, weighted.
    emitted: Rgb,
    numbers: Numbers,
    /// By [`Walk::light`].
    direct: Direct,
}

/// What the last scattering leaves for the weight of emission found next.
#[derive(Clone, Copy, Debug)]
struct Departure {
    position: Vec3,
    pdf: f32,
    is_delta: bool,
}

/// The random numbers of one vertex.
#[derive(Clone, Copy, Debug, Default)]
struct Numbers {
    light: Vec2,
    bsdf: Vec2,
    selection: f32,
    lobe: f32,
    roulette: f32,
}

/// Where an edge of a walk led.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Arrival {
    /// To its end.
    Ended,
    /// Through a mask.
    Passed,
    /// To a surface that may scatter.
    Surface,
}

/// Is direct light taken?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Taken {
    /// No.
    No,
    /// Yes, but there is none, and nobody asks whether its emitter is seen.
    Dark,
    /// Yes, if the shadow ray reaches the emitter.
    ByRay,
}

/// Light of one emitter that a surface would scatter, if nothing is in the way.
#[derive(Clone, Copy, Debug)]
struct Direct {
    state: Taken,
    ray: Ray,
    scattered: BsdfEval,
    radiance: Rgb,
    pdf: f32,
    /// Of multiple importance sampling.
    weight: f32,
    /// By [`Walk::shadow`]: 1 or 0, or the transmittance of the masks between.
    visibility: f32,
}

impl<'a, S: Sampler> Walk<'a, S> {
    /// A walk that begins with `ray`.
    pub(super) fn new(rules: &Rules<'_>, ray: Ray, sampler: S) -> Self {
        Self {
            sampler,
            ray,
            departure: Departure { position: ray.origin, pdf: 0.0, is_delta: true },
            throughput: Rgb::WHITE,
            first: [Rgb::BLACK; 2],
            first_weight: Rgb::WHITE,
            indirect: Rgb::BLACK,
            scatterings: 0,
            depth: 0,
            eta_squared: 1.0,
            // Rays start on the near plane, depth at the camera.
            features: FeatureWalk::new(ray.origin.distance(rules.scene.camera.center())),
            awaits_receiver: false,
            is_left_out: false,
            sample: PathSample::default(),
            hit: Hit { t: 0.0, u: 0.0, v: 0.0, primitive: 0 },
            at: Interaction::default(),
            shading: Shading::of_nothing(),
            emitted: Rgb::BLACK,
            numbers: Numbers::default(),
            direct: Direct {
                state: Taken::No,
                ray,
                scattered: BsdfEval::default(),
                radiance: Rgb::BLACK,
                pdf: 0.0,
                weight: 0.0,
                visibility: 0.0,
            },
        }
    }

    /// That of [`PathTracing::trace_without_direct`].
    pub(super) fn without_direct(rules: &Rules<'_>, ray: Ray, sampler: S) -> Self {
        Self { awaits_receiver: true, ..Self::new(rules, ray, sampler) }
    }
}
