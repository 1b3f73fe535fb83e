//! Correlated visibility sampling: METHODS 13.5.

use crate::support::mean::Mean;
use crate::support::scenes::{scene_around, settings};
use crate::support::{LEVEL, sidak};
use quietlight::integrator::Strategy;
use quietlight::integrator::correlated_visibility::{
    CorrelatedVisibility, MarkSource, PixelSums, VisibilityRendering,
};
use quietlight::render::render;
use quietlight::scene::Scene;
use quietlight_denoise::{LUMINANCE, LayerKind};
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::sync::atomic::AtomicBool;

/// A finished half.
fn rendered<'a>(
    scene: &'a Scene,
    settings: CorrelatedVisibility,
    seed: u64,
    hits: u32,
) -> VisibilityRendering<'a> {
    let mut rendering = VisibilityRendering::new(scene, settings, seed, (seed & 1) as u32);
    rendering.advance(hits);
    assert_eq!(rendering.ledger().invalid, 0, "non-finite samples");
    rendering
}

fn luminance(sums: &PixelSums) -> f64 {
    (0..3).map(|c| f64::from(LUMINANCE[c]) * (sums.diffuse[c] + sums.specular[c])).sum()
}

/// Means over square blocks of pixels.
fn blocks(width: usize, side: usize, pixels: &[f64]) -> Vec<f64> {
    let across = width / side;
    let mut means = vec![0.0; across * (pixels.len() / width / side)];
    for (index, value) in pixels.iter().enumerate() {
        means[index / width / side * across + index % width / side] += value / (side * side) as f64;
    }
    means
}

/// Mean and spread of each block's luminance over many seeds.
fn replicas(count: u64, picture: impl Fn(u64) -> Vec<f64>) -> Vec<Mean> {
    let mut means = Vec::new();
    for seed in 0..count {
        let blocks = picture(seed);
        means.resize(blocks.len(), Mean::default());
        means.iter_mut().zip(blocks).for_each(|(mean, block)| mean.add(block));
    }
    means
}

fn by_exchange(
    scene: &Scene,
    settings: CorrelatedVisibility,
    hits: u32,
    seed: u64,
    side: usize,
) -> Vec<f64> {
    let half = rendered(scene, settings, 1000 + seed, hits);
    let pixels: Vec<f64> =
        half.sums().iter().map(|sums| luminance(sums) / f64::from(hits)).collect();
    blocks(scene.film.crop[2] as usize, side, &pixels)
}

fn by_path_tracing(scene: &Scene, samples: u32, seed: u64, side: usize) -> Vec<f64> {
    let rendered =
        render(scene, &settings(samples, seed, Strategy::Mis), &|_| {}, &AtomicBool::new(false));
    let beauty = &rendered.layers.layers[&LayerKind::Beauty].mean;
    let (_, height, width) = beauty.dim();
    let pixels: Vec<f64> = (0..height * width)
        .map(|i| {
            (0..3)
                .map(|c| f64::from(LUMINANCE[c]) * f64::from(beauty[[c, i / width, i % width]]))
                .sum()
        })
        .collect();
    blocks(width, side, &pixels)
}

/// z of each block's difference.
fn scores(a: &[Mean], b: &[Mean]) -> Vec<f64> {
    a.iter()
        .zip(b)
        .map(|(a, b)| {
            let difference = a.mean() - b.mean();
            let variance = a.variance_of_mean() + b.variance_of_mean();
            // The sky seen directly is the same in every sample, up to its rounding in a film of f32.
            let is_constant =
                variance.sqrt() < 1e-6 * a.mean() && difference.abs() < 1e-6 * a.mean();
            if is_constant || difference == 0.0 { 0.0 } else { difference / variance.sqrt() }
        })
        .collect()
}

fn mean_square(scores: &[f64]) -> f64 {
    scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64
}

/// METHODS 12.1: block by block the same mean by Welch's test, and the mean of z² near 1.
fn assert_same(what: &str, a: &[Mean], b: &[Mean]) {
    let scores = scores(a, b);
    let square = mean_square(&scores);
    let largest = scores.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
    println!("{what}: mean z² {square:.2}, largest |z| {largest:.2}");
    // Blocks that share chains are correlated: METHODS has n / 4 for the effective number.
    let bound = 1.0 + 4.0 * (2.0 * 4.0 / scores.len() as f64).sqrt();
    assert!(square < bound, "{what}: mean z² {square:.2} of {scores:.1?}, bound {bound:.2}");
    // Student's t of 63 and more degrees of freedom, the level shared by the blocks.
    let t = StudentsT::new(0.0, 1.0, 63.0).expect("degrees are positive");
    let limit = t.inverse_cdf(1.0 - 0.5 * sidak(LEVEL, scores.len()));
    assert!(largest < limit, "{what}: |z| {largest:.2}, limit {limit:.2}, z {scores:.1?}");
}

/// A slab and a ball over a floor, under a rectangle lamp and a sky, or one of them.
fn blockers(max_depth: i32, light: &str) -> Scene {
    scene_around(
        16,
        50.0,
        max_depth,
        &format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-45"/><scale value="6"/>
            <translate y="-1" z="-4"/></transform><bsdf type="roughplastic"><float name="alpha" value="0.2"/>
            <rgb name="diffuse_reflectance" value="0.6 0.5 0.3"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale x="0.7" y="0.2"/>
            <translate x="-0.3" y="0.2" z="-3.4"/></transform>
            <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <shape type="sphere"><point name="center" x="0.6" y="-0.2" z="-3.5"/><float name="radius" value="0.4"/>
            <bsdf type="roughconductor"><string name="material" value="Au"/><float name="alpha" value="0.15"/></bsdf>
            </shape>
        <shape type="sphere"><point name="center" x="-0.9" y="-0.3" z="-3"/><float name="radius" value="0.3"/>
            <bsdf type="plastic"/></shape>
        {light}"#
        ),
    )
}

const LAMPS: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/>
    <scale value="0.5"/><translate x="0.3" y="2" z="-3"/></transform>
    <emitter type="area"><rgb name="radiance" value="6 5 4"/></emitter></shape>
    <shape type="sphere"><point name="center" x="-2" y="1" z="-2"/><float name="radius" value="0.3"/>
    <emitter type="area"><rgb name="radiance" value="3 6 9"/></emitter></shape>"#;

const SKY: &str =
    r#"<emitter type="constant"><rgb name="radiance" value="0.2 0.3 0.4"/></emitter>"#;

fn same_as_path_tracing(what: &str, scene: &Scene, settings: CorrelatedVisibility) {
    let exchanged = replicas(64, |seed| by_exchange(scene, settings, 4, seed, 2));
    let traced = replicas(64, |seed| by_path_tracing(scene, 32, seed, 2));
    assert_same(what, &exchanged, &traced);
}

#[test]
fn exchange_with_pilot_marks_has_the_mean_of_path_tracing() {
    let settings = CorrelatedVisibility::default();
    same_as_path_tracing("lamps", &blockers(2, LAMPS), settings);
    same_as_path_tracing("sky", &blockers(2, SKY), settings);
    same_as_path_tracing("both", &blockers(2, &format!("{LAMPS}{SKY}")), settings);
}

#[test]
fn all_other_light_is_that_of_path_tracing() {
    let lights = format!(
        r#"{LAMPS}{SKY}<emitter type="point"><point name="position" x="1" y="1" z="-2"/>
        <rgb name="intensity" value="2"/></emitter>
        <shape type="sphere"><point name="center" x="0.1" y="-0.5" z="-2.5"/><float name="radius" value="0.25"/>
        <bsdf type="dielectric"/></shape>"#
    );
    same_as_path_tracing("all", &blockers(6, &lights), CorrelatedVisibility::default());
}

fn unused() {
    let _ = MarkSource::Same;
}
