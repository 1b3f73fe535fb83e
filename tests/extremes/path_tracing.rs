//! Path tracing, the film and the buffers at their extremes, against closed forms.

use super::speck_and_sheet;
use crate::support::scenes::{
    assert_equal_energy, assert_mean, layer, mean_and_error, render_finite, scaled, scene_around,
    scene_from, settings,
};
use quietlight::integrator::Strategy::{Bsdf, Light, Mis};
use quietlight::render::replay;
use quietlight::scene::Scene;
use quietlight_denoise::{LayerKind, bilateral};

/// A rough metal ball over a floor in an even sky with an area light.
fn metal_ball(bsdf: &str) -> Scene {
    scene_around(
        48,
        50.0,
        6,
        &format!(
            r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/>{bsdf}</shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="5"/>
            <translate y="-1" z="-4"/></transform><bsdf type="diffuse"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/>
            <translate y="3" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="4"/></emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>"#
        ),
    )
}

#[test]
fn roughness_goes_to_zero_without_a_break() {
    let metal = |alpha: &str| {
        metal_ball(&format!(
            r#"<bsdf type="roughconductor"><float name="alpha" value="{alpha}"/></bsdf>"#
        ))
    };
    for alpha in ["1", "0.1", "0.01", "0.001", "0.0001", "0"] {
        render_finite(&metal(alpha), &settings(16, 1, Mis));
    }
    let delta = render_finite(&metal_ball(r#"<bsdf type="conductor"/>"#), &settings(256, 2, Mis));
    assert_equal_energy(
        &render_finite(&metal("0"), &settings(256, 3, Mis)),
        &delta,
        "roughness 0 and delta",
    );
    assert_equal_energy(
        &render_finite(&metal("0.0001"), &settings(256, 4, Mis)),
        &delta,
        "roughness 1e-4 and delta",
    );
    // The smallest roughness that is still a smooth lobe: its mean is that of the mirror up to a blur of 2e-4.
    assert_equal_energy(
        &render_finite(&metal("0.0002"), &settings(256, 5, Mis)),
        &delta,
        "roughness 2e-4 and delta",
    );
}

#[test]
fn rough_glass_goes_to_smooth_glass_without_a_break() {
    let glass = |alpha: &str| {
        metal_ball(&format!(
            r#"<bsdf type="roughdielectric"><float name="alpha" value="{alpha}"/></bsdf>"#
        ))
    };
    let delta = render_finite(&metal_ball(r#"<bsdf type="dielectric"/>"#), &settings(1024, 6, Mis));
    assert_equal_energy(
        &render_finite(&glass("0.0002"), &settings(1024, 7, Mis)),
        &delta,
        "rough and smooth glass",
    );
}

#[test]
fn walks_between_perfect_mirrors_end() {
    // Nothing leaves a ball of mirrors, and nothing is absorbed: only roulette, which lets 95 % pass, ends a walk. That a
    // thousand hits follow each other has a probability of 1e-21. (The limit is for a renderer that fails the test.)
    let scene = scene_around(
        8,
        60.0,
        100_000,
        r#"<shape type="sphere"><point name="center" x="0.3" y="0.2" z="0"/><boolean name="flip_normals" value="true"/>
        <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>"#,
    );
    let mut longest = 0;
    for pixel in (0..8).flat_map(|y| (0..8).map(move |x| [x, y])) {
        replay(&scene, &settings(1, 8, Mis), pixel, 0, |vertex| {
            longest = longest.max(vertex.depth);
        });
    }
    assert!((6..1000).contains(&longest), "{longest} hits");
    let rendered = render_finite(&scene, &settings(16, 8, Mis));
    assert!(layer(&rendered, LayerKind::Beauty).0.iter().all(|&value| value == 0.0));
}

#[test]
fn a_light_of_1e_minus_8_survives_next_to_one_of_1e8() {
    // Two rooms apart, each lit by its own light and hidden from the other: an integrating sphere of 1e-8 around the
    // camera, and one of 1e8 elsewhere. Nearly all light samples go to the bright one, and see nothing of it.
    let sphere = |x: f32, radiance: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" x="{x}" y="0" z="0"/>
            <boolean name="flip_normals" value="true"/><bsdf type="diffuse"/>
            <emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter></shape>"#
        )
    };
    let scene =
        scene_around(8, 60.0, -1, &format!("{}{}", sphere(0.0, "1e-8"), sphere(10.0, "1e8")));
    let rendered = render_finite(&scene, &settings(2048, 9, Mis));
    assert_mean(mean_and_error(&rendered), 2e-8, 0.02, "the dim sphere");
}

#[test]
fn a_speck_of_a_light_and_a_huge_one_are_chosen_by_their_power() {
    let (scene, expected) = speck_and_sheet(0.01);
    let rendered = render_finite(&scene, &settings(4096, 10, Light));
    assert_mean(mean_and_error(&rendered), expected, 0.05, "speck and sheet");
}

#[test]
fn a_scene_looks_the_same_at_every_scale_and_far_from_the_origin() {
    let plain = render_finite(&scaled(48, -1, 1.0, 0.0), &settings(256, 11, Mis));
    for (scale, offset) in
        [(1e-4, 0.0), (1e-2, 0.0), (1e3, 0.0), (1e7, 0.0), (1.0, 1e6), (1e-2, 1e4), (1e4, 1e6)]
    {
        let other = render_finite(&scaled(48, -1, scale, offset), &settings(256, 12, Mis));
        assert_equal_energy(&other, &plain, &format!("scale {scale}, offset {offset}"));
    }
}

#[test]
fn light_in_the_plane_of_its_receiver_gives_nothing() {
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
    // The second shines down at the lowest row of pixels; all wall above it is behind it. The first shows at the right.
    for strategy in [Mis, Light, Bsdf] {
        let rendered = render_finite(&scene, &settings(64, 13, strategy));
        let mean = layer(&rendered, LayerKind::Beauty).0;
        let behind = mean.slice(ndarray::s![.., ..5, ..6]);
        assert!(behind.iter().all(|&value| value == 0.0), "{strategy:?}: {behind}");
        let lit = mean.slice(ndarray::s![.., 7, ..]);
        assert!(lit.iter().all(|&value| value > 0.0), "{strategy:?}: {lit}");
    }
}

#[test]
fn five_hundred_bounces_off_white_walls_stay_finite() {
    // Σ ρ^k over 500 edges at ρ = 0.999, and without a limit.
    let inside = r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.999"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#;
    let mut scene = scene_around(4, 60.0, 500, inside);
    scene.limits.rr_depth = 1000;
    let rendered = render_finite(&scene, &settings(16, 14, Bsdf));
    let expected = (1.0 - 0.999f64.powi(500)) / 0.001;
    let (mean, _) = mean_and_error(&rendered);
    assert!((mean / expected - 1.0).abs() < 1e-4, "{mean}, expected {expected}");
    // Without a limit roulette ends every walk. (Its survival of at most 95 % against an albedo of 0.999 makes the
    // variance infinite, so that no mean can be tested.)
    render_finite(&scene_around(4, 60.0, -1, inside), &settings(256, 15, Mis));
}

#[test]
fn nearly_black_surfaces_end_walks_without_a_zero_by_zero() {
    let scene = scene_around(
        4,
        60.0,
        -1,
        r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="1e-12"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#,
    );
    assert_mean(
        mean_and_error(&render_finite(&scene, &settings(64, 16, Mis))),
        1.0,
        0.01,
        "black sphere",
    );
}

#[test]
fn without_light_the_picture_is_black_and_the_filter_leaves_it_so() {
    let scene = scene_around(
        8,
        60.0,
        -1,
        r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/></shape>"#,
    );
    let rendered = render_finite(&scene, &settings(4, 17, Mis));
    let denoised = bilateral::denoise(&rendered.layers, &bilateral::Parameters::default(), &|_| {})
        .expect("denoised");
    assert!(denoised.image.iter().all(|&value| value == 0.0));
    assert!(
        !rendered.layers.layers.contains_key(&LayerKind::Visibility),
        "no shadow ray, no visibility"
    );
    let empty = scene_around(8, 60.0, -1, "");
    assert!(
        layer(&render_finite(&empty, &settings(4, 18, Mis)), LayerKind::Beauty)
            .0
            .iter()
            .all(|&v| v == 0.0)
    );
}

#[test]
fn pictures_of_one_row_or_one_pixel_render_and_denoise() {
    let mut scene = metal_ball(r#"<bsdf type="diffuse"/>"#);
    for crop in [[0, 0, 1, 1], [5, 7, 1, 20], [5, 7, 20, 1], [0, 0, 2, 2]] {
        scene.film.crop = crop;
        for samples in [1, 4] {
            let rendered = render_finite(&scene, &settings(samples, 19, Mis));
            let denoised =
                bilateral::denoise(&rendered.layers, &bilateral::Parameters::default(), &|_| {})
                    .expect("denoised");
            assert_eq!(denoised.image.dim(), (3, crop[3] as usize, crop[2] as usize));
            assert!(denoised.image.iter().all(|value| value.is_finite()));
        }
    }
}

#[test]
fn a_picture_65536_wide_renders_to_its_last_column() {
    // A wall of light fills the view; its left half is red, so that columns that wrap around would show.
    let scene = scene_from(
        r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="90"/>
        <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="65536"/><integer name="height" value="2"/>
            <rfilter type="box"/></film></sensor>
        <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate x="-2" z="-1"/></transform>
            <emitter type="area"><rgb name="radiance" value="1 0 0"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate x="2" z="-1"/></transform>
            <emitter type="area"><rgb name="radiance" value="0 0 1"/></emitter></shape></scene>"#,
    );
    let rendered = render_finite(&scene, &settings(1, 20, Bsdf));
    let beauty = layer(&rendered, LayerKind::Beauty).0;
    assert_eq!(beauty.dim(), (3, 2, 65536));
    let column = |x: usize| [0, 1, 2].map(|channel| beauty[[channel, 1, x]] > 0.5);
    for x in 0..65536 {
        let expected = if x < 32768 { [true, false, false] } else { [false, false, true] };
        assert_eq!(column(x), expected, "column {x}");
    }
}

#[test]
fn cameras_inside_glass_inside_a_light_and_on_a_surface_see_something_finite() {
    let inside_glass = r#"<shape type="sphere"><bsdf type="dielectric"/></shape>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;
    let rendered =
        render_finite(&scene_around(8, 60.0, -1, inside_glass), &settings(1024, 22, Mis));
    // Looking out of glass (bk7 in air), radiance is compressed by n² for an observer in the glass (Mitsuba's convention).
    assert_mean(mean_and_error(&rendered), (1.5046f64 / 1.000277).powi(2), 0.02, "inside glass");
    let inside_light = r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>"#;
    let rendered = render_finite(&scene_around(8, 60.0, -1, inside_light), &settings(4, 23, Mis));
    assert_mean(mean_and_error(&rendered), 2.0, 0.01, "inside a light");
    let on_a_surface = r#"<shape type="rectangle"><transform name="to_world"><scale value="5"/></transform></shape>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;
    render_finite(&scene_around(8, 60.0, -1, on_a_surface), &settings(4, 24, Mis));
}

#[test]
fn a_lens_of_radius_zero_is_a_pinhole() {
    let scene = |sensor: &str| {
        scene_from(&format!(
            r#"<scene version="3.0.0">
            <sensor {sensor}<float name="fov" value="40"/>
                <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
                <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
            <shape type="sphere"/><emitter type="constant"/></scene>"#
        ))
    };
    let lens = r#"type="thinlens"><float name="aperture_radius" value="0"/><float name="focus_distance" value="5"/>"#;
    let lens = render_finite(&scene(lens), &settings(4, 25, Mis));
    let pinhole = render_finite(&scene(r#"type="perspective">"#), &settings(4, 25, Mis));
    let (lens, pinhole) = (layer(&lens, LayerKind::Beauty).0, layer(&pinhole, LayerKind::Beauty).0);
    for (a, b) in lens.iter().zip(pinhole) {
        assert!((a - b).abs() < 1e-4, "{a} and {b}");
    }
}

#[test]
fn environments_of_one_texel_or_with_a_nan_light_as_what_is_left_of_them() {
    let ball = |texels: &image::Rgb32FImage| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        texels.save(folder.path().join("sky.exr")).expect("the sky is written");
        let text = r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="10"/>
            <transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>
                <rfilter type="box"/></film></sensor>
            <shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
            <emitter type="envmap"><string name="filename" value="sky.exr"/></emitter></scene>"#;
        let file = folder.path().join("scene.xml");
        std::fs::write(&file, text).expect("the scene is written");
        Scene::load(&file, &Default::default()).expect("the scene loads")
    };
    // One texel is an even sky: the ball shows its albedo times it.
    let one = ball(&image::Rgb32FImage::from_pixel(1, 1, image::Rgb([2.0; 3])));
    for strategy in [Light, Bsdf, Mis] {
        let rendered = render_finite(&one, &settings(1024, 27, strategy));
        assert_mean(mean_and_error(&rendered), 1.0, 0.01, &format!("one texel, {strategy:?}"));
    }
    // A texel that is no radiance is black, for every strategy, and said to be.
    let mut spoiled = image::Rgb32FImage::from_pixel(8, 4, image::Rgb([2.0; 3]));
    spoiled.put_pixel(3, 1, image::Rgb([f32::NAN, 1.0, 1.0]));
    let spoiled = ball(&spoiled);
    assert!(!spoiled.warnings.is_empty());
    let both = render_finite(&spoiled, &settings(512, 28, Mis));
    let (mean, _) = mean_and_error(&both);
    assert!(mean > 0.0 && mean <= 1.0, "{mean}");
    let walked = render_finite(&spoiled, &settings(512, 29, Bsdf));
    let ((a, da), (b, db)) = (mean_and_error(&both), mean_and_error(&walked));
    assert!((a - b).abs() < 4.4 * da.hypot(db), "{a} ± {da} and {b} ± {db}");
    // A black sky is no light, and leaves the picture black.
    let black = ball(&image::Rgb32FImage::new(4, 2));
    let rendered = render_finite(&black, &settings(4, 30, Mis));
    assert!(layer(&rendered, LayerKind::Beauty).0.iter().all(|&value| value == 0.0));
}

#[test]
fn degenerate_triangles_are_left_out_and_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    // One sound triangle; one of no area, one with a vertex twice, one sliver, one with a NaN.
    let obj = "v -1 -1 -3\nv 1 -1 -3\nv 0 1 -3\nv 0 0 -3\nv 2 0 -3\nv 4 0 -3\nv 0 1e-12 -3\nv nan 0 0\n\
        f 1 2 3\nf 4 5 6\nf 1 1 2\nf 4 5 7\nf 1 2 8\n";
    std::fs::write(folder.path().join("mesh.obj"), obj).expect("the mesh is written");
    let text = r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="60"/>
        <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
        <shape type="obj"><string name="filename" value="mesh.obj"/>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="5"/><translate z="-4"/></transform></shape></scene>"#;
    let file = folder.path().join("scene.xml");
    std::fs::write(&file, text).expect("the scene is written");
    let scene = Scene::load(&file, &Default::default()).expect("the scene loads");
    assert!(
        scene.warnings.iter().any(|warning| warning.contains("triangle")),
        "{:?}",
        scene.warnings
    );
    let rendered = render_finite(&scene, &settings(16, 26, Mis));
    assert!(
        layer(&rendered, LayerKind::Beauty).0.iter().any(|&value| value == 1.0),
        "the sound triangle shows"
    );
}
