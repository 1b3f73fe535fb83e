//! Mitsuba scene files, from the text to the scene.

mod coordinates;
mod mistakes;

use glam::{DVec3, Vec2, Vec3};
use quietlight::geometry::{Interaction, Part};
use quietlight::scene::{LoadOptions, PathLimits, Scene, SceneError};
use std::error::Error;
use std::fs;
use tempfile::TempDir;

const CAMERA: &str = "<sensor type='perspective'><float name='fov' value='90'/>
    <transform name='to_world'><lookat origin='0, 0, 4' target='0, 0, 0' up='0, 1, 0'/></transform>
    <film type='hdrfilm'><integer name='width' value='200'/><integer name='height' value='100'/>
    <rfilter type='box'/></film></sensor>";

/// Loads `<scene version='3.0.0'>` with this content, written beside files of these names.
fn load_with(
    content: &str,
    files: &[(&str, &[u8])],
    options: &LoadOptions,
) -> Result<Scene, SceneError> {
    let folder = TempDir::new().expect("a temporary folder");
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).expect("a file");
    }
    let text = format!("<scene version='3.0.0'>{content}</scene>");
    fs::write(folder.path().join("scene.xml"), text).expect("a file");
    Scene::load(folder.path(), options)
}

/// As [`load_with`], after a camera that looks from (0, 0, 4) to the origin.
fn load(content: &str) -> Result<Scene, SceneError> {
    load_with(&format!("{CAMERA}{content}"), &[], &LoadOptions::default())
}

/// An error with its causes.
fn message(error: &SceneError) -> String {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        message += &format!(": {error}");
        cause = error.source();
    }
    message
}

/// What the camera sees in a pixel.
fn look(scene: &Scene, pixel: [f32; 2]) -> Option<Interaction> {
    let ray = scene.camera.ray(Vec2::from(pixel), Vec2::ZERO);
    let hit = scene.geometry.intersect(&ray)?;
    Some(scene.geometry.interaction(&ray, &hit))
}

/// A material that asks for surface coordinates.
const CHECKS: &str =
    "<bsdf type='diffuse'><texture name='reflectance' type='checkerboard'/></bsdf>";

const CENTER: [f32; 2] = [100.0, 50.0];

#[test]
fn every_plugin_is_read() {
    let mut image = std::io::Cursor::new(Vec::new());
    image::DynamicImage::new_luma8(1, 1)
        .write_to(&mut image, image::ImageFormat::Png)
        .expect("a black picture");
    let image = image.into_inner();
    let triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let content = "<integrator type='path'><integer name='max_depth' value='7'/><integer name='rr_depth' value='3'/>
          <boolean name='hide_emitters' value='true'/></integrator>
        <sensor type='thinlens'><float name='aperture_radius' value='0.1'/><float name='focus_distance' value='2'/>
          <string name='focal_length' value='35mm'/><float name='near_clip' value='0.1'/>
          <float name='far_clip' value='50'/><float name='principal_point_offset_x' value='0.1'/>
          <sampler type='multijitter'><integer name='sample_count' value='9'/></sampler>
          <film type='hdrfilm'><integer name='width' value='20'/><integer name='height' value='10'/>
          <string name='pixel_format' value='rgba'/><rfilter type='gaussian'/></film></sensor>
        <texture type='bitmap' id='image'><string name='filename' value='black.png'/><boolean name='raw' value='true'/>
          <string name='filter_type' value='nearest'/><string name='wrap_mode' value='clamp'/>
          <transform name='to_uv'><scale x='2' y='3'/></transform></texture>
        <bsdf type='diffuse' id='grey'/>
        <shape type='obj'><string name='filename' value='a.obj'/><boolean name='face_normals' value='true'/>
          <ref id='grey'/></shape>
        <shape type='ply'><string name='filename' value='a.ply'/><bsdf type='conductor'>
          <string name='material' value='Au'/></bsdf></shape>
        <shape type='sphere'><point name='center' x='1'/><float name='radius' value='2'/><bsdf type='roughconductor'>
          <rgb name='eta' value='1 2 3'/><rgb name='k' value='3'/><string name='distribution' value='ggx'/>
          <float name='alpha_u' value='0.1'/><ref name='alpha_v' id='image'/></bsdf></shape>
        <shape type='rectangle'><bsdf type='dielectric'><string name='int_ior' value='water'/></bsdf></shape>
        <shape type='cube'><bsdf type='roughdielectric'><float name='ext_ior' value='1'/></bsdf></shape>
        <shape type='disk'><bsdf type='thindielectric'><rgb name='specular_transmittance' value='0.5'/></bsdf></shape>
        <shape type='cylinder'><point name='p1' z='2'/><bsdf type='plastic'>
          <boolean name='nonlinear' value='true'/></bsdf></shape>
        <shape type='sphere'><bsdf type='twosided'><bsdf type='roughplastic'><float name='alpha' value='0.3'/>
          <texture name='diffuse_reflectance' type='checkerboard'><rgb name='color0' value='0.1'/>
          <ref name='color1' id='image'/></texture></bsdf></bsdf></shape>
        <shape type='cube'><bsdf type='mask'><ref name='opacity' id='image'/><bsdf type='bumpmap'>
          <float name='scale' value='3'/><ref id='image'/><ref id='grey'/></bsdf></bsdf></shape>
        <shape type='cube'><bsdf type='normalmap'><ref name='normalmap' id='image'/><ref id='grey'/></bsdf></shape>
        <shape type='cube'><bsdf type='blendbsdf'><float name='weight' value='0.3'/><ref id='grey'/>
          <bsdf type='null'/></bsdf></shape>
        <shape type='disk'><emitter type='area'><rgb name='radiance' value='5'/></emitter></shape>
        <emitter type='point'><point name='position' y='3'/></emitter>
        <emitter type='spot'><float name='cutoff_angle' value='30'/></emitter>
        <emitter type='directional'><vector name='direction' y='-1'/><rgb name='irradiance' value='2'/></emitter>
        <emitter type='envmap'><string name='filename' value='black.png'/><float name='scale' value='2'/></emitter>";
    let files: [(&str, &[u8]); 3] = [("a.obj", triangle), ("a.ply", ply), ("black.png", &image)];
    let scene = load_with(content, &files, &LoadOptions::default())
        .map_err(|error| message(&error))
        .expect("a scene");
    assert_eq!(scene.surfaces.len(), 12);
    // The grey one is shared, the light has its own.
    assert_eq!(scene.materials.len(), 12);
    assert_eq!(scene.surfaces.iter().filter(|surface| surface.emitter.is_some()).count(), 1);
    assert_eq!(
        (scene.limits.max_depth, scene.limits.rr_depth, scene.limits.hide_emitters),
        (Some(7), 3, true)
    );
    assert_eq!((scene.samples, scene.film.width, scene.film.height), (9, 20, 10));
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert!(
        scene.warnings[0].contains("rfilter \"gaussian\" replaced by \"box\""),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn what_is_left_out_is_as_in_mitsuba() {
    let scene = load("<shape type='cube'/><shape type='cube'><emitter type='area'/></shape>")
        .expect("a scene");
    assert_eq!(
        (scene.limits.max_depth, scene.limits.rr_depth, scene.limits.hide_emitters),
        (None, PathLimits::DEFAULT_RR_DEPTH, false)
    );
    assert_eq!((scene.samples, scene.film.crop), (4, [0, 0, 200, 100]));
    let at = look(&scene, CENTER).expect("a hit");
    let albedo = |surface: usize| {
        let material = scene.surfaces[surface].material;
        scene.materials[material.0 as usize].bsdf(&at).albedo().g
    };
    assert_eq!((albedo(0), albedo(1)), (0.5, 0.0));
    let emitter = scene.surfaces[1].emitter.expect("an emitter");
    assert_eq!(scene.emitters.radiance(emitter, &at, Vec3::Z).g, 1.0);
}

#[test]
fn the_camera_looks_along_z_with_x_to_the_left() {
    // At distance 4 a field of view of 90° across 200 pixels shows 8 units: 25 pixels a unit.
    let ball = |x: f32, y: f32| {
        let content = format!(
            "<shape type='sphere'><point name='center' x='{x}' y='{y}'/><float name='radius' value='0.1'/></shape>"
        );
        load(&content).expect("a scene")
    };
    // From (0, 0, 4) towards -z with y up, world +x is to the right.
    assert!(look(&ball(2.0, 0.0), [150.0, 50.0]).is_some());
    assert!(look(&ball(2.0, 0.0), [50.0, 50.0]).is_none());
    assert!(look(&ball(0.0, 1.0), [100.0, 25.0]).is_some());
    assert!(look(&ball(0.0, 1.0), [100.0, 75.0]).is_none());
}

#[test]
fn another_size_keeps_the_axis_of_the_field_of_view_and_the_crop() {
    let content = |axis: &str| {
        format!(
            "<sensor type='perspective'><float name='fov' value='90'/><string name='fov_axis' value='{axis}'/>
            <transform name='to_world'><lookat origin='0 0 4' target='0 0 0' up='0 1 0'/></transform>
            <film type='hdrfilm'><integer name='width' value='200'/><integer name='height' value='100'/>
            <integer name='crop_offset_x' value='50'/><integer name='crop_offset_y' value='20'/>
            <integer name='crop_width' value='100'/><integer name='crop_height' value='60'/></film></sensor>
            <shape type='sphere'><point name='center' x='2'/><float name='radius' value='0.1'/></shape>"
        )
    };
    let options = LoadOptions { size: Some((300, 300)), ..LoadOptions::default() };
    // Across: 8 units in 300 pixels. Down: the same, for the picture is square. The smaller side was the height: alike.
    for axis in ["x", "y", "smaller", "larger"] {
        let scene = load_with(&content(axis), &[], &options).expect("a scene");
        assert_eq!(
            (scene.film.width, scene.film.height, scene.film.crop),
            (300, 300, [75, 60, 150, 180])
        );
        assert!(look(&scene, [225.0, 150.0]).is_some(), "{axis}");
    }
    // At its own size the smaller axis is the height: 8 units in 100 pixels.
    let scene = load_with(&content("smaller"), &[], &LoadOptions::default()).expect("a scene");
    assert_eq!(scene.film.crop, [50, 20, 100, 60]);
    assert!(look(&scene, [125.0, 50.0]).is_some());
}

#[test]
fn a_rectangle_faces_z_even_when_mirrored() {
    for (steps, expected) in [
        ("", Vec3::Z),
        ("<scale x='-1'/>", Vec3::Z),
        ("<scale z='-1'/>", -Vec3::Z),
        ("<rotate y='1' angle='180'/>", -Vec3::Z),
        ("<rotate x='1' angle='45'/>", Vec3::new(0.0, -1.0, 1.0).normalize()),
    ] {
        for shape in ["rectangle", "disk"] {
            for (flip, sign) in [(false, 1.0), (true, -1.0)] {
                let content = format!(
                    "<shape type='{shape}'><transform name='to_world'>{steps}</transform>
                    <boolean name='flip_normals' value='{flip}'/></shape>"
                );
                let scene = load(&content).expect("a scene");
                let at = look(&scene, CENTER).expect("a hit");
                assert!(
                    (at.normal - expected * sign).length() < 1e-5,
                    "{shape} {steps} {flip}: {}",
                    at.normal
                );
                assert!(at.shading_normal.dot(at.normal) > 0.999, "{shape} {steps} {flip}");
            }
        }
    }
}

#[test]
fn analytic_shapes_stay_analytic_while_they_are_round() {
    let part = |content: &str| load(content).expect("a scene").geometry.parts()[0].clone();
    let shape = |name: &str, steps: &str| {
        part(&format!(
            "<shape type='{name}'><transform name='to_world'>{steps}</transform></shape>"
        ))
    };
    let turn = "<rotate x='1' y='2' z='3' angle='40'/>";
    let Part::Sphere { radius, flip_normals, .. } =
        shape("sphere", &format!("<scale value='-2'/>{turn}"))
    else {
        panic!("not a sphere")
    };
    assert!((radius - 2.0).abs() < 1e-6 && flip_normals);
    let Part::Cylinder { start, end, radius, flip_normals } =
        shape("cylinder", &format!("<scale x='2' y='2' z='5'/>{turn}<translate x='9'/>"))
    else {
        panic!("not a cylinder")
    };
    assert!(
        (radius - 2.0).abs() < 1e-6 && (start.distance(end) - 5.0).abs() < 1e-5 && !flip_normals
    );
    assert!(matches!(shape("disk", "<scale x='2'/>"), Part::Disk { .. }));
    for (name, steps) in [("sphere", "<scale x='2'/>"), ("cylinder", "<scale x='2'/>")] {
        let Part::Mesh(mesh) = shape(name, steps) else { panic!("{name} {steps}") };
        let bounds = mesh
            .positions
            .iter()
            .fold((Vec3::INFINITY, -Vec3::INFINITY), |(low, high), position| {
                (low.min(*position), high.max(*position))
            });
        assert!(
            (bounds.1 - bounds.0).x - 4.0 < 1e-5 && (bounds.1 - bounds.0).x > 3.99,
            "{name} {bounds:?}"
        );
        // Normals point outward, on the side that the winding says.
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|index| mesh.positions[index as usize]);
            let outward =
                if name == "sphere" { a + b + c } else { (a + b + c) * Vec3::new(1.0, 1.0, 0.0) };
            assert!((b - a).cross(c - a).dot(outward) > 0.0, "{name}: {triangle:?}");
        }
    }
}

#[test]
fn a_cube_is_closed_and_faces_outward() {
    let Part::Mesh(mesh) =
        load(&format!("<shape type='cube'>{CHECKS}</shape>")).expect("a scene").geometry.parts()[0]
            .clone()
    else {
        panic!("not a mesh")
    };
    let volume: f32 = mesh
        .triangles
        .iter()
        .map(|triangle| {
            let [a, b, c] = triangle.map(|index| mesh.positions[index as usize]);
            a.cross(b).dot(c) / 6.0
        })
        .sum();
    assert!((volume - 8.0).abs() < 1e-5, "{volume}");
    // Values from the vertex table of Mitsuba 3 (`src/shapes/cube.cpp`): one corner on three faces.
    for (position, normal, uv) in [
        (Vec3::new(1.0, -1.0, 1.0), -Vec3::Y, Vec2::new(1.0, 1.0)),
        (Vec3::new(1.0, -1.0, 1.0), Vec3::X, Vec2::new(0.0, 0.0)),
        (Vec3::new(1.0, -1.0, 1.0), Vec3::Z, Vec2::new(0.0, 1.0)),
        (Vec3::new(-1.0, 1.0, -1.0), Vec3::Y, Vec2::new(1.0, 1.0)),
        (Vec3::new(-1.0, 1.0, -1.0), -Vec3::X, Vec2::new(1.0, 0.0)),
        (Vec3::new(-1.0, 1.0, -1.0), -Vec3::Z, Vec2::new(0.0, 0.0)),
    ] {
        let found = (0..mesh.positions.len())
            .find(|&i| mesh.positions[i] == position && mesh.normals[i] == normal);
        assert_eq!(mesh.uvs[found.expect("a corner")], uv, "{position} {normal}");
    }
}

#[test]
fn a_scene_far_away_keeps_its_shape() {
    let scene_at = |offset: DVec3| {
        let move_by = format!("<translate x='{}' y='{}' z='{}'/>", offset.x, offset.y, offset.z);
        let content = format!(
            "<sensor type='perspective'><float name='fov' value='60'/><transform name='to_world'>
              <lookat origin='0 0 4' target='0 0 0' up='0 1 0'/>{move_by}</transform></sensor>
            <shape type='cube'><transform name='to_world'><rotate x='1' y='1' angle='33'/>{move_by}</transform></shape>
            <shape type='sphere'><transform name='to_world'><scale value='0.3'/><translate x='1.7'/>{move_by}</transform>
            <emitter type='area'/></shape>"
        );
        load_with(&content, &[], &LoadOptions::default()).expect("a scene")
    };
    let offset = DVec3::new(1e7, -2e6, 3e5);
    let (near, far) = (scene_at(DVec3::ZERO), scene_at(offset));
    assert!((far.origin - near.origin - offset).length() < 1.0, "{}", far.origin);
    let moved = (far.origin - near.origin - offset).as_vec3();
    let vertices = |scene: &Scene| match &scene.geometry.parts()[0] {
        Part::Mesh(mesh) => mesh.positions.clone(),
        part => panic!("{part:?}"),
    };
    for (a, b) in vertices(&near).into_iter().zip(vertices(&far)) {
        // Double precision at 1e7 has steps of 2e-9; single precision would have steps of 1.
        assert!((a - b - moved).length() < 1e-6, "{a} {b}");
    }
    let [a, b] = [&near, &far].map(|scene| look(scene, [384.0, 288.0]).expect("a hit").position);
    assert!((a - b - moved).length() < 1e-5, "{a} {b}");
}

#[test]
fn old_spellings_mean_the_same() {
    let old = "<integrator type='path'><integer name='maxDepth' value='5'/><boolean name='hideEmitters' value='true'/>
          </integrator>
        <sensor type='perspective'><float name='fov' value='40'/><string name='fovAxis' value='smaller'/>
          <transform name='toWorld'><lookAt origin='0 0 4' target='0 0 0' up='0 1 0'/></transform>
          <sampler type='ldsampler'><integer name='sampleCount' value='16'/></sampler>
          <film type='ldrfilm'><integer name='width' value='40'/><integer name='height' value='30'/>
          <boolean name='banner' value='false'/><rfilter type='box'/></film></sensor>
        <shape type='rectangle'><boolean name='flipNormals' value='true'/><bsdf type='diffuse'>
          <srgb name='diffuseReflectance' value='#ff8000'/></bsdf></shape>
        <shape type='sphere'><bsdf type='roughplastic'><float name='intIOR' value='1.5'/><float name='extIOR' value='1'/>
          <texture name='diffuseReflectance' type='checkerboard'><spectrum name='color0' value='0.1'/>
          <float name='uscale' value='4'/><float name='uoffset' value='0.5'/></texture></bsdf></shape>";
    let new = "<integrator type='path'><integer name='max_depth' value='5'/><boolean name='hide_emitters' value='true'/>
          </integrator>
        <sensor type='perspective'><float name='fov' value='40'/><string name='fov_axis' value='smaller'/>
          <transform name='to_world'><lookat origin='0 0 4' target='0 0 0' up='0 1 0'/></transform>
          <sampler type='independent'><integer name='sample_count' value='16'/></sampler>
          <film type='hdrfilm'><integer name='width' value='40'/><integer name='height' value='30'/>
          <rfilter type='box'/></film></sensor>
        <shape type='rectangle'><boolean name='flip_normals' value='true'/><bsdf type='diffuse'>
          <rgb name='reflectance' value='1 0.21586050011389926 0'/></bsdf></shape>
        <shape type='sphere'><bsdf type='roughplastic'><float name='int_ior' value='1.5'/>
          <float name='ext_ior' value='1'/><texture name='diffuse_reflectance' type='checkerboard'>
          <rgb name='color0' value='0.1'/>
          <transform name='to_uv'><translate x='0.5'/><scale x='4'/></transform></texture></bsdf></shape>";
    let [old, new] = [old, new].map(|content| {
        let scene = load_with(content, &[], &LoadOptions::default())
            .map_err(|error| message(&error))
            .expect("a scene");
        let Scene { materials, film, limits, samples, camera, geometry, warnings, .. } = scene;
        format!(
            "{materials:?} {film:?} {limits:?} {samples} {camera:?} {:?} {warnings:?}",
            geometry.parts()
        )
    });
    assert_eq!(old, new);
}

#[test]
fn definitions_replace_defaults() {
    let content = format!(
        "<default name='depth' value='3'/><integrator type='path'>
        <integer name='max_depth' value='$depth'/></integrator>{CAMERA}"
    );
    let options =
        LoadOptions { definitions: vec![("depth".into(), "9".into())], ..LoadOptions::default() };
    assert_eq!(load_with(&content, &[], &options).expect("a scene").limits.max_depth, Some(9));
    assert_eq!(
        load_with(&content, &[], &LoadOptions::default()).expect("a scene").limits.max_depth,
        Some(3)
    );
    let options =
        LoadOptions { definitions: vec![("dept".into(), "9".into())], ..LoadOptions::default() };
    let error = message(&load_with(&content, &[], &options).expect_err("unused"));
    assert!(error.contains("dept") && error.contains("did you mean \"depth\"?"), "{error}");
}
