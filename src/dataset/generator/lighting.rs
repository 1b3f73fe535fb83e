//! Light that no surface sends, and environment maps.

mod sky;

use super::colour;
use super::error::Error;
use super::picture;
use super::random::Random;
use super::stage::Stage;
use super::xml::Element;
use glam::{DMat4, DVec3};

/// Light that no surface sends, before exposure.
#[derive(Clone, Debug)]
pub(super) enum Light {
    /// Radiant intensity.
    Point { position: DVec3, intensity: DVec3 },
    /// A cone with soft edge.
    Spot { position: DVec3, target: DVec3, intensity: DVec3, cutoff_degrees: f64 },
    /// Parallel light with this irradiance across it.
    Directional { direction: DVec3, irradiance: DVec3 },
    /// The same radiance from everywhere.
    Constant(DVec3),
    /// An image, turned around y.
    Map { file: String, scale: f64, turn_degrees: f64 },
}

impl Light {
    /// The `<emitter>`, with its light multiplied by `exposure`.
    pub(super) fn element(&self, exposure: f64) -> Element {
        let plugin = |name| Element::plugin("emitter", name);
        match self {
            Self::Point { position, intensity } => {
                plugin("point").point("position", *position).rgb("intensity", *intensity * exposure)
            }
            Self::Spot { position, target, intensity, cutoff_degrees } => {
                let forward = (*target - *position).normalize_or(DVec3::NEG_Y);
                let (left, up) = forward.any_orthonormal_pair();
                let matrix = DMat4::from_cols(
                    left.extend(0.0),
                    up.extend(0.0),
                    forward.extend(0.0),
                    position.extend(1.0),
                );
                plugin("spot")
                    .matrix("to_world", &matrix)
                    .rgb("intensity", *intensity * exposure)
                    .float("cutoff_angle", *cutoff_degrees)
            }
            Self::Directional { direction, irradiance } => plugin("directional")
                .child(
                    Element::new("vector")
                        .attribute("name", "direction")
                        .attribute("value", super::xml::triple(*direction)),
                )
                .rgb("irradiance", *irradiance * exposure),
            Self::Constant(radiance) => plugin("constant").rgb("radiance", *radiance * exposure),
            Self::Map { file, scale, turn_degrees } => plugin("envmap")
                .string("filename", file)
                .float("scale", *scale * exposure)
                .matrix("to_world", &DMat4::from_rotation_y(turn_degrees.to_radians())),
        }
    }
}

/// Surrounds the scene with a map or a constant, its mean radiance about `radiance`, unless it is surrounded already.
///
/// # Errors
/// The map cannot be written.
pub(super) fn surround(stage: &mut Stage, random: &mut Random, radiance: f64) -> Result<(), Error> {
    if stage.is_surrounded() {
        return Ok(());
    }
    if random.chance(0.12) {
        stage.tag("constant-environment");
        stage.add_light(Light::Constant(colour::light(random) * radiance));
        return Ok(());
    }
    let map = sky::random(random);
    stage.tag("environment-map");
    stage.tags.extend(map.tags.iter());
    let (file, path) = stage.file("environment", "exr");
    picture::write_radiance(&path, map.width, &map.texels)?;
    let scale = radiance / map.mean_luminance().max(1e-6);
    let turn_degrees = random.uniform(0.0, 360.0);
    stage.add_light(Light::Map { file, scale, turn_degrees });
    Ok(())
}

/// A point, spot or directional light that shines on `target` from about this distance. Its irradiance there is about 1.
pub(super) fn lamp(stage: &mut Stage, random: &mut Random, position: DVec3, target: DVec3) {
    let (distance, colour) = (position.distance(target), colour::light(random));
    let intensity = colour * distance * distance;
    if random.chance(0.5) {
        stage.tag("point-light");
        stage.add_light(Light::Point { position, intensity });
    } else {
        stage.tag("spot-light");
        let cutoff_degrees = random.uniform(12.0, 55.0);
        stage.add_light(Light::Spot { position, target, intensity, cutoff_degrees });
    }
}

/// Parallel light from above.
pub(super) fn directional(stage: &mut Stage, random: &mut Random) {
    let mut direction = random.direction();
    direction.y = -direction.y.abs() - 0.25;
    stage.tag("directional-light");
    let irradiance = colour::light(random) * random.log_uniform(0.5, 4.0);
    stage.add_light(Light::Directional { direction: direction.normalize(), irradiance });
}
