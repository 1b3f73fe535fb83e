//! From a file to a [`Scene`] that can be rendered.

mod build;
pub mod camera;
mod change;
mod error;
mod identity;
mod inventory;
pub mod material;
pub mod mesh_file;
mod model;
pub mod mtl;
pub mod obj;
mod obj_scene;
pub mod ply;
mod requirements;
mod xml;

pub use camera::{Camera, CameraError, FovAxis, LensHit, LensView, Perspective};
pub use change::Changes;
pub use error::{Location, SceneError};
pub use inventory::{ImageFacts, Inventory};
pub use material::{Material, MaterialId};
pub use requirements::Requirements;

use crate::emitter::{EmitterId, Emitters};
use crate::geometry::Geometry;
use glam::Vec2;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What may be changed about a scene while it is loaded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Names and values that replace the `<default>`s of a scene file.
    pub definitions: Vec<(String, String)>,
    /// Width and height of the film, instead of the file's. The field of view keeps the axis that the file gives it for.
    pub size: Option<(u32, u32)>,
}

/// What a part of the geometry is made of and whether it shines.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Its material.
    pub material: MaterialId,
    /// Its emitter, if it shines.
    pub emitter: Option<EmitterId>,
}

/// The picture's size, and the part of it to render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FilmSettings {
    /// Pixels across the whole film.
    pub width: u32,
    /// Pixels down the whole film.
    pub height: u32,
    /// First column, first row, columns and rows to render.
    pub crop: [u32; 4],
}

impl FilmSettings {
    /// Density of a raster point that is uniform in the crop window, where the whole film has the measure 1: the pixels of
    /// the film over those of the crop.
    pub fn crop_pdf(&self) -> f64 {
        let [_, _, columns, rows] = self.crop.map(f64::from);
        f64::from(self.width) * f64::from(self.height) / (columns * rows)
    }

    /// The point of the crop window, in pixels of the whole film, that `u` in `[0, 1)²` chooses uniformly. Rounding does
    /// not carry it over the far edges.
    pub fn crop_point(&self, u: Vec2) -> Vec2 {
        let [left, top, columns, rows] = self.crop;
        let place = |start: u32, count: u32, u: f32| {
            let point = f64::from(start) + f64::from(count) * f64::from(u);
            (point as f32).min(((start + count) as f32).next_down())
        };
        Vec2::new(place(left, columns, u.x), place(top, rows, u.y))
    }

    /// Index of the pixel of the crop window, row by row, that holds a finite raster point; `None` outside of it.
    pub fn crop_pixel(&self, raster: Vec2) -> Option<usize> {
        let [left, top, columns, rows] = self.crop;
        let place = |at: f32, start: u32, count: u32| {
            let cell = f64::from(at).floor() - f64::from(start);
            (0.0..f64::from(count)).contains(&cell).then_some(cell as usize)
        };
        let (x, y) = (place(raster.x, left, columns)?, place(raster.y, top, rows)?);
        Some(y * columns as usize + x)
    }

    /// How many pixels there are to render.
    pub fn crop_pixels(&self) -> u64 {
        u64::from(self.crop[2]) * u64::from(self.crop[3])
    }
}

/// How long paths may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathLimits {
    /// Longest path in edges, as Mitsuba counts: 1 shows emitters only, 2 adds direct light; `None` is no limit. An edge that
    /// passes through masks is one edge, whichever way it is found; Mitsuba's camera rays count it as several.
    pub max_depth: Option<u32>,
    /// Russian roulette starts at this depth.
    pub rr_depth: u32,
    /// Are emitters invisible to the camera?
    pub hide_emitters: bool,
}

impl PathLimits {
    /// Where a scene does not say when roulette starts: as in Mitsuba 3. In the Cornell box at 64 samples, 3 takes 0.78 of the
    /// time and leaves 1.41 times the relative L2; 8 takes 1.29 times the time and leaves 0.85 of it.
    pub const DEFAULT_RR_DEPTH: u32 = 5;
}

/// Everything a renderer needs to know.
#[derive(Debug)]
pub struct Scene {
    /// All shapes.
    pub geometry: Geometry,
    /// One entry a part of `geometry`.
    pub surfaces: Vec<Surface>,
    /// Materials, found by [`MaterialId`].
    pub materials: Vec<Material>,
    /// All light.
    pub emitters: Emitters,
    /// The point of view.
    pub camera: Camera,
    /// The picture.
    pub film: FilmSettings,
    /// Path lengths.
    pub limits: PathLimits,
    /// Does any material let rays pass unscattered?
    pub has_masks: bool,
    /// Samples per pixel that the file asks for.
    pub samples: u32,
    /// What was subtracted from every world position at load, so that single precision serves far from the origin.
    pub origin: glam::DVec3,
    /// What the reader should know: plugins without effect, triangles left out.
    pub warnings: Vec<String>,
    /// The files that images were read from.
    pub image_files: BTreeSet<PathBuf>,
}

impl Scene {
    /// Loads a Mitsuba scene (`.xml`), the scene of a folder: its `scene.xml`, or an OBJ file with its materials (`.obj`).
    ///
    /// # Errors
    /// Whatever is wrong with the scene, with its place in the file and what would be right.
    pub fn load(path: &Path, options: &LoadOptions) -> Result<Self, SceneError> {
        Ok(describe(path, options)?.build())
    }

    /// As [`Scene::load`], with lights and materials changed, and with what the file says of the camera, from which others
    /// can be made.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn load_changed(
        path: &Path,
        options: &LoadOptions,
        changes: &mut dyn Changes,
    ) -> Result<(Self, Perspective), SceneError> {
        let mut description = describe(path, options)?;
        description.change(changes);
        let mut camera = description.camera;
        let scene = description.build();
        camera.to_world = glam::DMat4::from_translation(-scene.origin) * camera.to_world;
        Ok((scene, camera))
    }
}

/// What the scene file says that a path means.
fn describe(path: &Path, options: &LoadOptions) -> Result<build::Description, SceneError> {
    let path = find_scene(path)?;
    let read = if has_extension(&path, "obj") { obj_scene::load } else { xml::load };
    read(&path, options)
}

/// The scene file that a path means: itself, or what is in the folder: `scene.xml`, else the only `.obj`.
pub(crate) fn find_scene(path: &Path) -> Result<PathBuf, SceneError> {
    let refuse = |problem: &str| SceneError::NoScene {
        path: path.to_path_buf(),
        problem: problem.to_owned(),
    };
    if !path.is_dir() {
        let is_known = ["xml", "obj"].iter().any(|known| has_extension(path, known));
        let problem = "not a scene: expected a .xml or .obj file, or a folder with one";
        return if is_known { Ok(path.to_path_buf()) } else { Err(refuse(problem)) };
    }
    let xml = path.join("scene.xml");
    if xml.is_file() {
        return Ok(xml);
    }
    let read = |source| SceneError::Read { path: path.to_path_buf(), source };
    let mut found = Vec::new();
    for entry in path.read_dir().map_err(read)? {
        let file = entry.map_err(read)?.path();
        if has_extension(&file, "obj") {
            found.push(file);
        }
    }
    match found.len() {
        1 => Ok(found.remove(0)),
        0 => Err(refuse("neither a scene.xml nor a .obj file is in this folder")),
        _ => Err(refuse("no scene.xml is in this folder, and more than one .obj file: name one")),
    }
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_of_the_crop_is_as_dense_as_the_crop_is_small() {
        let film = FilmSettings { width: 64, height: 48, crop: [10, 20, 16, 6] };
        assert_eq!(film.crop_pdf(), 32.0);
        assert_eq!(FilmSettings { crop: [0, 0, 64, 48], ..film }.crop_pdf(), 1.0);
    }

    #[test]
    fn the_far_corner_of_a_crop_is_still_in_it() {
        // As large as a film may be: rounding would carry the last point over the edge.
        let film = FilmSettings { width: 65_536, height: 99, crop: [65_000, 90, 500, 9] };
        let corner = film.crop_point(Vec2::splat(1.0f32.next_down()));
        assert_eq!(film.crop_pixel(corner), Some(500 * 9 - 1));
        assert_eq!(film.crop_pixel(film.crop_point(Vec2::ZERO)), Some(0));
        assert_eq!(film.crop_pixel(Vec2::new(65_500.0, 95.0)), None);
        assert_eq!(film.crop_pixel(Vec2::new(65_499.9, 99.0)), None);
        assert_eq!(film.crop_pixels(), 4500);
    }

    #[test]
    fn our_own_scenes_load_without_warnings() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
        let mut count = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let Ok(files) = std::fs::read_dir(entry.unwrap().path()) else { continue };
            for path in files.map(|file| file.unwrap().path()) {
                // Parts of the XML scenes are OBJ files, too; those that are scenes come with materials.
                let is_scene = has_extension(&path, "obj") && path.with_extension("mtl").exists();
                if has_extension(&path, "xml") || is_scene {
                    let scene = Scene::load(&path, &LoadOptions::default()).unwrap();
                    assert_eq!(scene.warnings, Vec::<String>::new(), "{}", path.display());
                    assert!(
                        !scene.surfaces.is_empty() && !scene.emitters.is_dark(),
                        "{}",
                        path.display()
                    );
                    count += 1;
                }
            }
        }
        assert_eq!(count, 10);
    }
}
