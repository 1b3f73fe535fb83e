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
use crate::math::arc_tangent::arc_tangent2;
use crate::math::float::gamma;
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::TAU;

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
    uv: Vec2,
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
            uv: point.uv,
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
    let reciprocal = 1.0 / direction.length_squared();
    let middle = -origin.dot(direction) * reciprocal;
    let nearest = origin + direction * middle;
    let half_squared = radius * radius - nearest.length_squared();
    // Neither where the line passes by, nor where there is no line.
    (half_squared >= 0.0).then(|| {
        let half = (half_squared * reciprocal).sqrt();
        [middle - half, middle + half]
    })
}

/// The angle of `(x, y)` as a share of the full circle, in `[0, 1)`.
fn turn(x: f64, y: f64) -> f32 {
    let turn = arc_tangent2(y as f32, x as f32) / TAU;
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::FRAC_1_SQRT_2;

    fn hit(part: &Part, origin: Vec3, direction: Vec3) -> Option<(f32, Interaction)> {
        let shape = Shape::new(part).unwrap();
        let ray = Ray::new(origin, direction);
        let t = shape.intersect(&Query::new(&ray).unwrap(), f32::INFINITY)?;
        Some((t, shape.interaction(0, &ray, t)))
    }

    const SPHERE: Part = Part::Sphere { center: Vec3::ZERO, radius: 1.0, flip_normals: false };
    const DISK: Part =
        Part::Disk { center: Vec3::ZERO, axes: [Vec3::X, Vec3::Y], flip_normals: false };
    const CYLINDER: Part =
        Part::Cylinder { start: Vec3::ZERO, end: Vec3::Z, radius: 1.0, flip_normals: false };

    /// Against numbers of `mitsuba` 3.9.1, `scene.ray_intersect`: t, position, normal, uv and derivatives.
    #[test]
    fn shapes_are_parametrised_as_by_mitsuba() {
        let expected = [
            (
                SPHERE,
                [0.3, 0.2, 0.6],
                [0.6, 0.8, 0.0],
                0.450_948_74,
                [0.570_569, 0.560_759, 0.6],
                1.0,
                [0.123_62, 0.295_167],
                [-3.523_35, 3.584_99, 0.0],
                [1.344_37, 1.321_26, -2.513_27],
            ),
            (
                SPHERE,
                [-3.0, -3.0, 0.6],
                [1.0, 1.0, 0.0],
                2.434_314_7,
                [-0.565_685, -0.565_685, 0.6],
                1.0,
                [0.625, 0.295_167],
                [3.554_31, -3.554_31, 0.0],
                [-1.332_86, -1.332_86, -2.513_27],
            ),
            (
                CYLINDER,
                [0.3, 0.2, 0.6],
                [0.6, 0.8, 0.0],
                0.652_774,
                [0.691_664, 0.722_219, 0.6],
                0.0,
                [0.128_439, 0.6],
                [-4.537_84, 4.345_86, 0.0],
                [0.0, 0.0, 1.0],
            ),
            (
                CYLINDER,
                [-3.0, -3.0, 0.6],
                [1.0, 1.0, 0.0],
                2.292_893_2,
                [-FRAC_1_SQRT_2, -FRAC_1_SQRT_2, 0.6],
                0.0,
                [0.625, 0.6],
                [4.442_88, -4.442_88, 0.0],
                [0.0, 0.0, 1.0],
            ),
            (
                DISK,
                [0.3, 0.2, -1.0],
                [0.0, 0.0, 1.0],
                1.0,
                [0.3, 0.2, 0.0],
                f32::NAN,
                [0.360_555, 0.093_583_5],
                [0.832_05, 0.554_7, 0.0],
                [-1.256_64, 1.884_96, 0.0],
            ),
        ];
        for (part, origin, direction, t, position, normal_z, uv, dp_du, dp_dv) in expected {
            let (hit_t, at) = hit(&part, origin.into(), direction.into()).unwrap();
            let position = Vec3::from(position);
            // On the unit sphere and cylinder the normal is the position, with or without z; the disk's is z.
            let normal =
                if normal_z.is_nan() { Vec3::Z } else { position * Vec3::new(1.0, 1.0, normal_z) };
            assert!((hit_t - t).abs() < 1e-6, "{part:?}: t {hit_t}");
            assert!((at.position - position).length() < 2e-6, "{part:?}: position {}", at.position);
            assert!((at.normal - normal).length() < 2e-6, "{part:?}: normal {}", at.normal);
            assert!((at.uv - Vec2::from(uv)).length() < 2e-6, "{part:?}: uv {}", at.uv);
            assert!((at.dp_du - Vec3::from(dp_du)).length() < 2e-5, "{part:?}: dp_du {}", at.dp_du);
            assert!((at.dp_dv - Vec3::from(dp_dv)).length() < 2e-5, "{part:?}: dp_dv {}", at.dp_dv);
        }
    }

    #[test]
    fn flipped_shapes_only_turn_their_normal() {
        let (down, out) = (Vec3::new(-0.2, 0.3, -0.5), Vec3::new(0.5, 0.3, 0.1));
        let flipped = [
            (SPHERE, Part::Sphere { center: Vec3::ZERO, radius: 1.0, flip_normals: true }, down),
            (
                DISK,
                Part::Disk { center: Vec3::ZERO, axes: [Vec3::X, Vec3::Y], flip_normals: true },
                down,
            ),
            (
                CYLINDER,
                Part::Cylinder { start: Vec3::ZERO, end: Vec3::Z, radius: 1.0, flip_normals: true },
                out,
            ),
        ];
        for (part, flipped, direction) in flipped {
            let origin = Vec3::new(0.2, 0.1, 0.7);
            let (t, at) = hit(&part, origin, direction).unwrap();
            let (flipped_t, flipped) = hit(&flipped, origin, direction).unwrap();
            assert_eq!(
                (t, at.position, at.uv, at.dp_du),
                (flipped_t, flipped.position, flipped.uv, flipped.dp_du)
            );
            assert_eq!((at.normal, at.shading_normal), (-flipped.normal, -flipped.shading_normal));
        }
    }

    #[test]
    fn a_small_sphere_far_away_is_hit_where_it_is() {
        let center = Vec3::new(3e5, -2e5, 1e5);
        let part = Part::Sphere { center, radius: 0.25, flip_normals: false };
        let shape = Shape::new(&part).unwrap();
        for offset in [-1.01f64, -0.99, -0.5, 0.0, 0.7, 0.99, 1.01] {
            // Parallel to the line to the centre, at `offset` radii from it; from there the ray has exactly this direction.
            let across = center.as_dvec3().any_orthonormal_vector() * (offset * 0.25);
            let ray = Ray::new(across.as_vec3(), center);
            let exact = ray.origin.as_dvec3().cross(center.as_dvec3().normalize()).length() < 0.25;
            let t = shape.intersect(&Query::new(&ray).unwrap(), f32::INFINITY);
            assert_eq!(t.is_some(), exact, "{offset} radii from the centre");
            if let Some(t) = t {
                let at = shape.interaction(0, &ray, t);
                let distance = (at.position.as_dvec3() - center.as_dvec3()).length();
                assert!((distance - 0.25).abs() < 0.03, "{distance} from the centre");
                assert!(at.normal.dot(center) < 0.0, "the near side is hit");
            }
        }
    }

    #[test]
    fn a_cylinder_is_open_and_a_disk_is_round() {
        assert!(hit(&CYLINDER, Vec3::new(0.2, 0.3, -2.0), Vec3::Z).is_none());
        // Above the near wall, into the far one; and above both.
        let (t, at) =
            hit(&CYLINDER, Vec3::new(-3.0, 0.0, 2.0), Vec3::new(2.0, 0.0, -0.75)).unwrap();
        assert_eq!((t, at.position), (2.0, Vec3::new(1.0, 0.0, 0.5)));
        assert!(hit(&CYLINDER, Vec3::new(-3.0, 0.0, 2.0), Vec3::new(2.0, 0.0, -0.1)).is_none());
        let ellipse = Part::Disk {
            center: Vec3::Z,
            axes: [Vec3::X * 2.0, Vec3::Y * 0.5],
            flip_normals: false,
        };
        for (x, y, is_inside) in
            [(1.9, 0.0, true), (0.0, 0.6, false), (1.5, 0.3, true), (1.5, 0.4, false)]
        {
            assert_eq!(
                hit(&ellipse, Vec3::new(x, y, 5.0), Vec3::NEG_Z).is_some(),
                is_inside,
                "{x}, {y}"
            );
        }
        assert!(
            hit(&DISK, Vec3::new(-3.0, 0.1, 0.0), Vec3::X).is_none(),
            "in the plane of the disk"
        );
    }

    #[test]
    fn bounds_hold_every_point() {
        let parts = [
            Part::Sphere { center: Vec3::new(0.1, -7.3, 2.0), radius: 0.3, flip_normals: false },
            Part::Disk {
                center: Vec3::ONE,
                axes: [Vec3::new(0.3, 0.2, 0.1), Vec3::new(-0.2, 0.5, 0.3)],
                flip_normals: false,
            },
            Part::Cylinder {
                start: Vec3::ONE,
                end: Vec3::new(2.0, 1.5, 0.0),
                radius: 0.4,
                flip_normals: false,
            },
        ];
        for part in parts {
            let shape = Shape::new(&part).unwrap();
            let bounds = shape.bounds();
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for step in 0..200_000 {
                // Points of the box, low-discrepancy (Roberts 2018), seen from one place after another.
                let share =
                    (Vec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5) * step as f32).fract();
                let target = bounds.min + (bounds.max - bounds.min) * share;
                let turn = step as f32 * 0.3;
                let ray = Ray::new(target, Vec3::new(turn.cos(), (0.37 * turn).sin(), turn.sin()));
                if let Some(t) = shape.intersect(&Query::new(&ray).unwrap(), f32::INFINITY) {
                    let at = shape.interaction(0, &ray, t).position;
                    (low, high) = (low.min(at), high.max(at));
                }
            }
            assert!(
                low.cmpge(bounds.min).all() && high.cmple(bounds.max).all(),
                "{part:?}: {low} {high} leave {bounds:?}"
            );
            let slack = (low - bounds.min).max_element().max((bounds.max - high).max_element());
            assert!(slack < 0.05, "{part:?}: {bounds:?} is {slack} wider than the shape");
        }
    }
}
