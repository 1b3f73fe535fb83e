//! Flat disks and ellipses, parametrised as in Mitsuba 3: `u` is the distance from the centre, `v = φ/2π` from the
//! first half-axis.

use super::{Point, are_finite, oriented, turn};
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::TAU;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Disk {
    center: DVec3,
    axes: [DVec3; 2],
    /// `duals[i] · axes[j]` is 1 where `i = j`, else 0.
    duals: [DVec3; 2],
    normal: DVec3,
    flip_normals: bool,
}

impl Disk {
    pub(super) fn new(center: Vec3, axes: [Vec3; 2], flip_normals: bool) -> Option<Self> {
        if !are_finite(&[center, axes[0], axes[1]]) {
            return None;
        }
        let [first, second] = axes.map(|axis| axis.as_dvec3());
        let across = first.cross(second);
        let normal = across.try_normalize()?;
        let duals = [second.cross(normal) / across.length(), normal.cross(first) / across.length()];
        Some(Self { center: center.as_dvec3(), axes: [first, second], duals, normal, flip_normals })
    }

    /// Centre and half-size of the bounding box.
    pub(super) fn extent(&self) -> (DVec3, DVec3) {
        let [first, second] = self.axes;
        (self.center, (first * first + second * second).map(f64::sqrt))
    }

    /// The one parameter at which the line meets the disk, twice.
    pub(super) fn roots(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let to_center = self.center - origin;
        let t = to_center.dot(self.normal) / direction.dot(self.normal);
        let (x, y) = self.local(direction * t - to_center);
        (x * x + y * y <= 1.0).then_some([t, t])
    }

    /// The point of the disk's plane nearest to `near`.
    pub(super) fn point(&self, near: DVec3) -> Point {
        let (x, y) = self.local(near - self.center);
        let [first, second] = self.axes;
        let radius = (x * x + y * y).sqrt();
        let (cos_phi, sin_phi) = if radius > 0.0 { (x / radius, y / radius) } else { (1.0, 0.0) };
        Point {
            position: self.center + first * x + second * y,
            normal: oriented(self.normal, self.flip_normals),
            uv: Vec2::new(radius as f32, turn(x, y)),
            dp_du: first * cos_phi + second * sin_phi,
            dp_dv: (second * x - first * y) * TAU,
            magnitude: self.center.abs().max_element() + first.length() + second.length(),
        }
    }

    fn local(&self, from_center: DVec3) -> (f64, f64) {
        (self.duals[0].dot(from_center), self.duals[1].dot(from_center))
    }
}
