//! Materials: what a scene file says of a surface, with textures still to look up.
//!
//! Scene files nest adapters around models (two-sided, masked, bumped, blended). Here they are flattened: a
//! [`Material`] is one [`Model`] with at most one relief and one opacity, and only blends hold further models.

pub use super::model::{Model, Roughness};

use crate::bsdf::Bsdf;
use crate::geometry::Interaction;
use crate::math::{Frame, Rgb};
use crate::texture::Texture;
use glam::Vec3;

/// Index of a material in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MaterialId(pub u32);

/// What tilts the shading normal.
#[derive(Clone, Debug)]
enum Relief {
    /// Heights along the normal, in scene units, times `scale`.
    Bump { height: Texture, scale: f32 },
    /// Normals in the shading frame, each component stored as `(n + 1) / 2`.
    Normals(Texture),
}

/// Why nested materials cannot be flattened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NestingError {
    /// A bump or normal map around or beside another.
    #[error("a material can have one bump or normal map, around the whole material")]
    Relief,
    /// One side of a blend is two-sided, the other is not.
    #[error("both materials of a blend must be two-sided, or none")]
    Sides,
}

/// A material.
#[derive(Clone, Debug)]
pub struct Material {
    /// Does the surface look the same from behind? Then the frame is turned to the viewer before shading.
    pub two_sided: bool,
    /// Was it made two-sided with its relief? Then that is turned with the surface: what is high in front is deep behind.
    pub mirrors_relief: bool,
    model: Model,
    relief: Option<Box<Relief>>,
    /// `None` is opaque.
    opacity: Option<Box<Texture>>,
    is_isotropic: bool,
}

impl From<Model> for Material {
    /// The model on the side of the normal, opaque, without relief.
    fn from(model: Model) -> Self {
        let is_isotropic = model.is_isotropic();
        Self {
            two_sided: false,
            mirrors_relief: false,
            model,
            relief: None,
            opacity: None,
            is_isotropic,
        }
    }
}

impl Material {
    /// The same with other models; those of a blend are changed one by one.
    #[must_use]
    pub fn with_models(self, change: &mut dyn FnMut(Model) -> Model) -> Self {
        let model = self.model.changed(change);
        let is_isotropic = model.is_isotropic();
        Self { model, is_isotropic, ..self }
    }

    /// The same from both sides.
    #[must_use]
    pub fn with_two_sides(self) -> Self {
        Self { two_sided: true, mirrors_relief: self.relief.is_some(), ..self }
    }

    /// Light passes unscattered where `opacity` is not 1. Of two textured masks the inner one becomes a blend with nothing.
    #[must_use]
    pub fn masked(mut self, opacity: Texture) -> Self {
        let (inner, outer) =
            (self.opacity.as_ref().map(|inner| inner.constant()), opacity.constant());
        match (inner, outer) {
            (_, Some(Rgb::WHITE)) => return self,
            (Some(Some(inner)), Some(outer)) => {
                let opacity = Texture::from(Rgb::splat(inner.mean() * outer.mean()));
                return Self { opacity: Some(Box::new(opacity)), ..self };
            }
            _ => {}
        }
        if let Some(inner) = self.opacity.take() {
            self.model =
                Model::Blend { weight: *inner, models: Box::new([Model::Null, self.model]) };
        }
        Self { opacity: Some(Box::new(opacity)), ..self }
    }

    /// With heights along the normal, in scene units, times `scale`.
    ///
    /// # Errors
    /// [`NestingError::Relief`] when there is a relief already.
    pub fn bumped(self, height: Texture, scale: f32) -> Result<Self, NestingError> {
        self.with_relief(Relief::Bump { height, scale })
    }

    /// With normals of the shading frame, each component stored as `(n + 1) / 2`.
    ///
    /// # Errors
    /// [`NestingError::Relief`] when there is a relief already.
    pub fn normal_mapped(self, normals: Texture) -> Result<Self, NestingError> {
        self.with_relief(Relief::Normals(normals))
    }

    fn with_relief(self, relief: Relief) -> Result<Self, NestingError> {
        match self.relief {
            None => Ok(Self { relief: Some(Box::new(relief)), ..self }),
            Some(_) => Err(NestingError::Relief),
        }
    }

    /// `1 − weight` parts of the first material, `weight` parts of the second. A masked one becomes a blend with nothing.
    ///
    /// # Errors
    /// [`NestingError::Relief`] when one has a relief, [`NestingError::Sides`] when just one is two-sided.
    pub fn blend(weight: Texture, first: Self, second: Self) -> Result<Self, NestingError> {
        if first.relief.is_some() || second.relief.is_some() {
            return Err(NestingError::Relief);
        }
        if first.two_sided != second.two_sided {
            return Err(NestingError::Sides);
        }
        let two_sided = first.two_sided;
        let models = Box::new([first, second].map(|material| match material.opacity {
            None => material.model,
            Some(opacity) => {
                Model::Blend { weight: *opacity, models: Box::new([Model::Null, material.model]) }
            }
        }));
        Ok(Self { two_sided, ..Model::Blend { weight, models }.into() })
    }

    /// The scattering at a point.
    pub fn bsdf(&self, at: &Interaction) -> Bsdf<'_> {
        self.model.bsdf(at.uv)
    }

    /// [`Material::bsdf`], written into its place.
    #[inline(always)]
    pub fn set_bsdf<'a>(&'a self, at: &Interaction, bsdf: &mut Bsdf<'a>) {
        self.model.set_bsdf(at.uv, bsdf);
    }

    /// The shading frame at a point, with bump or normal map applied; its normal is not turned to the viewer. Its tangent
    /// follows `dp_du` where the model needs it.
    ///
    /// With a relief, light may come from above the tilted frame but from below the shading normal, or the other way:
    /// Mitsuba 3 takes no light from such directions.
    #[inline]
    pub fn frame(&self, at: &Interaction) -> Frame {
        match self.relief {
            // The most frequent one is worth the space.
            None if self.is_isotropic => Frame::from_normal(at.shading_normal),
            _ => self.tangent_frame(at),
        }
    }

    /// [`Material::frame`] where it follows `dp_du`.
    fn tangent_frame(&self, at: &Interaction) -> Frame {
        match self.relief.as_deref() {
            None => Frame::from_normal_and_tangent(at.shading_normal, at.dp_du),
            Some(relief) => {
                let normal = relief.normal(at).unwrap_or(at.shading_normal);
                Frame::from_normal_and_tangent(normal, at.dp_du)
            }
        }
    }

    /// How opaque the surface is at a point, in `[0, 1]`: light passes unscattered with the rest.
    #[inline]
    pub fn opacity(&self, at: &Interaction) -> f32 {
        match &self.opacity {
            None => 1.0,
            Some(opacity) => opacity.eval_scalar(at.uv).clamp(0.0, 1.0),
        }
    }

    /// Is there no mask, so that [`Material::opacity`] need not be asked?
    pub fn is_opaque(&self) -> bool {
        self.opacity.is_none()
    }

    /// Has it a bump or normal map?
    pub fn has_relief(&self) -> bool {
        self.relief.is_some()
    }

    /// Shows every part of the model; blends are taken apart.
    pub fn models(&self, see: &mut dyn FnMut(&Model)) {
        self.model.parts(see);
    }

    /// Shows every texture that it looks up, constants too.
    pub fn textures(&self, see: &mut dyn FnMut(&Texture)) {
        self.model.textures(see);
        if let Some(Relief::Bump { height: texture, .. } | Relief::Normals(texture)) =
            self.relief.as_deref()
        {
            see(texture);
        }
        if let Some(opacity) = &self.opacity {
            see(opacity);
        }
    }

    /// Does it ask where on a surface it is: by a texture, or for a direction to follow?
    pub fn needs_coordinates(&self) -> bool {
        let mut is_textured = false;
        self.textures(&mut |texture| is_textured |= texture.constant().is_none());
        is_textured || self.relief.is_some() || !self.is_isotropic
    }

    /// Do all lobes scatter diffusely? Then there is no specular radiance but what is seen directly.
    pub fn is_diffuse_only(&self) -> bool {
        self.model.all(&|model| matches!(model, Model::Diffuse(_)))
    }

    /// May a lobe be a perfect mirror, or let light through in one direction only? `true` also for textured roughness that
    /// may fall to zero.
    pub fn has_delta(&self) -> bool {
        self.model.any(&Model::may_be_delta)
    }

    /// May light come through to the other side, refracted or not?
    pub fn may_pass_light(&self) -> bool {
        let passes = |model: &Model| {
            matches!(model, Model::Null | Model::Dielectric { .. } | Model::ThinDielectric { .. })
        };
        self.opacity.is_some() || self.model.any(&passes)
    }
}

impl Relief {
    /// The tilted shading normal, on the same side of the surface as the untilted one; `None` where it is not defined.
    fn normal(&self, at: &Interaction) -> Option<Vec3> {
        let n = at.shading_normal;
        let outward = if n.dot(at.normal) < 0.0 { -at.normal } else { at.normal };
        match self {
            // The derivatives of the displaced surface p + h n, without those of n (Blinn 1978, "Simulation of Wrinkled
            // Surfaces"), and with the surface flat in the plane across the shading normal, as Mitsuba 3 has it.
            Self::Bump { height, scale } => {
                // Without area there is no slope.
                at.dp_du.cross(at.dp_dv).try_normalize()?;
                let slope = height.gradient(at.uv) * *scale;
                let dp_du = at.dp_du + n * (slope.x - n.dot(at.dp_du));
                let dp_dv = at.dp_dv + n * (slope.y - n.dot(at.dp_dv));
                let tilted = dp_du.cross(dp_dv).try_normalize()?;
                Some(if tilted.dot(outward) < 0.0 { -tilted } else { tilted })
            }
            // A normal that points into the surface is mirrored out of it.
            Self::Normals(normals) => {
                let local = Vec3::from(normals.eval(at.uv).to_array()) * 2.0 - 1.0;
                let tilted =
                    Frame::from_normal_and_tangent(n, at.dp_du).to_world(local).try_normalize()?;
                let below = tilted.dot(outward).min(0.0);
                (tilted - outward * (2.0 * below)).try_normalize()
            }
        }
    }
}

#[cfg(test)]
mod tests;
