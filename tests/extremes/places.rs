//! Where things are, at the extremes, for all methods.

use super::*;

#[test]
fn a_scene_is_as_bright_at_every_scale_and_far_from_the_origin() {
    let expected = by_path(&scaled(12, 6, 1.0, 0.0), 256);
    for (scale, offset) in [(1e-4, 0.0), (1e7, 0.0), (1.0, 1e6)] {
        let scene = scaled(12, 6, scale, offset);
        for (name, integrator) in methods() {
            let found = replicas(&scene, integrator, REPLICAS, 16);
            assert_same_mean(&found, &expected, &format!("{scale}, {offset}, {name}"));
        }
    }
}

#[test]
fn a_lens_of_radius_zero_is_a_pinhole() {
    let scene = |sensor: &str| {
        scene_from(&format!(
            r#"<scene version="3.0.0"><sensor {sensor}<float name="fov" value="40"/>
                <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
                <film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="12"/></film></sensor>
            <shape type="sphere"/><emitter type="constant"/></scene>"#
        ))
    };
    let lens = r#"type="thinlens"><float name="aperture_radius" value="0"/><float name="focus_distance" value="5"/>"#;
    let expected = by_path(&scene(r#"type="perspective">"#), 64);
    let scene = scene(lens);
    for (name, integrator) in methods() {
        assert_same_mean(&replicas(&scene, integrator, REPLICAS, 8), &expected, name);
    }
}

#[test]
fn cameras_inside_glass_inside_a_light_and_on_a_surface_see_something_finite() {
    let sky = r#"<emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;
    let glass = format!(r#"<shape type="sphere"><bsdf type="dielectric"/></shape>{sky}"#);
    let lamp = r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>"#;
    assert_like_path(&scene_around(6, 60.0, 6, &glass), "inside glass");
    assert_like_path(&scene_around(6, 60.0, 6, lamp), "inside a light");
    let surface = format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale value="5"/></transform></shape>{sky}"#
    );
    let scene = scene_around(6, 60.0, 6, &surface);
    for (_, integrator) in methods() {
        rendered(&scene, integrator, 8, 1);
    }
}

#[test]
fn degenerate_triangles_light_nothing() {
    // A lamp of one sound triangle among one of no area, one with a vertex twice, a sliver
    // of 4e6 : 1, a few units in the last place high, and one with a NaN, over a floor. The sliver shines, with all of its area.
    let scene = |triangles: &str| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let obj = format!(
            "v -1 1.5 -3\nv 1 1.5 -3\nv 0 1.5 -4\nv 0 1 -3\nv 2 1 -3\nv 4 1 -3\nv 0 1 -3.0000004\nv nan 0 0\n{triangles}"
        );
        std::fs::write(folder.path().join("mesh.obj"), obj).expect("the mesh is written");
        let text = format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="4"/></integrator>
            <sensor type="perspective"><float name="fov" value="60"/>
            <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>
                <rfilter type="box"/></film></sensor>
            <shape type="obj"><string name="filename" value="mesh.obj"/><boolean name="flip_normals" value="true"/>
                <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>
            <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
                <translate y="-1" z="-3"/></transform>{GREY}</shape></scene>"#
        );
        let file = folder.path().join("scene.xml");
        std::fs::write(&file, text).expect("the scene is written");
        Scene::load(&file, &LoadOptions::default()).expect("the scene loads")
    };
    let spoiled = scene("f 1 2 3\nf 4 5 6\nf 1 1 2\nf 4 5 7\nf 1 2 8\n");
    for told in ["1 triangles or shapes have a coordinate", "2 triangles or shapes have no area"] {
        assert!(
            spoiled.warnings.iter().any(|found| found.contains(told)),
            "{:?}",
            spoiled.warnings
        );
    }
    let expected = by_path(&scene("f 1 2 3\n"), 256);
    assert!(expected[0].mean() > 0.1);
    assert_same_mean(&by_path(&spoiled, 256), &expected, "path");
    for (name, integrator) in methods() {
        assert_same_mean(&replicas(&spoiled, integrator, REPLICAS, 16), &expected, name);
    }
}

#[test]
fn walls_that_meet_in_a_wedge_connect_as_close_as_one_likes() {
    // Two white walls at 6 degrees, seen into: light that gets deep into the wedge goes between points that nearly coincide.
    let wall = |angle: f32| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/>
            <translate z="1"/><scale x="3" y="1" z="2"/><rotate x="1" angle="{angle}"/><translate z="-4"/></transform>
            <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.9"/></bsdf></bsdf></shape>"#
        )
    };
    let scene = scene_around(
        8,
        20.0,
        8,
        &format!(
            r#"{}{}<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><scale value="0.5"/>
            <translate z="0.5"/></transform><emitter type="area"><rgb name="radiance" value="9"/></emitter></shape>"#,
            wall(3.0),
            wall(-3.0)
        ),
    );
    assert_like_path(&scene, "wedge");
}

#[test]
fn sheets_that_coincide_are_as_bright_as_by_path_tracing() {
    let sheet = format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale value="2"/><translate z="-3"/></transform>{GREY}</shape>"#
    );
    let lamp = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate z="-2" y="1"/></transform>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#;
    let scene = scene_around(8, 60.0, 6, &format!("{sheet}{sheet}{lamp}"));
    assert_like_path(&scene, "coinciding sheets");
}
