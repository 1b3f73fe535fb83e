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
                    *intensity *= factor;
                }
                Light::Infinite(Emitter::Directional { irradiance, .. }) => {
                    *irradiance *= factor;
                }
                Light::Infinite(Emitter::Environment(environment)) => match environment {
                    Environment::Constant(colour) => *colour *= factor,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Budget, RenderSettings, render};
    use crate::scene::{LoadOptions, Scene};
    use quietlight_denoise::{Image, LayerKind};
    use std::path::{Path, PathBuf};
    use std::sync::atomic::AtomicBool;

    /// The same changes everywhere; without `reflectance` models stay.
    struct Same {
        factor: f32,
        reflectance: Option<f32>,
    }

    impl Changes for Same {
        fn emitter(&mut self) -> Rgb {
            Rgb::splat(self.factor)
        }
        fn environment_turn(&mut self) -> f64 {
            0.0
        }
        fn model(&mut self, model: Model) -> Model {
            self.reflectance.map_or(model, |reflectance| Model::Diffuse(reflectance.into()))
        }
    }

    fn own(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
    }

    /// A scene with what our own have not: emitters of every other kind, the first shape one of them, and a blend of blends.
    const EVERYTHING_ELSE: &str = r#"<scene version="3.0.0"><sensor type="perspective"/>
        <shape type="sphere"><point name="center" x="-1" y="0" z="5"/><emitter type="area">
            <texture type="checkerboard" name="radiance"><rgb name="color0" value="3"/><rgb name="color1" value="1,2,3"/>
            </texture></emitter></shape>
        <shape type="sphere"><point name="center" x="1" y="0" z="5"/><bsdf type="blendbsdf">
            <float name="weight" value="0.5"/><bsdf type="diffuse"><rgb name="reflectance" value="0.9"/></bsdf>
            <bsdf type="blendbsdf"><float name="weight" value="0.5"/><bsdf type="plastic"/><bsdf type="roughconductor"/>
            </bsdf></bsdf></shape>
        <emitter type="point"><point name="position" x="0" y="3" z="0"/><rgb name="intensity" value="9"/></emitter>
        <emitter type="spot"><transform name="to_world"><lookat origin="0,0,0" target="1,0,5" up="0,1,0"/></transform>
            <rgb name="intensity" value="9"/></emitter>
        <emitter type="directional"><vector name="direction" x="0" y="-1" z="1"/><rgb name="irradiance" value="2"/>
        </emitter><emitter type="constant"><rgb name="radiance" value="0.1"/></emitter></scene>"#;

    /// The scenes of those names and [`EVERYTHING_ELSE`], with the folder that holds it.
    fn scenes(names: &[&str]) -> (Vec<PathBuf>, tempfile::TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("everything-else.xml");
        std::fs::write(&file, EVERYTHING_ELSE).unwrap();
        (names.iter().map(|name| own(name)).chain([file]).collect(), folder)
    }

    fn layer(scene: &Scene, kind: LayerKind) -> Image {
        let settings = RenderSettings { budget: Budget::Samples(2), ..RenderSettings::default() };
        let rendered = render(scene, &settings, &|_| {}, &AtomicBool::new(false));
        rendered.layers.layers[&kind].mean.clone()
    }

    #[test]
    fn twice_the_light_makes_twice_the_picture() {
        // Emission is linear, all emitters keep their probabilities, and a factor of 2 rounds nothing.
        let options = LoadOptions { size: Some((24, 20)), ..LoadOptions::default() };
        let (scenes, _folder) =
            scenes(&["cornell-box", "mis-plates", "still-life", "caustic-pool", "furnace"]);
        for file in scenes {
            let name = file.display();
            let original = Scene::load(&file, &options).unwrap();
            let mut changes = Same { factor: 2.0, reflectance: None };
            let (scene, camera) = Scene::load_changed(&file, &options, &mut changes).unwrap();
            let (once, twice) =
                (layer(&original, LayerKind::Beauty), layer(&scene, LayerKind::Beauty));
            assert!(once.iter().any(|&value| value > 0.0), "{name} is black");
            assert_eq!(once * 2.0, twice, "{name}");
            let center = camera.to_world.w_axis.truncate().as_vec3();
            assert_eq!(center, original.camera.center(), "{name}");
        }
    }

    #[test]
    fn every_model_is_asked_about() {
        let options = LoadOptions { size: Some((24, 20)), ..LoadOptions::default() };
        let (scenes, _folder) =
            scenes(&["mis-plates", "still-life", "cornell-box-glass", "ajar-door"]);
        for file in scenes {
            let name = file.display();
            let mut changes = Same { factor: 1.0, reflectance: Some(0.25) };
            let (scene, _) = Scene::load_changed(&file, &options, &mut changes).unwrap();
            let albedo = layer(&scene, LayerKind::Albedo);
            let depth = layer(&scene, LayerKind::Depth);
            for ((channel, y, x), &value) in albedo.indexed_iter() {
                // Of two samples none, one or both met a surface.
                let met = [0.0, 0.125, 0.25].contains(&value);
                assert!(
                    met && (value > 0.0) == (depth[[0, y, x]] > 0.0),
                    "{name} {value} {channel}"
                );
            }
        }
    }
}
