//! The layers beside the picture (METHODS 8, DESIGN 4): what each holds, and how sure it claims to be.

mod certainty;
mod features;

use crate::support::LEVEL;
use crate::support::mean::{Mean, p_of_z};
use crate::support::scenes::{
    assert_equal_energy_of, layer, mean_and_error_of, render_finite, scene_around, scene_from,
    settings,
};
use glam::Vec3;
use quietlight::integrator::PathSample;
use quietlight::integrator::Strategy::{Bsdf, Light, Mis};
use quietlight::render::{RenderSettings, Rendered, SamplerKind, render, replay};
use quietlight::scene::{Requirements, Scene};
use quietlight_denoise::LayerKind;
use std::sync::atomic::AtomicBool;

/// Plastic, glass, metal and a light that the camera sees, in an even sky.
fn still_life(size: u32) -> Scene {
    scene_around(
        size,
        60.0,
        6,
        r#"<shape type="sphere"><point name="center" x="-1" y="0" z="-4"/>
            <bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.6 0.3 0.1"/></bsdf></shape>
        <shape type="sphere"><point name="center" x="1" y="-0.4" z="-3"/><float name="radius" value="0.6"/>
            <bsdf type="dielectric"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="5"/>
            <translate y="-1" z="-4"/></transform><bsdf type="roughplastic"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="70"/><scale value="0.7"/>
            <translate y="1.7" z="-4"/></transform><emitter type="area"><rgb name="radiance" value="7 6 5"/></emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="0.2 0.3 0.4"/></emitter>"#,
    )
}

/// Samples of one pixel, by replay.
fn samples(scene: &Scene, pixel: [u32; 2], count: u32) -> Vec<PathSample> {
    (0..count).map(|sample| replay(scene, &settings(1, 1, Mis), pixel, sample, |_| {})).collect()
}

/// Is every number of that layer's mean `expected`, up to rounding?
fn assert_constant(rendered: &Rendered, kind: LayerKind, expected: &[f32]) {
    let mean = layer(rendered, kind).0;
    for ((channel, y, x), &value) in mean.indexed_iter() {
        let wanted = expected[channel];
        assert!(
            (value - wanted).abs() <= 1e-4 * wanted.abs(),
            "{kind:?} is {value} in channel {channel} at ({x}, {y}), expected {wanted}"
        );
    }
}

#[test]
fn diffuse_and_specular_sum_to_the_beauty_to_the_last_bit() {
    let scene = still_life(24);
    for (samples, sampler) in [(5, SamplerKind::Independent), (8, SamplerKind::Sobol)] {
        let rendered =
            render_finite(&scene, &RenderSettings { sampler, ..settings(samples, 2, Mis) });
        let [beauty, diffuse, specular] =
            [LayerKind::Beauty, LayerKind::Diffuse, LayerKind::Specular]
                .map(|kind| &rendered.layers.layers[&kind]);
        assert!(diffuse.mean.iter().any(|&v| v > 0.0) && specular.mean.iter().any(|&v| v > 0.0));
        assert_eq!(beauty.mean, &diffuse.mean + &specular.mean);
        let halves = |layer: &quietlight_denoise::Layer| {
            layer.halves.clone().expect("the film gives halves")
        };
        let ([a, b], [da, db], [sa, sb]) = (halves(beauty), halves(diffuse), halves(specular));
        assert_eq!((a, b), (da + sa, db + sb));
    }
    // A scene without a specular layer: all of it is diffuse.
    let rendered = render_finite(&point_lit_floor(8), &settings(4, 3, Mis));
    assert_eq!(layer(&rendered, LayerKind::Beauty).0, layer(&rendered, LayerKind::Diffuse).0);
}

/// A diffuse floor under a point light that fills the view of a camera that looks down.
fn point_lit_floor(max_depth: i32) -> Scene {
    scene_around(
        8,
        40.0,
        max_depth,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="-2"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.2 0.4 0.6"/></bsdf></shape>
        <emitter type="point"><point name="position" x="1" y="0" z="1"/><rgb name="intensity" value="9"/></emitter>"#,
    )
}

#[test]
fn the_light_is_split_alike_by_every_strategy() {
    // METHODS 8.1: light samples are split by the parts of the scattering, walks by the parts of their weight.
    let scene = still_life(48);
    let [light, bsdf, both] = [(Light, 4), (Bsdf, 5), (Mis, 6)]
        .map(|(strategy, seed)| render_finite(&scene, &settings(256, seed, strategy)));
    assert_equal_energy_of(
        LayerKind::Diffuse,
        &light,
        &both,
        "diffuse by light sampling and by both",
    );
    assert_equal_energy_of(LayerKind::Diffuse, &bsdf, &both, "diffuse by walking and by both");
    assert_equal_energy_of(LayerKind::Specular, &bsdf, &both, "specular by walking and by both");
}

#[test]
fn only_light_scattered_by_a_diffuse_lobe_at_the_first_hit_is_diffuse() {
    let show = |surface: &str| {
        let scene = scene_around(
            8,
            20.0,
            -1,
            &format!(
                r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/>{surface}</shape>
                <shape type="sphere"><float name="radius" value="20"/><boolean name="flip_normals" value="true"/>
                <bsdf type="diffuse"/></shape>
                <emitter type="point"><point name="position" x="0" y="3" z="0"/><rgb name="intensity" value="99"/></emitter>"#
            ),
        );
        render_finite(&scene, &settings(16, 13, Mis))
    };
    let black =
        |rendered: &Rendered, kind| layer(rendered, kind).0.iter().all(|&value| value == 0.0);
    for surface in [
        r#"<bsdf type="conductor"/>"#,
        r#"<bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf>"#,
        r#"<bsdf type="dielectric"/>"#,
        r#"<bsdf type="thindielectric"/>"#,
        r#"<bsdf type="roughdielectric"><float name="alpha" value="0.3"/></bsdf>"#,
        r#"<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter>"#,
    ] {
        let rendered = show(surface);
        assert!(black(&rendered, LayerKind::Diffuse), "{surface}");
        assert!(!black(&rendered, LayerKind::Specular), "{surface}");
    }
    let rendered = show(r#"<bsdf type="diffuse"/>"#);
    assert!(!rendered.layers.layers.contains_key(&LayerKind::Specular));
    assert!(!black(&rendered, LayerKind::Diffuse));
    let rendered = show(r#"<bsdf type="plastic"/>"#);
    assert!(!black(&rendered, LayerKind::Diffuse) && !black(&rendered, LayerKind::Specular));
}

#[test]
fn what_a_scene_does_not_require_is_not_there() {
    let kinds = |scene: &Scene| -> Vec<LayerKind> {
        render_finite(scene, &settings(2, 15, Mis)).layers.layers.into_keys().collect()
    };
    let without = |left_out: &[LayerKind]| -> Vec<LayerKind> {
        LayerKind::ALL.into_iter().filter(|kind| !left_out.contains(kind)).collect()
    };
    let ball = |surface: &str| {
        scene_around(
            4,
            20.0,
            5,
            &format!(
                r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/>{surface}</shape>"#
            ),
        )
    };
    assert_eq!(kinds(&still_life(4)), LayerKind::ALL);
    assert_eq!(kinds(&point_lit_floor(5)), without(&[LayerKind::Specular]));
    assert_eq!(kinds(&point_lit_floor(1)), without(&[LayerKind::Specular, LayerKind::Texture2]));
    assert_eq!(kinds(&ball("")), without(&[LayerKind::Specular, LayerKind::Visibility]));
    assert_eq!(kinds(&ball(r#"<bsdf type="conductor"/>"#)), without(&[LayerKind::Visibility]));
    // A light that the camera may not see, and diffuse surfaces.
    let mut hidden = ball(r#"<emitter type="area"><rgb name="radiance" value="1"/></emitter>"#);
    assert_eq!(kinds(&hidden), LayerKind::ALL);
    hidden.limits.hide_emitters = true;
    assert_eq!(kinds(&hidden), without(&[LayerKind::Specular]));
    assert!(Requirements::of(&hidden).left_out().iter().any(|line| line.contains("specular")));
}

#[test]
fn a_layer_that_is_left_out_would_have_been_black() {
    // What hidden emitters send to the camera directly is the only specular light of a diffuse scene.
    let mut scene = still_life(8);
    for index in 0..64 {
        for hide in [false, true] {
            scene.limits.hide_emitters = hide;
            let pixel = [index % 8, index / 8];
            let sample = replay(&scene, &settings(1, 16, Mis), pixel, 0, |_| {});
            let is_miss = sample.position == Vec3::ZERO && sample.normal == Vec3::ZERO;
            assert!(!(hide && is_miss) || sample.specular.is_black(), "{sample:?}");
        }
    }
    let floor = point_lit_floor(-1);
    assert!(
        samples(&floor, [4, 4], 64)
            .iter()
            .all(|sample| sample.specular.is_black() && !sample.diffuse.is_black())
    );
}

#[test]
fn a_sample_that_overflows_is_dropped_and_counted() {
    let counts = |rendered: &Rendered| {
        let samples = rendered.layers.samples.clone().expect("the film counts");
        (samples, rendered.layers.invalid.clone().expect("the film counts"))
    };
    let (samples, invalid) = counts(&render_finite(&still_life(8), &settings(5, 17, Mis)));
    assert!(samples.iter().all(|&count| count == 5.0) && invalid.iter().all(|&count| count == 0.0));
    // Radiance near the largest float: light samples of it overflow, the rest of the picture stays.
    let scene = scene_around(
        16,
        60.0,
        2,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="0.5"/><translate z="-3"/></transform></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="50"/><rotate x="1" angle="180"/>
            <translate z="2"/></transform><emitter type="area"><rgb name="radiance" value="3e38"/></emitter></shape>"#,
    );
    let rendered = render(&scene, &settings(8, 18, Light), &|_| {}, &AtomicBool::new(false));
    let (samples, invalid) = counts(&rendered);
    assert!((&samples + &invalid).iter().all(|&count| count == 8.0));
    assert!(invalid.iter().any(|&count| count > 0.0) && samples.iter().any(|&count| count > 0.0));
    let total: f64 = invalid.iter().map(|&count| f64::from(count)).sum();
    assert_eq!(total, rendered.invalid_samples as f64);
    for layer in rendered.layers.layers.values() {
        assert!(layer.mean.iter().all(|value| value.is_finite()));
    }
}
