//! A diffuse base under a clear coat, smooth or rough.
//!
//! Light that enters through the coat is scattered by the base, and partly reflected back to it from inside any number
//! of times: `f = T(wo) T(wi) ρ / (π η² (1 - ρ R))`, with the transmittance `T` of the coat from outside and its mean
//! reflectance `R` for diffuse light from inside. If the coat is not `nonlinear`, `1 - R` stands for `1 - ρ R`, so that
//! colours do not shift (the model of Mitsuba's `plastic`).

use super::conductor::reflection;
use super::delta::mirrored;
use super::microfacet::{Distribution, Microfacets};
use super::{Bsdf, BsdfEval, BsdfSample, DeltaEval, DeltaKind, fresnel};
use crate::math::Rgb;
use crate::math::warp::{cosine_hemisphere_pdf, square_to_cosine_hemisphere};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// What a smooth coat is, and what it does to diffuse light: computed once for a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Refractive index of the coat over that outside.
    eta: f32,
    /// Reflectance for diffuse light from inside.
    internal_reflectance: f32,
    /// Do colours shift by absorption between inner reflections?
    is_nonlinear: bool,
}

impl Coat {
    /// A smooth coat of relative index `eta`. The inner reflectance is integrated exactly, where Mitsuba has a fit (Egan
    /// and Hilgeman 1973) that is up to 0.1 % brighter for indices up to 1.7 and could return more light than came.
    pub fn new(eta: f32, is_nonlinear: bool) -> Self {
        Self { eta, internal_reflectance: fresnel::diffuse_reflectance(1.0 / eta), is_nonlinear }
    }

    /// What the base and the inner reflections make of light that entered, per unit of `T(wo) T(wi) cos / π`.
    fn base(&self, diffuse: Rgb) -> Rgb {
        let scale = 1.0 / (self.eta * self.eta);
        if self.is_nonlinear {
            diffuse.map(|rho| scale * rho / (1.0 - rho * self.internal_reflectance))
        } else {
            diffuse * (scale / (1.0 - self.internal_reflectance))
        }
    }

    /// Probability of choosing the coat, from estimates of what both lobes reflect: `reflected` of the light by the coat;
    /// of the rest the base returns what the coat lets out again. Both lobes keep a tenth if they reflect at all, so
    /// that neither's weight explodes where the estimate fails.
    fn probability(&self, reflected: f32, diffuse: Rgb, specular: Rgb) -> f32 {
        let coat = reflected * specular.mean();
        let out = (1.0 - self.internal_reflectance) * self.eta * self.eta;
        let base = (1.0 - reflected) * out * self.base(diffuse).mean();
        if base <= 0.0 {
            1.0
        } else if coat <= 0.0 {
            0.0
        } else {
            (coat / (coat + base)).clamp(0.1, 0.9)
        }
    }
}

/// Smooth plastic, seen and lit from above only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plastic {
    /// Reflectance of the base.
    pub diffuse: Rgb,
    /// Factor of what the coat reflects.
    pub specular: Rgb,
    /// The coat.
    pub coat: Coat,
}

impl Plastic {
    fn probability(&self, reflected: f32) -> f32 {
        self.coat.probability(reflected, self.diffuse, self.specular)
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::default();
        }
        let reflected = |w: Vec3| fresnel::dielectric(w.z.min(1.0), self.coat.eta).reflectance;
        let out = reflected(wo);
        let cosine = cosine_hemisphere_pdf(wi);
        BsdfEval {
            diffuse: self.coat.base(self.diffuse) * ((1.0 - out) * (1.0 - reflected(wi)) * cosine),
            specular: Rgb::BLACK,
            pdf: (1.0 - self.probability(out)) * cosine,
        }
    }

    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let reflected = fresnel::dielectric(wo.z.min(1.0), self.coat.eta).reflectance;
        let probability = self.probability(reflected);
        if lobe < probability {
            return Some(BsdfSample::delta(
                DeltaKind::Reflection,
                mirrored(wo),
                self.specular * (reflected / probability),
                probability,
                1.0,
            ));
        }
        let wi = square_to_cosine_hemisphere(u);
        self.eval(wo, wi).sampled(wi, 1.0)
    }

    pub(super) fn delta(&self, wo: Vec3, kind: DeltaKind) -> Option<DeltaEval> {
        if kind != DeltaKind::Reflection || wo.z <= 0.0 {
            return None;
        }
        let reflected = fresnel::dielectric(wo.z.min(1.0), self.coat.eta).reflectance;
        DeltaEval::new(mirrored(wo), self.specular * reflected, self.probability(reflected), 1.0)
    }
}

/// Points of the table of [`RoughCoat`]: as many as in Mitsuba, whose tables are to be met.
const NODES: usize = 64;

/// What a rough coat is, and what it does to light: computed once for a material, in some ten milliseconds.
#[derive(Clone, Debug, PartialEq)]
pub struct RoughCoat {
    /// Index and inner reflectance.
    coat: Coat,
    /// The surface; `None` is smooth.
    facets: Option<Microfacets>,
    /// Part of the light that gets in at the cosine `i / (NODES - 1)`.
    transmittance: [f32; NODES],
}

impl RoughCoat {
    /// A coat of relative index `eta` with microfacets of roughness `alpha`, alike in all directions. Smooth below
    /// [`SMOOTH`](super::microfacet::SMOOTH).
    pub fn new(distribution: Distribution, alpha: f32, eta: f32, is_nonlinear: bool) -> Self {
        let coat = Coat::new(eta, is_nonlinear);
        let Some(facets) = Microfacets::new(distribution, Vec2::splat(alpha)) else {
            return Self { coat, facets: None, transmittance: [0.0; NODES] };
        };
        let direction = |node: usize| {
            let cos = (node as f32 / (NODES - 1) as f32).max(1e-6);
            Vec3::new(((1.0 - cos) * (1.0 + cos)).sqrt(), 0.0, cos)
        };
        let transmittance =
            std::array::from_fn(|node| transmittance(&facets, direction(node), eta) as f32);
        // Mitsuba takes the mean over its nodes for the integral of R(cos) 2 cos dcos, which is 1.6 % below it; taking
        // the exact integral would make plastics visibly brighter than Mitsuba's.
        let sum: f64 = (0..NODES)
            .map(|node| {
                2.0 * f64::from(direction(node).z)
                    * reflectance(&facets, direction(node), 1.0 / eta)
            })
            .sum();
        let coat = Coat { internal_reflectance: (sum / NODES as f64) as f32, ..coat };
        Self { coat, facets: Some(facets), transmittance }
    }

    /// Part of the light from `w` that gets in.
    fn transmittance(&self, w: Vec3) -> f32 {
        let x = w.z.clamp(0.0, 1.0) * (NODES - 1) as f32;
        let node = (x as usize).min(NODES - 2);
        let t = x - node as f32;
        (1.0 - t) * self.transmittance[node] + t * self.transmittance[node + 1]
    }
}

/// Part of the light from `w` that a rough boundary refracts in one scattering.
fn transmittance(facets: &Microfacets, w: Vec3, eta: f32) -> f64 {
    mean_over_visible(facets, w, |h| {
        let cos = w.dot(h).clamp(0.0, 1.0);
        let interface = fresnel::dielectric(cos, eta);
        let wi = fresnel::refract(w, h, eta, interface.cos_refracted);
        if wi.z < 0.0 { (1.0 - interface.reflectance) * facets.visibility(wi) } else { 0.0 }
    })
}

/// Part of the light from `w` that a rough boundary reflects in one scattering.
fn reflectance(facets: &Microfacets, w: Vec3, eta: f32) -> f64 {
    mean_over_visible(facets, w, |h| {
        let wi = fresnel::reflect(w, h);
        let reflectance = fresnel::dielectric(w.dot(h).clamp(0.0, 1.0), eta).reflectance;
        if wi.z > 0.0 { reflectance * facets.visibility(wi) } else { 0.0 }
    })
}

/// Mean of `f(h)` over the normals visible from `w`: the midpoint rule after `u = sin²(πt/2)`, which smooths the square
/// roots and logarithms that the sampling has at both ends of the unit interval.
fn mean_over_visible(facets: &Microfacets, w: Vec3, f: impl Fn(Vec3) -> f32) -> f64 {
    const SIDE: usize = 32;
    let step = std::f64::consts::PI / SIDE as f64;
    let nodes: [(f32, f64); SIDE] = std::array::from_fn(|i| {
        let angle = step * (i as f64 + 0.5);
        // The weights are those of the substitution, divided by their sum.
        ((0.5 * (1.0 - angle.cos())) as f32, angle.sin() * (0.5 * step).sin())
    });
    let row = |x: f32| {
        nodes
            .iter()
            .map(|&(y, weight)| weight * f64::from(f(facets.sample_visible(w, Vec2::new(x, y)))))
            .sum::<f64>()
    };
    nodes.iter().map(|&(x, weight)| weight * row(x)).sum()
}

/// Rough plastic, seen and lit from above only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughPlastic<'a> {
    /// Reflectance of the base.
    pub diffuse: Rgb,
    /// Factor of what the coat reflects.
    pub specular: Rgb,
    /// The coat and its surface.
    coat: &'a RoughCoat,
    facets: Microfacets,
}

impl<'a> RoughPlastic<'a> {
    /// Rough plastic; smooth plastic if the coat is smooth.
    pub(super) fn build(diffuse: Rgb, specular: Rgb, coat: &'a RoughCoat) -> Bsdf<'a> {
        match coat.facets {
            Some(facets) => Bsdf::RoughPlastic(Self { diffuse, specular, coat, facets }),
            None => Bsdf::Plastic(Plastic { diffuse, specular, coat: coat.coat }),
        }
    }

    fn probability(&self, wo: Vec3) -> f32 {
        self.coat.coat.probability(1.0 - self.coat.transmittance(wo), self.diffuse, self.specular)
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let Some(reflection) = reflection(&self.facets, wo, wi) else {
            return BsdfEval::default();
        };
        let coat = &self.coat.coat;
        let fresnel = fresnel::dielectric(reflection.cos_facet.min(1.0), coat.eta).reflectance;
        let through = self.coat.transmittance(wo) * self.coat.transmittance(wi);
        let probability = self.probability(wo);
        BsdfEval {
            diffuse: coat.base(self.diffuse) * (through * wi.z / PI),
            specular: self.specular * (fresnel * reflection.value),
            pdf: probability * reflection.pdf + (1.0 - probability) * cosine_hemisphere_pdf(wi),
        }
    }

    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = if lobe < self.probability(wo) {
            fresnel::reflect(wo, self.facets.sample_visible(wo, u))
        } else {
            square_to_cosine_hemisphere(u)
        };
        self.eval(wo, wi).sampled(wi, 1.0)
    }
}
