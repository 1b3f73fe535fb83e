//! The extremes of METHODS 14 for the methods of Markov chains: finite, no panic, and the property that each row names.

use crate::support::mean::Mean;
use crate::support::scenes::{layer, render_finite, scaled, scene_around, scene_from, settings};
use crate::support::{LEVEL, sidak};
use quietlight::integrator::{
    Bdpt, Erpt, Integrator, Mlt, Mutations, PathTracing, PrimaryPaths, Pssmlt, Strategy,
};
use quietlight::render::{RenderSettings, Rendered};
use quietlight::scene::{LoadOptions, Scene};
use quietlight::transport::connect::Strategies;
use quietlight_denoise::{LUMINANCE, LayerKind, bilateral};
use rayon::prelude::*;

/// Comparisons of means in this file, at most: they share [`LEVEL`].
const COMPARISONS: usize = 1000;

/// Independent renders that a mean and its error come from.
const REPLICAS: u64 = 16;

/// All methods of Markov chains, with small pools of candidates.
fn methods() -> [(&'static str, Integrator); 6] {
    let pssmlt =
        |paths| Integrator::Pssmlt(Pssmlt { paths, bootstrap_samples: 1000, ..Pssmlt::default() });
    let mlt = |separate_direct| {
        Integrator::Mlt(Mlt { separate_direct, bootstrap_pairs: 1000, ..Mlt::default() })
    };
    let erpt = |seeds, separate_direct| {
        Integrator::Erpt(Erpt { seeds, separate_direct, ..Erpt::default() })
    };
    [
        ("pssmlt of both walks", pssmlt(PrimaryPaths::Bidirectional(Bdpt::default()))),
        ("pssmlt of the camera", pssmlt(PrimaryPaths::Camera(PathTracing::default()))),
        ("mlt", mlt(true)),
        ("mlt with direct light", mlt(false)),
        ("erpt", erpt(Strategies::ToLens, true)),
        ("erpt from the camera, with direct light", erpt(Strategies::FromCamera, false)),
    ]
}

fn rendered(scene: &Scene, integrator: Integrator, samples: u32, seed: u64) -> Rendered {
    let settings = RenderSettings { integrator, ..settings(samples, seed, Strategy::Mis) };
    let rendered = render_finite(scene, &settings);
    for (kind, layer) in &rendered.layers.layers {
        let halves = layer.halves.iter().flatten();
        for image in halves.chain([&layer.mean]).chain(&layer.variance) {
            assert!(image.iter().all(|value| value.is_finite()), "{kind:?} of {integrator:?}");
        }
    }
    rendered
}

/// Luminances of a picture: of all of it, of its upper half and of its left half. Chains have the first from their
/// normalisation alone; the others tell whether they also are where the light is.
fn parts(rendered: &Rendered) -> [f64; 3] {
    let beauty = layer(rendered, LayerKind::Beauty).0;
    let (_, height, width) = beauty.dim();
    let mut sums = [0.0; 3];
    for ((channel, y, x), &value) in beauty.indexed_iter() {
        let light = f64::from(LUMINANCE[channel] * value) * 3.0 / beauty.len() as f64;
        let belongs = [true, 2 * y < height, 2 * x < width];
        let counts = sums.iter_mut().zip(belongs).filter(|&(_, belongs)| belongs);
        counts.for_each(|(sum, _)| *sum += light);
    }
    sums
}

/// Mean luminance of the picture.
fn luminance(rendered: &Rendered) -> f64 {
    parts(rendered)[0]
}

/// Means of the [`parts`] of independent renders.
fn replicas(scene: &Scene, integrator: Integrator, count: u64, samples: u32) -> [Mean; 3] {
    let render = |seed| parts(&rendered(scene, integrator, samples, 100 + seed));
    let found: Vec<[f64; 3]> = (0..count).into_par_iter().map(render).collect();
    [0, 1, 2].map(|part| found.iter().map(|parts| parts[part]).collect())
}

/// Means agree, where errors of f32 count as none.
fn assert_same_mean(found: &[Mean; 3], expected: &[Mean; 3], what: &str) {
    for (part, (found, expected)) in found.iter().zip(expected).enumerate() {
        let (a, b) = (found.mean(), expected.mean());
        let is_equal = (a - b).abs() <= 1e-5 * b.abs();
        let p = if is_equal { 1.0 } else { found.p_same_as(expected) };
        let error = |mean: &Mean| mean.variance_of_mean().sqrt();
        assert!(
            p > sidak(LEVEL, COMPARISONS),
            "{what}, part {part}: {a} ± {}, expected {b} ± {}",
            error(found),
            error(expected)
        );
    }
}

/// The means of path tracing.
fn by_path(scene: &Scene, samples: u32) -> [Mean; 3] {
    replicas(scene, PathTracing::default().into(), REPLICAS, samples)
}

/// All methods have the means of path tracing, of 8 mutations per pixel.
fn assert_like_path(scene: &Scene, what: &str) {
    let expected = by_path(scene, 64);
    for (name, integrator) in methods() {
        let found = replicas(scene, integrator, REPLICAS, 8);
        assert_same_mean(&found, &expected, &format!("{what}, {name}"));
    }
}

fn fact<'a>(rendered: &'a Rendered, name: &str) -> &'a str {
    let found = rendered.report.facts.iter().find(|(fact, _)| fact == name);
    found.map_or_else(|| panic!("no fact {name}"), |(_, value)| value)
}

const GREY: &str = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf>"#;

/// A room of two walls and a ball of `bsdf` under a lamp.
fn room(depth: i32, bsdf: &str) -> Scene {
    scene_around(
        12,
        60.0,
        depth,
        &format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
            <translate y="-1" z="-3"/></transform>{GREY}</shape>
        <shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-5"/></transform>{GREY}</shape>
        <shape type="sphere"><point name="center" x="0.3" y="-0.3" z="-3.4"/><float name="radius" value="0.7"/>{bsdf}</shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="1.5"/>
            <translate y="1.6" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#
        ),
    )
}

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
    for inside in ["", ball, &hidden, &format!("{ball}{black}")] {
        let scene = scene_around(6, 60.0, -1, inside);
        for (name, integrator) in methods() {
            let rendered = rendered(&scene, integrator, 4, 1);
            let (mean, variance) = layer(&rendered, LayerKind::Beauty);
            assert!(mean.iter().chain(variance).all(|&value| value == 0.0), "{name}");
            let warnings = &rendered.report.warnings;
            assert!(warnings.iter().any(|told| told.contains("no light")), "{name}: {warnings:?}");
            let usual = bilateral::Parameters::default();
            let denoised = bilateral::denoise(&rendered.layers, &usual, &|_| {}).expect("denoised");
            assert!(denoised.image.iter().all(|&value| value == 0.0), "{name}");
        }
    }
}

#[test]
fn pictures_of_few_pixels_are_as_bright_as_path_traced_ones() {
    let mut scene = room(5, r#"<bsdf type="conductor"/>"#);
    for crop in [[4, 5, 1, 1], [6, 0, 1, 12], [0, 7, 12, 1], [3, 8, 2, 2]] {
        scene.film.crop = crop;
        let expected = by_path(&scene, 256);
        for (name, integrator) in methods() {
            let found = replicas(&scene, integrator, REPLICAS, 64);
            assert_same_mean(&found, &expected, &format!("{crop:?}, {name}"));
        }
    }
    // The whole film is one pixel.
    let text = r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/></shape>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;
    assert_like_path(&scene_around(1, 60.0, 4, text), "one pixel");
    assert_like_path(&scene_around(2, 60.0, 4, text), "two by two");
}

#[test]
fn a_crop_window_gets_all_the_light_of_its_chains_and_no_other() {
    // The mean luminance of the picture is the normalisation only if no chain is ever outside, not even to begin with.
    let mut scene = room(5, GREY);
    scene.film.crop = [7, 1, 4, 10];
    let chains = [
        Integrator::Mlt(Mlt { bootstrap_pairs: 1000, separate_direct: false, ..Mlt::default() }),
        Integrator::Pssmlt(Pssmlt { bootstrap_samples: 1000, ..Pssmlt::default() }),
    ];
    for integrator in chains {
        let rendered = rendered(&scene, integrator, 64, 2);
        let (mean, _) = fact(&rendered, "normalisation").split_once(' ').expect("b ± its error");
        let (mean, found): (f64, f64) = (mean.parse().expect("b"), luminance(&rendered));
        assert!((found / mean - 1.0).abs() < 1e-5, "{}: {found}, not {mean}", integrator.name());
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
fn a_scene_is_as_bright_at_every_scale_and_far_from_the_origin() {
    let expected = by_path(&scaled(12, 6, 1.0, 0.0), 256);
    for (scale, offset) in [(1e-4, 0.0), (1e7, 0.0), (1.0, 1e6)] {
        let scene = scaled(12, 6, scale, offset);
        for (name, integrator) in methods() {
            let found = replicas(&scene, integrator, REPLICAS, 16);
            assert_same_mean(&found, &expected, &format!("{scale}, {offset}, {name}"));
        }
    }
}

#[test]
fn roughness_goes_to_zero_without_a_break() {
    let scene = |alpha: &str| {
        let bsdf =
            format!(r#"<bsdf type="roughconductor"><float name="alpha" value="{alpha}"/></bsdf>"#);
        room(4, &bsdf)
    };
    for alpha in ["1", "0.1", "0.01", "0.001", "0.0001", "0"] {
        assert_like_path(&scene(alpha), &format!("roughness {alpha}"));
    }
}

#[test]
fn paths_are_as_long_as_they_may_be_and_no_longer() {
    for depth in [1, 2, 100, -1] {
        for hides in [false, true] {
            let mut scene = room(depth, r#"<bsdf type="dielectric"/>"#);
            scene.limits.hide_emitters = hides;
            // The lamp is seen from behind alone: let the camera look up at it.
            scene.film.crop = [0, 0, 12, 7];
            assert_like_path(&scene, &format!("{depth} edges, emitters hidden: {hides}"));
        }
    }
}

#[test]
fn chains_that_cannot_move_have_the_mean_of_their_seeds_and_tell() {
    let scene = room(5, GREY);
    let expected = by_path(&scene, 64);
    let mutations =
        Mutations { bidirectional: false, lens: false, caustic: false, multi_chain: false };
    let mlt = Mlt { mutations, bootstrap_pairs: 1000, separate_direct: false };
    let found = replicas(&scene, Integrator::Mlt(mlt), 2 * REPLICAS, 16);
    assert_same_mean(&found, &expected, "stuck mlt");
    // 64 chains of 36 mutations for 144 pixels.
    let told = rendered(&scene, Integrator::Mlt(mlt), 16, 1);
    assert_eq!(fact(&told, "chains"), "64 of 36 mutations");
    assert_eq!(fact(&told, "longest_stay"), "36 mutations");
    let erpt = Erpt { mutations, ..Erpt::default() };
    let found = replicas(&scene, Integrator::Erpt(erpt), REPLICAS, 16);
    assert_same_mean(&found, &expected, "stuck erpt");
}

#[test]
fn chains_of_one_mutation_that_share_a_few_seeds_are_right_on_average() {
    let mut scene = room(4, GREY);
    scene.film.crop = [2, 4, 8, 8];
    let expected = by_path(&scene, 64);
    // 64 chains of one mutation each, from eight pairs of walks a half. The means of such small pools are far from normal,
    // but 500 of them are not.
    let few = Mlt { bootstrap_pairs: 16, separate_direct: false, ..Mlt::default() };
    let one = rendered(&scene, Integrator::Mlt(few), 1, 3);
    assert_eq!(fact(&one, "chains"), "64 of 1 mutations");
    let found = replicas(&scene, Integrator::Mlt(few), 500, 1);
    assert_same_mean(&found, &expected, "mlt");
    let few = Pssmlt { bootstrap_samples: 16, ..Pssmlt::default() };
    let found = replicas(&scene, Integrator::Pssmlt(few), 500, 1);
    assert_same_mean(&found, &expected, "pssmlt");
}

#[test]
fn two_seeds_of_mlt_agree_within_the_errors_that_they_tell() {
    let scene = room(5, r#"<bsdf type="plastic"/>"#);
    let mlt = Mlt { bootstrap_pairs: 20_000, separate_direct: false, ..Mlt::default() };
    let [a, b] = [1, 2].map(|seed| rendered(&scene, Integrator::Mlt(mlt), 500, seed));
    // The mean luminance is the normalisation, to rounding: that is all the error that it has.
    let [of_a, of_b] = [&a, &b].map(|rendered| {
        let (mean, error) = fact(rendered, "normalisation").split_once(" ± ").expect("an error");
        let (mean, error): (f64, f64) = (mean.parse().expect("b"), error.parse().expect("error"));
        let found = luminance(rendered);
        assert!((found / mean - 1.0).abs() < 1e-5, "{found}, normalisation {mean}");
        assert!(error > 0.0 && error < 0.03 * mean, "{mean} ± {error}");
        (mean, error)
    });
    // Two-sided 10⁻⁴.
    let z = (of_a.0 - of_b.0) / of_a.1.hypot(of_b.1);
    assert!(z.abs() < 3.9, "{of_a:?} and {of_b:?}");
    // Pixel by pixel, by the variances of the layers: they depend on each other, which counts as a quarter of them.
    let ((mean_a, variance_a), (mean_b, variance_b)) =
        (layer(&a, LayerKind::Beauty), layer(&b, LayerKind::Beauty));
    let (mut squares, mut count) = (0.0, 0.0);
    for (at, a) in mean_a.indexed_iter() {
        let variance = f64::from(variance_a[at]) + f64::from(variance_b[at]);
        if variance > 0.0 {
            squares += f64::from(a - mean_b[at]).powi(2) / variance;
            count += 1.0;
        }
    }
    let (mean_square, pixels) = (squares / count, count / 3.0);
    let bound = 1.0 + 4.0 * (2.0 / (pixels / 4.0)).sqrt();
    assert!(mean_square < bound, "mean z² {mean_square:.2} of {pixels} pixels, bound {bound:.2}");
}

#[test]
fn a_lens_of_radius_zero_is_a_pinhole() {
    let scene = |sensor: &str| {
        scene_from(&format!(
            r#"<scene version="3.0.0"><sensor {sensor}<float name="fov" value="40"/>
                <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
                <film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="12"/></film></sensor>
            <shape type="sphere"/><emitter type="constant"/></scene>"#
        ))
    };
    let lens = r#"type="thinlens"><float name="aperture_radius" value="0"/><float name="focus_distance" value="5"/>"#;
    let expected = by_path(&scene(r#"type="perspective">"#), 64);
    let scene = scene(lens);
    for (name, integrator) in methods() {
        assert_same_mean(&replicas(&scene, integrator, REPLICAS, 8), &expected, name);
    }
}

#[test]
fn cameras_inside_glass_inside_a_light_and_on_a_surface_see_something_finite() {
    let sky = r#"<emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;
    let glass = format!(r#"<shape type="sphere"><bsdf type="dielectric"/></shape>{sky}"#);
    let lamp = r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>"#;
    assert_like_path(&scene_around(6, 60.0, 6, &glass), "inside glass");
    assert_like_path(&scene_around(6, 60.0, 6, lamp), "inside a light");
    let surface = format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale value="5"/></transform></shape>{sky}"#
    );
    let scene = scene_around(6, 60.0, 6, &surface);
    for (_, integrator) in methods() {
        rendered(&scene, integrator, 8, 1);
    }
}

#[test]
fn masks_are_seen_through_alike() {
    let mask = |opacity: f32| {
        format!(
            r#"<bsdf type="mask"><float name="opacity" value="{opacity}"/><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf>"#
        )
    };
    for opacity in [0.0, 0.4, 1.0] {
        assert_like_path(&room(6, &mask(opacity)), &format!("opacity {opacity}"));
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
