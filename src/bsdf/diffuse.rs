//! Ideal diffuse reflection.

use super::{BsdfEval, BsdfSample};
use crate::math::Rgb;
use crate::math::warp::{cosine_hemisphere_pdf, square_to_cosine_hemisphere};
use glam::{Vec2, Vec3};

/// A Lambertian surface, seen and lit from above only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diffuse {
    /// Part of the light that is reflected.
    pub reflectance: Rgb,
}

impl Diffuse {
    #[inline]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::default();
        }
        let pdf = cosine_hemisphere_pdf(wi);
        BsdfEval { diffuse: self.reflectance * pdf, specular: Rgb::BLACK, pdf }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let wi = square_to_cosine_hemisphere(u);
        let pdf = cosine_hemisphere_pdf(wi);
        // The density is the value but for the reflectance: what is left is known without a division.
        (wo.z > 0.0 && pdf > 0.0).then_some(BsdfSample {
            wi,
            diffuse: self.reflectance,
            specular: Rgb::BLACK,
            pdf,
            delta: None,
            eta: 1.0,
        })
    }
}
