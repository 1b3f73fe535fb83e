use super::*;
use crate::bsdf::{Distribution, RoughCoat};
use crate::texture::{Bitmap, Filter, Image, Wrap, load::Texels};
use glam::{Affine2, Vec2};
use std::f32::consts::FRAC_1_PI;
use std::sync::Arc;

fn at(uv: Vec2) -> Interaction {
    Interaction {
        normal: Vec3::Z,
        shading_normal: Vec3::Z,
        uv,
        dp_du: 4.0 * Vec3::X,
        dp_dv: Vec3::Y,
        ..Interaction::default()
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
    Model::Dielectric { eta: 1.5, reflectance: 1.0.into(), transmittance: 1.0.into(), roughness }
}

#[test]
fn textures_are_looked_up_where_the_surface_is_hit() {
    let material = Material::from(Model::Diffuse(bitmap(2, 1, vec![0.25, 0.75])));
    assert_eq!(material.bsdf(&at(Vec2::new(0.25, 0.5))).albedo(), Rgb::splat(0.25));
    assert_eq!(material.bsdf(&at(Vec2::new(0.75, 0.5))).albedo(), Rgb::splat(0.75));
    let blend = Material::blend(bitmap(2, 1, vec![0.0, 1.0]), diffuse(0.1), diffuse(0.5)).unwrap();
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
    assert!((frame.normal - Vec3::new(-2.0, 0.0, 4.0).normalize()).length() < 1e-6, "{frame:?}");
    assert!((frame.tangent - Vec3::new(4.0, 0.0, 2.0).normalize()).length() < 1e-6, "{frame:?}");
    // Mirrored surface coordinates do not turn the normal around.
    let mut mirrored = at(Vec2::new(0.5, 0.5));
    mirrored.dp_du = -mirrored.dp_du;
    assert!(
        (material.frame(&mirrored).normal - Vec3::new(2.0, 0.0, 4.0).normalize()).length() < 1e-6
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
    let texels =
        vec![[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [128, 128, 128], [10, 20, 30]];
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
    let roughness =
        Roughness { distribution: Distribution::Ggx, alpha: Box::new([0.1.into(), 0.3.into()]) };
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
    let masked = diffuse(0.5).masked(0.5.into()).masked(0.5.into());
    assert_eq!(masked.opacity(&at(Vec2::ZERO)), 0.25);
    let opaque = diffuse(0.5).masked(1.0.into());
    assert!(opaque.is_opaque() && !opaque.may_pass_light());
    let texture = bitmap(2, 1, vec![-1.0, 3.0]);
    let cut = diffuse(0.5).masked(texture.clone());
    assert_eq!(cut.opacity(&at(Vec2::new(0.25, 0.5))), 0.0);
    assert_eq!(cut.opacity(&at(Vec2::new(0.75, 0.5))), 1.0);
    // Of two textures, or a texture in a number, both are in force: here nothing, and half of all.
    for (cut, share) in [(cut.clone().masked(texture), 1.0), (cut.masked(0.5.into()), 0.5)] {
        for (u, there) in [(0.25, 0.0), (0.75, 1.0)] {
            let at = at(Vec2::new(u, 0.5));
            let scattered = cut.bsdf(&at).eval(Vec3::Z, Vec3::Z).diffuse * cut.opacity(&at);
            let expected = there * share * 0.5 * FRAC_1_PI;
            assert!((scattered.r - expected).abs() < 1e-6, "{scattered:?} {expected}");
        }
    }
    // A coloured number counts by its mean: Mitsuba 3.9.1 shows 0.6 behind this.
    let coloured = diffuse(0.5).masked(Texture::Constant(Rgb::new(0.9, 0.2, 0.1)));
    assert!((coloured.opacity(&at(Vec2::ZERO)) - 0.4).abs() < 1e-6);
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
    let thin = blend(diffuse(0.0), diffuse(1.0).masked(0.25.into())).unwrap();
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
