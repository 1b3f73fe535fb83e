//! Bidirectional path tracing (Lafortune and Willems 1993; Veach and Guibas 1994).

use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::transport::connect::{Contribution, Pair, Strategies};
use crate::transport::mis::Heuristic;
use crate::transport::walk::{Subpath, Walker};
use glam::Vec2;

/// A bidirectional path tracer: prefer it where light is focused, or comes mainly through narrow openings that the light's
/// own walk gets through.
///
/// Every prefix of a walk from an emitter is joined with every prefix of one from the lens, the lens itself included, and
/// each path weighted by how likely the other strategies were to find it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bdpt {
    /// How strategies share a path.
    pub heuristic: Heuristic,
    /// Which strategies there are.
    pub strategies: Strategies,
}

/// Memory that one sample leaves to the next.
#[derive(Debug, Default)]
pub struct Workspace<'s> {
    eye: Subpath<'s>,
    light: Subpath<'s>,
}

impl Bdpt {
    /// One sample: a walk from the lens through `raster` (pixels of the whole film; `lens` chooses the point of the
    /// aperture), one from an emitter, and everything that joins them, appended to `found` in a fixed order. Only those of
    /// two or more eye vertices belong to the pixel sampled.
    pub fn trace<'s, S: Sampler>(
        &self,
        scene: &'s Scene,
        raster: Vec2,
        lens: Vec2,
        sampler: &mut S,
        workspace: &mut Workspace<'s>,
        found: &mut Vec<Contribution>,
    ) {
        let max_depth = scene.limits.max_depth.unwrap_or(u32::MAX);
        self.walk(scene, raster, lens, sampler, workspace).connect(max_depth, found);
    }

    /// The two walks of a sample, not yet connected.
    pub fn walk<'a, 's, S: Sampler>(
        &self,
        scene: &'s Scene,
        raster: Vec2,
        lens: Vec2,
        sampler: &mut S,
        workspace: &'a mut Workspace<'s>,
    ) -> Pair<'a, 's> {
        let Workspace { eye, light } = workspace;
        let max_depth = scene.limits.max_depth.unwrap_or(u32::MAX);
        let walker = Walker {
            scene,
            max_steps: max_depth,
            rr_depth: scene.limits.rr_depth,
            heuristic: self.heuristic,
            sees_lens: self.strategies == Strategies::All && scene.camera.has_lens(),
        };
        walker.from_lens(eye, raster, lens, sampler);
        sampler.begin_walk(1);
        let max_steps = match self.strategies {
            Strategies::FromCamera => 0,
            // A path of most edges may end on the lens: the last surface then still has to scatter.
            _ => max_depth.saturating_sub(1).saturating_add(u32::from(walker.sees_lens)),
        };
        let start = Walker { max_steps, ..walker }.from_light(light, sampler);
        let Self { heuristic, strategies } = *self;
        Pair { scene, heuristic, strategies, eye, raster, lens, light, start }
    }
}
