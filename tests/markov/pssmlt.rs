//! Pictures of primary sample space against those of the path tracer.

use crate::support::mean::Mean;
use crate::support::scenes::{render_finite, scene_around, settings};
use crate::support::{LEVEL, sidak};
use quietlight::integrator::{Bdpt, Integrator, PathTracing, PrimaryPaths, Pssmlt, Strategy};
use quietlight::render::{Budget, RenderSettings, Rendered};
use quietlight::scene::Scene;
use quietlight_denoise::{Image, LayerKind};
use std::time::{Duration, Instant};

/// A room with a mirror ball and a glossy floor, lit by a small lamp that shines at the ceiling.
pub(crate) fn room(lamp: &str) -> Scene {
    scene_around(
        24,
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

/// Both kinds of samples that random numbers can stand for.
fn kinds_of_paths() -> [PrimaryPaths; 2] {
    [PrimaryPaths::Camera(PathTracing::default()), PrimaryPaths::Bidirectional(Bdpt::default())]
}

/// Settings with pools of `candidates` samples.
fn chains_of(paths: PrimaryPaths, candidates: u32, samples: u32, seed: u64) -> RenderSettings {
    let method = Pssmlt { paths, bootstrap_samples: candidates, ..Pssmlt::default() };
    let integrator = Integrator::Pssmlt(method);
    RenderSettings { integrator, ..settings(samples, seed, Strategy::Mis) }
}

fn chains(samples: u32, seed: u64) -> RenderSettings {
    chains_of(kinds_of_paths()[0], 2000, samples, seed)
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

/// Of each layer the blocks' means over renders with other seeds.
fn replicate<const N: usize>(
    scene: &Scene,
    kinds: [LayerKind; N],
    side: usize,
    replicas: u64,
    of: impl Fn(u64) -> RenderSettings,
) -> [Vec<Mean>; N] {
    let mut means = [const { Vec::new() }; N];
    for seed in 0..replicas {
        let rendered = render_finite(scene, &of(1000 + seed));
        for (means, kind) in means.iter_mut().zip(kinds) {
            let found = blocks(&rendered.layers.layers[&kind].mean, side);
            means.resize(found.len(), Mean::default());
            means.iter_mut().zip(found).for_each(|(mean, value)| mean.add(value));
        }
    }
    means
}

/// METHODS 12.1 for whole renders repeated. Welch's test in every block; and the mean of the squares of `n` numbers of
/// Student's distribution with `d` degrees is `d / (d − 2)`, where blocks that depend on each other count as a quarter of
/// them. Blocks that are black by both methods say nothing.
fn assert_same(a: &[Mean], b: &[Mean], what: &str) {
    let is_black = |mean: &Mean| mean.mean() == 0.0 && mean.variance() == 0.0;
    let pairs: Vec<(&Mean, &Mean)> =
        a.iter().zip(b).filter(|(a, b)| !(is_black(a) && is_black(b))).collect();
    let count = pairs.len() as f64;
    assert!(count >= 3.0, "{what}: {count} blocks with light");
    let square = |(a, b): &(&Mean, &Mean)| {
        (a.mean() - b.mean()).powi(2) / (a.variance_of_mean() + b.variance_of_mean())
    };
    let mean_square = pairs.iter().map(square).sum::<f64>() / count;
    let degrees = (a[0].count().min(b[0].count()) - 1) as f64;
    let bound = degrees / (degrees - 2.0) * (1.0 + 4.0 * (8.0 / count).sqrt());
    assert!(mean_square < bound, "{what}: mean z² {mean_square:.2}, bound {bound:.2}");
    let p = pairs.iter().map(|(a, b)| a.p_same_as(b)).fold(1.0, f64::min);
    assert!(p > sidak(LEVEL, pairs.len()), "{what}: smallest p {p:.2e} of {count} blocks");
}

const RADIANCE: [LayerKind; 3] = [LayerKind::Beauty, LayerKind::Diffuse, LayerKind::Specular];

#[test]
fn primary_sample_space_has_the_mean_of_path_tracing_in_every_block() {
    let scene = room(LAMP);
    let expected = replicate(&scene, RADIANCE, 4, 32, |seed| settings(64, seed, Strategy::Mis));
    for paths in kinds_of_paths() {
        let primary = replicate(&scene, RADIANCE, 4, 40, |seed| chains_of(paths, 2000, 64, seed));
        for ((kind, expected), primary) in RADIANCE.iter().zip(&expected).zip(primary) {
            assert_same(&primary, expected, &format!("{paths:?}, {kind:?}"));
        }
    }
}

#[test]
fn few_candidates_and_short_chains_have_the_same_mean() {
    // 64 chains of a single mutation from two pools of 20 samples: nearly all of the picture is where chains start.
    let mut scene = room(LAMP);
    scene.film.crop = [8, 4, 8, 8];
    let [short] = replicate(&scene, [LayerKind::Beauty], 4, 4000, |seed| {
        chains_of(kinds_of_paths()[0], 40, 1, seed)
    });
    let [paths] =
        replicate(&scene, [LayerKind::Beauty], 4, 32, |seed| settings(256, seed, Strategy::Mis));
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
    let cases = kinds_of_paths().into_iter().flat_map(|paths| [(paths, 2), (paths, 8)]);
    for (paths, threads) in cases {
        let settings = chains_of(paths, 2000, 300, 5);
        let one = on_threads(1, &scene, &settings);
        let many = on_threads(threads, &scene, &settings);
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
    scene.film.crop = [4, 4, 12, 8];
    let [expected] =
        replicate(&scene, [LayerKind::Beauty], 4, 32, |seed| settings(64, seed, Strategy::Mis));
    for paths in kinds_of_paths() {
        let [window] =
            replicate(&scene, [LayerKind::Beauty], 4, 32, |seed| chains_of(paths, 2000, 100, seed));
        assert_same(&window, &expected, &format!("crop window, {paths:?}"));
    }
}

/// Mean luminance of a picture.
fn brightness(image: &Image) -> f64 {
    let pixels = (image.len() / 3) as f64;
    [0.2126, 0.7152, 0.0722]
        .iter()
        .zip(image.outer_iter())
        .map(|(weight, plane)| weight * plane.iter().map(|&value| f64::from(value)).sum::<f64>())
        .sum::<f64>()
        / pixels
}

#[test]
fn each_half_is_as_bright_as_its_own_pool_says() {
    // Every mutation records a luminance of 1: what a half has in all is its normalisation, and pools of their own make
    // independent halves of it. The correlation of 64 pairs is N(0, 1/64).
    let mut scene = room(LAMP);
    scene.film.crop = [8, 4, 8, 8];
    for paths in kinds_of_paths() {
        let mut halves = Vec::new();
        for seed in 0..64 {
            let rendered = render_finite(&scene, &chains_of(paths, 200, 4, seed));
            let layer = &rendered.layers.layers[&LayerKind::Beauty];
            halves.push(layer.halves.as_ref().expect("halves").each_ref().map(brightness));
            let facts = &rendered.report.facts;
            let said = facts.iter().find(|(name, _)| name == "normalisation").expect("is told");
            let b: f64 = said.1.split(' ').next().expect("a number").parse().expect("a number");
            let found = brightness(&layer.mean);
            assert!((found / b - 1.0).abs() < 1e-5, "{found} instead of {b}");
        }
        let mean = |half: usize| halves.iter().map(|h: &[f64; 2]| h[half]).sum::<f64>() / 64.0;
        let means = [mean(0), mean(1)];
        let moment = |i: usize, j: usize| -> f64 {
            halves.iter().map(|h| (h[i] - means[i]) * (h[j] - means[j])).sum()
        };
        let correlation = moment(0, 1) / (moment(0, 0) * moment(1, 1)).sqrt();
        assert!(correlation.abs() < 4.0 / 8.0, "{paths:?}: correlation {correlation}");
    }
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
fn the_variance_of_chains_is_that_of_other_seeds() {
    // Half of the squared difference of two renders has the variance as its mean, averaged over the pixels. Small pools, so
    // that the normalisation's error is a part that the halves must not share.
    let scene = room(LAMP);
    let (mut claimed, mut actual) = (Mean::default(), Mean::default());
    for pair in 0..32 {
        let [a, b] = [2 * pair, 2 * pair + 1].map(|seed| {
            let rendered = render_finite(&scene, &chains_of(kinds_of_paths()[0], 200, 32, seed));
            rendered.layers.layers[&LayerKind::Beauty].clone()
        });
        let average = |image: &Image| f64::from(image.sum()) / image.len() as f64;
        for layer in [&a, &b] {
            claimed.add(average(layer.variance.as_ref().expect("halves give a variance")));
        }
        let difference = &a.mean - &b.mean;
        actual.add(0.5 * average(&(&difference * &difference)));
    }
    let p = claimed.p_same_as(&actual);
    assert!(p > LEVEL, "claimed {}, actual {}: p {p:.1e}", claimed.mean(), actual.mean());
}

#[test]
fn beauty_of_chains_is_diffuse_and_specular_exactly() {
    let rendered = render_finite(&room(LAMP), &chains(40, 2));
    let layer = |kind| &rendered.layers.layers[&kind];
    let [beauty, diffuse, specular] = RADIANCE.map(layer);
    assert_eq!(beauty.mean, &diffuse.mean + &specular.mean);
    for half in [0, 1] {
        let [b, d, s] =
            [beauty, diffuse, specular].map(|layer| &layer.halves.as_ref().expect("halves")[half]);
        assert_eq!(*b, d + s);
    }
    assert!(specular.mean.iter().any(|&value| value > 0.0));
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
        // How much longer it takes is the machine's business. It ends at most half a round early, and no round is longer than all.
        let least = time * 2 / 3;
        assert!(rendered.samples >= 1 && start.elapsed() >= least, "{} samples", rendered.samples);
    }
}
