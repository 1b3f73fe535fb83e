//! The layers beside the picture (METHODS 8, DESIGN 4): what each holds, and how sure it claims to be.

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
fn albedo_lies_in_the_unit_interval_on_every_material() {
    // Where the reflectance is said by the scene, that is what the layer holds; else only its range is known.
    let cases: [(&str, Option<[f32; 3]>); 14] = [
        (
            r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.1 0.5 1"/></bsdf>"#,
            Some([0.1, 0.5, 1.0]),
        ),
        (
            r#"<bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.1 0.5 1"/></bsdf>"#,
            Some([0.1, 0.5, 1.0]),
        ),
        (
            r#"<bsdf type="roughplastic"><rgb name="diffuse_reflectance" value="0.1 0.5 1"/></bsdf>"#,
            Some([0.1, 0.5, 1.0]),
        ),
        (
            r#"<bsdf type="roughconductor"><string name="material" value="none"/><float name="alpha" value="0.4"/></bsdf>"#,
            Some([1.0; 3]),
        ),
        (
            r#"<bsdf type="roughconductor"><string name="material" value="Au"/><float name="alpha" value="0.2"/></bsdf>"#,
            None,
        ),
        (r#"<bsdf type="roughdielectric"><float name="alpha" value="0.2"/></bsdf>"#, None),
        (
            r#"<bsdf type="blendbsdf"><float name="weight" value="0.25"/><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/>
            </bsdf><bsdf type="diffuse"><rgb name="reflectance" value="0.4"/></bsdf></bsdf>"#,
            Some([0.7; 3]),
        ),
        (
            r#"<bsdf type="blendbsdf"><float name="weight" value="0.5"/><bsdf type="roughconductor"/><bsdf type="conductor"/>
            </bsdf>"#,
            None,
        ),
        (
            r#"<bsdf type="mask"><float name="opacity" value="0.5"/><bsdf type="diffuse"/></bsdf>"#,
            None,
        ),
        (
            r#"<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"><rgb name="color0" value="1"/>
            <rgb name="color1" value="0"/><transform name="to_uv"><scale value="9"/></transform></texture></bsdf>"#,
            None,
        ),
        (r#"<bsdf type="conductor"/>"#, Some([0.0; 3])),
        (r#"<bsdf type="dielectric"/>"#, Some([0.0; 3])),
        (r#"<bsdf type="thindielectric"/>"#, Some([0.0; 3])),
        (
            r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.25"/></bsdf>
            <emitter type="area"><rgb name="radiance" value="1e4"/></emitter>"#,
            Some([0.25; 3]),
        ),
    ];
    for (surface, expected) in cases {
        let scene = scene_around(
            8,
            20.0,
            5,
            &format!(
                r#"<shape type="sphere"><point name="center" x="0" y="0" z="-3"/>{surface}</shape>
                <emitter type="constant"><rgb name="radiance" value="50"/></emitter>"#
            ),
        );
        let rendered = render_finite(&scene, &settings(16, 7, Mis));
        for kind in [LayerKind::Albedo, LayerKind::Texture2] {
            for &value in layer(&rendered, kind).0 {
                assert!((0.0..=1.0).contains(&value), "{kind:?} {value} of {surface}");
            }
        }
        if let Some(expected) = expected {
            assert_constant(&rendered, LayerKind::Albedo, &expected);
        }
    }
}

#[test]
fn normals_are_of_unit_length_and_turned_to_the_viewer() {
    // Balls seen from outside, one sheet seen from behind, a bumpy floor, and nothing beside them.
    let scene = scene_around(
        24,
        70.0,
        6,
        r#"<shape type="sphere"><point name="center" x="-1" y="0" z="-4"/><bsdf type="roughplastic"/></shape>
        <shape type="sphere"><point name="center" x="1" y="0" z="-3"/><float name="radius" value="0.6"/>
            <bsdf type="roughdielectric"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="160"/><scale value="0.5"/>
            <translate y="1.2" z="-3"/></transform><bsdf type="diffuse"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
            <translate y="-1" z="-4"/></transform><bsdf type="bumpmap"><float name="scale" value="0.4"/>
            <texture type="checkerboard"><transform name="to_uv"><scale value="5"/></transform></texture>
            <bsdf type="diffuse"/></bsdf></shape>
        <emitter type="constant"/>"#,
    );
    let (mut found, mut missed) = (0, 0);
    for pixel in (0..24).flat_map(|y| (0..24).map(move |x| [x, y])) {
        for sample in samples(&scene, pixel, 2) {
            if sample.normal == Vec3::ZERO {
                assert_eq!((sample.depth, sample.albedo.max_component()), (0.0, 0.0));
                missed += 1;
            } else {
                assert!((sample.normal.length() - 1.0).abs() < 1e-5, "{sample:?}");
                // The camera is at the origin of the file, and every surface here is found at the first hit.
                let to_viewer = scene.camera.center() - sample.position;
                assert!(sample.normal.dot(to_viewer) >= 0.0, "{sample:?}");
                assert!((to_viewer.length() / sample.depth - 1.0).abs() < 1e-4, "{sample:?}");
                found += 1;
            }
        }
    }
    assert!(found > 200 && missed > 200, "{found} hits, {missed} misses");
}

#[test]
fn features_follow_a_mirror_to_the_wall_that_it_shows() {
    // A mirror at 45°, 2 in front of the camera, shows a wall 3 to its side: its normal looks back along the light.
    let wall = |bsdf: &str| {
        scene_around(
            2,
            0.01,
            5,
            &format!(
                r#"<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="45"/><translate z="-2"/></transform>
                {bsdf}</shape>
                <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="-90"/><translate x="3" z="-2"/></transform>
                <bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.2 0.1"/></bsdf></shape>
                <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#
            ),
        )
    };
    let scene = wall(r#"<bsdf type="conductor"/>"#);
    let rendered = render_finite(&scene, &settings(4, 8, Mis));
    assert_constant(&rendered, LayerKind::Albedo, &[0.7, 0.2, 0.1]);
    assert_constant(&rendered, LayerKind::Texture2, &[0.7, 0.2, 0.1]);
    assert_constant(&rendered, LayerKind::Depth, &[5.0]);
    for sample in samples(&scene, [0, 0], 4) {
        assert!((sample.normal + Vec3::X).length() < 1e-5, "{sample:?}");
        let mirror = sample.position.as_dvec3() + scene.origin;
        assert!((mirror - glam::DVec3::new(0.0, 0.0, -2.0)).length() < 1e-3, "{mirror}");
        assert_eq!(sample.visibility, 0.0, "a mirror takes no light samples");
    }
    // A rough mirror is a surface of its own.
    let rough = r#"<bsdf type="roughconductor"><string name="material" value="none"/><float name="alpha" value="0.2"/></bsdf>"#;
    let rendered = render_finite(&wall(rough), &settings(4, 8, Mis));
    assert_constant(&rendered, LayerKind::Albedo, &[1.0; 3]);
    assert_constant(&rendered, LayerKind::Depth, &[2.0]);
}

#[test]
fn features_follow_glass_to_what_lies_behind() {
    // A pane 0.2 thick, 1.9 in front of the camera, a wall at 4. Light that the pane reflects finds nothing; each pair of
    // reflections inside makes the path 0.4 longer.
    let scene = scene_around(
        2,
        0.01,
        -1,
        r#"<shape type="cube"><transform name="to_world"><scale x="50" y="50" z="0.1"/><translate z="-2"/></transform>
        <bsdf type="dielectric"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="20"/><translate z="-4"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.3 0.6 0.9"/></bsdf></shape>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#,
    );
    let (mut through, mut reflected) = (0, 0);
    for sample in samples(&scene, [1, 0], 1000) {
        let position = sample.position.as_dvec3() + scene.origin;
        assert!((position.z + 1.9).abs() < 1e-4, "{position}");
        if sample.normal == Vec3::ZERO {
            assert_eq!((sample.depth, sample.albedo.max_component()), (0.0, 0.0), "{sample:?}");
            reflected += 1;
        } else {
            assert_eq!(sample.albedo.to_array(), [0.3, 0.6, 0.9]);
            assert!((sample.normal - Vec3::Z).length() < 1e-5, "{sample:?}");
            let pairs = (sample.depth - 4.0) / 0.4;
            assert!(pairs > -1e-3 && (pairs - pairs.round()).abs() < 1e-2, "{sample:?}");
            // The second hit is the far side of the pane.
            assert_eq!(sample.texture2.to_array(), [1.0; 3]);
            through += 1;
        }
        assert_eq!(sample.diffuse.max_component(), 0.0, "all that glass shows is specular");
    }
    // A slab of index 1.5 passes (1 − F) / (1 + F) = 92.3 % of the light: 1000 draws have a deviation of 8.4.
    assert!((through - 923i32).abs() < 40 && through + reflected == 1000, "{through} {reflected}");
}

#[test]
fn positions_are_those_of_the_file_far_from_its_origin() {
    let scene = scene_from(
        r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/>
        <transform name="to_world"><lookat origin="1000000,-200000,30005" target="1000000,-200000,30000" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="9"/><integer name="height" value="9"/><rfilter type="box"/></film></sensor>
        <shape type="rectangle"><transform name="to_world"><scale value="20"/><translate x="1000000" y="-200000" z="30000"/>
        </transform></shape><emitter type="constant"/></scene>"#,
    );
    let rendered = render_finite(&scene, &settings(64, 9, Mis));
    let (mean, variance) = layer(&rendered, LayerKind::Position);
    let [_, _, depth] = [0, 1, 2].map(|channel| mean[[channel, 4, 4]]);
    assert_eq!(depth, 30000.0);
    // Half a pixel is 5 tan 20° / 9 = 0.2 wide, and 1e6 is stored in steps of 0.06.
    assert!((mean[[0, 4, 4]] - 1e6).abs() < 0.15, "{}", mean[[0, 4, 4]]);
    assert!((mean[[1, 4, 4]] + 2e5).abs() < 0.15, "{}", mean[[1, 4, 4]]);
    // The variance is that of points spread over a pixel 0.404 wide, w² / 12 / 64, and not of numbers around 1e6. Four
    // samples' worth of its deviation at kurtosis 1.8, sqrt(0.8 / 64) = 11 %, is 45 %.
    let expected = (10.0 * 20f32.to_radians().tan() / 9.0).powi(2) / 12.0 / 64.0;
    assert!(
        (variance[[0, 4, 4]] / expected - 1.0).abs() < 0.45,
        "{} {expected}",
        variance[[0, 4, 4]]
    );
    // Depth is measured from the camera, not from its near plane.
    assert!((layer(&rendered, LayerKind::Depth).0[[0, 4, 4]] - 5.0).abs() < 5e-3);
}

#[test]
fn a_miss_has_no_features_and_is_specular() {
    let scene = scene_around(
        8,
        60.0,
        -1,
        r#"<emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>"#,
    );
    let rendered = render_finite(&scene, &settings(4, 10, Mis));
    for kind in LayerKind::ALL {
        let expected =
            if matches!(kind, LayerKind::Beauty | LayerKind::Specular) { 0.5 } else { 0.0 };
        if kind != LayerKind::Position {
            assert_constant(&rendered, kind, &[expected; 3]);
        }
    }
    for sample in samples(&scene, [3, 3], 4) {
        assert_eq!(PathSample { specular: sample.specular, ..PathSample::default() }, sample);
    }
}

#[test]
fn visibility_is_the_share_of_light_samples_that_arrive() {
    // A light of 2×2 over the camera's head, 2 above the floor, to the side; screens halfway between them.
    let floor = |screen: &str| {
        let scene = scene_around(
            4,
            0.01,
            2,
            &format!(
                r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="-1"/></transform>
                <bsdf type="diffuse"/></shape>
                <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><translate x="2" z="1"/>
                </transform><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>{screen}"#
            ),
        );
        render_finite(&scene, &settings(1024, 11, Light))
    };
    // The screen's edges as seen from the floor point lie at twice their distance on the light's plane.
    let screen = |y: f32, bsdf: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale x="0.9"/><translate x="1.1" y="{y}"/></transform>
            {bsdf}</shape>"#
        )
    };
    let opaque = r#"<bsdf type="twosided"><bsdf type="diffuse"/></bsdf>"#;
    assert_constant(&floor(""), LayerKind::Visibility, &[1.0]);
    assert_constant(&floor(&screen(0.0, opaque)), LayerKind::Visibility, &[0.0]);
    // Half of the light, whichever way points on it are chosen: screen and light are mirrored at the plane y = 0.
    let half = floor(&screen(1.0, opaque));
    let mean = layer(&half, LayerKind::Visibility).0.mean().expect("pixels");
    let z = (f64::from(mean) - 0.5) / (0.5 / f64::sqrt(16.0 * 1024.0));
    assert!(p_of_z(z) > LEVEL, "visibility {mean} in the penumbra, z = {z:.2}");
    let veil =
        r#"<bsdf type="mask"><float name="opacity" value="0.25"/><bsdf type="diffuse"/></bsdf>"#;
    assert_constant(&floor(&screen(0.0, veil)), LayerKind::Visibility, &[0.75]);
    // And the picture is as much darker as the visibility says.
    let (bright, dim) = (floor(""), floor(&screen(0.0, veil)));
    let ratio = mean_and_error_of(LayerKind::Beauty, &dim).0
        / mean_and_error_of(LayerKind::Beauty, &bright).0;
    assert!((ratio - 0.75).abs() < 1e-5, "{ratio}");
}

#[test]
fn texture2_is_the_albedo_of_the_second_hit() {
    // From any point of a sphere's inside the next hit is the sphere.
    let inside = r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.3 0.2 0.1"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#;
    for max_depth in [2, 5, -1] {
        let rendered =
            render_finite(&scene_around(4, 60.0, max_depth, inside), &settings(4, 12, Mis));
        assert_constant(&rendered, LayerKind::Texture2, &[0.3, 0.2, 0.1]);
    }
    // From a floor under the sky there is none.
    let rendered = render_finite(&point_lit_floor(-1), &settings(4, 12, Mis));
    assert_constant(&rendered, LayerKind::Texture2, &[0.0; 3]);
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

/// Renders of the same small film with different seeds; of four samples a pixel, so that n − 1 is far from n.
fn replicas(sampler: SamplerKind) -> Vec<Rendered> {
    // No wider than the window over which variances are compared with halves, so that the window is the film.
    let scene = still_life(11);
    (0..256)
        .map(|seed| render_finite(&scene, &RenderSettings { sampler, ..settings(4, seed, Mis) }))
        .collect()
}

/// For each replica the sum over pixels and channels of `difference(pixel's deviations, index, replica)`, where
/// deviations are those of the halves A and B from their means over all replicas.
fn over_replicas(
    replicas: &[Rendered],
    kind: LayerKind,
    each: impl Fn(f64, f64, f64) -> f64,
) -> Mean {
    let count = replicas.len() as f64;
    let halves =
        |r: &Rendered| r.layers.layers[&kind].halves.clone().expect("the film gives halves");
    let all: Vec<_> = replicas.iter().map(halves).collect();
    let zero = ndarray::Array3::<f64>::zeros(all[0][0].dim());
    let means = [0, 1].map(|half| {
        all.iter().fold(zero.clone(), |sum, halves| sum + halves[half].mapv(f64::from)) / count
    });
    replicas
        .iter()
        .zip(&all)
        .map(|(rendered, halves)| {
            let variance = layer(rendered, kind).1;
            let deviation = |half: usize, at| f64::from(halves[half][at]) - means[half][at];
            ndarray::indices(variance.dim())
                .into_iter()
                .map(|(c, y, x)| {
                    let at = [c, y, x];
                    each(deviation(0, at), deviation(1, at), f64::from(variance[at]))
                })
                .sum()
        })
        .collect()
}

#[test]
fn the_reported_variance_is_that_of_the_mean() {
    // Over R replicas Σ (x − x̄)² R / (R − 1) − Σ σ² has the expectation 0; the sums over a picture are nearly normal.
    for sampler in [SamplerKind::Independent, SamplerKind::Sobol] {
        let replicas = replicas(sampler);
        let unbiased = replicas.len() as f64 / (replicas.len() - 1) as f64;
        for kind in [
            LayerKind::Beauty,
            LayerKind::Diffuse,
            LayerKind::Specular,
            LayerKind::Albedo,
            LayerKind::Visibility,
        ] {
            let squared = |a: f64, b: f64| 0.25 * (a + b) * (a + b) * unbiased;
            let difference =
                over_replicas(&replicas, kind, |a, b, variance| squared(a, b) - variance);
            let found = over_replicas(&replicas, kind, |a, b, _| squared(a, b)).mean();
            let what = format!("{sampler:?} {kind:?}");
            let error = difference.variance_of_mean().sqrt() / found;
            assert!(error < 0.1, "{what}: an error of {error:.3} of the variance sees nothing");
            let p = difference.p_against(0.0);
            assert!(
                p > LEVEL,
                "{what}: {:.3} of the variance too little, p {p:.1e}",
                difference.mean() / found
            );
        }
    }
}

#[test]
fn stratified_samples_have_less_variance_and_say_so() {
    // Direct light of a large emitter on a floor: two smooth integrals over two numbers each.
    let scene = scene_around(
        11,
        40.0,
        2,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="-2"/></transform>
        <bsdf type="diffuse"/></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><scale value="2"/>
        <translate x="1" z="1"/></transform><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>"#,
    );
    let sum = |sampler| -> f64 {
        let rendered = render_finite(&scene, &RenderSettings { sampler, ..settings(64, 14, Mis) });
        layer(&rendered, LayerKind::Diffuse).1.iter().map(|&value| f64::from(value)).sum()
    };
    // Points of a (0, 2)-sequence integrate it at n^-3 instead of n^-1; at half of 64 that is far more than the half.
    let (sobol, independent) = (sum(SamplerKind::Sobol), sum(SamplerKind::Independent));
    assert!(sobol < 0.5 * independent, "{sobol} and {independent}");
}

#[test]
fn halves_are_independent_and_average_to_the_mean() {
    for sampler in [SamplerKind::Independent, SamplerKind::Sobol] {
        let replicas = replicas(sampler);
        for kind in [LayerKind::Beauty, LayerKind::Visibility, LayerKind::Albedo] {
            for rendered in &replicas[..4] {
                let layer = &rendered.layers.layers[&kind];
                let [a, b] = layer.halves.as_ref().expect("the film gives halves");
                for ((&mean, &a), &b) in layer.mean.iter().zip(a).zip(b) {
                    // Each is rounded once; of the sums the larger half bounds the rounding.
                    assert!(
                        (0.5 * (a + b) - mean).abs() <= 4e-7 * a.abs().max(b.abs()),
                        "{a} {b} {mean}"
                    );
                }
            }
            let covariance = over_replicas(&replicas, kind, |a, b, _| a * b);
            let variance = over_replicas(&replicas, kind, |a, b, _| 0.5 * (a * a + b * b)).mean();
            let what = format!("{sampler:?} {kind:?}");
            let error = covariance.variance_of_mean().sqrt() / variance;
            assert!(error < 0.1, "{what}: an error of {error:.3} of the variance sees nothing");
            let p = covariance.p_against(0.0);
            assert!(
                p > LEVEL,
                "{what}: correlation {:.3}, p {p:.1e}",
                covariance.mean() / variance
            );
        }
    }
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
