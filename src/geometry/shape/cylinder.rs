//! Open cylinders, parametrised as in Mitsuba 3: `u = φ/2π` around the axis, `v` from 0 at the start to 1 at the end. The
//! tangent of [`Frame::from_normal`] around the axis is `φ = 0`.

use super::{Point, are_finite, circle_roots, oriented, turn};
use crate::math::Frame;
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::TAU;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Cylinder {
    start: DVec3,
    /// Orthonormal; the last points from start to end.
    frame: [DVec3; 3],
    length: f64,
    radius: f64,
    flip_normals: bool,
}

impl Cylinder {
    pub(super) fn new(start: Vec3, end: Vec3, radius: f32, flip_normals: bool) -> Option<Self> {
        if !(are_finite(&[start, end]) && radius > 0.0 && radius.is_finite()) {
            return None;
        }
        let span = end.as_dvec3() - start.as_dvec3();
        let axis = span.try_normalize()?;
        let tangent = Frame::from_normal(axis.as_vec3())
            .tangent
            .as_dvec3()
            .reject_from_normalized(axis)
            .normalize();
        Some(Self {
            start: start.as_dvec3(),
            frame: [tangent, axis.cross(tangent), axis],
            length: span.length(),
            radius: f64::from(radius),
            flip_normals,
        })
    }

    /// Centre and half-size of the bounding box.
    pub(super) fn extent(&self) -> (DVec3, DVec3) {
        let [x, y, axis] = self.frame;
        let half = axis * (0.5 * self.length);
        (self.start + half, half.abs() + (x * x + y * y).map(f64::sqrt) * self.radius)
    }

    /// Parameters at which the line meets the side; NaN for one that lies beyond an end.
    pub(super) fn roots(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let origin = self.local(origin - self.start);
        let direction = self.local(direction);
        let roots = circle_roots(origin.with_z(0.0), direction.with_z(0.0), self.radius)?;
        Some(roots.map(|t| {
            let along = origin.z + t * direction.z;
            if (0.0..=self.length).contains(&along) { t } else { f64::NAN }
        }))
    }

    /// The point of the side nearest to `near`.
    pub(super) fn point(&self, near: DVec3) -> Point {
        let [x, y, axis] = self.frame;
        let local = self.local(near - self.start);
        let around = local.with_z(0.0).normalize_or(DVec3::X);
        let outward = x * around.x + y * around.y;
        Point {
            position: self.start + axis * local.z + outward * self.radius,
            normal: oriented(outward, self.flip_normals),
            uv: Vec2::new(turn(around.x, around.y), (local.z / self.length) as f32),
            dp_du: (y * around.x - x * around.y) * (TAU * self.radius),
            dp_dv: axis * self.length,
            magnitude: self.start.abs().max_element() + self.length + self.radius,
        }
    }

    fn local(&self, world: DVec3) -> DVec3 {
        let [x, y, axis] = self.frame;
        DVec3::new(x.dot(world), y.dot(world), axis.dot(world))
    }
}
