//! The features of a sample: what the denoisers are told of the surfaces that it saw.

use super::PathSample;
use crate::geometry::Interaction;
use crate::transport::shading::Shading;

/// Follows the walk until every feature is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct FeatureWalk {
    hits: u32,
    length: f32,
    is_surface_found: bool,
}

impl FeatureWalk {
    /// Of a walk whose first ray starts so far from the camera.
    pub(super) fn new(length: f32) -> Self {
        Self { hits: 0, length, is_surface_found: false }
    }

    /// Will further hits add nothing?
    pub(super) fn are_known(&self) -> bool {
        self.hits >= 2 && self.is_surface_found
    }

    /// The ray went on through a mask at `t`.
    pub(super) fn pass(&mut self, t: f32) {
        self.length += t;
    }

    /// The ray met a surface at `t`.
    #[inline]
    pub(super) fn visit(
        &mut self,
        sample: &mut PathSample,
        shading: &Shading<'_>,
        at: &Interaction,
        t: f32,
    ) {
        self.hits += 1;
        if self.hits > 2 && self.is_surface_found {
            return;
        }
        self.length += t;
        if self.hits == 1 {
            sample.position = at.position;
        }
        if self.hits == 2 {
            sample.texture2 = shading.bsdf.albedo();
        }
        if !self.is_surface_found && shading.bsdf.has_smooth() {
            self.is_surface_found = true;
            sample.albedo = shading.bsdf.albedo();
            sample.normal =
                if shading.wo.z < 0.0 { -shading.frame.normal } else { shading.frame.normal };
            sample.depth = self.length;
        }
    }
}
