//! The extremes of METHODS 14 for bidirectional path tracing, through the renderer: finite, no panic, and the property that
//! each row names.

use super::{AREA, GLASS, film, room, room_around};
use crate::support::scenes::{
    assert_equal_energy, assert_mean, layer, mean_and_error, render_finite, scaled, scene_around,
    scene_from, settings,
};
use quietlight::integrator::bdpt::{Bdpt, Workspace};
use quietlight::integrator::{Integrator, Strategy};
use quietlight::render::{RenderSettings, Rendered, SamplerKind};
use quietlight::sampler::{IndependentSampler, Sampler};
use quietlight::scene::Scene;
use quietlight_denoise::LayerKind;

fn bidirectional(samples: u32, seed: u64) -> RenderSettings {
    RenderSettings {
        integrator: Integrator::Bdpt(Bdpt::default()),
        ..settings(samples, seed, Strategy::Mis)
    }
}

/// Renders by both methods and asserts that they agree.
fn assert_as_path_tracing(scene: &Scene, samples: u32, what: &str) {
    assert_equal_energy(
        &render_finite(scene, &bidirectional(samples, 1)),
        &render_finite(scene, &settings(samples, 2, Strategy::Mis)),
        what,
    );
}

fn is_black(rendered: &Rendered) -> bool {
    layer(rendered, LayerKind::Beauty).0.iter().all(|&value| value == 0.0)
}

#[test]
fn one_two_and_eight_threads_give_the_same_bits() {
    // Wide enough for several tiles, so that threads share it.
    let scene = film(100, 40, 6, "", &room_around(GLASS, AREA));
    for sampler in [SamplerKind::Sobol, SamplerKind::Independent] {
        let settings = RenderSettings { sampler, ..bidirectional(9, 5) };
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads").install(|| render_finite(&scene, &settings))
        };
        let one = on(1);
        for threads in [2, 8] {
            let many = on(threads);
            for (kind, layer) in &one.layers.layers {
                let other = &many.layers.layers[kind];
                assert_eq!(layer.mean, other.mean, "{kind:?} on {threads} threads");
                assert_eq!(layer.variance, other.variance, "{kind:?} on {threads} threads");
                assert_eq!(layer.halves, other.halves, "{kind:?} on {threads} threads");
            }
        }
    }
}

#[test]
fn features_are_those_of_path_tracing_to_the_bit() {
    let scene = room(6, GLASS, AREA);
    let (ours, paths) = (
        render_finite(&scene, &bidirectional(8, 5)),
        render_finite(&scene, &settings(8, 5, Strategy::Mis)),
    );
    for (kind, layer) in paths.layers.layers.iter().filter(|(kind, _)| !kind.is_radiance()) {
        assert_eq!(layer.mean, ours.layers.layers[kind].mean, "{kind:?}");
    }
}

#[test]
fn walks_between_perfect_mirrors_end() {
    let scene = scene_around(
        4,
        60.0,
        -1,
        r#"<shape type="sphere"><point name="center" x="0.3" y="0.2" z="0"/><boolean name="flip_normals" value="true"/>
        <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>
        <emitter type="point"><point name="position" x="0.4" y="0.1" z="0"/></emitter>"#,
    );
    assert!(is_black(&render_finite(&scene, &bidirectional(16, 8))));
}

#[test]
fn five_hundred_bounces_off_white_walls_stay_finite() {
    let sphere = |albedo: &str| {
        format!(
            r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
            <bsdf type="diffuse"><rgb name="reflectance" value="{albedo}"/></bsdf>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#
        )
    };
    let mut scene = scene_around(2, 60.0, 500, &sphere("0.999"));
    scene.limits.rr_depth = 1000;
    let (mean, _) = mean_and_error(&render_finite(&scene, &bidirectional(2, 14)));
    // Weights of 500 strategies sum to 1 and the sphere gives each path the same light: little variance.
    let expected = (1.0 - 0.999f64.powi(500)) / 0.001;
    assert!((mean / expected - 1.0).abs() < 0.02, "{mean}, expected {expected}");
    let dark = scene_around(4, 60.0, -1, &sphere("1e-12"));
    assert_mean(
        mean_and_error(&render_finite(&dark, &bidirectional(64, 16))),
        1.0,
        0.01,
        "black sphere",
    );
}

#[test]
fn a_light_of_1e_minus_8_survives_next_to_one_of_1e8() {
    let sphere = |x: f32, radiance: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" x="{x}" y="0" z="0"/>
            <boolean name="flip_normals" value="true"/><bsdf type="diffuse"/>
            <emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter></shape>"#
        )
    };
    let both = format!("{}{}", sphere(0.0, "1e-8"), sphere(10.0, "1e8"));
    let rendered = render_finite(&scene_around(8, 60.0, -1, &both), &bidirectional(1024, 9));
    assert_mean(mean_and_error(&rendered), 2e-8, 0.03, "the dim sphere");
}

#[test]
fn a_scene_looks_the_same_at_every_scale_and_far_from_the_origin() {
    let plain = render_finite(&scaled(48, 5, 1.0, 0.0), &bidirectional(64, 11));
    for (scale, offset) in [(1e-4, 0.0), (1e7, 0.0), (1.0, 1e6)] {
        let other = render_finite(&scaled(48, 5, scale, offset), &bidirectional(64, 12));
        assert_equal_energy(&other, &plain, &format!("scale {scale}, offset {offset}"));
    }
}

#[test]
fn grazing_light_and_points_that_coincide_stay_finite() {
    // A light in the plane of its receiver, one that touches it, and two sheets at the same place.
    let scene = scene_around(
        8,
        60.0,
        6,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="2"/><translate z="-3"/></transform></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate z="-3"/></transform></shape>
        <shape type="rectangle"><transform name="to_world"><translate x="2" z="-3"/></transform>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate z="-3" y="2"/></transform>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#,
    );
    render_finite(&scene, &bidirectional(256, 13));
}

#[test]
fn without_light_or_in_the_dark_the_picture_is_black() {
    let ball = r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/></shape>"#;
    let dark = r#"<emitter type="point"><rgb name="intensity" value="0"/></emitter>
        <emitter type="constant"><rgb name="radiance" value="0"/></emitter>"#;
    for inside in ["", ball, &format!("{ball}{dark}")] {
        assert!(is_black(&render_finite(
            &scene_around(8, 60.0, -1, inside),
            &bidirectional(4, 17)
        )));
    }
}

#[test]
fn pictures_of_one_row_or_one_pixel_are_parts_of_the_whole() {
    let mut scene = room(5, GLASS, AREA);
    let whole = mean_of(&render_finite(&scene, &bidirectional(512, 18)), [6, 0, 1, 16]);
    for crop in [[6, 0, 1, 16], [5, 7, 8, 1], [4, 4, 1, 1]] {
        scene.film.crop = crop;
        let rendered = render_finite(&scene, &bidirectional(512, 19));
        let mean = mean_of(&rendered, [0, 0, crop[2], crop[3]]);
        assert!(mean > 0.0, "{crop:?}");
        if crop[2] == 1 && crop[3] == 16 {
            // Two independent renders of 16 pixels; their noise is about 2 %.
            assert!((mean / whole - 1.0).abs() < 0.1, "{mean}, {whole}");
        }
    }
}

/// Mean of the beauty in a window.
fn mean_of(rendered: &Rendered, [left, top, width, height]: [u32; 4]) -> f64 {
    let (mean, _) = layer(rendered, LayerKind::Beauty);
    let window = (top..top + height).flat_map(|y| (left..left + width).map(move |x| [y, x]));
    let values = window.flat_map(|[y, x]| (0..3).map(move |c| [c, y as usize, x as usize]));
    values.map(|at| f64::from(mean[at])).sum::<f64>() / f64::from(3 * width * height)
}

#[test]
fn the_camera_may_be_inside_glass_inside_a_light_or_on_a_surface() {
    let around = |radius: f32, z: f32, inside: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" x="0" y="0" z="{z}"/>
            <float name="radius" value="{radius}"/>{inside}</shape>"#
        )
    };
    let light = r#"<emitter type="area"><rgb name="radiance" value="1"/></emitter>"#;
    let floor = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
        <translate y="-1.5" z="-3"/></transform></shape>"#;
    for (what, inside) in [
        ("inside glass", format!("{AREA}{floor}{}", around(0.5, 0.0, GLASS))),
        ("inside a light", format!("{floor}{}", around(0.5, 0.0, light))),
        ("on a surface", format!("{AREA}{floor}{}", around(1.0, 1.0, ""))),
    ] {
        let rendered = render_finite(&scene_around(32, 60.0, 5, &inside), &bidirectional(16, 20));
        assert!(mean_of(&rendered, [0, 0, 32, 32]).is_finite(), "{what}");
    }
    let scene = scene_around(48, 60.0, 5, &format!("{AREA}{floor}{}", around(0.5, 0.0, GLASS)));
    assert_as_path_tracing(&scene, 64, "inside glass");
}

#[test]
fn a_lens_without_radius_is_a_pinhole() {
    let scene = |sensor: &str| {
        scene_from(&format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="4"/></integrator>
            <sensor {sensor}<float name="fov" value="60"/>
            <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
            <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform></sensor>
            {AREA}<shape type="sphere"><point name="center" x="0" y="-1" z="-3"/></shape></scene>"#
        ))
    };
    let lens = r#"type="thinlens"><float name="aperture_radius" value="0"/><float name="focus_distance" value="5"/>"#;
    let [lens, pinhole] = [lens, r#"type="perspective">"#]
        .map(|sensor| render_finite(&scene(sensor), &bidirectional(4, 25)));
    assert_eq!(layer(&lens, LayerKind::Beauty), layer(&pinhole, LayerKind::Beauty));
}

#[test]
fn no_path_is_longer_than_the_limit() {
    for limit in [1, 2, 3, 100] {
        let mut scene = room(limit, GLASS, AREA);
        scene.limits.rr_depth = 1000;
        let (mut workspace, mut found) = (Workspace::default(), Vec::new());
        let mut longest = 0;
        for sample in 0..2000 {
            let mut sampler = IndependentSampler::new(3, sample, 0);
            let (raster, lens) = (sampler.next_2d() * 16.0, sampler.next_2d());
            found.clear();
            Bdpt::default().trace(&scene, raster, lens, &mut sampler, &mut workspace, &mut found);
            longest = found.iter().map(|one| one.s + one.t - 1).fold(longest, u32::max);
        }
        assert!(longest <= limit, "{longest}, limit {limit}");
        assert!(limit == 100 || longest == limit, "{longest}, limit {limit}");
    }
}

#[test]
fn roughness_goes_to_zero_without_a_break() {
    let metal = |alpha: &str| {
        let bsdf = format!(
            r#"<bsdf type="roughconductor"><string name="material" value="Cu"/><float name="alpha" value="{alpha}"/></bsdf>"#
        );
        let mut scene = room(4, &bsdf, AREA);
        scene.film.crop = [4, 4, 8, 8];
        scene
    };
    for alpha in ["1", "0.1", "0.01", "0.001", "0.0001"] {
        render_finite(&metal(alpha), &bidirectional(64, 1));
    }
    let image = |alpha| mean_and_error(&render_finite(&metal(alpha), &bidirectional(1024, 2)));
    let (delta, error) = image("0");
    for alpha in ["0.0001", "0.0002"] {
        let (mean, other) = image(alpha);
        // The mean of a blur of 2e-4 is that of the mirror.
        let z = (mean - delta) / error.hypot(other);
        assert!(error < 0.02 * delta && z.abs() < 4.4, "{alpha}: {mean} ± {other}, {delta}");
    }
}

#[test]
fn an_environment_of_one_pixel_is_even() {
    let even = r#"<emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let one = ndarray::Array3::from_elem((3, 1, 1), 1.0f32);
    quietlight_denoise::exr::write(
        &folder.path().join("one.exr"),
        &quietlight_denoise::Layers { width: 1, height: 1, ..Default::default() },
        &quietlight_denoise::exr::WriteOptions { picture: Some(&one), ..Default::default() },
    )
    .expect("the picture is written");
    let file = folder.path().join("one.exr").display().to_string();
    let map =
        format!(r#"<emitter type="envmap"><string name="filename" value="{file}"/></emitter>"#);
    let ball = r#"<shape type="sphere"><point name="center" x="0" y="0" z="-3"/>
        <float name="radius" value="2.5"/></shape>"#;
    let [map, even] = [map.as_str(), even].map(|light| {
        render_finite(&scene_around(48, 60.0, 4, &format!("{ball}{light}")), &bidirectional(64, 7))
    });
    assert_equal_energy(&map, &even, "an even sky as a map");
}
