//! Scenes whose radiance is known in closed form (METHODS 13.1 and appendix H).

use crate::support::scenes::{
    assert_mean, layer, mean_and_error, render_finite, scene_around, settings,
};
use quietlight::integrator::Strategy::{Bsdf, Light, Mis};
use quietlight_denoise::LayerKind;

/// The inside of a sphere of radius 1 around the camera: reflectance ρ, emission E, both grey.
fn integrating_sphere(reflectance: f32, emission: f32) -> String {
    format!(
        r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="{reflectance}"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="{emission}"/></emitter></shape>"#
    )
}

#[test]
fn an_integrating_sphere_sees_e_over_one_minus_rho() {
    // Every bounce multiplies by ρ: L = E (1 + ρ + ρ² + …) = E / (1 − ρ).
    let scene = scene_around(8, 60.0, -1, &integrating_sphere(0.6, 0.5));
    for strategy in [Light, Bsdf, Mis] {
        let rendered = render_finite(&scene, &settings(512, 1, strategy));
        assert_mean(mean_and_error(&rendered), 0.5 / 0.4, 0.01, &format!("{strategy:?}"));
    }
}

#[test]
fn each_path_length_of_an_integrating_sphere_adds_its_own_power_of_rho() {
    // Up to k edges: E (1 + ρ + … + ρ^(k−1)); a path limit off by one is off by ρ^(k−1), 22 % at k = 4.
    let mut expected = 0.0;
    for k in 1..=6 {
        expected += 0.5 * 0.6f64.powi(k - 1);
        let scene = scene_around(8, 60.0, k, &integrating_sphere(0.6, 0.5));
        for strategy in [Light, Bsdf, Mis] {
            let rendered = render_finite(&scene, &settings(256, 2, strategy));
            assert_mean(
                mean_and_error(&rendered),
                expected,
                0.01,
                &format!("{strategy:?}, {k} edges"),
            );
        }
    }
}

#[test]
fn a_furnace_sees_the_albedo() {
    // A convex body in light of 1 from everywhere shows its albedo; at albedo 1 it cannot be seen at all.
    for albedo in [1.0, 0.5] {
        let scene = scene_around(
            16,
            10.0,
            -1,
            &format!(
                r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/>
                <bsdf type="diffuse"><rgb name="reflectance" value="{albedo}"/></bsdf></shape>
                <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#
            ),
        );
        for strategy in [Light, Bsdf, Mis] {
            let rendered = render_finite(&scene, &settings(1024, 3, strategy));
            assert_mean(mean_and_error(&rendered), albedo, 0.01, &format!("{strategy:?}"));
        }
    }
}

#[test]
fn a_white_furnace_is_one_in_every_pixel_when_only_bsdfs_are_sampled() {
    // Each sample is a product of ones, so only rounding is left; a sphere in front of light of 1 is invisible.
    let scene = scene_around(
        24,
        40.0,
        -1,
        r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#,
    );
    let rendered = render_finite(&scene, &settings(8, 4, Bsdf));
    for &value in layer(&rendered, LayerKind::Beauty).0 {
        assert!((value - 1.0).abs() < 1e-5, "{value}");
    }
}

#[test]
fn smooth_glass_and_mirrors_in_a_white_furnace_are_invisible() {
    // Nothing is absorbed, and the radiance that glass compresses on the way in is stretched on the way out.
    for bsdf in [
        r#"<bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf>"#,
        r#"<bsdf type="thindielectric"><float name="int_ior" value="1.5"/></bsdf>"#,
        r#"<bsdf type="conductor"><string name="material" value="none"/></bsdf>"#,
    ] {
        let mut scene = scene_around(
            8,
            15.0,
            -1,
            &format!(
                r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/>{bsdf}</shape>
                <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#
            ),
        );
        // Without roulette every sample is one up to rounding, whichever way it takes.
        scene.limits.rr_depth = u32::MAX;
        for strategy in [Light, Bsdf, Mis] {
            let rendered = render_finite(&scene, &settings(256, 5, strategy));
            for &value in layer(&rendered, LayerKind::Beauty).0 {
                assert!((value - 1.0).abs() < 1e-5, "{bsdf} {strategy:?}: {value}");
            }
        }
    }
}

/// A Lambertian floor of reflectance ρ, seen from above through a narrow field of view, so that all pixels look at very
/// nearly the point (0, 0, −1); `light` is what shines on it.
fn floor_under(light: &str, reflectance: f32) -> quietlight::scene::Scene {
    scene_around(
        4,
        0.01,
        2,
        &format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="-1"/></transform>
            <bsdf type="diffuse"><rgb name="reflectance" value="{reflectance}"/></bsdf></shape>{light}"#
        ),
    )
}

#[test]
fn a_rectangle_light_gives_lamberts_polygon_irradiance() {
    // A 2×2 light at height h = 2 above the receiver, off the camera's axis at x in [1, 3], facing down. The polygon
    // formula (Lambert 1760): E = L/2 Σ β_i n·(r_i × r_{i+1}) / |r_i × r_{i+1}|.
    let corners = [[1.0, -1.0, 2.0], [3.0, -1.0, 2.0], [3.0, 1.0, 2.0], [1.0, 1.0, 2.0f64]]
        .map(glam::DVec3::from);
    let mut irradiance = 0.0;
    for i in 0..4 {
        let (a, b) = (corners[i].normalize(), corners[(i + 1) % 4].normalize());
        let across = a.cross(b);
        irradiance += 0.5 * across.length().atan2(a.dot(b)) * across.normalize().z;
    }
    let radiance = 3.0;
    let expected = 0.7 / std::f64::consts::PI * radiance * irradiance.abs();
    let scene = floor_under(
        r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><translate x="2" z="1"/>
        </transform><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>"#,
        0.7,
    );
    for strategy in [Light, Bsdf, Mis] {
        let rendered = render_finite(&scene, &settings(16384, 6, strategy));
        assert_mean(mean_and_error(&rendered), expected, 0.01, &format!("{strategy:?}"));
    }
}

#[test]
fn sphere_and_point_lights_give_their_closed_forms() {
    // A sphere light of radius r, its centre at distance d in direction θ, wholly above the horizon:
    // E = π L (r/d)² cos θ (appendix H). At (3, 0, 2) from the receiver, r = 1: d² = 13, cos θ = 2/√13.
    let (d2, cos) = (13.0f64, 2.0 / 13.0f64.sqrt());
    let scene = floor_under(
        r#"<shape type="sphere"><point name="center" x="3" y="0" z="1"/>
        <emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>"#,
        0.5,
    );
    for strategy in [Light, Bsdf, Mis] {
        let rendered = render_finite(&scene, &settings(16384, 7, strategy));
        assert_mean(
            mean_and_error(&rendered),
            0.5 * 2.0 / d2 * cos,
            0.02,
            &format!("sphere, {strategy:?}"),
        );
    }
    // A point light: L = ρ/π I cos θ / d².
    let scene = floor_under(
        r#"<emitter type="point"><point name="position" x="3" y="0" z="1"/><rgb name="intensity" value="4"/></emitter>"#,
        0.5,
    );
    for strategy in [Light, Mis] {
        let rendered = render_finite(&scene, &settings(64, 8, strategy));
        let expected = 0.5 / std::f64::consts::PI * 4.0 * cos / d2;
        // All pixels see the same point up to 1e-4 of the distance, twice that of the radiance.
        let (mean, _) = mean_and_error(&rendered);
        assert!(
            (mean / expected - 1.0).abs() < 5e-4,
            "point, {strategy:?}: {mean}, expected {expected}"
        );
    }
}

#[test]
fn a_glass_slab_dims_a_light_by_its_fresnel_sums() {
    // A light seen straight through a slab of index 1.5: F = 0.04 at normal incidence, and all inner reflections
    // together pass T = (1 − F) / (1 + F).
    let f = 0.04f64;
    let scene = scene_around(
        4,
        0.01,
        -1,
        r#"<shape type="cube"><transform name="to_world"><scale x="50" y="50" z="0.1"/><translate z="-2"/></transform>
        <bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="20"/><translate z="-4"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#,
    );
    for strategy in [Light, Bsdf, Mis] {
        let rendered = render_finite(&scene, &settings(16384, 9, strategy));
        assert_mean(
            mean_and_error(&rendered),
            (1.0 - f) / (1.0 + f),
            0.01,
            &format!("{strategy:?}"),
        );
    }
}

#[test]
fn the_first_edge_shows_emission_and_nothing_else() {
    let scene = scene_around(8, 60.0, 1, &integrating_sphere(0.9, 0.25));
    let rendered = render_finite(&scene, &settings(4, 10, Mis));
    for &value in layer(&rendered, LayerKind::Beauty).0 {
        assert_eq!(value, 0.25);
    }
}
