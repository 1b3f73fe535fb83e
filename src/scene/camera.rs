//! The perspective camera: pinhole and thin lens.

use crate::geometry::Ray;
use glam::Vec2;

/// A perspective camera.
#[derive(Clone, Debug)]
pub struct Camera {}

impl Camera {
    /// The ray through `raster` (pixels, `(0, 0)` the upper left corner of the whole film); `lens` in `[0, 1)²` chooses
    /// the point on a thin lens. Direction is a unit vector.
    pub fn ray(&self, _raster: Vec2, _lens: Vec2) -> Ray {
        todo!()
    }

    /// Radius of the lens, in scene units; 0 for a pinhole.
    pub fn lens_radius(&self) -> f32 {
        todo!()
    }
}
