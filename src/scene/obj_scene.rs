//! Scenes that are just an OBJ file with its MTL materials.

use super::build::{Description, Light, Shape, ShapeDescription};
use super::camera::{FovAxis, Perspective};
use super::error::SceneError;
use super::material::{Material, MaterialId, Model};
use super::mesh_file::{MeshError, MeshOptions, RawMesh};
use super::obj::{Regular, append, read_text};
use super::{FilmSettings, LoadOptions, PathLimits, mtl};
use crate::emitter::{Emitter, Environment};
use crate::math::Rgb;
use crate::texture::{ImageCache, Texture};
use glam::{DMat3, DMat4, DVec3};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// The film where nothing else is asked for.
const SIZE: (u32, u32) = (512, 512);
const SAMPLES: u32 = 64;
/// Field of view of the shorter side of the film, in degrees.
const FOV: f64 = 40.0;
/// How much deeper than wide a scene must be before it is looked at from the side.
const DEEP: f64 = 1.5;

/// Reads an OBJ file and its material libraries as a scene.
///
/// All triangles of one material are one shape. Materials mean what [`mtl`] says. Meshes without normals are shown
/// flat. A scene in which nothing emits light (`Ke`) is lit by a white environment. The camera stands in front of the
/// scene's box, looking along −z with +y up, or along −x where the box is more than 1.5 times as deep as wide, so far
/// off that all of the box's front is within a field of view of 40°.
///
/// # Errors
/// A file cannot be read or parsed, there are no faces, or they are too far apart.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Description, SceneError> {
    if let Some((name, _)) = options.definitions.first() {
        return Err(SceneError::UnusedDefinition { name: name.clone(), known: Vec::new() });
    }
    let text = read_text(path)?;
    let regular = Regular::new(path, &text, true)?;
    let mut warnings = regular.warnings(path);
    let folder = path.parent().unwrap_or(Path::new(""));
    let libraries = libraries(&regular, folder, &mut warnings)?;
    let (models, library) = regular.parse(path, |name| libraries[name].clone())?;

    let mut meshes = BTreeMap::<Option<usize>, RawMesh>::new();
    for model in &models {
        append(meshes.entry(model.mesh.material_id).or_default(), &model.mesh, &regular, true);
    }
    meshes.retain(|_, mesh| !mesh.triangles.is_empty());
    let mut low_high: Option<(DVec3, DVec3)> = None;
    for mesh in meshes.values_mut() {
        mesh.sanitise(path);
        warnings.append(&mut mesh.warnings);
        if let Some((low, high)) = mesh.bounds(&DMat4::IDENTITY) {
            let (all_low, all_high) = low_high.unwrap_or((low, high));
            low_high = Some((all_low.min(low), all_high.max(high)));
        }
    }
    let Some((low, high)) = low_high.filter(|(low, high)| low != high) else {
        return Err(MeshError::malformed(path, None, "no faces with any extent").into());
    };
    let diagonal = (high - low).length();
    if diagonal > f64::from(f32::MAX) {
        let message = format!("vertices from {low} to {high}, more than single precision holds");
        return Err(MeshError::malformed(path, None, message).into());
    }

    let mut materials = Vec::new();
    let mut shapes = Vec::new();
    let mut images = ImageCache::default();
    for (id, mesh) in meshes {
        let (material, radiance) = match id {
            Some(id) => mtl::material(&library[id], folder, &mut images)?,
            None => {
                let count = mesh.triangles.len();
                warnings.push(format!(
                    "{}: {count} triangles have no known material; grey",
                    path.display()
                ));
                (Material::from(Model::Diffuse(0.5.into())).with_two_sides(), None)
            }
        };
        shapes.push(shape(mesh, MaterialId(materials.len() as u32), radiance, regular.has_normals));
        materials.push(material);
    }
    warnings.append(&mut images.warnings);
    let mut lights = Vec::new();
    if shapes.iter().all(|shape| shape.radiance.is_none()) {
        warnings.push(format!(
            "{}: nothing emits light (Ke); a white environment does",
            path.display()
        ));
        lights.push(Light::Infinite(Emitter::Environment(Environment::Constant(Rgb::WHITE))));
    }

    let (width, height) = options.size.unwrap_or(SIZE);
    Ok(Description {
        shapes,
        materials,
        lights,
        camera: camera(low, high, [width, height]),
        film: FilmSettings { width, height, crop: [0, 0, width, height] },
        limits: PathLimits {
            max_depth: None,
            rr_depth: PathLimits::DEFAULT_RR_DEPTH,
            hide_emitters: false,
        },
        samples: SAMPLES,
        warnings,
        image_files: images.files,
    })
}

fn shape(
    mesh: RawMesh,
    material: MaterialId,
    radiance: Option<Texture>,
    has_normals: bool,
) -> ShapeDescription {
    let options = MeshOptions { face_normals: !has_normals, flip_normals: false };
    ShapeDescription {
        shape: Shape::Mesh { mesh, to_world: DMat4::IDENTITY, options },
        material,
        radiance,
    }
}

/// The libraries that the file names; none twice.
fn libraries(
    regular: &Regular,
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Result<HashMap<PathBuf, tobj::MTLLoadResult>, SceneError> {
    let mut libraries = HashMap::new();
    for name in regular.libraries() {
        if !libraries.contains_key(Path::new(name)) {
            libraries.insert(PathBuf::from(name), mtl::read(&folder.join(name), warnings)?);
        }
    }
    Ok(libraries)
}

/// In front of the box, far enough to see all of its front.
fn camera(low: DVec3, high: DVec3, [width, height]: [u32; 2]) -> Perspective {
    let (center, half) = ((low + high) * 0.5, (high - low) * 0.5);
    let from_side = half.z > DEEP * half.x;
    let (backward, across, depth) =
        if from_side { (DVec3::X, half.z, half.x) } else { (DVec3::Z, half.x, half.z) };
    let aspect = f64::from(width) / f64::from(height);
    let visible = (FOV.to_radians() / 2.0).tan();
    let distance = (across / (visible * aspect.max(1.0))).max(half.y / (visible / aspect.min(1.0)));
    let diagonal = half.length();
    // A box without a front, a wall seen edge-on, still needs room.
    let distance = depth + distance.max(0.1 * diagonal);
    let eye = center + backward * distance;
    // Looking along +z of its own space, +x to the left of the picture.
    let axes = DMat3::from_cols(DVec3::Y.cross(-backward), DVec3::Y, -backward);
    Perspective {
        to_world: DMat4::from_translation(eye) * DMat4::from_mat3(axes),
        fov: FOV,
        fov_axis: FovAxis::Smaller,
        film: [width, height],
        near_clip: 1e-4 * diagonal,
        far_clip: 1e4 * diagonal,
        ..Perspective::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Part;
    use crate::scene::{Camera, Scene};
    use glam::{Vec2, Vec3};

    fn write(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, content) in files {
            std::fs::write(folder.path().join(name), content).unwrap();
        }
        folder
    }

    fn scene(files: &[(&str, &str)]) -> Result<Scene, SceneError> {
        Scene::load(&write(files).path().join("a.obj"), &LoadOptions::default())
    }

    #[test]
    fn vertices_that_are_too_far_apart_are_refused() {
        let error = scene(&[("a.obj", "v -1 1 -1\nv 2 0 -1\nv 1 0 1e308\nf 1 2 3\n")]);
        let error = error.expect_err("more than single precision holds").to_string();
        assert!(error.contains("a.obj") && error.contains("single precision"), "{error}");
    }

    const QUADS: &str = "mtllib my\tlib.mtl\no one\nusemtl grey\nv 0 0 0\nv 4 0 0\nv 4 2 0\nv 0 2 0\nf 1 2 3 4\n\
                         g two\nusemtl lamp\nf -1 -2 -3\ng three\nusemtl grey\nf 1 2 3\nusemtl other\nf 1 2 4\n";

    #[test]
    fn triangles_of_one_material_are_one_shape() {
        let library = "newmtl grey\nKd 0.2 0.2 0.2\nnewmtl lamp\nKe 1 2 3\n";
        let scene = scene(&[("a.obj", QUADS), ("my\tlib.mtl", library)]).unwrap();
        let triangles = |part: &Part| match part {
            Part::Mesh(mesh) => mesh.triangles.len(),
            _ => 0,
        };
        let mut found: Vec<(usize, bool)> = scene
            .geometry
            .parts()
            .iter()
            .zip(&scene.surfaces)
            .map(|(part, surface)| (triangles(part), surface.emitter.is_some()))
            .collect();
        found.sort_unstable();
        assert_eq!(found, [(1, false), (1, true), (3, false)]);
        assert!(scene.warnings.iter().any(|warning| warning.contains("no known material")));
    }

    #[test]
    fn a_scene_without_lamps_gets_a_white_environment() {
        let library = "newmtl grey\nKd 0.2\nnewmtl lamp\nKd 0.5\n";
        let scene = scene(&[("a.obj", QUADS), ("my\tlib.mtl", library)]).unwrap();
        assert_eq!(scene.emitters.environment(Vec3::Y), Rgb::WHITE);
        assert!(scene.warnings.iter().any(|warning| warning.contains("white environment")));
    }

    #[test]
    fn missing_and_broken_files_are_named() {
        let message = scene(&[("a.obj", QUADS)]).unwrap_err().to_string();
        assert!(message.contains("my\tlib.mtl"), "{message}");
        let message = scene(&[("a.obj", QUADS), ("my\tlib.mtl", "newmtl grey\nKd red\n")])
            .unwrap_err()
            .to_string();
        assert!(message.contains("my\tlib.mtl:2: "), "{message}");
        let library = "newmtl grey\nmap_Kd gone.png\nnewmtl lamp\n";
        let message = scene(&[("a.obj", QUADS), ("my\tlib.mtl", library)]).unwrap_err().to_string();
        assert!(message.contains("gone.png"), "{message}");
        assert!(scene(&[("a.obj", "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")]).is_err());
        assert!(scene(&[("a.obj", "")]).is_err());
    }

    #[test]
    fn the_camera_sees_the_whole_front_and_little_more() {
        for (size, film) in [
            (DVec3::new(5.0, 5.0, 6.0), [64, 64]),
            (DVec3::new(9.0, 1.0, 2.0), [200, 100]),
            (DVec3::new(1.0, 9.0, 1.2), [100, 300]),
            (DVec3::new(1.0, 2.0, 9.0), [100, 100]),
        ] {
            let low = DVec3::new(100.0, -3.0, 7.0);
            let parameters = camera(low, low + size, film);
            let camera = Camera::perspective(&parameters).unwrap();
            let eye = parameters.to_world.transform_point3(DVec3::ZERO);
            let from_side = size.z > 1.5 * size.x;
            let mut outermost = 0.0f32;
            for corner in 0..8 {
                let part = DVec3::new(
                    f64::from(corner & 1),
                    f64::from(corner >> 1 & 1),
                    f64::from(corner >> 2),
                );
                // The nearest corners lie on the edge of the film: rounding may put them outside.
                let corner = low + size * ((part - 0.5) * 0.9999 + 0.5);
                let raster =
                    camera.raster_of((corner - eye).as_vec3(), Vec2::ZERO).expect("in view");
                let centred = raster / Vec2::new(film[0] as f32, film[1] as f32) * 2.0 - 1.0;
                outermost = outermost.max(centred.abs().max_element());
                // A corner at greater x (or lesser z, from the side) is to the right, one at greater y is up.
                let right = if from_side { part.z < 0.5 } else { part.x > 0.5 };
                assert_eq!(centred.x > 0.0, right, "{size} {part} {centred}");
                assert_eq!(centred.y < 0.0, part.y > 0.5);
            }
            assert!((outermost - 1.0).abs() < 1e-3, "{size}: {outermost}");
        }
    }

    #[test]
    fn the_obj_cornell_box_loads() {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box-obj/cornell-box.obj");
        let scene = Scene::load(&path, &LoadOptions::default()).unwrap();
        assert_eq!(scene.warnings, Vec::<String>::new());
        assert_eq!(scene.surfaces.iter().filter(|surface| surface.emitter.is_some()).count(), 1);
    }
}
