//! Shapes that are met by formula: spheres, disks, cylinders.
//!
//! They are few and cost little, so everything is computed in f64: a ray that starts outside by one f32 ulp is seen to start
//! outside, and points are exact up to their final rounding.

mod cylinder;
mod disk;
mod sphere;

use cylinder::Cylinder;
use disk::Disk;
use sphere::Sphere;

use super::bvh::{Aabb, Query};
use super::{Interaction, Part, Ray};
use crate::math::float::gamma;
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::TAU;

/// A shape ready for rays.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    Sphere(Sphere),
    Disk(Disk),
    Cylinder(Cylinder),
}

/// Runs the same expression on whichever shape it is.
macro_rules! dispatch {
    ($self:expr, $shape:ident => $call:expr) => {
        match $self {
            Shape::Sphere($shape) => $call,
            Shape::Disk($shape) => $call,
            Shape::Cylinder($shape) => $call,
        }
    };
}

/// A point on a shape, in f64: position, unit normal, surface coordinates and the derivatives by them.
pub(super) struct Point {
    position: DVec3,
    normal: DVec3,
    uv: (f64, f64),
    dp_du: DVec3,
    dp_dv: DVec3,
    /// The sizes that `position` was computed from, for its error.
    magnitude: f64,
}

impl Shape {
    /// `None` for a mesh, and for a shape without area or with a size that is not finite.
    pub(crate) fn new(part: &Part) -> Option<Self> {
        match *part {
            Part::Mesh(_) => None,
            Part::Sphere { center, radius, flip_normals } => {
                Sphere::new(center, radius, flip_normals).map(Self::Sphere)
            }
            Part::Disk { center, axes, flip_normals } => {
                Disk::new(center, axes, flip_normals).map(Self::Disk)
            }
            Part::Cylinder { start, end, radius, flip_normals } => {
                Cylinder::new(start, end, radius, flip_normals).map(Self::Cylinder)
            }
        }
    }

    pub(crate) fn bounds(&self) -> Aabb {
        let (center, half) = dispatch!(self, shape => shape.extent());
        // Rounding to f32 may cut off half an ulp.
        Aabb {
            min: (center - half).as_vec3().map(f32::next_down),
            max: (center + half).as_vec3().map(f32::next_up),
        }
    }

    /// The first of the parameters in `(0, t_max)` where the ray meets the surface.
    pub(crate) fn intersect(&self, query: &Query, t_max: f32) -> Option<f32> {
        let (origin, direction) = (query.origin.as_dvec3(), query.direction.as_dvec3());
        let roots = dispatch!(self, shape => shape.roots(origin, direction))?;
        roots.into_iter().map(|t| t as f32).find(|&t| t > 0.0 && t < t_max)
    }

    /// What there is to know where `ray` meets the surface at about `t`.
    pub(crate) fn interaction(&self, part: u32, ray: &Ray, t: f32) -> Interaction {
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        // `t` was rounded to f32; far away that is more than the shape's size.
        let t = dispatch!(self, shape => shape.roots(origin, direction))
            .and_then(|roots| roots.into_iter().find(|&root| root as f32 == t))
            .unwrap_or(f64::from(t));
        let point = dispatch!(self, shape => shape.point(origin + direction * t));
        let position = point.position.as_vec3();
        // A few roundings in f64, and one to f32.
        let error = position.abs() * gamma(1) + (point.magnitude * (16.0 * f64::EPSILON)) as f32;
        let normal = point.normal.as_vec3();
        Interaction {
            part,
            position,
            error,
            normal,
            shading_normal: normal,
            uv: Vec2::new(point.uv.0 as f32, point.uv.1 as f32),
            dp_du: point.dp_du.as_vec3(),
            dp_dv: point.dp_dv.as_vec3(),
        }
    }
}

/// Where the line `origin + t·direction` is `radius` from the origin of coordinates, in ascending order.
///
/// Solved from the point nearest to the centre, because far away the usual discriminant is a difference of huge numbers
/// (Haines et al. 2019, "Precision Improvements for Ray/Sphere Intersection").
fn circle_roots(origin: DVec3, direction: DVec3, radius: f64) -> Option<[f64; 2]> {
    let length_squared = direction.length_squared();
    let middle = -origin.dot(direction) / length_squared;
    let nearest = origin + direction * middle;
    let half_squared = (radius - nearest.length()) * (radius + nearest.length());
    if !(half_squared >= 0.0) {
        return None;
    }
    let half = (half_squared / length_squared).sqrt();
    Some([middle - half, middle + half])
}

/// The angle of `(x, y)` as a share of the full circle, in `[0, 1)`.
fn turn(x: f64, y: f64) -> f64 {
    let turn = y.atan2(x) / TAU;
    if turn < 0.0 { turn + 1.0 } else { turn }
}

/// `normal`, turned round if asked to.
fn oriented(normal: DVec3, flip_normals: bool) -> DVec3 {
    if flip_normals { -normal } else { normal }
}

/// Are all three finite?
fn are_finite(vectors: &[Vec3]) -> bool {
    vectors.iter().all(|vector| vector.is_finite())
}
