//! Lights and materials changed between reading a scene and building it.

use super::build::{Description, Light};
use super::material::Model;
use crate::emitter::{Emitter, Environment};
use crate::math::Rgb;
use crate::texture::{Checkerboard, Texture};

/// What the lights and materials of a scene become. Each is asked about once, in the order in which the scene has them.
pub trait Changes {
    /// Factor of the light of the next emitter. Emission by an image stays as it is.
    fn emitter(&mut self) -> Rgb;
    /// By how much the next environment map is turned around its poles, in radians.
    fn environment_turn(&mut self) -> f64;
    /// What the next model becomes; blends are taken apart.
    fn model(&mut self, model: Model) -> Model;
}

impl Description {
    /// Asks for every emitter and material, and changes it.
    pub(super) fn change(&mut self, changes: &mut dyn Changes) {
        for radiance in self.shapes.iter_mut().filter_map(|shape| shape.radiance.as_mut()) {
            *radiance = scaled(radiance, changes.emitter());
        }
        for light in &mut self.lights {
            let factor = changes.emitter();
            match light {
                Light::Point { intensity, .. } | Light::Spot { intensity, .. } => {
                    *intensity = *intensity * factor;
                }
                Light::Infinite(Emitter::Directional { irradiance, .. }) => {
                    *irradiance = *irradiance * factor;
                }
                Light::Infinite(Emitter::Environment(environment)) => match environment {
                    Environment::Constant(colour) => *colour = *colour * factor,
                    Environment::Map(map) => {
                        **map = map.changed(factor, changes.environment_turn());
                    }
                },
                // The emitters that are somewhere are described by the variants above.
                Light::Infinite(
                    Emitter::Area { .. } | Emitter::Point { .. } | Emitter::Spot { .. },
                ) => {}
            }
        }
        for material in &mut self.materials {
            *material = material.clone().with_models(&mut |model| changes.model(model));
        }
    }
}

/// The texture times a factor; images stay as they are.
fn scaled(texture: &Texture, factor: Rgb) -> Texture {
    match texture {
        Texture::Constant(colour) => Texture::Constant(*colour * factor),
        Texture::Bitmap(_) => texture.clone(),
        Texture::Checkerboard(board) => {
            let textures =
                board.textures.as_ref().each_ref().map(|texture| scaled(texture, factor));
            Texture::Checkerboard(Checkerboard { textures: Box::new(textures), ..board.clone() })
        }
    }
}
