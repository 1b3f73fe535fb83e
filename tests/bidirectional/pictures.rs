//! Whole pictures: single strategies and families of them against path tracing (METHODS 13.2).

use super::{AREA, GLASS, LENS, MIRROR, film, room};
use crate::support::batches::{Batches, assert_same, bdpt_batches, luminance, path_batches};
use crate::support::scenes::{render_finite, scene_around, settings};
use glam::Vec2;
use quietlight::integrator::bdpt::Bdpt;
use quietlight::integrator::{PathTracing, Strategy};
use quietlight::math::Rgb;
use quietlight::render::RenderSettings;
use quietlight::scene::Scene;
use quietlight::transport::connect::{Contribution, Strategies};
use quietlight::transport::mis::Heuristic;
use quietlight_denoise::LayerKind;

const BATCHES: u32 = 32;

const METAL: &str = r#"<bsdf type="roughconductor"><string name="material" value="Au"/><float name="alpha" value="0.3"/></bsdf>"#;
const CONSTANT: &str =
    r#"<emitter type="constant"><rgb name="radiance" value="1 0.5 0.2"/></emitter>"#;
const POINT: &str = r#"<emitter type="point"><point name="position" x="0.5" y="1" z="-2"/>
    <rgb name="intensity" value="2"/></emitter>"#;
const SPOT: &str = r#"<emitter type="spot"><transform name="to_world">
    <lookat origin="0.8,1.2,-1.5" target="0,-0.8,-3.2" up="0,0,1"/></transform>
    <rgb name="intensity" value="6"/><float name="cutoff_angle" value="25"/></emitter>"#;
const PARALLEL: &str = r#"<emitter type="directional"><vector name="direction" x="0.2" y="-1" z="-0.4"/>
    <rgb name="irradiance" value="2"/></emitter>"#;

/// Diffuse things that do not touch, so that 1 / d² is bounded between any two.
const SEPARATE: &str = r#"<bsdf type="twosided" id="grey"><bsdf type="diffuse">
        <rgb name="reflectance" value="0.7 0.6 0.5"/></bsdf></bsdf>
    <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="1.5"/>
        <translate y="-1.2" z="-3.5"/></transform><ref id="grey"/></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="1.6"/><translate y="1" z="-6"/></transform>
        <ref id="grey"/></shape>
    <shape type="sphere"><point name="center" x="0.2" y="0" z="-3.5"/><float name="radius" value="0.5"/>
        <ref id="grey"/></shape>
    <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.8"/>
        <translate y="1.9" z="-3.5"/></transform><emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#;

/// Estimate 0: path tracing of paths of exactly `k` edges. Renders with and without the last edge share their numbers, so
/// that their difference has no more noise than it should.
fn paths_of(scene: &Scene, k: u32, samples: u32) -> Batches {
    Batches::run(scene, BATCHES, |batch, add| {
        for (max_depth, sign) in [(k, 1.0), (k - 1, -1.0)] {
            let integrator = PathTracing { max_depth, ..PathTracing::default() }.into();
            let settings = RenderSettings {
                integrator,
                ..settings(samples, 500 + u64::from(batch), Strategy::Mis)
            };
            let rendered = render_finite(scene, &settings);
            let beauty = &rendered.layers.layers[&LayerKind::Beauty].mean;
            let (_, height, width) = beauty.dim();
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let colour = Rgb::from([0, 1, 2].map(|channel| beauty[[channel, y, x]]));
                add(0, Vec2::new(x as f32, y as f32), sign * luminance(colour));
            }
        }
    })
}

#[test]
fn every_strategy_sees_what_path_tracing_sees_of_its_path_length() {
    let scene = film(16, 16, 4, "", SEPARATE);
    let index = |s: u32, t: u32| (s * 8 + t) as usize;
    let strategies = bdpt_batches(&scene, Bdpt::default(), BATCHES, 96, |found| {
        Some((index(found.s, found.t), 1.0))
    });
    for k in 1..=4 {
        let expected = paths_of(&scene, k, 96);
        for s in 0..=k {
            // What is seen directly is left to the eye's walk.
            if k > 1 || s == 0 {
                let t = k + 1 - s;
                assert_same(&strategies, index(s, t), &expected, 0, &format!("s {s}, t {t}"));
            }
        }
    }
}

/// A family of strategies against path tracing; `factor` is what a contribution counts for.
fn assert_family(
    scene: &Scene,
    integrator: Bdpt,
    samples: u32,
    factor: impl Fn(&Contribution) -> f64 + Sync,
    what: &str,
) {
    let family =
        bdpt_batches(scene, integrator, BATCHES, samples, |found| Some((0, factor(found))));
    let reference = path_batches(scene, BATCHES, samples);
    assert_same(&family, 0, &reference, 0, what);
}

#[test]
fn all_strategies_together_see_what_path_tracing_sees() {
    let every = format!("{AREA}{CONSTANT}{POINT}{SPOT}{PARALLEL}");
    for (what, heuristic, scene) in [
        ("mirror ball, area light", Heuristic::Power, room(6, MIRROR, AREA)),
        ("glass ball, area light", Heuristic::Balance, room(6, GLASS, AREA)),
        ("glass ball, environment", Heuristic::Power, room(6, GLASS, CONSTANT)),
        ("metal ball, point", Heuristic::Power, room(5, METAL, POINT)),
        ("metal ball, spot", Heuristic::Power, room(5, METAL, SPOT)),
        ("metal ball, directional", Heuristic::Power, room(5, METAL, PARALLEL)),
        ("metal ball, all lights", Heuristic::Power, room(5, METAL, &every)),
        ("thin lens", Heuristic::Power, film(16, 16, 5, LENS, SEPARATE)),
    ] {
        let integrator = Bdpt { heuristic, ..Bdpt::default() };
        assert_family(&scene, integrator, 48, |found| found.weight, what);
    }
}

#[test]
fn the_strategies_of_path_tracing_and_those_of_chains_are_whole_by_themselves() {
    let scene = room(6, GLASS, AREA);
    for strategies in [Strategies::FromCamera, Strategies::ToLens] {
        let integrator = Bdpt { strategies, ..Bdpt::default() };
        assert_family(&scene, integrator, 48, |found| found.weight, &format!("{strategies:?}"));
    }
    let lens = film(16, 16, 4, LENS, SEPARATE);
    let integrator = Bdpt { strategies: Strategies::ToLens, ..Bdpt::default() };
    assert_family(&lens, integrator, 48, |found| found.weight, "to the lens");
}

/// Only splats: light that walks to a surface and from there to the lens, or that walks into it.
fn only(t: u32) -> impl Fn(&Contribution) -> f64 + Sync {
    move |found| f64::from(u8::from(found.t == t))
}

#[test]
fn light_that_walks_into_a_lens_makes_the_whole_picture_and_none_in_a_pinhole() {
    let mut scene = film(16, 16, 4, LENS, SEPARATE);
    // What is seen directly is left to the eye's walk.
    scene.limits.hide_emitters = true;
    assert_family(&scene, Bdpt::default(), 192, only(0), "into the lens");
    assert_family(&scene, Bdpt::default(), 96, only(1), "to a point of the lens");
    let mut found = bdpt_batches(&film(16, 16, 4, "", SEPARATE), Bdpt::default(), 2, 16, |one| {
        (one.t == 0).then_some((0, 1.0))
    });
    assert_eq!(found.whole(0), (0.0, 0.0));
    found = bdpt_batches(&scene, Bdpt::default(), 2, 16, |one| (one.t == 0).then_some((0, 1.0)));
    assert!(found.whole(0).0 > 0.0);
}

#[test]
fn splats_are_scaled_by_the_crop_window_of_a_film_that_is_not_square() {
    let mut scene = film(40, 24, 4, "", SEPARATE);
    scene.limits.hide_emitters = true;
    scene.film.crop = [8, 8, 24, 8];
    assert_family(&scene, Bdpt::default(), 96, only(1), "crop, splats alone");
    scene.limits.hide_emitters = false;
    assert_family(&scene, Bdpt::default(), 48, |found| found.weight, "crop, weighted");
}

#[test]
fn light_carries_the_factors_of_media_and_of_shading_normals() {
    let floor = |bsdf: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
            <translate y="-1" z="-4"/></transform>{bsdf}</shape>{AREA}"#
        )
    };
    // The light is inside the ball of rough glass, the camera in air.
    let water = r#"<shape type="sphere"><point name="center" x="0" y="0" z="-3"/><float name="radius" value="1"/>
            <bsdf type="roughdielectric"><float name="alpha" value="0.4"/><float name="int_ior" value="1.5"/></bsdf></shape>
        <shape type="sphere"><point name="center" x="0" y="0" z="-3"/><float name="radius" value="0.4"/>
            <emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
            <translate y="-1.3" z="-4"/></transform><bsdf type="diffuse"/></shape>"#;
    let bump = floor(
        r#"<bsdf type="bumpmap"><float name="scale" value="0.6"/><texture type="checkerboard">
            <transform name="to_uv"><scale value="3"/></transform></texture><bsdf type="diffuse"/></bsdf>"#,
    );
    for (what, mut scene) in [
        ("light in glass", film(16, 16, 4, "", water)),
        ("bumps", film(16, 16, 4, "", &bump)),
        ("interpolated normals", interpolated()),
    ] {
        scene.limits.hide_emitters = true;
        assert_family(&scene, Bdpt::default(), 96, only(1), what);
    }
}

/// A coarse tent with the normals of a dome, over a floor.
fn interpolated() -> Scene {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(
        folder.path().join("tent.obj"),
        "v -1.5 0 1.5\nv 1.5 0 1.5\nv 1.5 0 -1.5\nv -1.5 0 -1.5\nv 0 0.8 0\n\
         vn -0.6 0.5 0.6\nvn 0.6 0.5 0.6\nvn 0.6 0.5 -0.6\nvn -0.6 0.5 -0.6\nvn 0 1 0\n\
         f 1//1 2//2 5//5\nf 2//2 3//3 5//5\nf 3//3 4//4 5//5\nf 4//4 1//1 5//5\n",
    )
    .expect("the mesh is written");
    let file = folder.path().join("scene.xml");
    std::fs::write(
        &file,
        format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="4"/></integrator>
            <sensor type="perspective"><float name="fov" value="60"/>
            <transform name="to_world"><lookat origin="0,0,0" target="0,-0.3,-1" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
                <rfilter type="box"/></film></sensor>
            <shape type="obj"><string name="filename" value="tent.obj"/><transform name="to_world">
                <translate y="-1.2" z="-3"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
            {AREA}</scene>"#
        ),
    )
    .expect("the scene is written");
    Scene::load(&file, &quietlight::scene::LoadOptions::default()).expect("the scene loads")
}

#[test]
fn masks_and_blends_with_nothing_let_the_same_light_pass() {
    let window = |bsdf: &str| {
        format!(
            r#"{SEPARATE}<shape type="rectangle"><transform name="to_world"><scale value="0.8"/>
            <translate x="-0.3" z="-2"/></transform>{bsdf}</shape>"#
        )
    };
    let mask = r#"<bsdf type="mask"><float name="opacity" value="0.6"/>
        <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf>"#;
    let blend = r#"<bsdf type="blendbsdf"><float name="weight" value="0.4"/><bsdf type="null"/>
        <bsdf type="diffuse"/></bsdf>"#;
    for (what, bsdf) in [("mask", mask), ("blend", blend)] {
        let scene = film(16, 16, 5, "", &window(bsdf));
        assert_family(&scene, Bdpt::default(), 48, |found| found.weight, what);
    }
}

#[test]
fn hidden_emitters_still_light_the_scene() {
    let mut scene = room(5, MIRROR, AREA);
    scene.limits.hide_emitters = true;
    assert_family(&scene, Bdpt::default(), 48, |found| found.weight, "hidden emitters");
}

#[test]
fn a_sphere_of_light_around_the_camera_is_flat_in_splats() {
    // What the wall scatters of its own light once is 0.6 · 0.5 everywhere, whatever the raster position's density.
    let scene = scene_around(
        24,
        80.0,
        2,
        r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="0.5"/></emitter></shape>"#,
    );
    let splats =
        bdpt_batches(&scene, Bdpt::default(), BATCHES, 64, |found| Some((0, only(1)(found))));
    for block in 0..9 {
        let (mean, error) = splats.block(0, block);
        // |z| of nine blocks: two-sided 10⁻⁵ is 4.4 with Gauss, 5.2 with Student's 31 degrees of freedom.
        assert!(error < 0.01 && ((mean - 0.3) / error).abs() < 5.2, "{block}: {mean} ± {error}");
    }
}
