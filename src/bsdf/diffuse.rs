//! Ideal diffuse reflection.

use super::{BsdfEval, BsdfSample};
use crate::math::Rgb;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, FRAC_PI_4};

/// A Lambertian surface, seen and lit from above only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diffuse {
    /// Part of the light that is reflected.
    pub reflectance: Rgb,
}

impl Diffuse {
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::default();
        }
        let pdf = cosine_hemisphere_pdf(wi);
        BsdfEval { diffuse: self.reflectance * pdf, specular: Rgb::BLACK, pdf }
    }

    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let wi = square_to_cosine_hemisphere(u);
        self.eval(wo, wi).sampled(wi, 1.0)
    }
}

/// Maps the unit square to the upper hemisphere with density `cos θ / π`, keeping nearby points nearby: the concentric
/// disk (Shirley and Chiu 1997, "A Low Distortion Map"), raised to the sphere (Malley's method).
pub(super) fn square_to_cosine_hemisphere(u: Vec2) -> Vec3 {
    let p = 2.0 * u - Vec2::ONE;
    let (radius, phi) = if p.x == 0.0 && p.y == 0.0 {
        (0.0, 0.0)
    } else if p.x.abs() > p.y.abs() {
        (p.x, FRAC_PI_4 * (p.y / p.x))
    } else {
        (p.y, FRAC_PI_2 - FRAC_PI_4 * (p.x / p.y))
    };
    let (sin, cos) = phi.sin_cos();
    Vec3::new(radius * cos, radius * sin, ((1.0 - radius) * (1.0 + radius)).max(0.0).sqrt())
}

/// Density of [`square_to_cosine_hemisphere`], per steradian.
pub(super) fn cosine_hemisphere_pdf(w: Vec3) -> f32 {
    w.z.max(0.0) * FRAC_1_PI
}
