//! Rays and what they hit.

use glam::Vec3;

/// A half-line from `origin`, up to parameter `t_max`. Hits with `0 < t < t_max` count: origins are moved off
/// surfaces by rounding-error bounds ([`crate::math::float`]), so no smallest `t` is needed.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where `t` is 0.
    pub origin: Vec3,
    /// Need not be a unit vector; `t` counts in its lengths.
    pub direction: Vec3,
    /// Hits at or beyond this do not count; infinite for an unbounded ray.
    pub t_max: f32,
}

impl Ray {
    /// An unbounded ray.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_max: f32::INFINITY }
    }

    /// From `start`, with its parameter 1 at `end`, where it ends.
    #[inline]
    pub fn between(start: Vec3, end: Vec3) -> Self {
        Self { origin: start, direction: end - start, t_max: 1.0 }
    }

    /// The point at parameter `t`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// The nearest intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex; 0 on other shapes.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex; 0 on other shapes.
    pub v: f32,
    /// Which primitive: first all triangles in the order given to the tree, then all other shapes.
    pub primitive: u32,
}
