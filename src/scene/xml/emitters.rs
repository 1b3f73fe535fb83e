//! Emitters: what shines without being a shape, and the radiance of shapes that shine.

use super::document::{Document, PluginId};
use super::properties::Properties;
use super::textures::{self, Range};
use crate::emitter::{Emitter, Environment, EnvironmentMap};
use crate::scene::build::Light;
use crate::scene::error::SceneError;
use crate::texture::{ImageCache, Texture};
use glam::{DMat3, DVec3};

/// The emitter plugins known outside of shapes.
const KNOWN: [&str; 5] = ["constant", "directional", "envmap", "point", "spot"];

/// The radiance of a shape, from the `area` emitter nested in it.
///
/// # Errors
/// Another plugin, a property that does not fit, or an image that cannot be read.
pub(super) fn area(
    document: &Document,
    id: PluginId,
    images: &mut ImageCache,
) -> Result<Texture, SceneError> {
    let mut properties = Properties::new(document, id);
    if properties.name() != "area" {
        return Err(properties.unknown_plugin(&["area"]));
    }
    let radiance = textures::texture(&mut properties, "radiance", 1.0, Range::Positive, images)?;
    ignore_sampling(&mut properties);
    properties.finish()?;
    Ok(radiance)
}

/// How often Mitsuba chooses the emitter; here that goes by power.
fn ignore_sampling(properties: &mut Properties<'_>) {
    properties.ignore(&["sampling_weight"]);
}

/// An emitter that is no shape.
///
/// # Errors
/// An unknown plugin, a property that does not fit, or an image that cannot be read.
pub(super) fn light(
    document: &Document,
    id: PluginId,
    images: &mut ImageCache,
    warnings: &mut Vec<String>,
) -> Result<Light, SceneError> {
    let mut properties = Properties::new(document, id);
    ignore_sampling(&mut properties);
    let light = match properties.name() {
        "area" => {
            let expected = "an emitter nested in a shape";
            return Err(SceneError::value(
                properties.location(),
                properties.title(),
                "in the scene",
                expected,
            ));
        }
        "point" => {
            let to_world = properties.transform("to_world")?;
            let position = properties.vector("position")?;
            Light::Point {
                position: position.unwrap_or_else(|| to_world.transform_point3(DVec3::ZERO)),
                intensity: textures::color(&mut properties, "intensity", 1.0, images)?,
            }
        }
        "spot" => {
            let to_world = properties.transform("to_world")?;
            let cutoff = properties.float_in(
                "cutoff_angle",
                20.0,
                "more than 0, at most 180 degrees",
                |angle| angle > 0.0 && angle <= 180.0,
            )?;
            let beam = properties.float_in(
                "beam_width",
                cutoff * 0.75,
                "from 0 to cutoff_angle",
                |angle| (0.0..=cutoff).contains(&angle),
            )?;
            Light::Spot {
                position: to_world.transform_point3(DVec3::ZERO),
                direction: to_world.transform_vector3(DVec3::Z),
                intensity: textures::color(&mut properties, "intensity", 1.0, images)?,
                cutoff_degrees: cutoff,
                beam_degrees: beam,
            }
        }
        "directional" => {
            let to_world = properties.transform("to_world")?;
            let direction = match properties.vector("direction")? {
                Some(direction) => direction,
                None => to_world.transform_vector3(DVec3::Z),
            };
            let Some(direction) = direction.try_normalize() else {
                return Err(properties.wrong("direction", "zero", "a vector with a length"));
            };
            let irradiance = textures::color(&mut properties, "irradiance", 1.0, images)?;
            Light::Infinite(Emitter::Directional { direction: direction.as_vec3(), irradiance })
        }
        "constant" => {
            let radiance = textures::color(&mut properties, "radiance", 1.0, images)?;
            Light::Infinite(Emitter::Environment(Environment::Constant(radiance)))
        }
        "envmap" => environment_map(&mut properties, images, warnings)?,
        _ => return Err(properties.unknown_plugin(&KNOWN)),
    };
    properties.finish()?;
    Ok(light)
}

fn environment_map(
    properties: &mut Properties<'_>,
    images: &mut ImageCache,
    warnings: &mut Vec<String>,
) -> Result<Light, SceneError> {
    let path = properties.file()?;
    let scale = properties.float_in("scale", 1.0, "0 or more", |scale| scale >= 0.0)?;
    let to_world = DMat3::from_mat4(properties.transform("to_world")?);
    // A choice of how to sample, not of what there is to see.
    properties.ignore(&["mis_compensation"]);
    let location = properties.location_of("filename");
    let image =
        images.load_once(&path, false).map_err(|error| SceneError::asset(location, error))?;
    let size = [image.width as usize, image.height as usize];
    let broken = image.broken;
    let map = EnvironmentMap::new(size, image.into_linear(), scale as f32, to_world)
        .map_err(|error| SceneError::asset(properties.location(), error))?;
    let count = broken + map.invalid_texels();
    if count > 0 {
        warnings.push(format!(
            "{}: {count} texels are negative, too large or no number",
            path.display()
        ));
    }
    Ok(Light::Infinite(Emitter::Environment(Environment::from(map))))
}
