//! Different estimators of the same picture agree, block by block, within their own errors.

use crate::support::scenes::{
    assert_equal_energy, mean_and_error, render_finite, scene_around, settings,
};
use quietlight::integrator::Strategy::{Bsdf, Light, Mis};
use quietlight::render::SamplerKind;
use quietlight::scene::{LoadOptions, Scene};

/// A room with every kind of lobe: coloured diffuse walls, a rough metal back wall, a plastic floor, a ball of smooth
/// glass or a mirror, a large ceiling light.
fn room(ball: &str) -> Scene {
    scene_around(
        32,
        60.0,
        8,
        &format!(
            r#"
        <bsdf type="twosided" id="red"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.2 0.1"/></bsdf></bsdf>
        <bsdf type="twosided" id="green"><bsdf type="diffuse"><rgb name="reflectance" value="0.2 0.6 0.2"/></bsdf></bsdf>
        <bsdf type="twosided" id="metal"><bsdf type="roughconductor"><string name="material" value="Cu"/>
            <float name="alpha" value="0.3"/></bsdf></bsdf>
        <bsdf type="twosided" id="plastic"><bsdf type="roughplastic"><float name="alpha" value="0.2"/>
            <rgb name="diffuse_reflectance" value="0.4 0.5 0.7"/></bsdf></bsdf>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
            <translate y="-1" z="-3"/></transform><ref id="plastic"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-5"/></transform>
            <ref id="metal"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="90"/><scale value="3"/>
            <translate x="-1.5" z="-3"/></transform><ref id="red"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="-90"/><scale value="3"/>
            <translate x="1.5" z="-3"/></transform><ref id="green"/></shape>
        <shape type="sphere"><point name="center" x="0.2" y="-0.5" z="-3"/><float name="radius" value="0.5"/>{ball}</shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.8"/>
            <translate y="1.5" z="-3"/></transform>
            <emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#
        ),
    )
}

const MIRROR: &str = r#"<bsdf type="conductor"><string name="material" value="none"/></bsdf>"#;

#[test]
fn choosing_lights_walking_into_them_and_both_give_the_same_picture() {
    let scene = room(MIRROR);
    let both = render_finite(&scene, &settings(256, 1, Mis));
    assert_equal_energy(
        &render_finite(&scene, &settings(256, 2, Bsdf)),
        &both,
        "BSDF sampling and MIS",
    );
    assert_equal_energy(
        &render_finite(&scene, &settings(256, 3, Light)),
        &both,
        "light sampling and MIS",
    );
}

#[test]
fn russian_roulette_keeps_the_picture() {
    let mut scene = room(MIRROR);
    scene.limits.rr_depth = 100;
    let without = render_finite(&scene, &settings(256, 4, Mis));
    scene.limits.rr_depth = 1;
    assert_equal_energy(
        &render_finite(&scene, &settings(256, 5, Mis)),
        &without,
        "roulette from the first hit",
    );
}

#[test]
fn sobol_points_and_independent_numbers_give_the_same_picture() {
    let scene = room(MIRROR);
    let mut sobol = settings(256, 6, Mis);
    sobol.sampler = SamplerKind::Sobol;
    let independent = render_finite(&scene, &settings(256, 7, Mis));
    assert_equal_energy(&render_finite(&scene, &sobol), &independent, "Sobol and independent");
}

#[test]
fn two_windows_of_masks_are_seen_through_alike_by_every_strategy() {
    // Shadow rays count the masks that they cross, walks cross them at random: MIS must weigh both as the same paths.
    let scene = veiled(-1);
    let both = render_finite(&scene, &settings(256, 8, Mis));
    for (strategy, seed) in [(Bsdf, 9), (Light, 10)] {
        let one = render_finite(&scene, &settings(256, seed, strategy));
        assert_equal_energy(&one, &both, &format!("{strategy:?} and MIS"));
    }
}

#[test]
fn the_last_edge_passes_masks_alike_by_every_strategy() {
    // Direct light alone. What walks would miss of it, the weights of light sampling would not make good.
    let scene = veiled(2);
    let [(light, light_error), (both, error)] = [(Light, 11), (Mis, 12)].map(|(strategy, seed)| {
        mean_and_error(&render_finite(&scene, &settings(2048, seed, strategy)))
    });
    let error = error.hypot(light_error);
    assert!(error < 0.01 * light, "{light} ± {error}: nothing would be seen");
    assert!((light - both).abs() < 4.4 * error, "{light} {both} ± {error}");
}

/// A floor under two veils under a lamp.
fn veiled(max_depth: i32) -> Scene {
    scene_around(
        32,
        60.0,
        max_depth,
        r#"<bsdf type="mask" id="veil"><float name="opacity" value="0.4"/>
            <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/>
            <translate y="-1" z="-3"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="3"/>
            <translate y="0.6" z="-3"/></transform><ref id="veil"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="3"/>
            <translate y="0.8" z="-3"/></transform><ref id="veil"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/>
            <translate y="1.5" z="-3"/></transform>
            <emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>"#,
    )
}

#[test]
fn caustics_of_a_glass_ball_are_found_alike_by_walking_and_by_both() {
    let scene = room(r#"<bsdf type="dielectric"/>"#);
    let both = render_finite(&scene, &settings(1024, 11, Mis));
    assert_equal_energy(&render_finite(&scene, &settings(1024, 12, Bsdf)), &both, "through glass");
}

#[test]
fn an_environment_with_a_sun_is_sampled_alike_by_every_strategy() {
    // A dim sky with one texel 300 times brighter: walking rarely finds it, choosing by luminance nearly always does.
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut sky = image::Rgb32FImage::from_pixel(32, 16, image::Rgb([0.2, 0.3, 0.5]));
    sky.put_pixel(11, 4, image::Rgb([100.0, 90.0, 60.0]));
    sky.save(folder.path().join("sky.exr")).expect("the sky is written");
    let file = folder.path().join("scene.xml");
    let text = r#"<scene version="3.0.0">
        <sensor type="perspective"><float name="fov" value="40"/>
            <transform name="to_world"><lookat origin="0,2,6" target="0,0,0" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/></film></sensor>
        <emitter type="envmap"><string name="filename" value="sky.exr"/>
            <transform name="to_world"><rotate x="1" angle="20"/></transform></emitter>
        <shape type="sphere"><bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="6"/>
            <translate y="-1"/></transform><bsdf type="diffuse"/></shape>
        </scene>"#;
    std::fs::write(&file, text).expect("the scene is written");
    let scene = Scene::load(&file, &LoadOptions::default()).expect("the scene loads");
    let both = render_finite(&scene, &settings(512, 13, Mis));
    assert_equal_energy(
        &render_finite(&scene, &settings(4096, 14, Bsdf)),
        &both,
        "BSDF sampling and MIS",
    );
    assert_equal_energy(
        &render_finite(&scene, &settings(1024, 15, Light)),
        &both,
        "light sampling and MIS",
    );
}
