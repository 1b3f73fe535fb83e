//! Pictures of primary sample space against those of the path tracer.

use crate::support::mean::{Mean, p_of_z};
use crate::support::scenes::{render_finite, scene_around, settings};
use crate::support::{LEVEL, sidak};
use quietlight::integrator::{Integrator, Pssmlt, Strategy};
use quietlight::render::{Budget, RenderSettings, Rendered};
use quietlight::scene::Scene;
use quietlight_denoise::{Image, LayerKind};
use std::time::{Duration, Instant};

/// A room with a mirror ball and a glossy floor, lit by a small lamp that shines at the ceiling.
pub(crate) fn room(lamp: &str) -> Scene {
    scene_around(
        16,
        60.0,
        5,
        &format!(
            r#"
        <bsdf type="twosided" id="red"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.2 0.1"/></bsdf></bsdf>
        <bsdf type="twosided" id="white"><bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></bsdf>
        <bsdf type="twosided" id="floor"><bsdf type="roughplastic"><float name="alpha" value="0.2"/>
            <rgb name="diffuse_reflectance" value="0.4 0.5 0.7"/></bsdf></bsdf>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/>
            <translate y="-1" z="-3"/></transform><ref id="floor"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="2"/>
            <translate y="1.5" z="-3"/></transform><ref id="white"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate z="-5"/></transform>
            <ref id="white"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="90"/><scale value="2"/>
            <translate x="-1.5" z="-3"/></transform><ref id="red"/></shape>
        <shape type="sphere"><point name="center" x="0.5" y="-0.5" z="-3"/><float name="radius" value="0.5"/>
            <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="0.4"/>
            <translate y="0.4" z="-3.5"/></transform><bsdf type="diffuse"/>{lamp}</shape>"#
        ),
    )
}

pub(crate) const LAMP: &str =
    r#"<emitter type="area"><rgb name="radiance" value="8 7 5"/></emitter>"#;

fn chains(samples: u32, seed: u64) -> RenderSettings {
    let method = Pssmlt { bootstrap_samples: 2000, ..Pssmlt::default() };
    RenderSettings {
        integrator: Integrator::Pssmlt(method),
        ..settings(samples, seed, Strategy::Mis)
    }
}

/// Sum over the channels of the mean of each block of `side` pixels.
fn blocks(image: &Image, side: usize) -> Vec<f64> {
    let (channels, height, width) = image.dim();
    let mut blocks = Vec::new();
    for top in (0..height).step_by(side) {
        for left in (0..width).step_by(side) {
            let pixels = (0..channels)
                .flat_map(|c| (top..top + side).map(move |y| (c, y)))
                .flat_map(|(c, y)| (left..left + side).map(move |x| [c, y, x]));
            let sum: f64 = pixels.map(|at| f64::from(image[at])).sum();
            blocks.push(sum / (side * side) as f64);
        }
    }
    blocks
}

/// The blocks' means over renders with other seeds.
fn replicate(
    scene: &Scene,
    kind: LayerKind,
    side: usize,
    replicas: u64,
    of: impl Fn(u64) -> RenderSettings,
) -> Vec<Mean> {
    let mut means = Vec::new();
    for seed in 0..replicas {
        let rendered = render_finite(scene, &of(1000 + seed));
        let found = blocks(&rendered.layers.layers[&kind].mean, side);
        means.resize(found.len(), Mean::default());
        means.iter_mut().zip(found).for_each(|(mean, value)| mean.add(value));
    }
    means
}

/// Mean z² of the difference of two methods over the blocks, and the smallest p-value, by Welch's test.
fn compare(a: &[Mean], b: &[Mean]) -> (f64, f64) {
    let mut squares = 0.0;
    let mut smallest = 1.0f64;
    for (a, b) in a.iter().zip(b) {
        let variance = a.variance_of_mean() + b.variance_of_mean();
        squares += (a.mean() - b.mean()).powi(2) / variance;
        smallest = smallest.min(a.p_same_as(b));
    }
    (squares / a.len() as f64, smallest)
}

/// METHODS 12.1 for whole renders repeated: a sum of `n` squares of Student's t of `d` degrees has mean `d / (d − 2)`, and
/// blocks that depend on each other count as a quarter of them.
fn assert_same(a: &[Mean], b: &[Mean], what: &str) {
    let (mean_square, p) = compare(a, b);
    let degrees = (a[0].count().min(b[0].count()) - 1) as f64;
    let bound = degrees / (degrees - 2.0) * (1.0 + 4.0 * (8.0 / a.len() as f64).sqrt());
    assert!(mean_square < bound, "{what}: mean z² {mean_square:.2}, bound {bound:.2}");
    assert!(p > sidak(LEVEL, a.len()), "{what}: smallest p {p:.2e} of {} blocks", a.len());
}

#[test]
fn primary_sample_space_has_the_mean_of_path_tracing_in_every_block() {
    let scene = room(LAMP);
    let paths = |kind| replicate(&scene, kind, 4, 32, |seed| settings(256, seed, Strategy::Mis));
    let primary = |kind| replicate(&scene, kind, 4, 48, |seed| chains(200, seed));
    for kind in [LayerKind::Beauty, LayerKind::Diffuse, LayerKind::Specular] {
        assert_same(&primary(kind), &paths(kind), &format!("{kind:?}"));
    }
}

#[test]
fn few_candidates_and_short_chains_have_the_same_mean() {
    // 64 chains of four mutations from two pools of 20 samples: nearly all of the picture is where chains start.
    let scene = room(LAMP);
    let method = Pssmlt { bootstrap_samples: 40, ..Pssmlt::default() };
    let short = replicate(&scene, LayerKind::Beauty, 8, 3000, |seed| RenderSettings {
        integrator: Integrator::Pssmlt(method),
        budget: Budget::Samples(1),
        ..chains(1, seed)
    });
    let paths =
        replicate(&scene, LayerKind::Beauty, 8, 32, |seed| settings(256, seed, Strategy::Mis));
    assert_same(&short, &paths, "short chains");
}

fn on_threads(threads: usize, scene: &Scene, settings: &RenderSettings) -> Rendered {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| render_finite(scene, settings))
}

#[test]
fn one_two_and_eight_threads_give_the_same_bits_of_chains() {
    let mut scene = room(LAMP);
    scene.film.crop = [3, 2, 11, 9];
    let one = on_threads(1, &scene, &chains(900, 5));
    for threads in [2, 8] {
        let many = on_threads(threads, &scene, &chains(900, 5));
        assert_eq!((one.samples, &one.report), (many.samples, &many.report));
        for (kind, layer) in &one.layers.layers {
            let other = &many.layers.layers[kind];
            assert_eq!(layer.mean, other.mean, "{kind:?} on {threads} threads");
            assert_eq!(layer.variance, other.variance, "{kind:?} on {threads} threads");
            assert_eq!(layer.halves, other.halves, "{kind:?} on {threads} threads");
        }
    }
}

#[test]
fn a_crop_window_has_the_brightness_of_its_part_of_the_film() {
    let mut scene = room(LAMP);
    scene.film.crop = [4, 4, 8, 4];
    let window = replicate(&scene, LayerKind::Beauty, 4, 32, |seed| chains(400, seed));
    let paths =
        replicate(&scene, LayerKind::Beauty, 4, 32, |seed| settings(256, seed, Strategy::Mis));
    assert_same(&window, &paths, "crop window");
}

#[test]
fn a_black_scene_is_black_and_said_to_be() {
    let scene = room("");
    let rendered = render_finite(&scene, &chains(50, 1));
    for kind in [LayerKind::Beauty, LayerKind::Diffuse] {
        let layer = &rendered.layers.layers[&kind];
        assert!(layer.mean.iter().all(|&value| value == 0.0));
        assert!(layer.variance.as_ref().is_some_and(|v| v.iter().all(|&value| value == 0.0)));
    }
    assert_eq!(rendered.samples, 50);
    assert!(rendered.report.warnings.iter().any(|warning| warning.contains("black")));
    // What is seen there does not depend on light.
    assert!(rendered.layers.layers[&LayerKind::Albedo].mean.iter().any(|&value| value > 0.1));
}

#[test]
fn layers_of_chains_are_whole_and_their_variance_is_that_of_replicas() {
    let scene = room(LAMP);
    let mut pixel_mean: Vec<Mean> = Vec::new();
    let mut claimed = Mean::default();
    for seed in 0..64 {
        let rendered = render_finite(&scene, &chains(400, seed));
        let beauty = &rendered.layers.layers[&LayerKind::Beauty];
        let sum = &rendered.layers.layers[&LayerKind::Diffuse].mean
            + &rendered.layers.layers[&LayerKind::Specular].mean;
        assert_eq!(beauty.mean, sum);
        pixel_mean.resize(beauty.mean.len(), Mean::default());
        pixel_mean.iter_mut().zip(&beauty.mean).for_each(|(m, &value)| m.add(value.into()));
        let variance = beauty.variance.as_ref().expect("halves give a variance");
        claimed.extend(variance.iter().map(|&value| f64::from(value)));
    }
    let actual = pixel_mean.iter().map(Mean::variance).sum::<f64>() / pixel_mean.len() as f64;
    // Each replica's mean claimed variance comes from 768 differences of halves, which share 64 chains: its own standard
    // deviation was measured as 0.4 of itself, so that of the mean of 64 is 5 %; the actual variance from 64 replicas of
    // as many pixels is as good. 4 times √2 · 5 %.
    let ratio = claimed.mean() / actual;
    assert!((ratio - 1.0).abs() < 0.28, "claimed {}, actual {actual}: {ratio}", claimed.mean());
}

#[test]
fn a_budget_of_time_is_heeded_by_paths_and_chains() {
    let scene = room(LAMP);
    let time = Duration::from_millis(400);
    for integrator in [Integrator::default(), Integrator::Pssmlt(Pssmlt::default())] {
        let settings = RenderSettings {
            budget: Budget::Time(time),
            integrator,
            ..settings(0, 3, Strategy::Mis)
        };
        let start = Instant::now();
        let rendered = render_finite(&scene, &settings);
        assert!(rendered.samples > 1, "{} samples", rendered.samples);
        // Not less, and by no more than a round longer: some 0.3 s of two threads, and tests run side by side.
        let took = start.elapsed();
        assert!(took >= time && took < time + Duration::from_secs(5), "{took:?}");
    }
}
