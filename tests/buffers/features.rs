//! What surfaces are like, in buffers.

use super::*;

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
