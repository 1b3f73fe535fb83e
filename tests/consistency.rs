//! All methods see the same light: six scenes, every method that can find their light, independent replicas compared block by
//! block (METHODS, appendix K).

use crate::support::batches::{Batches, assert_same, bdpt_batches, render_batches};
use crate::support::scenes::scene_around;
use quietlight::integrator::{
    Bdpt, CorrelatedVisibility, Erpt, Integrator, Mlt, PathTracing, PrimaryPaths, Pssmlt,
};
use quietlight::scene::{LoadOptions, Scene};
use quietlight::transport::connect::Strategies;
use std::path::Path;

/// Independent renders of each method.
const REPLICAS: u32 = 32;

/// One of our own scenes, small.
fn own(name: &str, size: (u32, u32)) -> Scene {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let options = LoadOptions { size: Some(size), ..LoadOptions::default() };
    Scene::load(&file, &options).expect("our own scene loads")
}

/// What all others are compared with: all strategies of bidirectional path tracing.
fn reference(scene: &Scene, samples: u32) -> Batches {
    bdpt_batches(scene, Bdpt::default(), REPLICAS, samples, |found| Some((0, found.weight)))
}

fn pssmlt() -> Integrator {
    let paths = PrimaryPaths::Bidirectional(Bdpt::default());
    Integrator::Pssmlt(Pssmlt { paths, bootstrap_samples: 4000, ..Pssmlt::default() })
}

fn mlt() -> Integrator {
    Integrator::Mlt(Mlt { bootstrap_pairs: 4000, ..Mlt::default() })
}

/// Metropolis light transport that finds direct light itself.
fn whole_mlt() -> Integrator {
    Integrator::Mlt(Mlt { bootstrap_pairs: 4000, separate_direct: false, ..Mlt::default() })
}

fn erpt(seeds: Strategies) -> Integrator {
    Integrator::Erpt(Erpt { seeds, ..Erpt::default() })
}

/// Compares each method's replicas with the reference.
fn assert_all_agree(what: &str, scene: &Scene, samples: u32, methods: &[(&str, Integrator)]) {
    let reference = reference(scene, samples);
    for &(name, integrator) in methods {
        let found = render_batches(scene, integrator, REPLICAS, samples);
        assert_same(&found, 0, &reference, 0, &format!("{what}: {name} and bdpt"));
    }
}

fn check_diffuse_box(samples: u32) {
    assert_all_agree(
        "diffuse box",
        &own("cornell-box", (16, 16)),
        samples,
        &[
            ("path", PathTracing::default().into()),
            ("pssmlt", pssmlt()),
            ("mlt", mlt()),
            ("mlt with direct light", whole_mlt()),
            ("erpt", erpt(Strategies::ToLens)),
            ("erpt from the camera", erpt(Strategies::FromCamera)),
            ("visibility", Integrator::Visibility(CorrelatedVisibility::default())),
        ],
    );
}

fn check_glass(samples: u32) {
    assert_all_agree(
        "mirror and glass",
        &own("cornell-box-glass", (16, 16)),
        samples,
        &[
            ("pssmlt", pssmlt()),
            ("mlt", mlt()),
            ("mlt with direct light", whole_mlt()),
            ("erpt", erpt(Strategies::ToLens)),
        ],
    );
}

/// Scenes whose light path tracing hardly finds.
fn check_hard(name: &str, samples: u32) {
    assert_all_agree(
        name,
        &own(name, (16, 16)),
        samples,
        &[("pssmlt", pssmlt()), ("mlt", mlt()), ("erpt", erpt(Strategies::ToLens))],
    );
}

fn check_environment(samples: u32) {
    assert_all_agree(
        "environment",
        &own("blockers", (16, 16)),
        samples,
        &[
            ("path", PathTracing::default().into()),
            ("pssmlt", pssmlt()),
            ("mlt", mlt()),
            ("erpt", erpt(Strategies::ToLens)),
            ("visibility", Integrator::Visibility(CorrelatedVisibility::default())),
        ],
    );
}

#[test]
fn a_diffuse_box() {
    check_diffuse_box(64);
}

#[test]
fn mirror_and_glass() {
    check_glass(64);
}

#[test]
fn a_pool() {
    check_hard("caustic-pool", 64);
}

#[test]
fn a_door_ajar() {
    check_hard("ajar-door", 64);
}

#[test]
fn an_environment_with_blockers() {
    check_environment(64);
}

#[test]
#[ignore = "a quarter of an hour"]
fn all_scenes_with_sixteen_times_the_samples() {
    check_diffuse_box(1024);
    check_glass(1024);
    check_hard("caustic-pool", 1024);
    check_hard("ajar-door", 1024);
    check_environment(1024);
}

#[test]
fn a_point_and_a_spot_in_a_box_with_a_mirror() {
    let scene = scene_around(
        16,
        60.0,
        6,
        r#"<bsdf type="twosided" id="grey"><bsdf type="diffuse"><rgb name="reflectance" value="0.6 0.5 0.4"/></bsdf></bsdf>
        <shape type="cube"><transform name="to_world"><scale value="3"/><translate z="-2"/></transform><ref id="grey"/></shape>
        <shape type="sphere"><point name="center" x="0.4" y="-1" z="-3"/><float name="radius" value="0.7"/>
            <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>
        <emitter type="point"><point name="position" x="-0.8" y="1.2" z="-2.5"/><rgb name="intensity" value="3 2 1"/></emitter>
        <emitter type="spot"><transform name="to_world"><lookat origin="1,1.5,-2" target="0,-1,-3" up="0,0,1"/></transform>
            <rgb name="intensity" value="1 2 4"/></emitter>"#,
    );
    // Path tracing cannot find what the mirror throws of them on the walls.
    assert_all_agree(
        "point and spot",
        &scene,
        64,
        &[
            ("mlt", mlt()),
            ("mlt with direct light", whole_mlt()),
            ("erpt", erpt(Strategies::ToLens)),
        ],
    );
}

#[test]
fn emitters_of_1e8_and_1e_minus_8() {
    // The bright one hangs behind a wall that hides it from the left half, where the dim one is all there is but for what
    // comes around.
    let scene = scene_around(
        16,
        60.0,
        5,
        r#"<bsdf type="twosided" id="grey"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf>
        <shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-4"/></transform><ref id="grey"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale x="0.01" y="4" z="1"/><rotate y="1" angle="90"/>
            <scale x="1" y="1" z="4"/><translate z="-2"/></transform><ref id="grey"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.2"/>
            <translate x="1" y="1.5" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="1e8"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.2"/>
            <translate x="-1" y="1.5" z="-3"/></transform><emitter type="area"><rgb name="radiance" value="1e-8"/></emitter></shape>"#,
    );
    assert_all_agree(
        "1e8 and 1e-8",
        &scene,
        64,
        &[("mlt", mlt()), ("erpt", erpt(Strategies::ToLens))],
    );
}

#[test]
fn a_crop_window_of_a_box_with_glass() {
    let mut scene = own("cornell-box-glass", (32, 24));
    scene.film.crop = [9, 3, 16, 16];
    assert_all_agree(
        "crop window",
        &scene,
        32,
        &[
            ("path", PathTracing::default().into()),
            ("pssmlt", pssmlt()),
            ("mlt", mlt()),
            ("mlt with direct light", whole_mlt()),
            ("erpt", erpt(Strategies::ToLens)),
        ],
    );
}
