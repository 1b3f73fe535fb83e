//! How surfaces scatter light.
//!
//! Directions are unit vectors in the local frame (`z` is the shading normal) and both point away from the surface:
//! `wo` to where the walk came from (the eye), `wi` to where it goes (the light). Densities are per steradian.
//! `eval` includes the cosine `|cos θi|`. Delta lobes have no value and no density: `eval` and `pdf` leave them out.
//!
//! Opaque models scatter above the surface only; boundaries of transparent media read from the sign of `wo.z` which
//! medium the walk is in. Values are Mitsuba 3's, so that pictures compare; where they differ on purpose, the model says
//! so. Two-sided materials, masks and bumps are the material's business, not the model's.

mod beckmann;
mod blend;
mod conductor;
mod delta;
mod dielectric;
mod diffuse;
pub mod fresnel;
mod ggx;
pub mod media;
pub mod metals;
pub mod microfacet;
mod plastic;

pub use blend::Blend;
pub use conductor::{Conductor, Metal, RoughConductor};
pub use delta::{DeltaEval, DeltaKind, DeltaLobe};
pub use dielectric::{Dielectric, Glass, RoughDielectric, ThinDielectric};
pub use diffuse::Diffuse;
pub use microfacet::Distribution;
pub use plastic::{Coat, Plastic, RoughCoat, RoughPlastic};

use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// `f(wo, wi) |cos θi|`, per steradian, split by the kind of lobe, and the density of the whole smooth mixture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BsdfEval {
    /// What diffuse lobes scatter.
    pub diffuse: Rgb,
    /// What all other smooth lobes scatter.
    pub specular: Rgb,
    /// Density of [`Bsdf::sample`] choosing `wi`, per steradian, with the probability of a smooth lobe included.
    pub pdf: f32,
}

impl BsdfEval {
    /// Does nothing scatter?
    #[inline]
    pub fn is_black(&self) -> bool {
        self.diffuse.is_black() && self.specular.is_black()
    }

    /// The sample of a direction that was chosen with the density of this evaluation; `None` if it cannot be chosen.
    #[inline]
    fn sampled(self, wi: Vec3, eta: f32) -> Option<BsdfSample> {
        // Written so that NaN, too, is no density.
        (self.pdf > 0.0).then(|| BsdfSample {
            wi,
            diffuse: self.diffuse / self.pdf,
            specular: self.specular / self.pdf,
            pdf: self.pdf,
            delta: None,
            eta,
        })
    }
}

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Where the walk goes.
    pub wi: Vec3,
    /// The diffuse part of the weight `f(wo, wi) |cos θi| / pdf`, dimensionless; the weight is the sum of both parts.
    pub diffuse: Rgb,
    /// The other part of the weight. For a delta lobe: reflectance / probability of the lobe.
    pub specular: Rgb,
    /// Density of `wi` per steradian, of the whole smooth mixture; the discrete probability of the lobe for delta lobes.
    pub pdf: f32,
    /// The delta lobe that scattered, if one did.
    pub delta: Option<DeltaLobe>,
    /// Refractive index of the medium that `wi` lies in over that of `wo`: 1 unless the light was refracted.
    pub eta: f32,
}

impl BsdfSample {
    fn delta(kind: DeltaKind, wi: Vec3, specular: Rgb, pdf: f32, eta: f32) -> Self {
        Self { wi, diffuse: Rgb::BLACK, specular, pdf, delta: Some(kind.into()), eta }
    }

    /// Did a delta lobe scatter?
    #[inline]
    pub fn is_delta(&self) -> bool {
        self.delta.is_some()
    }
}

/// The scattering of a surface at one point: numbers only, textures already looked up. What a material computes once
/// (the table of a rough coat) is borrowed from it.
#[derive(Clone, Debug)]
pub enum Bsdf<'a> {
    /// Lets light through unchanged.
    Null,
    /// Lambert's law.
    Diffuse(Diffuse),
    /// A mirror of metal.
    Conductor(Conductor),
    /// Brushed or ground metal.
    RoughConductor(RoughConductor),
    /// Glass, water.
    Dielectric(Dielectric),
    /// Ground glass.
    RoughDielectric(RoughDielectric),
    /// A window pane without thickness.
    ThinDielectric(ThinDielectric),
    /// A diffuse base under a smooth clear coat.
    Plastic(Plastic),
    /// A diffuse base under a rough clear coat.
    RoughPlastic(RoughPlastic<'a>),
    /// Two models side by side.
    Blend(Blend<'a>),
}

impl<'a> Bsdf<'a> {
    /// A diffuse surface.
    pub fn diffuse(reflectance: Rgb) -> Self {
        Self::Diffuse(Diffuse { reflectance })
    }

    /// A smooth metal.
    pub fn conductor(metal: Metal) -> Self {
        Self::Conductor(Conductor { metal })
    }

    /// A metal with roughness `alpha` along tangent and bitangent; smooth below [`microfacet::SMOOTH`].
    pub fn rough_conductor(metal: Metal, distribution: Distribution, alpha: Vec2) -> Self {
        RoughConductor::build(metal, distribution, alpha)
    }

    /// A smooth boundary between two transparent media.
    pub fn dielectric(glass: Glass) -> Self {
        Self::Dielectric(Dielectric { glass })
    }

    /// A boundary with roughness `alpha` along tangent and bitangent; smooth below [`microfacet::SMOOTH`].
    pub fn rough_dielectric(glass: Glass, distribution: Distribution, alpha: Vec2) -> Self {
        RoughDielectric::build(glass, distribution, alpha)
    }

    /// A thin sheet of a transparent medium.
    pub fn thin_dielectric(glass: Glass) -> Self {
        Self::ThinDielectric(ThinDielectric { glass })
    }

    /// Smooth plastic: reflectance of the base in `[0, 1]`, factor of what the coat reflects, the coat.
    pub fn plastic(diffuse: Rgb, specular: Rgb, coat: Coat) -> Self {
        Self::Plastic(Plastic { diffuse, specular, coat })
    }

    /// Rough plastic, as [`Bsdf::plastic`]; smooth if the coat is.
    pub fn rough_plastic(diffuse: Rgb, specular: Rgb, coat: &'a RoughCoat) -> Self {
        RoughPlastic::build(diffuse, specular, coat)
    }

    /// `1 - weight` parts of the first and `weight` parts of the second model; the weight is limited to `[0, 1]`.
    pub fn blend(weight: f32, first: Self, second: Self) -> Self {
        Blend::build(weight, first, second)
    }

    /// `f |cos θi|` and its density for two directions; all zero where the surface does not scatter smoothly.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        match self {
            // The most frequent model is worth the space.
            Self::Diffuse(model) => model.eval(wo, wi),
            // Taken apart, what the diffuse model gives stays in registers.
            _ => {
                let BsdfEval { diffuse, specular, pdf } = self.eval_others(wo, wi);
                BsdfEval { diffuse, specular, pdf }
            }
        }
    }

    /// [`Bsdf::eval`] of all models but the diffuse one.
    fn eval_others(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        match self {
            Self::Diffuse(model) => model.eval(wo, wi),
            Self::RoughConductor(model) => model.eval(wo, wi),
            Self::RoughDielectric(model) => model.eval(wo, wi),
            Self::Plastic(model) => model.eval(wo, wi),
            Self::RoughPlastic(model) => model.eval(wo, wi),
            Self::Blend(model) => model.eval(wo, wi),
            Self::Null | Self::Conductor(_) | Self::Dielectric(_) | Self::ThinDielectric(_) => {
                BsdfEval::default()
            }
        }
    }

    /// Density of choosing `wi` given `wo`, per steradian; equals `eval(wo, wi).pdf`.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.eval(wo, wi).pdf
    }

    /// Chooses a direction; `lobe` picks the lobe, `u` the direction in it. `None` when the light is absorbed.
    /// Weights are those of radiance: a refraction multiplies by `(n_o / n_i)²`.
    #[inline]
    pub fn sample(&self, wo: Vec3, lobe: f32, u: Vec2) -> Option<BsdfSample> {
        match self {
            Self::Diffuse(model) => model.sample(wo, u),
            _ => self.sample_others(wo, lobe, u),
        }
    }

    /// [`Bsdf::sample`] of all models but the diffuse one.
    fn sample_others(&self, wo: Vec3, lobe: f32, u: Vec2) -> Option<BsdfSample> {
        match self {
            Self::Null => Some(BsdfSample::delta(DeltaKind::Pass, -wo, Rgb::WHITE, 1.0, 1.0)),
            Self::Diffuse(model) => model.sample(wo, u),
            Self::Conductor(model) => model.sample(wo),
            Self::RoughConductor(model) => model.sample(wo, u),
            Self::Dielectric(model) => model.sample(wo, lobe),
            Self::RoughDielectric(model) => model.sample(wo, lobe, u),
            Self::ThinDielectric(model) => model.sample(wo, lobe),
            Self::Plastic(model) => model.sample(wo, lobe, u),
            Self::RoughPlastic(model) => model.sample(wo, lobe, u),
            Self::Blend(model) => model.sample(wo, lobe, u),
        }
    }

    /// Follows one delta lobe: what [`Bsdf::sample`] would return had it chosen that lobe, the weight times its probability
    /// instead of the weight. `None` where the lobe does not exist: in total reflection, on the wrong side, in another model.
    pub fn delta(&self, wo: Vec3, lobe: DeltaLobe) -> Option<DeltaEval> {
        match self {
            Self::Blend(model) => model.delta(wo, lobe),
            _ if lobe.leaf != 0 => None,
            Self::Null => (lobe.kind == DeltaKind::Pass).then_some(DeltaEval {
                wi: -wo,
                reflectance: Rgb::WHITE,
                probability: 1.0,
                eta: 1.0,
            }),
            Self::Conductor(model) => model.delta(wo, lobe.kind),
            Self::Dielectric(model) => model.delta(wo, lobe.kind),
            Self::ThinDielectric(model) => model.delta(wo, lobe.kind),
            Self::Plastic(model) => model.delta(wo, lobe.kind),
            Self::Diffuse(_)
            | Self::RoughConductor(_)
            | Self::RoughDielectric(_)
            | Self::RoughPlastic(_) => None,
        }
    }

    /// How many models are mixed.
    fn leaves(&self) -> u8 {
        match self {
            Self::Blend(model) => model.leaves(),
            _ => 1,
        }
    }

    /// Is there a lobe that `eval` knows of?
    #[inline]
    pub fn has_smooth(&self) -> bool {
        match self {
            Self::Null | Self::Conductor(_) | Self::Dielectric(_) | Self::ThinDielectric(_) => {
                false
            }
            Self::Diffuse(_)
            | Self::RoughConductor(_)
            | Self::RoughDielectric(_)
            | Self::Plastic(_)
            | Self::RoughPlastic(_) => true,
            Self::Blend(model) => model.has_smooth(),
        }
    }

    /// The colour that the denoisers see, in `[0, 1]`: the diffuse reflectance where there is a diffuse lobe, else the
    /// reflectance at normal incidence (tint times Fresnel for metals, tint for glass).
    pub fn albedo(&self) -> Rgb {
        let albedo = match self {
            Self::Null => Rgb::WHITE,
            Self::Diffuse(model) => model.reflectance,
            Self::Conductor(model) => model.metal.albedo(),
            Self::RoughConductor(model) => model.metal.albedo(),
            Self::Dielectric(model) => model.glass.transmittance,
            Self::RoughDielectric(model) => model.glass.transmittance,
            Self::ThinDielectric(model) => model.glass.transmittance,
            Self::Plastic(model) => model.diffuse,
            Self::RoughPlastic(model) => model.diffuse,
            Self::Blend(model) => model.albedo(),
        };
        albedo.clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bsdf_is_small() {
        // It is made at every vertex of every path.
        assert!(size_of::<Bsdf<'_>>() <= 64, "{}", size_of::<Bsdf<'_>>());
    }
}
