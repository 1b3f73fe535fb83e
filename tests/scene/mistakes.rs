//! Scenes with something wrong in them: told with its place and what would be right, never a panic.

use super::{CAMERA, load, load_with, message};
use quietlight::scene::{LoadOptions, Scene};
use std::fs;
use tempfile::TempDir;

#[test]
fn triangles_that_no_ray_can_hit_are_counted() {
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\n";
    let content =
        format!("{CAMERA}<shape type='obj'><string name='filename' value='a.obj'/></shape>");
    let scene = load_with(&content, &[("a.obj", obj)], &LoadOptions::default()).expect("a scene");
    assert_eq!(scene.warnings, ["1 triangles or shapes have no area; left out"]);
}

#[test]
fn definitions_that_nothing_uses_are_counted_and_not_read() {
    let scene = load(
        "<bsdf type='nonsense' id='a'/><bsdf type='diffuse' id='b'/><shape type='cube'><ref id='b'/></shape>",
    );
    let warnings = scene.expect("a scene").warnings;
    assert!(
        matches!(&warnings[..], [warning] if warning.contains("scene.xml:4:") && warning.contains("1 unused")),
        "{warnings:?}"
    );
}

#[test]
fn a_mistake_is_told_with_its_place_and_what_is_known() {
    let shape = |inside: &str| format!("<shape type='cube'>{inside}</shape>");
    let bsdf = |inside: &str| shape(&format!("<bsdf {inside}</bsdf>"));
    for (content, expected) in [
        (shape("<bsdf type='difuse'/>"), "did you mean \"diffuse\"?); known: blendbsdf, bumpmap"),
        (
            bsdf("type='diffuse'><rgb name='reflectence' value='1'/>"),
            "did you mean \"reflectance\"?",
        ),
        (
            bsdf("type='diffuse'><rgb name='reflectance' value='1.5'/>"),
            "expected values from 0 to 1",
        ),
        (
            bsdf("type='diffuse'><boolean name='reflectance' value='true'/>"),
            "expected a texture, color or number",
        ),
        (bsdf("type='conductor'><string name='material' value='Gold'/>"), "Au"),
        (
            bsdf("type='conductor'><string name='material' value='Au'/><rgb name='k' value='1'/>"),
            "beside eta or k",
        ),
        (bsdf("type='dielectric'><string name='int_ior' value='bk8'/>"), "did you mean \"bk7\"?"),
        (bsdf("type='dielectric'><float name='int_ior' value='0'/>"), "expected more than 0"),
        (bsdf("type='plastic'><float name='int_ior' value='1.000277'/>"), "equal to ext_ior"),
        (
            bsdf("type='roughconductor'><string name='distribution' value='phong'/>"),
            "known: beckmann, ggx",
        ),
        (bsdf("type='roughconductor'><float name='alpha_u' value='0.1'/>"), "alpha_v beside it"),
        (bsdf("type='roughplastic'><float name='alpha' value='-1'/>"), "expected 0 or more"),
        (
            bsdf("type='twosided'><bsdf type='dielectric'/>"),
            "expected a bsdf that lets no light through",
        ),
        (bsdf("type='twosided'>"), "the bsdf of bsdf \"twosided\" is missing"),
        (
            bsdf("type='twosided'><bsdf type='diffuse'/><bsdf type='plastic'/>"),
            "the same for both sides",
        ),
        (
            bsdf("type='blendbsdf'><bsdf type='diffuse'/>"),
            "one of the two bsdfs to blend is missing",
        ),
        (
            bsdf("type='bumpmap'><bsdf type='diffuse'/>"),
            "the texture of bsdf \"bumpmap\" is missing",
        ),
        (
            bsdf("type='diffuse'><texture name='reflectance' type='perlin'/>"),
            "known: bitmap, checkerboard",
        ),
        (
            bsdf(
                "type='diffuse'><texture name='reflectance' type='bitmap'><string name='filename' value='no.png'/></texture>",
            ),
            "expected a file in",
        ),
        (shape("<bsdf type='diffuse'/><bsdf type='diffuse'/>"), "was already given at"),
        (
            shape("<medium type='homogeneous' name='interior'/>"),
            "unknown element inside shape \"cube\" \"medium\"",
        ),
        (shape("<emitter type='point'/>"), "known: area"),
        (
            shape("<transform name='to_world'><scale x='0'/></transform>"),
            "expected a transform that loses no dimension",
        ),
        (
            "<shape type='sphere'><float name='radius' value='0'/></shape>".into(),
            "expected more than 0",
        ),
        (
            "<shape type='cylinder'><point name='p1' value='0'/></shape>".into(),
            "expected another point than p0",
        ),
        ("<shape type='heightfield'/>".into(), "known: cube, cylinder, disk"),
        ("<shape type='obj'/>".into(), "\"filename\" of shape \"obj\" is missing"),
        ("<emitter type='area'/>".into(), "expected an emitter nested in a shape"),
        ("<emitter type='sunsky'/>".into(), "known: constant, directional, envmap, point, spot"),
        (
            "<emitter type='constant'/><emitter type='constant'/>".into(),
            "the environment was already given",
        ),
        (
            "<emitter type='constant'><rgb name='radiance' value='-1'/></emitter>".into(),
            "expected no negative value",
        ),
        (
            "<emitter type='spot'><float name='beam_width' value='30'/></emitter>".into(),
            "from 0 to cutoff_angle",
        ),
        (
            "<emitter type='directional'><vector name='direction' value='0'/></emitter>".into(),
            "with a length",
        ),
        ("<integrator type='volpath'/>".into(), "known: direct, path"),
        (
            "<integrator type='path'><integer name='max_depth' value='-2'/></integrator>".into(),
            "-1 for no limit",
        ),
        (
            "<integrator type='path'><float name='max_depth' value='2'/></integrator>".into(),
            "expected an integer",
        ),
        (
            "<float name='gamma' value='2.2'/>".into(),
            "unknown property of scene \"scene\" \"gamma\"",
        ),
    ] {
        let error = match load(&format!("\n\n  {content}")) {
            Err(error) => message(&error),
            Ok(_) => panic!("loaded: {content}"),
        };
        assert!(error.contains("scene.xml:6:"), "{content}: {error}");
        assert!(error.contains(expected), "{content}: {error}");
    }
}

#[test]
fn a_wrong_sensor_is_told_with_its_place() {
    let film = |inside: &str| {
        format!("<sensor type='perspective'><film type='hdrfilm'>{inside}</film></sensor>")
    };
    let integer = |name: &str, value: i64| format!("<integer name='{name}' value='{value}'/>");
    let sensor = |inside: &str| format!("<sensor type='perspective'>{inside}</sensor>");
    for (content, expected) in [
        (String::new(), "a <sensor> is missing"),
        ("<sensor type='orthographic'/>".into(), "known: perspective, thinlens"),
        (
            "<sensor type='thinlens'/>".into(),
            "\"aperture_radius\" of sensor \"thinlens\" is missing",
        ),
        (sensor("<float name='fov' value='180'/>"), "between 0 and 180"),
        (sensor("<string name='fov_axis' value='z'/>"), "known: diagonal, larger, smaller, x, y"),
        (sensor("<string name='focal_length' value='wide'/>"), "millimetres"),
        (
            sensor("<float name='fov' value='45'/><string name='focal_length' value='50mm'/>"),
            "one of them",
        ),
        (
            sensor("<float name='near_clip' value='10'/><float name='far_clip' value='1'/>"),
            "far_clip",
        ),
        (sensor("<transform name='to_world'><scale x='2'/></transform>"), "turned and moved only"),
        (sensor("<film type='specfilm'/>"), "known: hdrfilm"),
        (sensor("<sampler type='blue'/>"), "known: halton"),
        (
            sensor(
                "<sampler type='independent'><integer name='sample_count' value='0'/></sampler>",
            ),
            "at least 1",
        ),
        (film(&integer("width", 0)), "at least 1 pixel"),
        (film(&integer("height", -5)), "at least 1 pixel"),
        (
            film(&format!(
                "{}{}",
                integer("width", 4_000_000_000),
                integer("height", 4_000_000_000)
            )),
            "at most",
        ),
        (film(&integer("width", 5_000_000_000)), "at least 1 pixel"),
        (film(&integer("crop_offset_x", 768)), "a part of the film's 768 pixels"),
        (film(&integer("crop_width", 769)), "a part of the film's 768 pixels"),
        (film(&integer("crop_offset_y", i64::MIN)), "a part of the film's 576 pixels"),
        (film(&integer("crop_height", i64::MAX)), "a part of the film's 576 pixels"),
    ] {
        let error = match load_with(&content, &[], &LoadOptions::default()) {
            Err(error) => message(&error),
            Ok(_) => panic!("loaded: {content}"),
        };
        assert!(error.contains("scene.xml:1:") && error.contains(expected), "{content}: {error}");
    }
    for size in [(0, 10), (u32::MAX, u32::MAX)] {
        let options = LoadOptions { size: Some(size), ..LoadOptions::default() };
        assert!(load_with(CAMERA, &[], &options).is_err(), "{size:?}");
    }
}

#[test]
fn broken_files_that_a_scene_names_are_told_with_both_places() {
    for (content, name, bytes) in [
        (
            "<shape type='obj'><string name='filename' value='a.obj'/></shape>",
            "a.obj",
            &b"v 0 0 0\nf 1 2 3\n"[..],
        ),
        (
            "<shape type='ply'><string name='filename' value='a.ply'/></shape>",
            "a.ply",
            b"ply\nformat",
        ),
        (
            "<emitter type='envmap'><string name='filename' value='a.exr'/></emitter>",
            "a.exr",
            b"\x76\x2f\x31\x01\x02",
        ),
    ] {
        let error =
            load_with(&format!("{CAMERA}{content}"), &[(name, bytes)], &LoadOptions::default());
        let error = message(&error.expect_err(content));
        assert!(error.contains("scene.xml:4:") && error.contains(name), "{error}");
    }
}

#[test]
fn a_path_that_is_no_scene_is_refused() {
    let folder = TempDir::new().expect("a temporary folder");
    for name in ["none", "none.xml", "scene.blend", "."] {
        fs::write(folder.path().join("scene.blend"), "BLENDER").expect("a file");
        let error = message(
            &Scene::load(&folder.path().join(name), &LoadOptions::default()).expect_err(name),
        );
        assert!(error.contains(folder.path().to_string_lossy().as_ref()), "{error}");
    }
}
