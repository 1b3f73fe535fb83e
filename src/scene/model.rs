//! How light scatters, as scene files say it: the models with their textures.

use crate::bsdf::microfacet::SMOOTH;
use crate::bsdf::{Bsdf, Coat, Distribution, Glass, Metal, RoughCoat};
use crate::math::Rgb;
use crate::texture::Texture;
use glam::Vec2;

/// How light scatters, with a texture wherever a number may vary over the surface.
#[derive(Clone, Debug)]
pub enum Model {
    /// Lets light through unchanged.
    Null,
    /// Lambert's law with this reflectance.
    Diffuse(Texture),
    /// A metal; smooth where the roughness is 0.
    Conductor {
        /// Real part of the refractive index.
        eta: Rgb,
        /// Imaginary part of the refractive index.
        k: Rgb,
        /// Factor of everything reflected.
        tint: Texture,
        /// Its surface; `None` is smooth.
        roughness: Option<Roughness>,
    },
    /// A boundary between two transparent media.
    Dielectric {
        /// Refractive index below the surface over that above it.
        eta: f32,
        /// Factor of everything reflected.
        reflectance: Texture,
        /// Factor of everything refracted.
        transmittance: Texture,
        /// Its surface; `None` is smooth.
        roughness: Option<Roughness>,
    },
    /// A sheet of a transparent medium without thickness.
    ThinDielectric {
        /// Refractive index of the sheet over that around it.
        eta: f32,
        /// Factor of everything reflected.
        reflectance: Texture,
        /// Factor of everything let through.
        transmittance: Texture,
    },
    /// A diffuse base under a smooth clear coat.
    Plastic {
        /// Reflectance of the base.
        diffuse: Texture,
        /// Factor of what the coat reflects.
        specular: Texture,
        /// The coat.
        coat: Coat,
    },
    /// A diffuse base under a rough clear coat.
    RoughPlastic {
        /// Reflectance of the base.
        diffuse: Texture,
        /// Factor of what the coat reflects.
        specular: Texture,
        /// The coat.
        coat: Box<RoughCoat>,
    },
    /// Two models side by side: `1 − weight` parts of the first, `weight` parts of the second.
    Blend {
        /// How much of the second.
        weight: Texture,
        /// The two.
        models: Box<[Self; 2]>,
    },
}

/// A surface of microfacets.
#[derive(Clone, Debug)]
pub struct Roughness {
    /// Distribution of the facets.
    pub distribution: Distribution,
    /// Roughness along tangent and bitangent.
    pub alpha: Box<[Texture; 2]>,
}

impl Roughness {
    /// The same roughness everywhere and along all directions.
    pub fn isotropic(distribution: Distribution, alpha: impl Into<Texture>) -> Self {
        let alpha = alpha.into();
        Self { distribution, alpha: Box::new([alpha.clone(), alpha]) }
    }

    fn at(&self, uv: Vec2) -> Vec2 {
        let [along, across] = self.alpha.as_ref();
        Vec2::new(along.eval_scalar(uv), across.eval_scalar(uv))
    }

    /// Is a part of the surface smooth, as far as can be told without looking at every texel?
    fn may_be_smooth(&self) -> bool {
        let may_be = |alpha: &Texture| alpha.constant().is_none_or(|value| value.mean() < SMOOTH);
        self.alpha.iter().all(may_be)
    }

    fn is_isotropic(&self) -> bool {
        let [along, across] = self.alpha.as_ref().each_ref().map(Texture::constant);
        along.is_some() && along == across
    }
}

impl Model {
    /// The scattering at these surface coordinates.
    pub(super) fn bsdf(&self, uv: Vec2) -> Bsdf<'_> {
        match self {
            Self::Null => Bsdf::Null,
            Self::Diffuse(reflectance) => Bsdf::diffuse(reflectance.eval(uv)),
            Self::Conductor { eta, k, tint, roughness } => {
                let metal = Metal { eta: *eta, k: *k, tint: tint.eval(uv) };
                match roughness {
                    None => Bsdf::conductor(metal),
                    Some(rough) => Bsdf::rough_conductor(metal, rough.distribution, rough.at(uv)),
                }
            }
            Self::Dielectric { eta, reflectance, transmittance, roughness } => {
                let glass = glass(*eta, reflectance, transmittance, uv);
                match roughness {
                    None => Bsdf::dielectric(glass),
                    Some(rough) => Bsdf::rough_dielectric(glass, rough.distribution, rough.at(uv)),
                }
            }
            Self::ThinDielectric { eta, reflectance, transmittance } => {
                Bsdf::thin_dielectric(glass(*eta, reflectance, transmittance, uv))
            }
            Self::Plastic { diffuse, specular, coat } => {
                Bsdf::plastic(diffuse.eval(uv), specular.eval(uv), *coat)
            }
            Self::RoughPlastic { diffuse, specular, coat } => {
                Bsdf::rough_plastic(diffuse.eval(uv), specular.eval(uv), coat)
            }
            Self::Blend { weight, models } => {
                let [first, second] = models.as_ref();
                Bsdf::blend(weight.eval_scalar(uv), first.bsdf(uv), second.bsdf(uv))
            }
        }
    }

    /// [`Model::bsdf`], written into its place.
    #[inline(always)]
    pub(super) fn set_bsdf<'a>(&'a self, uv: Vec2, bsdf: &mut Bsdf<'a>) {
        match self {
            // The most frequent one is worth the space.
            Self::Diffuse(Texture::Constant(reflectance)) => *bsdf = Bsdf::diffuse(*reflectance),
            _ => *bsdf = self.bsdf(uv),
        }
    }

    /// The model with every part changed. Blends are taken apart and put together again.
    pub(super) fn changed(self, change: &mut dyn FnMut(Self) -> Self) -> Self {
        match self {
            Self::Blend { weight, models } => {
                let models = (*models).map(|model| model.changed(change));
                Self::Blend { weight, models: Box::new(models) }
            }
            model => change(model),
        }
    }

    /// Shows every part of the model. Blends are taken apart.
    pub(super) fn parts(&self, see: &mut dyn FnMut(&Self)) {
        match self {
            Self::Blend { models, .. } => models.iter().for_each(|model| model.parts(see)),
            _ => see(self),
        }
    }

    /// Shows every texture, those of blends too.
    pub(super) fn textures(&self, see: &mut dyn FnMut(&Texture)) {
        match self {
            Self::Null => {}
            Self::Diffuse(reflectance) => see(reflectance),
            Self::Conductor { tint, roughness, .. } => {
                see(tint);
                roughness.iter().flat_map(|roughness| roughness.alpha.iter()).for_each(&mut *see);
            }
            Self::Dielectric { reflectance, transmittance, roughness, .. } => {
                see(reflectance);
                see(transmittance);
                roughness.iter().flat_map(|roughness| roughness.alpha.iter()).for_each(&mut *see);
            }
            Self::ThinDielectric { reflectance, transmittance, .. } => {
                see(reflectance);
                see(transmittance);
            }
            Self::Plastic { diffuse, specular, .. }
            | Self::RoughPlastic { diffuse, specular, .. } => {
                see(diffuse);
                see(specular);
            }
            Self::Blend { weight, models } => {
                see(weight);
                models.iter().for_each(|model| model.textures(see));
            }
        }
    }

    /// Does every part of the model satisfy `test`? Blends are taken apart.
    pub(super) fn all(&self, test: &impl Fn(&Self) -> bool) -> bool {
        match self {
            Self::Blend { models, .. } => models.iter().all(|model| model.all(test)),
            _ => test(self),
        }
    }

    /// Does a part of the model satisfy `test`?
    pub(super) fn any(&self, test: &impl Fn(&Self) -> bool) -> bool {
        !self.all(&|model| !test(model))
    }

    /// May this part of a model scatter into one direction only? Blends are none of their own.
    pub(super) fn may_be_delta(&self) -> bool {
        match self {
            Self::Diffuse(_) | Self::Blend { .. } => false,
            Self::Null | Self::ThinDielectric { .. } | Self::Plastic { .. } => true,
            // The coat knows whether it is too smooth to be rough.
            Self::RoughPlastic { coat, .. } => {
                matches!(Bsdf::rough_plastic(Rgb::WHITE, Rgb::WHITE, coat), Bsdf::Plastic(_))
            }
            Self::Conductor { roughness, .. } | Self::Dielectric { roughness, .. } => {
                roughness.as_ref().is_none_or(Roughness::may_be_smooth)
            }
        }
    }

    /// Does the model look the same however it is turned around the normal?
    pub(super) fn is_isotropic(&self) -> bool {
        self.all(&|model| match model {
            Self::Conductor { roughness: Some(roughness), .. }
            | Self::Dielectric { roughness: Some(roughness), .. } => roughness.is_isotropic(),
            _ => true,
        })
    }
}

fn glass(eta: f32, reflectance: &Texture, transmittance: &Texture, uv: Vec2) -> Glass {
    Glass { eta, reflectance: reflectance.eval(uv), transmittance: transmittance.eval(uv) }
}
