//! Bidirectional path tracing: every strategy alone, and all of them weighted (METHODS 13.2).

use crate::support::batches::{Batches, assert_same, bdpt_batches, path_batches};
use crate::support::scenes::scene_around;
use quietlight::integrator::Bdpt;
use quietlight::scene::Scene;
use quietlight::transport::mis::Heuristic;

const MIRROR: &str = r#"<bsdf type="conductor"><string name="material" value="none"/></bsdf>"#;
const GLASS: &str = r#"<bsdf type="dielectric"/>"#;

/// A room of diffuse, metal and plastic walls around a ball, open at the front, in the light of `light`.
fn room(depth: i32, ball: &str, light: &str) -> Scene {
    scene_around(
        16,
        60.0,
        depth,
        &format!(
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
        ),
    )
}

const AREA: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.8"/>
    <translate y="1.5" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="3 2.5 2"/></emitter></shape>"#;

#[test]
fn every_strategy_sees_each_path_length_of_an_integrating_sphere() {
    // G is 1 / (4 R²) between all points of the wall, so that connections have hardly any variance.
    let scene = scene_around(
        8,
        60.0,
        6,
        r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="0.5"/></emitter></shape>"#,
    );
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
            assert!(error < 0.01, "s {s}, t {t}: ± {error}");
            assert!(z.abs() < 4.4, "s {s}, t {t}: {mean} ± {error}, expected 0.5");
        }
    }
}

/// The weighted sum of all strategies against path tracing.
fn assert_same_picture(scene: &Scene, heuristic: Heuristic, what: &str) {
    let all = bdpt_batches(scene, Bdpt { heuristic }, 32, 64, |found| Some((0, found.weight)));
    let reference: Batches = path_batches(scene, 32, 64);
    assert_same(&all, 0, &reference, 0, what);
}

#[test]
fn all_strategies_together_see_what_path_tracing_sees() {
    assert_same_picture(&room(6, MIRROR, AREA), Heuristic::Power, "mirror ball, area light");
    assert_same_picture(&room(6, GLASS, AREA), Heuristic::Balance, "glass ball, area light");
}
