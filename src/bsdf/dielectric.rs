//! Boundaries between two transparent media: smooth, rough, and thin sheets.
//!
//! `eta` is the index below the surface over that above it; the sign of `wo.z` says where the walk is.

use super::delta::mirrored;
use super::microfacet::{Distribution, Microfacets};
use super::{Bsdf, BsdfEval, BsdfSample, DeltaEval, DeltaKind, fresnel};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// Two media and the tints of what their boundary reflects and lets through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glass {
    /// Refractive index below the surface over that above it.
    pub eta: f32,
    /// Factor of everything reflected.
    pub reflectance: Rgb,
    /// Factor of everything refracted.
    pub transmittance: Rgb,
}

impl Glass {
    /// Is the index the same on both sides, as far as can be told?
    fn is_matched(&self) -> bool {
        (self.eta - 1.0).abs() < fresnel::MATCHED
    }

    /// The index of the side that `wo` does not lie on over that of the side it lies on.
    fn eta_beyond(&self, wo: Vec3) -> f32 {
        if wo.z > 0.0 { self.eta } else { 1.0 / self.eta }
    }

    /// Straight through.
    fn passed(&self, wo: Vec3) -> BsdfSample {
        BsdfSample::delta(DeltaKind::Pass, -wo, self.transmittance, 1.0, 1.0)
    }
}

/// A smooth boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// The media.
    pub glass: Glass,
}

impl Dielectric {
    pub(super) fn sample(&self, wo: Vec3, lobe: f32) -> Option<BsdfSample> {
        let glass = &self.glass;
        if glass.is_matched() {
            return Some(glass.passed(wo));
        }
        if wo.z == 0.0 {
            return None;
        }
        let eta = glass.eta_beyond(wo);
        let interface = fresnel::dielectric(wo.z.abs().min(1.0), eta);
        // The light is reflected with the probability of its reflectance, so that only the tints remain as weights.
        if lobe < interface.reflectance {
            let probability = interface.reflectance;
            let kind = DeltaKind::Reflection;
            return Some(BsdfSample::delta(
                kind,
                mirrored(wo),
                glass.reflectance,
                probability,
                1.0,
            ));
        }
        Some(BsdfSample::delta(
            DeltaKind::Refraction,
            refracted(wo, eta, interface.cos_refracted),
            glass.transmittance / (eta * eta),
            1.0 - interface.reflectance,
            eta,
        ))
    }

    pub(super) fn delta(&self, wo: Vec3, kind: DeltaKind) -> Option<DeltaEval> {
        let glass = &self.glass;
        if glass.is_matched() {
            let passed = DeltaEval::new(-wo, glass.transmittance, 1.0, 1.0);
            return passed.filter(|_| kind == DeltaKind::Pass);
        }
        if wo.z == 0.0 {
            return None;
        }
        let eta = glass.eta_beyond(wo);
        let interface = fresnel::dielectric(wo.z.abs().min(1.0), eta);
        match kind {
            DeltaKind::Reflection => {
                let reflected = interface.reflectance;
                DeltaEval::new(mirrored(wo), glass.reflectance * reflected, reflected, 1.0)
            }
            DeltaKind::Refraction => {
                let probability = 1.0 - interface.reflectance;
                let reflectance = glass.transmittance * (probability / (eta * eta));
                let wi = refracted(wo, eta, interface.cos_refracted);
                DeltaEval::new(wi, reflectance, probability, eta)
            }
            DeltaKind::Pass => None,
        }
    }
}

/// Where `wo` continues behind a smooth boundary; `eta` and `cos_refracted` as in [`fresnel::refract`].
fn refracted(wo: Vec3, eta: f32, cos_refracted: f32) -> Vec3 {
    Vec3::new(-wo.x / eta, -wo.y / eta, -cos_refracted.copysign(wo.z)).normalize()
}

/// A rough boundary (Walter et al. 2007, equations 20 and 21).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughDielectric {
    /// The media.
    pub glass: Glass,
    /// Their boundary.
    pub facets: Microfacets,
}

impl RoughDielectric {
    /// A rough boundary; a smooth one if the roughness is below [`SMOOTH`](super::microfacet::SMOOTH) or if there is
    /// nothing to refract.
    pub(super) fn build(glass: Glass, distribution: Distribution, alpha: Vec2) -> Bsdf<'static> {
        match Microfacets::new(distribution, alpha) {
            Some(facets) if !glass.is_matched() => Bsdf::RoughDielectric(Self { glass, facets }),
            _ => Bsdf::Dielectric(Dielectric { glass }),
        }
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z == 0.0 || wi.z == 0.0 {
            return BsdfEval::default();
        }
        // A reflection about the origin turns the surface around and changes no normal's density.
        let eta = self.glass.eta_beyond(wo);
        let (wo, wi) = if wo.z > 0.0 { (wo, wi) } else { (-wo, -wi) };
        let is_reflection = wi.z > 0.0;
        // The facet that reflects or refracts one direction into the other (Walter et al. 2007, equations 13 and 16).
        let across = if is_reflection { wo + wi } else { wo + eta * wi };
        let length2 = across.length_squared();
        if length2 < f32::MIN_POSITIVE {
            return BsdfEval::default();
        }
        let h = across / length2.sqrt().copysign(across.z);
        let (cos_o, cos_i) = (wo.dot(h), wi.dot(h));
        // A facet cannot be seen from behind, nor can light be refracted to the side it came from.
        if cos_o <= 0.0 || (cos_i > 0.0) != is_reflection {
            return BsdfEval::default();
        }
        let reflectance = fresnel::dielectric(cos_o.min(1.0), eta).reflectance;
        let visible = self.facets.density(h) / self.facets.projected_area(wo);
        let (tint, pdf) = if is_reflection {
            (self.glass.reflectance, reflectance * visible / 4.0)
        } else {
            // `across` is (wo + η wi), and its length that of the projections on h: what Walter et al. write squared.
            let jacobian = eta * eta * cos_i.abs() / length2;
            let tint = self.glass.transmittance / (eta * eta);
            (tint, (1.0 - reflectance) * visible * cos_o * jacobian)
        };
        BsdfEval { diffuse: Rgb::BLACK, specular: tint * (pdf * self.facets.visibility(wi)), pdf }
    }

    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let above = wo * 1.0f32.copysign(wo.z);
        let h = self.facets.sample_visible(above, u);
        let eta = self.glass.eta_beyond(wo);
        let interface = fresnel::dielectric(above.dot(h).clamp(0.0, 1.0), eta);
        let (wi, eta) = if lobe < interface.reflectance {
            (fresnel::reflect(above, h), 1.0)
        } else {
            (fresnel::refract(above, h, eta, interface.cos_refracted), eta)
        };
        // Light that a facet sends to the wrong side of the surface would need a second scattering: it is lost.
        if (wi.z > 0.0) != (eta == 1.0) {
            return None;
        }
        let wi = wi * 1.0f32.copysign(wo.z);
        self.eval(wo, wi).sampled(wi, eta)
    }
}

/// A sheet so thin that light leaves it where it came in, in its old direction, after any number of inner reflections.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinDielectric {
    /// The medium inside, relative to that outside, which is the same on both sides.
    pub glass: Glass,
}

impl ThinDielectric {
    pub(super) fn sample(&self, wo: Vec3, lobe: f32) -> Option<BsdfSample> {
        let glass = &self.glass;
        let reflected = self.reflected(wo);
        Some(if lobe < reflected {
            let kind = DeltaKind::Reflection;
            BsdfSample::delta(kind, mirrored(wo), glass.reflectance, reflected, 1.0)
        } else {
            BsdfSample::delta(DeltaKind::Pass, -wo, glass.transmittance, 1.0 - reflected, 1.0)
        })
    }

    pub(super) fn delta(&self, wo: Vec3, kind: DeltaKind) -> Option<DeltaEval> {
        let glass = &self.glass;
        let reflected = self.reflected(wo);
        let passed = 1.0 - reflected;
        match kind {
            DeltaKind::Reflection => {
                DeltaEval::new(mirrored(wo), glass.reflectance * reflected, reflected, 1.0)
            }
            DeltaKind::Pass => DeltaEval::new(-wo, glass.transmittance * passed, passed, 1.0),
            DeltaKind::Refraction => None,
        }
    }

    /// Part of the light that is reflected, by the front and from inside.
    fn reflected(&self, wo: Vec3) -> f32 {
        let once = fresnel::dielectric(wo.z.abs().min(1.0), self.glass.eta).reflectance;
        // F + (1-F)² F + (1-F)² F³ + ...
        2.0 * once / (1.0 + once)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glass(eta: f32) -> Glass {
        Glass { eta, reflectance: Rgb::WHITE, transmittance: Rgb::WHITE }
    }

    #[test]
    fn a_thin_sheet_sums_its_inner_reflections() {
        for cos in [1.0f32, 0.7, 0.2] {
            let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            let f = f64::from(fresnel::dielectric(cos, 1.5).reflectance);
            // Bounce by bounce instead of 2F / (1 + F).
            let series: f64 =
                f + (0..60).map(|n| (1.0 - f).powi(2) * f.powi(2 * n + 1)).sum::<f64>();
            let sheet = ThinDielectric { glass: glass(1.5) };
            assert!((f64::from(sheet.sample(wo, 0.0).unwrap().pdf) - series).abs() < 1e-6);
            assert!(
                (f64::from(sheet.sample(wo, 0.999_999).unwrap().pdf) - (1.0 - series)).abs() < 1e-6
            );
        }
    }

    #[test]
    fn two_boundaries_make_a_slab_that_transmits_what_the_sheet_does() {
        // T = (1-F)/(1+F) with F of either face: the refracted direction meets the second face at the angle whose
        // reflectance is the same.
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let face = Dielectric { glass: glass(1.5) };
        let entered = face.sample(wo, 0.999_999).unwrap();
        let inner = Dielectric { glass: glass(1.0 / 1.5) };
        // Inside the slab the walk looks back along -wi at a face whose index falls.
        let left = inner.sample(-entered.wi, 0.999_999).unwrap();
        assert!((left.pdf - entered.pdf).abs() < 1e-6);
        assert!((left.wi + wo).length() < 1e-6);
        let (f, t) = (1.0 - entered.pdf, entered.pdf * left.pdf);
        let slab = t / (1.0 - f * f);
        let sheet = ThinDielectric { glass: glass(1.5) }.sample(wo, 0.999_999).unwrap().pdf;
        assert!((slab - sheet).abs() < 1e-6);
        // Radiance is compressed inside and expands again.
        assert!((entered.specular.r * 2.25 - 1.0).abs() < 1e-6);
        assert!((entered.specular.r * left.specular.r - 1.0).abs() < 1e-6);
        assert!((entered.eta - 1.5).abs() < 1e-6 && (left.eta * 1.5 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn equal_indices_are_no_boundary() {
        let wo = Vec3::new(0.6, 0.0, -0.8);
        for eta in [1.0f32, 1.0 + 5e-6, 1.0 - 5e-6] {
            for bsdf in [
                RoughDielectric::build(glass(eta), Distribution::Ggx, Vec2::splat(0.3)),
                Bsdf::Dielectric(Dielectric { glass: glass(eta) }),
            ] {
                let through = bsdf.sample(wo, 0.0, Vec2::ZERO).unwrap();
                assert_eq!((through.wi, through.specular, through.pdf), (-wo, Rgb::WHITE, 1.0));
                assert!(through.is_delta() && !bsdf.has_smooth());
            }
        }
    }
}
