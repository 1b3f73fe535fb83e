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
    /// Two textured masks around each other.
    #[error("a material can have one textured mask")]
    Masks,
}

/// A material.
#[derive(Clone, Debug)]
pub struct Material {
    /// Does the surface look the same from behind? Then the frame is turned to the viewer before shading.
    pub two_sided: bool,
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
        Self { two_sided: false, model, relief: None, opacity: None, is_isotropic }
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
        Self { two_sided: true, ..self }
    }

    /// Light passes unscattered where `opacity` is not 1.
    ///
    /// # Errors
    /// [`NestingError::Masks`] when it is masked already, and not both by the same number everywhere.
    pub fn masked(self, opacity: Texture) -> Result<Self, NestingError> {
        let opacity = match (&self.opacity, opacity.constant()) {
            (None, Some(opacity)) if opacity == Rgb::WHITE => None,
            (None, _) => Some(opacity),
            (Some(inner), Some(outer)) => match inner.constant() {
                Some(inner) => Some((inner * outer).into()),
                None if outer == Rgb::WHITE => return Ok(self),
                None => return Err(NestingError::Masks),
            },
            (Some(_), None) => return Err(NestingError::Masks),
        };
        Ok(Self { opacity: opacity.map(Box::new), ..self })
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
mod tests {
    use super::*;
    use crate::bsdf::{Distribution, RoughCoat};
    use crate::texture::{Bitmap, Filter, Image, Wrap, load::Texels};
    use glam::{Affine2, Vec2};
    use std::sync::Arc;

    fn at(uv: Vec2) -> Interaction {
        Interaction {
            part: 0,
            position: Vec3::ZERO,
            error: Vec3::ZERO,
            normal: Vec3::Z,
            shading_normal: Vec3::Z,
            uv,
            dp_du: Vec3::new(4.0, 0.0, 0.0),
            dp_dv: Vec3::new(0.0, 1.0, 0.0),
        }
    }

    fn bitmap(width: u32, height: u32, texels: Vec<f32>) -> Texture {
        let image = Arc::new(Image::new(width, height, Texels::Gray(texels), true));
        Texture::Bitmap(Bitmap {
            image,
            wrap: Wrap::Repeat,
            filter: Filter::Bilinear,
            to_uv: Affine2::IDENTITY,
        })
    }

    fn diffuse(reflectance: f32) -> Material {
        Model::Diffuse(reflectance.into()).into()
    }

    fn glass(roughness: Option<Roughness>) -> Model {
        Model::Dielectric {
            eta: 1.5,
            reflectance: 1.0.into(),
            transmittance: 1.0.into(),
            roughness,
        }
    }

    #[test]
    fn textures_are_looked_up_where_the_surface_is_hit() {
        let material = Material::from(Model::Diffuse(bitmap(2, 1, vec![0.25, 0.75])));
        assert_eq!(material.bsdf(&at(Vec2::new(0.25, 0.5))).albedo(), Rgb::splat(0.25));
        assert_eq!(material.bsdf(&at(Vec2::new(0.75, 0.5))).albedo(), Rgb::splat(0.75));
        let blend =
            Material::blend(bitmap(2, 1, vec![0.0, 1.0]), diffuse(0.1), diffuse(0.5)).unwrap();
        assert!((blend.bsdf(&at(Vec2::new(0.5, 0.5))).albedo().g - 0.3).abs() < 1e-6);
        assert!(matches!(blend.bsdf(&at(Vec2::new(0.75, 0.5))), Bsdf::Diffuse(_)));
    }

    #[test]
    fn a_bump_tilts_by_its_slope_in_scene_units() {
        // Heights 0 and 0.5 at u = 0.25 and 0.75: between them the slope is 1 for one u, which is 4 units long; doubled,
        // the surface rises 2 in 4.
        let height = bitmap(2, 1, vec![0.0, 0.5]);
        let material = diffuse(0.5).bumped(height, 2.0).unwrap();
        let frame = material.frame(&at(Vec2::new(0.5, 0.5)));
        assert!(
            (frame.normal - Vec3::new(-2.0, 0.0, 4.0).normalize()).length() < 1e-6,
            "{frame:?}"
        );
        assert!(
            (frame.tangent - Vec3::new(4.0, 0.0, 2.0).normalize()).length() < 1e-6,
            "{frame:?}"
        );
        // Mirrored surface coordinates do not turn the normal around.
        let mut mirrored = at(Vec2::new(0.5, 0.5));
        mirrored.dp_du = -mirrored.dp_du;
        assert!(
            (material.frame(&mirrored).normal - Vec3::new(2.0, 0.0, 4.0).normalize()).length()
                < 1e-6
        );
        // Without derivatives there is no tilt, and no NaN.
        mirrored.dp_du = Vec3::ZERO;
        assert_eq!(material.frame(&mirrored).normal, Vec3::Z);
    }

    #[test]
    fn a_normal_map_is_relative_to_the_shading_frame() {
        let stored = |n: Vec3| Texture::from(Rgb::from((n * 0.5 + 0.5).to_array()));
        let tilted = Vec3::new(0.6, 0.0, 0.8);
        let material = diffuse(0.5).normal_mapped(stored(tilted)).unwrap();
        let mut at = at(Vec2::ZERO);
        assert!((material.frame(&at).normal - tilted).length() < 1e-6);
        (at.dp_du, at.dp_dv) = (Vec3::Y, -Vec3::X);
        assert!((material.frame(&at).normal - Vec3::new(0.0, 0.6, 0.8)).length() < 1e-6);
        let inward = diffuse(0.5).normal_mapped(stored(Vec3::new(0.6, 0.0, -0.8))).unwrap();
        assert!((inward.frame(&at).normal - Vec3::new(0.0, 0.6, 0.8)).length() < 1e-6);
        let none = diffuse(0.5).normal_mapped(0.5.into()).unwrap();
        assert_eq!(none.frame(&at).normal, Vec3::Z);
    }

    #[test]
    fn reliefs_agree_with_mitsuba() {
        // Normals recovered from three values of a white diffuse surface in Mitsuba 3.9.1, to about four digits.
        let n = Vec3::new(0.1, 0.2, 1.0).normalize();
        let (dp_du, dp_dv) = (Vec3::new(2.0, 0.3, 0.1), Vec3::new(-0.2, 1.5, 0.2));
        let at = Interaction {
            normal: dp_du.cross(dp_dv).normalize(),
            shading_normal: n,
            dp_du,
            dp_dv,
            ..at(Vec2::new(0.3, 0.7))
        };
        let texels = vec![
            [255, 0, 0],
            [0, 255, 0],
            [0, 0, 255],
            [255, 255, 255],
            [128, 128, 128],
            [10, 20, 30],
        ];
        let texture = |width, height, texels| {
            Texture::Bitmap(Bitmap {
                image: Arc::new(Image::new(width, height, Texels::Rgb8(texels), true)),
                wrap: Wrap::Repeat,
                filter: Filter::Bilinear,
                to_uv: Affine2::IDENTITY,
            })
        };
        let bump = |scale| diffuse(1.0).bumped(texture(2, 3, texels.clone()), scale).unwrap();
        let map = diffuse(1.0).normal_mapped(texture(1, 1, vec![[200, 100, 220]])).unwrap();
        for (material, expected) in [
            (bump(1.0), Vec3::new(0.058_85, -0.350_66, 0.934_25)),
            (bump(0.4), Vec3::new(0.083_64, -0.046_78, 0.995_35)),
            (map, Vec3::new(0.698_40, -0.002_03, 0.715_62)),
        ] {
            let normal = material.frame(&at).normal;
            assert!((normal - expected).length() < 2e-3, "{normal} {expected}");
        }
    }

    #[test]
    fn brushed_metal_is_aligned_with_the_surface_coordinates() {
        let roughness = Roughness {
            distribution: Distribution::Ggx,
            alpha: Box::new([0.1.into(), 0.3.into()]),
        };
        let metal = |roughness| Model::Conductor {
            eta: Rgb::WHITE,
            k: Rgb::WHITE,
            tint: 1.0.into(),
            roughness: Some(roughness),
        };
        let mut turned = at(Vec2::ZERO);
        turned.dp_du = Vec3::new(0.0, 2.0, 1.0);
        assert_eq!(Material::from(metal(roughness)).frame(&turned).tangent, Vec3::Y);
        let round = Roughness::isotropic(Distribution::Ggx, 0.1);
        assert_eq!(Material::from(metal(round)).frame(&turned), Frame::from_normal(Vec3::Z));
    }

    #[test]
    fn masks_multiply_and_end_in_the_unit_interval() {
        let masked = diffuse(0.5).masked(0.5.into()).unwrap().masked(0.5.into()).unwrap();
        assert_eq!(masked.opacity(&at(Vec2::ZERO)), 0.25);
        let opaque = diffuse(0.5).masked(1.0.into()).unwrap();
        assert!(opaque.is_opaque() && !opaque.may_pass_light());
        let texture = bitmap(2, 1, vec![-1.0, 3.0]);
        let cut = diffuse(0.5).masked(texture.clone()).unwrap();
        assert_eq!(cut.opacity(&at(Vec2::new(0.25, 0.5))), 0.0);
        assert_eq!(cut.opacity(&at(Vec2::new(0.75, 0.5))), 1.0);
        assert_eq!(cut.masked(texture).unwrap_err(), NestingError::Masks);
    }

    #[test]
    fn nesting_is_flattened_or_refused() {
        let height = || bitmap(2, 1, vec![0.0, 1.0]);
        let bumped = diffuse(0.5).bumped(height(), 1.0).unwrap().with_two_sides();
        assert!(bumped.two_sided && bumped.relief.is_some());
        assert_eq!(bumped.clone().bumped(height(), 1.0).unwrap_err(), NestingError::Relief);
        let blend = |a, b| Material::blend(0.5.into(), a, b);
        assert_eq!(blend(bumped, diffuse(0.5)).unwrap_err(), NestingError::Relief);
        assert_eq!(
            blend(diffuse(0.5).with_two_sides(), diffuse(0.5)).unwrap_err(),
            NestingError::Sides
        );
        // Half of a surface that is a quarter there reflects an eighth.
        let thin = blend(diffuse(0.0), diffuse(1.0).masked(0.25.into()).unwrap()).unwrap();
        assert!(thin.is_opaque() && thin.may_pass_light());
        let eval = thin.bsdf(&at(Vec2::ZERO)).eval(Vec3::Z, Vec3::Z);
        assert!((eval.diffuse.r - 0.125 / std::f32::consts::PI).abs() < 1e-6);
    }

    #[test]
    fn queries_look_into_blends() {
        let coat = |alpha| Box::new(RoughCoat::new(Distribution::Ggx, alpha, 1.5, false));
        let plastic = |alpha| Model::RoughPlastic {
            diffuse: 0.5.into(),
            specular: 1.0.into(),
            coat: coat(alpha),
        };
        let rough = |alpha| Some(Roughness { distribution: Distribution::Ggx, alpha });
        let textured = Box::new([bitmap(1, 1, vec![0.2]), bitmap(1, 1, vec![0.2])]);
        for (model, is_diffuse, has_delta, passes) in [
            (Model::Diffuse(0.5.into()), true, false, false),
            (Model::Null, false, true, true),
            (plastic(0.2), false, false, false),
            (plastic(0.0), false, true, false),
            (glass(None), false, true, true),
            (glass(rough(Box::new([0.2.into(), 0.2.into()]))), false, false, true),
            (glass(rough(Box::new([0.0.into(), 0.0.into()]))), false, true, true),
            (glass(rough(textured)), false, true, true),
        ] {
            let name = format!("{model:?}");
            let alone = Material::from(model.clone());
            assert_eq!(alone.is_diffuse_only(), is_diffuse, "{name}");
            let blend = Material::blend(0.5.into(), diffuse(0.5), model.into()).unwrap();
            for material in [alone, blend] {
                assert_eq!(material.has_delta(), has_delta, "{name}");
                assert_eq!(material.may_pass_light(), passes, "{name}");
            }
        }
    }
}
