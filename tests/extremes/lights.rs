//! Emitters at their extremes, for all methods.

use super::denoisers::{denoised, denoisers};
use super::*;
use quietlight_denoise::metrics::{flip, relative_l2};

#[test]
fn darkness_stays_dark_and_is_told() {
    let ball = r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/></shape>"#;
    // A lamp in a closed box, which nothing leaves.
    let hidden = format!(
        r#"{ball}<shape type="sphere"><point name="center" x="9" y="0" z="0"/>{GREY}</shape>
        <shape type="sphere"><point name="center" x="9" y="0" z="0"/><float name="radius" value="0.5"/>
            <emitter type="area"><rgb name="radiance" value="9"/></emitter></shape>"#
    );
    let black = r#"<emitter type="constant"><rgb name="radiance" value="0"/></emitter>"#;
    let denoisers = denoisers();
    for inside in ["", ball, &hidden, &format!("{ball}{black}")] {
        let scene = scene_around(6, 60.0, -1, inside);
        for (name, integrator) in methods() {
            let rendered = rendered(&scene, integrator, 4, 1);
            let (mean, variance) = layer(&rendered, LayerKind::Beauty);
            assert!(mean.iter().chain(variance).all(|&value| value == 0.0), "{name}");
            let warnings = &rendered.report.warnings;
            let is_sampled = matches!(name, "bdpt" | "visibility");
            let is_told = warnings.iter().any(|told| told.contains("no light"));
            assert_eq!(is_told, !is_sampled, "{name}: {warnings:?}");
            for (denoiser, running) in &denoisers {
                let image = denoised(denoiser, running, &rendered.layers).image;
                assert!(image.iter().all(|&value| value == 0.0), "{name}, {denoiser}");
                let scores = [relative_l2(&image, mean), flip(&image, mean, 67.0)];
                assert!(
                    scores.into_iter().all(|score| score.expect("a score") == 0.0),
                    "{denoiser}"
                );
            }
        }
    }
}

#[test]
fn a_light_of_1e_minus_8_survives_next_to_one_of_1e8() {
    // The camera is inside an integrating sphere of 1e-8 (twice that with all bounces), and one of 1e8 is elsewhere.
    let sphere = |x: f32, radiance: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" x="{x}" y="0" z="0"/>
            <boolean name="flip_normals" value="true"/><bsdf type="diffuse"/>
            <emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter></shape>"#
        )
    };
    let scene =
        scene_around(6, 60.0, -1, &format!("{}{}", sphere(0.0, "1e-8"), sphere(10.0, "1e8")));
    for (name, integrator) in methods() {
        let [found, ..] = replicas(&scene, integrator, REPLICAS, 64);
        let p = found.p_against(2e-8);
        let (mean, error) = (found.mean(), found.variance_of_mean().sqrt());
        assert!(p > sidak(LEVEL, COMPARISONS) && error < 2e-9, "{name}: {mean:e} ± {error:e}");
    }
}

#[test]
fn environments_of_few_texels_light_as_they_do_path_tracing() {
    let ball = |texels: &image::Rgb32FImage| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        texels.save(folder.path().join("sky.exr")).expect("the sky is written");
        let text = r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="5"/></integrator>
            <sensor type="perspective"><float name="fov" value="40"/>
            <transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>
                <rfilter type="box"/></film></sensor>
            <shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
            <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
                <translate y="-1"/></transform><bsdf type="diffuse"/></shape>
            <emitter type="envmap"><string name="filename" value="sky.exr"/></emitter></scene>"#;
        let file = folder.path().join("scene.xml");
        std::fs::write(&file, text).expect("the scene is written");
        Scene::load(&file, &LoadOptions::default()).expect("the scene loads")
    };
    assert_like_path(&ball(&image::Rgb32FImage::from_pixel(1, 1, image::Rgb([2.0; 3]))), "1×1");
    // One texel of a hundred shines, high in the sky.
    let mut single = image::Rgb32FImage::new(16, 8);
    single.put_pixel(4, 2, image::Rgb([50.0, 40.0, 30.0]));
    assert_like_path(&ball(&single), "a single texel");
    let black = ball(&image::Rgb32FImage::new(4, 2));
    for (name, integrator) in methods() {
        assert_eq!(luminance(&rendered(&black, integrator, 4, 1)), 0.0, "{name}");
    }
}

#[test]
fn a_dim_light_behind_a_wall_is_not_drowned() {
    // A wall from the camera on divides the view: its right half has a lamp of 1e8 and its left half one of 1e-8, and of direct
    // light nothing comes over. What is left is the light of the dim lamp, found as if the other were not there.
    let wall = r#"<shape type="cube"><transform name="to_world"><scale x="0.01" y="9" z="3"/><translate z="-3.1"/></transform>
        <bsdf type="diffuse"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="4"/><translate z="-4"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>"#;
    let lamp = |x: f32, radiance: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><scale value="0.5"/>
            <translate x="{x}" y="0.3" z="-1"/></transform>
            <emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter></shape>"#
        )
    };
    let dim = lamp(-1.2, "1e-8");
    let scene = |lamps: &str| {
        let mut scene = scene_around(12, 60.0, 2, &format!("{wall}{lamps}"));
        scene.film.crop = [0, 0, 5, 12];
        scene
    };
    let (alone, both) = (scene(&dim), scene(&format!("{dim}{}", lamp(1.2, "1e8"))));
    let expected = by_path(&alone, 256);
    for (name, integrator) in methods() {
        let found = replicas(&both, integrator, REPLICAS, 64);
        assert_same_mean(&found, &expected, name);
        let relative = found[0].variance_of_mean().sqrt() / found[0].mean();
        assert!(relative < 0.1, "{name}: the error {relative} is too large to see anything");
    }
}

#[test]
fn a_speck_of_a_light_and_a_huge_one_are_chosen_by_their_power() {
    // A ten thousandth of the light that walks from the emitters send to the plane is what the camera sees of it, so that it
    // sees a wider part here.
    let (scene, expected) = speck_and_sheet(1.0);
    for (name, integrator) in methods() {
        let [found, ..] = replicas(&scene, integrator, REPLICAS, 64);
        let (p, error) = (found.p_against(expected), found.variance_of_mean().sqrt());
        let is_close = (found.mean() / expected - 1.0).abs() < 1e-3;
        assert!(
            (is_close || p > sidak(LEVEL, COMPARISONS)) && error < 0.1 * expected,
            "{name}: {} ± {error}, expected {expected}",
            found.mean()
        );
    }
}

#[test]
fn light_in_the_plane_of_its_receiver_gives_nothing_that_is_not_finite() {
    // One lamp lies in the plane of the wall, a second stands upright on it and lights it below, at every angle down to 0.
    let scene = scene_around(
        8,
        60.0,
        -1,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="2"/><translate z="-3"/></transform></shape>
        <shape type="rectangle"><transform name="to_world"><translate x="2" z="-3"/></transform>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate z="-3" y="-1"/></transform>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#,
    );
    assert_like_path(&scene, "light along its receiver");
}
