//! A point on a surface, with what shading and further rays need to know of it.

use super::Ray;
use glam::{Vec2, Vec3};

/// A point on a surface.
#[derive(Clone, Copy, Debug)]
pub struct Interaction {
    /// Which part of the scene was hit.
    pub part: u32,
    /// The point, computed so that its error is small (barycentric for triangles).
    pub position: Vec3,
    /// Absolute bound of the rounding error of `position`, per axis.
    pub error: Vec3,
    /// Unit geometric normal, on the side that the part defines, not turned to the viewer.
    pub normal: Vec3,
    /// Unit interpolated normal; on the same side as `normal`.
    pub shading_normal: Vec3,
    /// Surface coordinates.
    pub uv: Vec2,
    /// Derivative of the position by `u`.
    pub dp_du: Vec3,
    /// Derivative of the position by `v`.
    pub dp_dv: Vec3,
}

impl Interaction {
    /// An unbounded ray in `direction` whose origin is moved off the surface, to the side `direction` points to, by the
    /// rounding-error bound.
    pub fn spawn(&self, _direction: Vec3) -> Ray {
        todo!()
    }
}
