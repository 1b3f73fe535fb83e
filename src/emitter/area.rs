//! Area emitters: parts of the scene that shine, from the side that their normals point to.
//!
//! Points are sampled uniformly by area, and the density converted to solid angle; a sphere seen from outside is sampled
//! by the cone of directions to it, which is exact and never gives its far side.

mod shape;

use super::{EmitterSample, mean};
use crate::geometry::{Interaction, Part};
use crate::math::{Frame, Rgb, warp};
use crate::texture::Texture;
use glam::{Vec2, Vec3};
use shape::{Shape, SurfacePoint, sphere_uv};
use std::f64::consts::PI;

/// A part that shines, with what sampling it needs.
#[derive(Clone, Debug)]
pub(super) struct AreaEmitter {
    shape: Shape,
    radiance: Radiance,
    area: f64,
    /// Density of points per unit of area, `1 / area`; 0 where there is nothing to sample.
    pdf_area: f32,
}

/// Emitted radiance; most emitters have the same everywhere, and then no surface coordinates are computed.
#[derive(Clone, Debug)]
enum Radiance {
    Uniform(Rgb),
    Textured(Texture),
}

impl AreaEmitter {
    pub(super) fn new(part: Part, radiance: Texture) -> Self {
        let radiance = match radiance {
            Texture::Constant(colour) => Radiance::Uniform(colour),
            textured => Radiance::Textured(textured),
        };
        let (shape, area) = Shape::new(part, matches!(radiance, Radiance::Textured(_)));
        // An area whose inverse single precision does not hold is treated as none at all.
        let pdf_area = (1.0 / area) as f32;
        let usable = area > 0.0 && pdf_area > 0.0 && pdf_area.is_finite();
        let (area, pdf_area) = if usable { (area, pdf_area) } else { (0.0, 0.0) };
        Self { shape, radiance, area, pdf_area }
    }

    /// Watts: `π · area · mean radiance`.
    pub(super) fn power(&self) -> f64 {
        let radiance = match &self.radiance {
            Radiance::Uniform(colour) => *colour,
            Radiance::Textured(texture) => texture.mean(),
        };
        PI * self.area * mean(radiance)
    }

    /// Radiance sent from the side that shines.
    #[inline]
    pub(super) fn radiance(&self, uv: Vec2) -> Rgb {
        match &self.radiance {
            Radiance::Uniform(colour) => *colour,
            Radiance::Textured(texture) => texture.eval(uv),
        }
    }

    /// A direction to a point of the emitter, seen from its shining side; `triangle` chooses among triangles.
    #[inline(always)]
    pub(super) fn sample(&self, from: Vec3, triangle: f32, u: Vec2) -> Option<EmitterSample> {
        if let Shape::Sphere { center, radius, flip_normals } = self.shape
            && let Some(cone) = Cone::to_sphere(from, center, radius)
        {
            // From outside only a sphere with outward normals shines.
            if flip_normals {
                return None;
            }
            // Taken apart, what other shapes give stays in registers.
            let EmitterSample { direction, distance, radiance, pdf, is_delta } =
                self.sample_cone(&cone, radius, u);
            return Some(EmitterSample { direction, distance, radiance, pdf, is_delta });
        }
        let point = self.shape.sample(triangle, u)?;
        let to_point = point.position - from;
        let distance = to_point.length();
        let direction = to_point / distance;
        let cosine = -point.normal.dot(direction);
        // The direction to the point itself is NaN.
        if cosine <= 0.0 || cosine.is_nan() {
            return None;
        }
        let pdf = to_solid_angle(self.pdf_area, distance, cosine);
        Some(EmitterSample {
            direction,
            distance,
            radiance: self.radiance(self.uv(triangle, u)),
            pdf,
            is_delta: false,
        })
    }

    /// A point, uniform in area, and the bound of its rounding error; `triangle` chooses among triangles.
    pub(super) fn sample_point(&self, triangle: f32, u: Vec2) -> Option<(SurfacePoint, Vec3)> {
        let point = self.shape.sample(triangle, u)?;
        let error = self.shape.error(triangle, point.position);
        Some((point, error))
    }

    /// Surface coordinates of the point that those numbers choose; not found out where the radiance is the same everywhere.
    #[inline]
    pub(super) fn uv(&self, triangle: f32, u: Vec2) -> Vec2 {
        match self.radiance {
            Radiance::Uniform(_) => Vec2::ZERO,
            Radiance::Textured(_) => self.shape.uv(triangle, u),
        }
    }

    /// Density of [`AreaEmitter::sample_point`] per unit of area; 0 where there is nothing to sample.
    pub(super) fn point_pdf(&self) -> f64 {
        if self.area > 0.0 { 1.0 / self.area } else { 0.0 }
    }

    /// Density, per steradian, with which [`AreaEmitter::sample`] from `from` gives the direction to `at`.
    #[inline]
    pub(super) fn pdf(&self, from: Vec3, at: &Interaction) -> f32 {
        let to_point = at.position - from;
        let distance = to_point.length();
        let cosine = -shining_normal(at).dot(to_point / distance);
        if cosine <= 0.0 || cosine.is_nan() || self.pdf_area == 0.0 {
            return 0.0;
        }
        if let Shape::Sphere { center, radius, .. } = self.shape
            && let Some(cone) = Cone::to_sphere(from, center, radius)
        {
            return cone.pdf;
        }
        to_solid_angle(self.pdf_area, distance, cosine)
    }

    fn sample_cone(&self, cone: &Cone, radius: f32, u: Vec2) -> EmitterSample {
        let local = warp::square_to_cone(u, cone.cap);
        let direction = Frame::from_normal(cone.axis).to_world(local);
        // The nearer intersection; at the cone's rim rounding may miss the sphere by a hair.
        let sine_squared = local.truncate().length_squared();
        let half_chord =
            (radius * radius - cone.distance * cone.distance * sine_squared).max(0.0).sqrt();
        // The product of the distances of both intersections over the farther one: the difference of the middle and half the
        // chord, next to the surface, would be a difference of equals.
        let farther = cone.distance * local.z + half_chord;
        let distance = cone.gap * ((cone.distance + radius) / farther);
        let radiance = match &self.radiance {
            Radiance::Uniform(colour) => *colour,
            Radiance::Textured(texture) => {
                let from_center = direction * distance - cone.axis * cone.distance;
                texture.eval(sphere_uv(from_center.normalize_or(-cone.axis)))
            }
        };
        EmitterSample { direction, distance, radiance, pdf: cone.pdf, is_delta: false }
    }
}

/// The directions in which a sphere is seen from a point outside.
struct Cone {
    /// Unit vector to the centre.
    axis: Vec3,
    /// How far the centre is.
    distance: f32,
    /// How far the sphere is.
    gap: f32,
    /// `1 - cos` of the half-angle.
    cap: f32,
    /// Density of uniform directions, per steradian; 0 where the cone is too narrow for single precision.
    pdf: f32,
}

impl Cone {
    /// `None` from inside.
    #[inline]
    fn to_sphere(from: Vec3, center: Vec3, radius: f32) -> Option<Self> {
        let to_center = center - from;
        // Next to the sphere single precision would leave nothing of the gap, and shadow rays would end inside of the sphere.
        let exact_distance = (center.as_dvec3() - from.as_dvec3()).length();
        let gap = (exact_distance - f64::from(radius)) as f32;
        let distance = exact_distance as f32;
        let sine = radius / distance;
        if sine >= 1.0 || sine.is_nan() {
            return None;
        }
        let cap = warp::one_minus_cosine(sine * sine);
        Some(Self {
            axis: to_center / distance,
            distance,
            gap,
            cap,
            pdf: finite_or_zero(warp::cone_pdf(cap)),
        })
    }
}

/// The density per steradian of a point with density `pdf_area` per unit of area, `distance` away, whose normal makes an
/// angle of the given cosine with the direction: `pdf_area · distance² / cosine`; 0 where that is not finite.
#[inline]
fn to_solid_angle(pdf_area: f32, distance: f32, cosine: f32) -> f32 {
    finite_or_zero(pdf_area * distance * distance / cosine)
}

/// A density that single precision cannot hold counts as 0 both when sampling and when evaluating, so that the two
/// agree and the light is left to the other sampling method.
#[inline]
fn finite_or_zero(pdf: f32) -> f32 {
    if pdf.is_finite() { pdf } else { 0.0 }
}

/// The unit geometric normal on the side that shines: that of the shading normal, which is the other one where a mesh
/// has vertex normals against its winding. As in Mitsuba 3, apart from triangles whose normals lean over by more than a
/// right angle.
#[inline]
pub(super) fn shining_normal(at: &Interaction) -> Vec3 {
    if at.normal.dot(at.shading_normal) < 0.0 { -at.normal } else { at.normal }
}
