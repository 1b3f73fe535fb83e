//! A scene under construction: shapes, materials, lights, and where there is something to see.

use super::error::Error;
use super::form::{Form, Object, Role};
use super::lighting::Light;
use super::material;
use super::random::Random;
use super::xml::Element;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// What a set or a room does to its stage, by one of several methods.
pub(super) type Step<T> = fn(&mut T) -> Result<(), Error>;

/// Index of a material on the stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MaterialIndex(usize);

/// A surface, black where it shines.
#[derive(Clone, Debug)]
struct Surface {
    form: Form,
    material: Option<MaterialIndex>,
    /// Radiance before exposure.
    radiance: Option<DVec3>,
}

/// Something worth looking at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interest {
    pub(super) center: DVec3,
    pub(super) radius: f64,
}

/// A scene under construction. Its images are in the folder as soon as they are made.
#[derive(Debug)]
pub(super) struct Stage {
    folder: PathBuf,
    surfaces: Vec<Surface>,
    materials: Vec<Element>,
    lights: Vec<Light>,
    files: Vec<PathBuf>,
    /// What it contains.
    pub(super) tags: BTreeSet<&'static str>,
    /// What cameras may look at.
    pub(super) interests: Vec<Interest>,
    /// Box that cameras stay in.
    pub(super) camera_box: (DVec3, DVec3),
}

impl Stage {
    /// An empty stage with its files in `folder`.
    pub(super) fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_path_buf(),
            surfaces: Vec::new(),
            materials: Vec::new(),
            lights: Vec::new(),
            files: Vec::new(),
            tags: BTreeSet::new(),
            interests: Vec::new(),
            camera_box: (DVec3::splat(-1e3), DVec3::splat(1e3)),
        }
    }

    /// A new file: its name in the scene and its path.
    pub(super) fn file(&mut self, stem: &str, extension: &str) -> (String, PathBuf) {
        let name = format!("{stem}-{:02}.{extension}", self.files.len() + 1);
        let path = self.folder.join(&name);
        self.files.push(path.clone());
        (name, path)
    }

    /// Notes what the scene contains.
    pub(super) fn tag(&mut self, tag: &'static str) {
        self.tags.insert(tag);
    }

    /// Adds a `<bsdf>`.
    pub(super) fn add_material(&mut self, bsdf: Element) -> MaterialIndex {
        self.materials.push(bsdf);
        MaterialIndex(self.materials.len() - 1)
    }

    /// Adds a surface.
    pub(super) fn add(&mut self, form: Form, material: MaterialIndex) {
        self.surfaces.push(Surface { form, material: Some(material), radiance: None });
    }

    /// Adds a surface that shines; `radiance` is before exposure.
    pub(super) fn add_shining(&mut self, form: Form, radiance: DVec3) {
        self.surfaces.push(Surface { form, material: None, radiance: Some(radiance) });
    }

    /// Adds light that no surface sends.
    pub(super) fn add_light(&mut self, light: Light) {
        self.lights.push(light);
    }

    /// Is there a light from everywhere?
    pub(super) fn is_surrounded(&self) -> bool {
        self.lights.iter().any(|light| matches!(light, Light::Constant(_) | Light::Map { .. }))
    }

    /// Adds an object, each of its roles in a new material.
    ///
    /// # Errors
    /// A texture cannot be written.
    pub(super) fn place(&mut self, object: &Object, random: &mut Random) -> Result<(), Error> {
        self.place_with(object, random, &mut BTreeMap::new())
    }

    /// As [`Stage::place`]; materials made before are taken from `wardrobe`, new ones are put there.
    ///
    /// # Errors
    /// A texture cannot be written.
    pub(super) fn place_with(
        &mut self,
        object: &Object,
        random: &mut Random,
        wardrobe: &mut BTreeMap<Role, MaterialIndex>,
    ) -> Result<(), Error> {
        for (role, form) in &object.parts {
            let material = match wardrobe.get(role) {
                Some(material) => *material,
                None => {
                    let made = material::for_role(self, *role, random)?;
                    wardrobe.insert(*role, made);
                    made
                }
            };
            self.add(form.clone(), material);
        }
        self.tags.extend(object.tag);
        Ok(())
    }

    /// Notes that there is something to look at.
    pub(super) fn show(&mut self, object: &Object) {
        let (low, high) = object.bounds();
        let radius = 0.5 * (high - low).length();
        self.interests.push(Interest { center: 0.5 * (low + high), radius });
    }

    /// Writes the meshes.
    ///
    /// # Errors
    /// The file system refuses.
    pub(super) fn write_meshes(&mut self) -> Result<Vec<Element>, Error> {
        let surfaces = std::mem::take(&mut self.surfaces);
        let mut elements = Vec::with_capacity(surfaces.len());
        for surface in &surfaces {
            elements.push(match &surface.form {
                Form::Mesh(mesh) => {
                    let (name, path) = self.file("mesh", "ply");
                    mesh.write(&path)?;
                    let shape = Element::plugin("shape", "ply").string("filename", &name);
                    let is_flat = mesh.normals.is_empty();
                    if is_flat { shape.boolean("face_normals", true) } else { shape }
                }
                form => form.element().expect("only meshes need a file"),
            });
        }
        self.surfaces = surfaces;
        Ok(elements)
    }

    /// Removes what was written for a scene that is given up.
    ///
    /// # Errors
    /// The file system refuses.
    pub(super) fn remove_files(&self) -> Result<(), Error> {
        for path in &self.files {
            std::fs::remove_file(path).map_err(|source| Error::io(path, source))?;
        }
        Ok(())
    }

    /// The whole scene file; `shapes` are those of [`Stage::write_meshes`]. Light is multiplied by `exposure`.
    pub(super) fn document(
        &self,
        shapes: &[Element],
        sensor: &Element,
        max_depth: u32,
        exposure: f64,
    ) -> String {
        let integrator = Element::plugin("integrator", "path").integer("max_depth", max_depth);
        let mut scene = Element::new("scene")
            .attribute("version", "3.0.0")
            .child(integrator)
            .child(sensor.clone());
        for (index, material) in self.materials.iter().enumerate() {
            // Materials whose object was not built after all would be warned of.
            let is_used = |surface: &Surface| surface.material.is_some_and(|used| used.0 == index);
            if self.surfaces.iter().any(is_used) {
                scene = scene.child(material.clone().attribute("id", format!("material-{index}")));
            }
        }
        for light in &self.lights {
            scene = scene.child(light.element(exposure));
        }
        for (surface, shape) in self.surfaces.iter().zip(shapes) {
            let mut shape = shape.clone();
            if let Some(radiance) = surface.radiance {
                let black = Element::plugin("bsdf", "diffuse").rgb("reflectance", DVec3::ZERO);
                let emitter =
                    Element::plugin("emitter", "area").rgb("radiance", radiance * exposure);
                shape = shape.child(black).child(emitter);
            }
            if let Some(material) = surface.material {
                let reference = format!("material-{}", material.0);
                shape = shape.child(Element::new("ref").attribute("id", reference));
            }
            scene = scene.child(shape);
        }
        scene.text()
    }
}
