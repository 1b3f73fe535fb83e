//! Spheres, parametrised as in Mitsuba 3: `u = φ/2π` around the z axis from the x axis, `v = θ/π` from the north pole.

use super::{Point, are_finite, circle_roots, oriented, turn};
use crate::math::arc_tangent::arc_tangent2;
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;
use std::f64::consts::{PI, TAU};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Sphere {
    center: DVec3,
    radius: f64,
    flip_normals: bool,
}

impl Sphere {
    pub(super) fn new(center: Vec3, radius: f32, flip_normals: bool) -> Option<Self> {
        (are_finite(&[center]) && radius > 0.0 && radius.is_finite()).then(|| Self {
            center: center.as_dvec3(),
            radius: f64::from(radius),
            flip_normals,
        })
    }

    /// Centre and half-size of the bounding box.
    pub(super) fn extent(&self) -> (DVec3, DVec3) {
        (self.center, DVec3::splat(self.radius))
    }

    pub(super) fn roots(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        circle_roots(origin - self.center, direction, self.radius)
    }

    /// The point of the surface nearest to `near`.
    pub(super) fn point(&self, near: DVec3) -> Point {
        let outward = (near - self.center).normalize_or(DVec3::Z);
        let (sin_theta, z) = (outward.truncate().length(), outward.z);
        // At the poles any direction serves as φ = 0.
        let (cos_phi, sin_phi) = if sin_theta > 0.0 {
            (outward.x / sin_theta, outward.y / sin_theta)
        } else {
            (1.0, 0.0)
        };
        Point {
            position: self.center + outward * self.radius,
            normal: oriented(outward, self.flip_normals),
            uv: Vec2::new(
                turn(outward.x, outward.y),
                arc_tangent2(sin_theta as f32, z as f32) * FRAC_1_PI,
            ),
            dp_du: DVec3::new(-outward.y, outward.x, 0.0) * (TAU * self.radius),
            dp_dv: DVec3::new(z * cos_phi, z * sin_phi, -sin_theta) * (PI * self.radius),
            magnitude: self.center.abs().max_element() + self.radius,
        }
    }
}
