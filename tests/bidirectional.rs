//! Bidirectional path tracing: every strategy alone, and all of them weighted (METHODS 13.2).

mod extremes;
mod pictures;

use crate::support::batches::bdpt_batches;
use crate::support::scenes::{scene_around, scene_from};
use glam::Vec2;
use quietlight::integrator::bdpt::{Bdpt, Workspace};
use quietlight::sampler::{IndependentSampler, Sampler};
use quietlight::scene::Scene;
use quietlight::transport::connect::Contribution;
use quietlight::transport::mis::Heuristic;
use quietlight::transport::path::Path;

const MIRROR: &str = r#"<bsdf type="conductor"><string name="material" value="none"/></bsdf>"#;
const GLASS: &str = r#"<bsdf type="dielectric"/>"#;

/// A camera at the origin that looks along −z, with a lens if one is given.
fn film(width: u32, height: u32, depth: u32, lens: &str, inside: &str) -> Scene {
    let sensor = if lens.is_empty() { "perspective" } else { "thinlens" };
    scene_from(&format!(
        r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{depth}"/></integrator>
        <sensor type="{sensor}"><float name="fov" value="60"/>{lens}
            <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
                <rfilter type="box"/></film></sensor>{inside}</scene>"#
    ))
}

const LENS: &str =
    r#"<float name="aperture_radius" value="0.4"/><float name="focus_distance" value="3"/>"#;

/// A room of diffuse, metal and plastic walls around a ball, open at the front, in the light of `light`.
fn room(depth: u32, ball: &str, light: &str) -> Scene {
    film(16, 16, depth, "", &room_around(ball, light))
}

fn room_around(ball: &str, light: &str) -> String {
    format!(
        r#"
        <bsdf type="twosided" id="red"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.2 0.1"/></bsdf></bsdf>
        <bsdf type="twosided" id="metal"><bsdf type="roughconductor"><string name="material" value="Cu"/>
            <float name="alpha" value="0.3"/></bsdf></bsdf>
        <bsdf type="twosided" id="plastic"><bsdf type="plastic">
            <rgb name="diffuse_reflectance" value="0.4 0.5 0.7"/></bsdf></bsdf>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
            <translate y="-1" z="-3"/></transform><ref id="plastic"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-5"/></transform>
            <ref id="metal"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="90"/><scale value="3"/>
            <translate x="-1.5" z="-3"/></transform><ref id="red"/></shape>
        <shape type="sphere"><point name="center" x="0.2" y="-0.5" z="-3"/><float name="radius" value="0.5"/>{ball}</shape>
        {light}"#
    )
}

const AREA: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.8"/>
    <translate y="1.5" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#;

#[test]
fn every_strategy_sees_each_path_length_of_an_integrating_sphere() {
    // G is 1 / (4 R²) between all points of the wall, so that connections have hardly any variance.
    let mut scene = scene_around(
        8,
        60.0,
        6,
        r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="0.5"/></emitter></shape>"#,
    );
    // Roulette would be the only noise of most.
    scene.limits.rr_depth = 100;
    let batches = bdpt_batches(&scene, Bdpt::default(), 32, 40, |found| {
        let k = found.s + found.t - 1;
        Some(((found.s * 8 + found.t) as usize, 1.0 / 0.6f64.powi(k as i32 - 1)))
    });
    for k in 1..=6u32 {
        for s in 0..=k {
            // What is seen directly is left to the eye's walk.
            if k == 1 && s > 0 {
                continue;
            }
            let t = k + 1 - s;
            let (mean, error) = batches.whole((s * 8 + t) as usize);
            let z = (mean - 0.5) / error.max(1e-7);
            assert!(error < 0.015, "s {s}, t {t}: ± {error}");
            assert!(z.abs() < 4.4, "s {s}, t {t}: {mean} ± {error}, expected 0.5");
        }
    }
}

/// Everything that a few thousand samples of `scene` find: the contribution and its whole path.
fn for_each_path(
    scene: &Scene,
    heuristic: Heuristic,
    mut check: impl FnMut(&Contribution, &Path<'_>),
) {
    let integrator = Bdpt { heuristic, ..Bdpt::default() };
    let mut workspace = Workspace::default();
    let mut found = Vec::new();
    for sample in 0..4000 {
        let mut sampler = IndependentSampler::new(3, sample, 0);
        let raster = sampler.next_2d() * Vec2::new(16.0, 16.0);
        let lens = sampler.next_2d();
        let pair = integrator.walk(scene, raster, lens, &mut sampler, &mut workspace);
        found.clear();
        pair.connect(6, &mut found);
        for one in &found {
            let path = pair.path(one.s, one.t).expect("what was found is a path");
            check(one, &path);
        }
    }
}

fn scenes_with_everything() -> Vec<(&'static str, Scene)> {
    let constant = r#"<emitter type="constant"><rgb name="radiance" value="1 0.5 0.2"/></emitter>"#;
    let point = r#"<emitter type="point"><point name="position" x="0.5" y="1" z="-2"/>
        <rgb name="intensity" value="2"/></emitter>"#;
    let parallel = r#"<emitter type="directional"><vector name="direction" x="0.2" y="-1" z="-0.4"/>
        <rgb name="irradiance" value="2"/></emitter>"#;
    let without_roulette = |mut scene: Scene| {
        // Walks divide by the probability of surviving roulette, paths do not.
        scene.limits.rr_depth = 100;
        scene
    };
    let room = |depth, ball: &str, light: &str| without_roulette(room(depth, ball, light));
    let through_lens = |ball: &str, light: &str| {
        without_roulette(film(16, 16, 6, LENS, &room_around(ball, light)))
    };
    vec![
        ("mirror, area", room(6, MIRROR, AREA)),
        ("glass, area", room(6, GLASS, AREA)),
        ("glass, environment", room(6, GLASS, constant)),
        ("mirror, point", room(6, MIRROR, point)),
        ("glass, directional", room(6, GLASS, parallel)),
        ("thin lens", through_lens(MIRROR, AREA)),
        ("thin lens and glass, environment", through_lens(GLASS, constant)),
        ("light in glass", room(6, GLASS, INSIDE)),
        ("all lights", room(6, GLASS, &format!("{AREA}{constant}{point}{parallel}"))),
    ]
}

/// A light inside the ball.
const INSIDE: &str = r#"<shape type="sphere"><point name="center" x="0.2" y="-0.5" z="-3"/><float name="radius" value="0.2"/>
    <emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#;

#[test]
fn the_balance_heuristic_makes_every_strategy_the_same_function_of_the_path() {
    // w_s f / p_s = f / Σ p: contributions come from the factors of the walks, weights from densities per area.
    for (what, scene) in scenes_with_everything() {
        let mut compared = 0;
        for_each_path(&scene, Heuristic::Balance, |_, path| {
            let weights = path.weights(Heuristic::Balance);
            let total: f64 = weights.iter().sum();
            assert!((total - 1.0).abs() < 1e-9, "{what}: weights sum to {total}");
            // A chain of delta events between different media is found with a density that is off by n² from one of its sides
            // (METHODS 3.2): weights sum to 1, but are not quite those of the balance heuristic.
            if what == "light in glass" {
                return;
            }
            let values: Vec<f64> = (0..=path.k())
                .filter(|&s| path.k() > 1 && weights[s] > 0.0)
                .map(|s| path.ln_contribution(s) + weights[s].ln())
                .collect();
            for pair in values.windows(2) {
                compared += 1;
                // A weight of 1e-12 is 1 less others, with that many digits fewer.
                assert!(
                    (pair[0] - pair[1]).abs() < 1e-7,
                    "{what}: {values:?}, {:?}",
                    path.events()
                );
            }
        });
        assert!(
            what == "light in glass" || compared > 5_000,
            "{what}: only {compared} pairs of strategies"
        );
    }
}

/// `ln` of what strategy `s` finds. Of light in the lens the weights tell it: they are as the densities, or as their squares.
fn ln_contribution(path: &Path<'_>, s: usize, heuristic: Heuristic) -> f64 {
    if s <= path.k() {
        return path.ln_contribution(s);
    }
    let weights = path.weights(heuristic);
    let known = (0..=path.k()).find(|&s| weights[s] > 1e-100).expect("a strategy to the lens");
    path.ln_contribution(known) + (weights[known] / weights[s]).ln() / heuristic.raise(2.0).log2()
}

#[test]
fn weights_along_the_walks_are_those_of_the_whole_path() {
    for heuristic in [Heuristic::Balance, Heuristic::Power] {
        for (what, scene) in scenes_with_everything() {
            let (mut all, mut off, mut in_lens) = (0, 0, 0);
            for_each_path(&scene, heuristic, |one, path| {
                let expected = path.weights(heuristic)[one.s as usize];
                let ln_found = f64::from((one.diffuse + one.specular).luminance()).ln();
                let ln_expected = ln_contribution(path, one.s as usize, heuristic);
                all += 1;
                in_lens += u32::from(one.t == 0);
                // Walks use the direction that they sampled, the path that between the points found: these differ by
                // roundings of single precision, which a grazing direction or a short edge magnifies.
                if (one.weight - expected).abs() > 1e-3 || (ln_found - ln_expected).abs() > 1e-2 {
                    off += 1;
                }
            });
            assert!(all > 5_000 && off * 1000 < all, "{what}: {off} of {all} are off");
            assert_eq!(what.contains("lens"), in_lens > 0, "{what}: {in_lens} met the lens");
        }
    }
}
