//! Surface coordinates: where they run, what keeps them, what turns and flips them.

use super::{CAMERA, CENTER, CHECKS, load, load_with, look};
use glam::Vec2;
use quietlight::geometry::Part;
use quietlight::scene::LoadOptions;

#[test]
fn uv_runs_over_a_rectangle_from_corner_to_corner() {
    let scene = load(&format!("<shape type='rectangle'>{CHECKS}</shape>")).expect("a scene");
    // 25 pixels a unit: (0.5, 0.25) is at 12.5 pixels to the right and 6.25 up.
    let uv = look(&scene, [112.5, 43.75]).expect("a hit").uv;
    assert!((uv - Vec2::new(0.75, 0.625)).length() < 1e-5, "{uv}");
}

#[test]
fn meshes_keep_surface_coordinates_for_what_asks_for_them() {
    const BOARD: &str = "<texture type='checkerboard'";
    let asking = [
        CHECKS.to_owned(),
        format!("<bsdf type='mask'>{BOARD} name='opacity'/><bsdf type='diffuse'/></bsdf>"),
        format!("<bsdf type='bumpmap'>{BOARD}/><bsdf type='diffuse'/></bsdf>"),
        "<bsdf type='roughconductor'><float name='alpha_u' value='0.1'/><float name='alpha_v' value='0.3'/></bsdf>".into(),
        format!("<emitter type='area'>{BOARD} name='radiance'/></emitter>"),
    ];
    let others = [
        String::new(),
        "<bsdf type='roughconductor'><float name='alpha' value='0.1'/></bsdf>".into(),
        "<emitter type='area'/>".into(),
    ];
    let kept = |inside: &String| {
        let scene = load(&format!("<shape type='cube'>{inside}</shape>")).expect("a scene");
        let mesh = scene.geometry.parts()[0].mesh().expect("a mesh");
        assert!([0, mesh.positions.len()].contains(&mesh.uvs.len()), "{inside}");
        !mesh.uvs.is_empty()
    };
    for inside in &asking {
        assert!(kept(inside), "{inside}");
    }
    for inside in &others {
        assert!(!kept(inside), "{inside}");
    }
}

#[test]
fn texture_coordinates_turn_with_spheres_and_cylinders() {
    let pattern = CHECKS;
    let turn = "<transform name='to_world'><rotate y='1' angle='90'/></transform>";
    let shape = |name: &str, inside: &str| {
        load(&format!("<shape type='{name}'>{inside}</shape>")).expect("a scene")
    };
    for name in ["sphere", "cylinder"] {
        assert!(!matches!(shape(name, turn).geometry.parts()[0], Part::Mesh(_)), "{name}");
        // A direction to follow turns as a pattern does.
        let brushed = "<bsdf type='roughconductor'><float name='alpha_u' value='0.1'/>\
            <float name='alpha_v' value='0.6'/></bsdf>";
        for bsdf in [pattern, brushed] {
            let turned = shape(name, &format!("{turn}{bsdf}"));
            assert!(matches!(turned.geometry.parts()[0], Part::Mesh(_)), "{name} {bsdf}");
        }
    }
    // The pole of v = 0, at +z of the object, is turned to +x; what was at +x is at -z. Looked at from +z, the middle of
    // the sphere is what was at -x: half around.
    let at = look(&shape("sphere", &format!("{turn}{pattern}")), CENTER).expect("a hit");
    assert!((at.uv - Vec2::new(0.5, 0.5)).length() < 1e-3, "{}", at.uv);
    let at = look(&shape("sphere", &format!("{turn}{pattern}")), [115.0, 50.0]).expect("a hit");
    assert!(at.uv.y < 0.45, "{}", at.uv);
    // And the analytic one agrees with the mesh where both serve.
    let analytic = look(&shape("sphere", pattern), [110.0, 40.0]).expect("a hit").uv;
    let stretched = "<transform name='to_world'><scale x='1.002'/></transform>";
    let mesh =
        look(&shape("sphere", &format!("{stretched}{pattern}")), [110.0, 40.0]).expect("a hit").uv;
    assert!((analytic - mesh).length() < 3e-3, "{analytic} {mesh}");
}

#[test]
fn obj_flips_v_unless_told_not_to_and_ply_does_not() {
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0.25\nf 1/1 2/1 3/1\n";
    let ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float u\nproperty float v\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0 0.25\n1 0 0 0 0.25\n0 1 0 0 0.25\n3 0 1 2\n";
    for (kind, flip, v) in
        [("obj", "", 0.75), ("ply", "", 0.25), ("obj", "false", 0.25), ("ply", "true", 0.75)]
    {
        let flip = match flip {
            "" => String::new(),
            flip => format!("<boolean name='flip_tex_coords' value='{flip}'/>"),
        };
        let content = format!(
            "{CAMERA}<shape type='{kind}'><string name='filename' value='a.{kind}'/>{flip}{CHECKS}</shape>"
        );
        let scene = load_with(&content, &[("a.obj", obj), ("a.ply", ply)], &LoadOptions::default())
            .expect("a scene");
        let Part::Mesh(mesh) = &scene.geometry.parts()[0] else { panic!("not a mesh") };
        assert_eq!(mesh.uvs, [Vec2::new(0.0, v); 3], "{kind} {flip}");
    }
}
