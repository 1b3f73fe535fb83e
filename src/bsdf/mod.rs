//! How surfaces scatter light.
//!
//! Directions are unit vectors in the local frame (`z` is the shading normal) and both point away from the surface:
//! `wo` to where the walk came from (the eye), `wi` to where it goes (the light). Densities are per steradian.
//! `eval` includes the cosine `|cos θi|`. Delta lobes have no value and no density: `eval` and `pdf` leave them out.

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
    /// Did a delta lobe scatter?
    pub is_delta: bool,
    /// Refractive index of the medium that `wi` lies in over that of `wo`: 1 unless the light was refracted.
    pub eta: f32,
}

/// The scattering of a surface at one point: numbers only, textures already looked up.
#[derive(Clone, Debug)]
pub enum Bsdf {
    /// Lets light through unchanged.
    Null,
}

impl Bsdf {
    /// `f |cos θi|` and its density for two directions; all zero where the surface does not scatter smoothly.
    pub fn eval(&self, _wo: Vec3, _wi: Vec3) -> BsdfEval {
        todo!()
    }

    /// Density of choosing `wi` given `wo`, per steradian; equals `eval(wo, wi).pdf`.
    pub fn pdf(&self, _wo: Vec3, _wi: Vec3) -> f32 {
        todo!()
    }

    /// Chooses a direction; `lobe` picks the lobe, `u` the direction in it. `None` when the light is absorbed.
    /// Weights are those of radiance: a refraction multiplies by `(n_o / n_i)²`.
    pub fn sample(&self, _wo: Vec3, _lobe: f32, _u: Vec2) -> Option<BsdfSample> {
        todo!()
    }

    /// Is there a lobe that `eval` knows of?
    pub fn has_smooth(&self) -> bool {
        todo!()
    }

    /// The colour that the denoisers see, in `[0, 1]`: the diffuse reflectance where there is a diffuse lobe, else the
    /// reflectance at normal incidence (tint times Fresnel for metals, tint for glass).
    pub fn albedo(&self) -> Rgb {
        todo!()
    }
}
