//! Unidirectional path tracing (Kajiya 1986) with next-event estimation and multiple importance sampling.
//!
//! A walk goes in stages from edge to edge. Walks are taken one by one ([`PathTracing::trace`]), or many at a time, stage by
//! stage, in a [`Batch`]: with the same bits, and faster.

mod batch;
mod features;
mod walk;

pub use batch::Batch;

use super::receiver::Receiver;
use crate::geometry::{Interaction, Ray};
use crate::math::Rgb;
use crate::sampler::Sampler;
use crate::scene::Scene;
use glam::Vec3;
use std::ops::ControlFlow;
use walk::{Arrival, Rules, Walk};

/// How direct light is found. All three have the same mean, which is how they test each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Strategy {
    /// Only by choosing points on emitters; emission counts where a camera ray or a delta lobe leads to it.
    Light,
    /// Only by walking into emitters; point, spot and directional emitters stay dark.
    Bsdf,
    /// Both, weighted by the power heuristic.
    #[default]
    Mis,
    /// Not at all: walks end as soon as the features of a sample are known, and its radiance means nothing. The features are
    /// those of the other strategies that have shadow rays, bit for bit.
    Features,
}

/// A path tracer: prefer it wherever light is not mainly found through narrow openings or focused by glass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathTracing {
    /// How direct light is found.
    pub strategy: Strategy,
    /// Longest path in edges, where the scene does not set a lower limit: 2 for direct light alone.
    pub max_depth: u32,
}

impl Default for PathTracing {
    fn default() -> Self {
        Self { strategy: Strategy::default(), max_depth: u32::MAX }
    }
}

/// What one camera sample found. Radiance is `diffuse + specular`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathSample {
    /// Radiance scattered by a diffuse lobe at the first hit.
    pub diffuse: Rgb,
    /// All other radiance, emission and background included.
    pub specular: Rgb,
    /// Albedo at the first surface that is not only delta; 0 when there is none.
    pub albedo: Rgb,
    /// Unit shading normal there, turned to where the ray came from.
    pub normal: Vec3,
    /// Position of the first hit, relative to [`Scene::origin`].
    pub position: Vec3,
    /// Length of the path to the first surface that is not only delta.
    pub depth: f32,
    /// Albedo at the second hit.
    pub texture2: Rgb,
    /// Did the shadow ray of the first hit reach its emitter? 1 or 0, or the transmittance of the masks between.
    pub visibility: f32,
}

impl PathSample {
    /// Are radiance and features all finite?
    pub fn is_finite(&self) -> bool {
        (self.diffuse + self.specular).is_finite()
            && (self.albedo + self.texture2).is_finite()
            && self.normal.is_finite()
            && self.position.is_finite()
            && (self.depth + self.visibility).is_finite()
    }
}

/// One hit of a walk, as [`PathTracing::trace_observed`] reports it for the replay of a sample.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    /// Edges from the camera to here.
    pub depth: u32,
    /// What was hit.
    pub at: Interaction,
    /// Product of all weights up to here.
    pub throughput: Rgb,
    /// Radiance added to the sample here: emission and direct light, weighted.
    pub added: Rgb,
}

impl PathTracing {
    /// Follows one camera ray through `scene`.
    pub fn trace<S: Sampler>(&self, scene: &Scene, ray: Ray, sampler: &mut S) -> PathSample {
        self.trace_observed(scene, ray, sampler, |_| {})
    }

    /// The same, calling `observe` at every hit.
    pub fn trace_observed<S: Sampler>(
        &self,
        scene: &Scene,
        ray: Ray,
        sampler: &mut S,
        observe: impl FnMut(Vertex),
    ) -> PathSample {
        let rules = Rules::new(self, scene);
        follow(&rules, Walk::new(&rules, ray, sampler), observe, |_| ControlFlow::Continue(()))
    }

    /// Follows one camera ray without the light that [`Receiver::scatter`] leads straight from emitters to the camera:
    /// `receive` is given the receiver, if the ray meets one that may be lit, and may end the walk there. With the light that
    /// reaches the receiver directly this has the mean of [`PathTracing::trace`]; its shadow ray's visibility is 0.
    pub fn trace_without_direct<'a, S: Sampler>(
        &self,
        scene: &'a Scene,
        ray: Ray,
        sampler: &mut S,
        receive: impl FnMut(Receiver<'a>) -> ControlFlow<()>,
    ) -> PathSample {
        let rules = Rules::new(self, scene);
        follow(&rules, Walk::without_direct(&rules, ray, sampler), |_| {}, receive)
    }
}

/// Takes one walk to its end.
fn follow<'a, S: Sampler>(
    rules: &Rules<'a>,
    mut walk: Walk<'a, &mut S>,
    mut observe: impl FnMut(Vertex),
    mut receive: impl FnMut(Receiver<'a>) -> ControlFlow<()>,
) -> PathSample {
    while walk.may_go_on(rules) {
        if !walk.intersect(rules) {
            walk.escape(rules);
            break;
        }
        walk.interact(rules);
        match walk.arrive(rules) {
            Arrival::Ended => break,
            Arrival::Passed => continue,
            Arrival::Surface => {}
        }
        if !walk.may_go_on(rules) {
            observe(walk.vertex(Rgb::BLACK));
            break;
        }
        let receiver = walk.received();
        let is_receiver = receiver.is_some();
        let mut direct = Rgb::BLACK;
        if let Some(receiver) = receiver {
            if receive(receiver).is_break() {
                break;
            }
        } else {
            walk.light(rules);
            walk.shadow(rules);
            direct = walk.collect();
        }
        observe(walk.vertex(direct));
        if walk.scatter(rules, is_receiver).is_break() {
            break;
        }
    }
    walk.finish()
}
