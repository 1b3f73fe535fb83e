//! A surface point in its local frame.

use crate::bsdf::Bsdf;
use crate::geometry::Interaction;
use crate::math::Frame;
use crate::scene::Material;
use glam::Vec3;

/// A surface point seen from `wo`, ready to scatter.
#[derive(Clone, Debug)]
pub struct Shading<'a> {
    /// The model, textures looked up.
    pub bsdf: Bsdf<'a>,
    /// Local frame: `z` is the shading normal, turned to `wo` where the material is two-sided.
    pub frame: Frame,
    /// Geometric normal on the side of the frame's normal.
    pub normal: Vec3,
    /// Local direction to where the ray came from.
    pub wo: Vec3,
}

impl<'a> Shading<'a> {
    /// The surface of `material` at `at`, seen from the unit direction `wo`.
    pub fn new(material: &'a Material, at: &Interaction, wo: Vec3) -> Self {
        let mut shading = Self::of_nothing();
        shading.set(material, at, wo);
        shading
    }

    /// [`Shading::new`], written into its place.
    #[inline(always)]
    pub fn set(&mut self, material: &'a Material, at: &Interaction, wo: Vec3) {
        let mut frame = material.frame(at);
        // Some meshes have vertex normals against their winding: the normals decide which side is which.
        let mut normal = if at.normal.dot(frame.normal) < 0.0 { -at.normal } else { at.normal };
        let mut local = frame.to_local(wo);
        if material.mirrors_relief {
            let untilted = at.shading_normal;
            if untilted.dot(wo) < 0.0 {
                let mirrored = frame.normal - untilted * (2.0 * untilted.dot(frame.normal));
                frame = Frame::from_normal_and_tangent(mirrored, at.dp_du);
                local = frame.to_local(wo);
                normal = -normal;
            }
        } else if material.two_sided && local.z < 0.0 {
            frame.normal = -frame.normal;
            local.z = -local.z;
            normal = -normal;
        }
        (self.frame, self.normal, self.wo) = (frame, normal, local);
        material.set_bsdf(at, &mut self.bsdf);
    }

    /// A surface that lets all light through, until there is another.
    pub fn of_nothing() -> Self {
        let frame = Frame { tangent: Vec3::X, bitangent: Vec3::Y, normal: Vec3::Z };
        Self { bsdf: Bsdf::Null, frame, normal: Vec3::Z, wo: Vec3::Z }
    }

    /// Does a direction, given in the local frame and in the world, lie on the same side of the surface by both
    /// normals? Where an interpolated normal says otherwise light would leak through the surface: such directions
    /// scatter nothing, whichever way the light goes, so that all integrators agree.
    #[inline]
    pub fn is_consistent(&self, local: Vec3, world: Vec3) -> bool {
        local.z * self.normal.dot(world) > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;
    use crate::scene::material::Model;
    use crate::texture::Texture;

    #[test]
    fn a_relief_is_mirrored_with_what_is_made_two_sided_around_it() {
        // As Mitsuba 3.9.1, which mirrors directions at the untilted surface in `twosided` around `normalmap`.
        let normal = Vec3::new(-0.6, 0.0, 0.8);
        let stored = Texture::Constant(Rgb::from(((normal + 1.0) * 0.5).to_array()));
        let tilted = |material: Material| material.normal_mapped(stored.clone()).expect("one");
        let model = || Material::from(Model::Diffuse(Rgb::splat(0.5).into()));
        let at = Interaction {
            normal: Vec3::Z,
            shading_normal: Vec3::Z,
            dp_du: Vec3::X,
            dp_dv: Vec3::Y,
            ..Interaction::default()
        };
        let behind = Vec3::new(0.1, 0.2, -0.9).normalize();
        for (material, expected) in [
            (tilted(model()).with_two_sides(), Vec3::new(-0.6, 0.0, -0.8)),
            (tilted(model().with_two_sides()), -normal),
        ] {
            for (wo, expected) in [(-behind, normal), (behind, expected)] {
                let shading = Shading::new(&material, &at, wo);
                assert!(shading.frame.normal.abs_diff_eq(expected, 1e-6), "{:?}", shading.frame);
                assert!(shading.wo.z > 0.0 && shading.is_consistent(shading.wo, wo));
                let again = shading.frame.to_world(shading.wo);
                assert!(again.abs_diff_eq(wo, 1e-6), "{again}");
            }
        }
    }
}
