//! Mitsuba scene files: version 3 of the format, with the spellings of 0.5 to 2 upgraded.
//!
//! Reading goes in two steps. [`read`] turns text into a [`document`]: plugins with properties, parameters substituted,
//! includes and references resolved, and the place of everything kept. Then each kind of plugin is asked for what it
//! means, by the file named after it; what nobody asks for is an error, as in Mitsuba, so that nothing is passed over
//! in silence. Definitions that no shape uses are not asked at all.
//!
//! Deliberately absent: participating media, spectra, motion, instances, hair.

mod bsdfs;
mod document;
mod element;
mod emitters;
mod parameters;
mod properties;
mod read;
mod sensor;
mod shapes;
mod source;
mod textures;
mod transform;
mod upgrade;
mod value;

use super::LoadOptions;
use super::build::{Description, ShapeDescription};
use super::error::{Location, SceneError};
use super::material::{Material, MaterialId, Model};
use crate::math::Rgb;
use crate::texture::ImageCache;
use document::{Document, PluginId};
use properties::Properties;
use std::collections::HashMap;
use std::path::Path;

/// Kinds of plugins that may stand in a scene only to be referred to.
const DEFINITIONS: [&str; 9] =
    ["bsdf", "film", "medium", "phase", "rfilter", "sampler", "spectrum", "texture", "volume"];

/// Reads a scene file and all the files that it names.
///
/// # Errors
/// Whatever [`SceneError`] says, with its place.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Description, SceneError> {
    let document = read::read(path, &options.definitions)?;
    let mut scene = Properties::new(&document, document.root());
    let mut warnings = Vec::new();

    let limits = match scene.plugin("integrator")? {
        Some(id) => sensor::integrator(&document, id, &mut warnings)?,
        None => sensor::DEFAULT_LIMITS,
    };
    let sensors = scene.plugins("sensor");
    let Some(first) = sensors.first() else {
        return Err(SceneError::missing(scene.location(), "a <sensor>"));
    };
    let sensor = sensor::sensor(&document, *first, options.size, &mut warnings)?;
    if let Some(other) = sensors.get(1) {
        warnings.push(format!("{}: only the first sensor is used", document[*other].location));
    }

    let mut reader = SurfaceReader::new(&document);
    let shapes = scene.plugins("shape");
    let shapes = shapes.into_iter().map(|id| reader.shape(id)).collect::<Result<Vec<_>, _>>()?;
    let mut lights = Vec::new();
    let mut environment: Option<&Location> = None;
    for id in scene.plugins("emitter") {
        let light = emitters::light(&document, id, &mut reader.images, &mut reader.warnings)?;
        if light.is_environment() {
            let location = &document[id].location;
            if let Some(previous) = environment.replace(location) {
                let (location, previous) = (location.clone(), previous.clone());
                return Err(SceneError::Duplicate {
                    location,
                    what: "the environment".to_owned(),
                    previous,
                });
            }
        }
        lights.push(light);
    }
    for kind in DEFINITIONS {
        scene.plugins(kind);
    }
    scene.finish()?;

    warnings.append(&mut reader.warnings);
    warnings.append(&mut reader.images.warnings);
    warnings.extend(unused_definitions(&document));
    Ok(Description {
        shapes,
        materials: reader.materials,
        lights,
        camera: sensor.camera,
        film: sensor.film,
        limits,
        samples: sensor.samples,
        warnings,
        image_files: reader.images.files,
    })
}

/// Reads shapes, and each material once however often it is referred to.
struct SurfaceReader<'a> {
    document: &'a Document,
    materials: Vec<Material>,
    by_plugin: HashMap<PluginId, MaterialId>,
    /// Materials of shapes that name none: grey, and black for those that shine.
    default: [Option<MaterialId>; 2],
    images: ImageCache,
    warnings: Vec<String>,
}

impl<'a> SurfaceReader<'a> {
    fn new(document: &'a Document) -> Self {
        Self {
            document,
            materials: Vec::new(),
            by_plugin: HashMap::new(),
            default: [None; 2],
            images: ImageCache::default(),
            warnings: Vec::new(),
        }
    }

    fn shape(&mut self, id: PluginId) -> Result<ShapeDescription, SceneError> {
        let mut properties = Properties::new(self.document, id);
        let (bsdf, emitter) = (properties.plugin("bsdf")?, properties.plugin("emitter")?);
        let material = match bsdf {
            Some(bsdf) => self.material(bsdf)?,
            None => self.default_material(emitter.is_some()),
        };
        let has_pattern = self.materials[material.0 as usize].needs_coordinates()
            || emitter.is_some_and(|id| self.document.is_textured(id));
        let shape = shapes::shape(&mut properties, has_pattern, &mut self.warnings)?;
        let radiance = match emitter {
            Some(emitter) => Some(emitters::area(self.document, emitter, &mut self.images)?),
            None => None,
        };
        properties.finish()?;
        Ok(ShapeDescription { shape, material, radiance })
    }

    fn material(&mut self, bsdf: PluginId) -> Result<MaterialId, SceneError> {
        if let Some(id) = self.by_plugin.get(&bsdf) {
            return Ok(*id);
        }
        let material = bsdfs::material(self.document, bsdf, &mut self.images)?;
        let id = self.add(material);
        self.by_plugin.insert(bsdf, id);
        Ok(id)
    }

    /// As in Mitsuba: half of the light is reflected, and nothing by emitters.
    fn default_material(&mut self, shines: bool) -> MaterialId {
        if let Some(id) = self.default[usize::from(shines)] {
            return id;
        }
        let reflectance = Rgb::splat(if shines { 0.0 } else { 0.5 });
        let id = self.add(Model::Diffuse(reflectance.into()).into());
        self.default[usize::from(shines)] = Some(id);
        id
    }

    fn add(&mut self, material: Material) -> MaterialId {
        self.materials.push(material);
        MaterialId((self.materials.len() - 1) as u32)
    }
}

/// A warning when there are definitions that nothing refers to: they were not looked at, so they may be wrong.
fn unused_definitions(document: &Document) -> Option<String> {
    let is_definition = |id: PluginId| DEFINITIONS.contains(&document[id].kind.as_str());
    let (definitions, mut open): (Vec<_>, Vec<_>) =
        document.nested(document.root()).partition(|id| is_definition(*id));
    let mut is_used = vec![false; document.plugins.len()];
    while let Some(id) = open.pop() {
        if !std::mem::replace(&mut is_used[id.0 as usize], true) {
            open.extend(document.nested(id));
        }
    }
    let unused: Vec<_> = definitions.into_iter().filter(|id| !is_used[id.0 as usize]).collect();
    let first = document[*unused.first()?].location.clone();
    Some(format!("{first}: {} unused definitions were not read, this is the first", unused.len()))
}
