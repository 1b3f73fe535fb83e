//! Metals: smooth mirrors and rough ones.

use super::delta::mirrored;
use super::microfacet::{Distribution, Microfacets};
use super::{Bsdf, BsdfEval, BsdfSample, DeltaEval, DeltaKind, fresnel};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// What a conductor is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metal {
    /// Real part of the refractive index.
    pub eta: Rgb,
    /// Imaginary part of the refractive index (extinction).
    pub k: Rgb,
    /// Factor of everything reflected.
    pub tint: Rgb,
}

impl Metal {
    /// Reflectance at an angle with this cosine.
    fn reflectance(&self, cos: f32) -> Rgb {
        self.tint * fresnel::conductor(cos.clamp(0.0, 1.0), self.eta, self.k)
    }

    /// Reflectance at normal incidence.
    pub(super) fn albedo(&self) -> Rgb {
        self.reflectance(1.0)
    }
}

/// A perfectly smooth metal, seen from above only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    /// The metal.
    pub metal: Metal,
}

impl Conductor {
    pub(super) fn sample(&self, wo: Vec3) -> Option<BsdfSample> {
        let found = self.delta(wo, DeltaKind::Reflection)?;
        Some(BsdfSample::delta(DeltaKind::Reflection, found.wi, found.reflectance, 1.0, 1.0))
    }

    pub(super) fn delta(&self, wo: Vec3, kind: DeltaKind) -> Option<DeltaEval> {
        let exists = kind == DeltaKind::Reflection && wo.z > 0.0;
        exists.then(|| DeltaEval {
            wi: mirrored(wo),
            reflectance: self.metal.reflectance(wo.z),
            probability: 1.0,
            eta: 1.0,
        })
    }
}

/// A rough metal, seen and lit from above only (Walter et al. 2007, equation 20).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughConductor {
    /// The metal.
    pub metal: Metal,
    /// Its surface.
    pub facets: Microfacets,
}

impl RoughConductor {
    /// A rough metal; a smooth one if the roughness is below [`SMOOTH`](super::microfacet::SMOOTH).
    pub(super) fn build(metal: Metal, distribution: Distribution, alpha: Vec2) -> Bsdf<'static> {
        match Microfacets::new(distribution, alpha) {
            Some(facets) => Bsdf::RoughConductor(Self { metal, facets }),
            None => Bsdf::Conductor(Conductor { metal }),
        }
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let Some(coat) = reflection(&self.facets, wo, wi) else {
            return BsdfEval::default();
        };
        BsdfEval {
            diffuse: Rgb::BLACK,
            specular: self.metal.reflectance(coat.cos_facet) * coat.value,
            pdf: coat.pdf,
        }
    }

    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = fresnel::reflect(wo, self.facets.sample_visible(wo, u));
        self.eval(wo, wi).sampled(wi, 1.0)
    }
}

/// Reflection by perfectly reflecting microfacets.
pub(super) struct Reflection {
    /// `f |cos θi|`, per steradian, without the reflectance of the facets.
    pub(super) value: f32,
    /// Density of choosing a visible facet and reflecting in it, per steradian.
    pub(super) pdf: f32,
    /// Cosine between the directions and the facet's normal.
    pub(super) cos_facet: f32,
}

/// `D G1(wo) G1(wi) / (4 cos θo)` and `D G1(wo) / (4 cos θo)`; `None` unless both directions are above the surface.
pub(super) fn reflection(facets: &Microfacets, wo: Vec3, wi: Vec3) -> Option<Reflection> {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return None;
    }
    // Two grazing directions that face each other may have no facet between them in floating point.
    let h = (wo + wi).try_normalize()?;
    let pdf = facets.density(h) / (4.0 * facets.projected_area(wo));
    Some(Reflection { value: pdf * facets.visibility(wi), pdf, cos_facet: wo.dot(h) })
}
