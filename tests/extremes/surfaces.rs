//! Surfaces at their extremes, for all methods.

use super::*;

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

const MIRROR: &str = r#"<bsdf type="conductor"><string name="material" value="none"/></bsdf>"#;

#[test]
fn mirrors_that_face_each_other_are_as_bright_as_by_path_tracing() {
    // Without a limit: through a slit between two mirrors, which most walks leave after some ten reflections, at a ball
    // and the lamp that lights it.
    let mirror = |side: f32| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="{}"/><scale value="2"/>
            <translate x="{}" z="-2"/></transform>{MIRROR}</shape>"#,
            -90.0 * side,
            0.1 * side
        )
    };
    let scene = scene_around(
        12,
        60.0,
        -1,
        &format!(
            r#"{}{}<shape type="sphere"><point name="center" x="0" y="-0.5" z="-5.5"/>{GREY}</shape>
            <shape type="sphere"><point name="center" x="-0.5" y="1" z="-5"/><float name="radius" value="0.3"/>
                <emitter type="area"><rgb name="radiance" value="3 2 1"/></emitter></shape>"#,
            mirror(1.0),
            mirror(-1.0)
        ),
    );
    assert_like_path(&scene, "facing mirrors");
}

#[test]
fn walks_between_perfect_mirrors_end() {
    // Nothing leaves a ball of mirrors; some walks never meet the lamp in it.
    let scene = scene_around(
        4,
        60.0,
        -1,
        &format!(
            r#"<shape type="sphere"><point name="center" x="0.3" y="0.2" z="0"/>
            <boolean name="flip_normals" value="true"/>{MIRROR}</shape>
            <shape type="sphere"><point name="center" x="0.4" y="0.1" z="-0.5"/><float name="radius" value="0.1"/>
                <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#
        ),
    );
    for (name, integrator) in methods() {
        assert!(luminance(&rendered(&scene, integrator, 8, 1)) > 0.0, "{name}");
    }
}

/// A white sphere of albedo 0.999 that shines, paths of so many edges, and its radiance `Σ ρ^k`.
fn white_sphere(edges: u32) -> (Scene, f64) {
    let mut scene = scene_around(
        1,
        60.0,
        edges as i32,
        r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.999"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#,
    );
    scene.limits.rr_depth = 1000;
    (scene, (1.0 - 0.999f64.powi(edges as i32)) / 0.001)
}

#[test]
fn five_hundred_bounces_off_white_walls_stay_finite() {
    // A pair of walks can be joined in 125 000 ways, so that there are few of them: chains of one mutation from pools of four
    // pairs. Every connection in a sphere is worth the same, which leaves them little noise. Those that join every pair, and
    // those that have thousands of probes, bounce fifty times.
    for (name, integrator) in methods() {
        let is_slow = name.starts_with("erpt") || name == "pssmlt of both walks";
        // Of 64 deposits of one size, those of chains that were rounded to one more or less make 10 %; three times that.
        let (edges, samples, bound) = if is_slow { (50, 64, 0.3) } else { (500, 1, 0.05) };
        let (scene, expected) = white_sphere(edges);
        let integrator = match with_few_candidates(integrator, 4) {
            Integrator::Erpt(erpt) => Integrator::Erpt(Erpt { chain_length: 1, ..erpt }),
            other => other,
        };
        let found = luminance(&rendered(&scene, integrator, samples, 1));
        assert!((found / expected - 1.0).abs() < bound, "{name}: {found}, {expected}");
    }
}

#[test]
fn nearly_black_surfaces_end_walks_without_a_zero_by_zero() {
    // Seen is what surfaces of albedo 1e-12 reflect of a lamp behind the camera: of its light that is all, to 1e-12.
    let scene = |albedo: &str| {
        scene_around(
            8,
            60.0,
            -1,
            &format!(
                r#"<bsdf type="diffuse" id="black"><rgb name="reflectance" value="{albedo}"/></bsdf>
            <shape type="rectangle"><transform name="to_world"><scale value="4"/><translate z="-3"/></transform>
                <ref id="black"/></shape>
            <shape type="sphere"><point name="center" x="0.3" y="0.2" z="-2"/><float name="radius" value="0.5"/>
                <ref id="black"/></shape>
            <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><translate x="1" z="1"/></transform>
                <emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>"#
            ),
        )
    };
    let mut direct = scene("0.5");
    direct.limits.max_depth = Some(2);
    let expected = by_path(&direct, 256).map(|mean| mean.mean() * 2e-12);
    for (name, integrator) in methods() {
        let found = replicas(&scene("1e-12"), integrator, REPLICAS, 64);
        for (found, expected) in found.iter().zip(expected) {
            let (found, error) =
                (found.mean() / expected, found.variance_of_mean().sqrt() / expected);
            // The reference itself knows 0.2 %.
            assert!(
                (found - 1.0).abs() < 6.5 * error + 0.01 && error < 0.1,
                "{name}: {found} ± {error}"
            );
        }
    }
}
