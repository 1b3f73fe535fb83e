//! What is done with a file of which nothing is known: it is read, and used where it is accepted.
//!
//! The fuzz targets do so with whatever they find, the test `kept_inputs` with what they have found.

use glam::{DMat4, DVec3, Vec3};
use quietlight::emitter::EnvironmentMap;
use quietlight::geometry::{Geometry, Part, Ray};
use quietlight::integrator::{Bdpt, Integrator, PathTracing};
use quietlight::render::{Budget, RenderSettings, render, replay};
use quietlight::scene::mesh_file::{MeshOptions, RawMesh};
use quietlight::scene::{LoadOptions, Scene, obj, ply};
use quietlight::texture::Image;
use quietlight_denoise::{exr, picture};
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// What a file claims to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A Mitsuba scene, beside the files of `beside/`.
    Xml,
    /// Wavefront OBJ, and after a line `#mtl` its material library.
    Obj,
    /// A PLY mesh.
    Ply,
    /// A texture or picture: PNG, JPEG, HDR, EXR, PFM.
    Image,
    /// Layers for the denoisers.
    Exr,
}

/// The longest paths that are followed in a scene that was accepted: it may ask for any number.
const MAX_DEPTH: u32 = 8;

/// The largest picture that is rendered, in pixels.
const MAX_PIXELS: u64 = 64;

impl Kind {
    /// Puts into `folder` what files of this kind may name.
    pub fn prepare(self, folder: &Path) {
        let files: [(&str, &[u8]); 5] = [
            ("part.xml", include_bytes!("beside/part.xml")),
            ("mesh.obj", include_bytes!("beside/mesh.obj")),
            ("mesh.ply", include_bytes!("beside/mesh.ply")),
            ("picture.png", include_bytes!("beside/picture.png")),
            ("sky.hdr", include_bytes!("beside/sky.hdr")),
        ];
        for (name, bytes) in files {
            fs::write(folder.join(name), bytes).expect("the folder can be written to");
        }
    }

    /// Reads `bytes` as a file in `folder`, and uses what comes of it. Whether it is accepted does not matter.
    pub fn try_file(self, folder: &Path, bytes: &[u8]) {
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.join(name);
            fs::write(&path, bytes).expect("the folder can be written to");
            path
        };
        match self {
            Self::Xml => try_scene(&write("scene.xml", bytes)),
            Self::Obj => {
                let mark = b"\n#mtl\n";
                let end = bytes.windows(mark.len()).position(|window| window == mark);
                let (mesh, library) = bytes.split_at(end.unwrap_or(bytes.len()));
                write("a.mtl", library);
                let path = write("a.obj", mesh);
                try_scene(&path);
                if let Ok(mesh) = obj::load(&path, true) {
                    try_mesh(mesh);
                }
            }
            Self::Ply => {
                if let Ok(mesh) = ply::load(&write("a.ply", bytes), true) {
                    try_mesh(mesh);
                }
            }
            Self::Image => {
                let ending = match bytes {
                    [0x89, ..] => "png",
                    [0xff, ..] => "jpg",
                    [b'#', ..] => "hdr",
                    [b'P', ..] => "pfm",
                    _ => "exr",
                };
                let path = write(&format!("a.{ending}"), bytes);
                for raw in [false, true] {
                    let Ok(image) = Image::load(&path, raw) else { break };
                    let mean = image.mean();
                    assert!(mean.is_finite() || !image.is_gray(), "the mean is {mean:?}");
                    let size = [image.width as usize, image.height as usize];
                    let map =
                        EnvironmentMap::new(size, image.into_linear(), 1.0, glam::DMat3::IDENTITY);
                    map.expect("an image is an environment");
                }
                let _ = picture::read_picture(&path);
            }
            Self::Exr => {
                let path = write("a.exr", bytes);
                if let Ok(contents) = exr::read(&path) {
                    contents.layers.check_shapes().expect("what was read has one shape");
                }
            }
        }
    }
}

/// Loads a scene, and follows some paths in it.
fn try_scene(path: &Path) {
    let Ok(mut scene) = Scene::load(path, &LoadOptions::default()) else { return };
    let depth = scene.limits.max_depth.unwrap_or(MAX_DEPTH);
    scene.limits.max_depth = Some(depth.min(MAX_DEPTH));
    let [left, top, width, height] = scene.film.crop;
    let settings = RenderSettings { budget: Budget::Samples(1), ..RenderSettings::default() };
    for (x, y) in [(0, 0), (width / 2, height / 2), (width - 1, height - 1)] {
        replay(&scene, &settings, [left + x, top + y], 0, |_| {});
    }
    if scene.film.crop_pixels() <= MAX_PIXELS {
        for integrator in [PathTracing::default().into(), Integrator::Bdpt(Bdpt::default())] {
            let settings = RenderSettings { integrator, ..settings };
            render(&scene, &settings, &|_| {}, &AtomicBool::new(false));
        }
    }
}

/// Builds a tree over a mesh, and shoots a ray at the middle of some triangles.
fn try_mesh(mesh: RawMesh) {
    let count = mesh.positions.len();
    let all = mesh.triangles.iter().flatten();
    assert!(all.clone().all(|&index| (index as usize) < count), "an index is out of range");
    let mesh = mesh.into_mesh(&DMat4::IDENTITY, DVec3::ZERO, MeshOptions::default());
    let targets: Vec<Vec3> = (mesh.triangles.iter().take(4))
        .filter_map(|&triangle| mesh.corners(triangle))
        .map(|[a, b, c]| (a + b + c) / 3.0)
        .filter(|target| target.is_finite())
        .collect();
    let geometry = Geometry::new(vec![Part::Mesh(mesh)]);
    for target in targets {
        let direction = (target - Vec3::new(0.3, 0.5, 7.0)).normalize_or(Vec3::X);
        let ray = Ray::new(Vec3::new(0.3, 0.5, 7.0), direction);
        if let Some(hit) = geometry.intersect(&ray) {
            geometry.interaction(&ray, &hit);
        }
    }
}
