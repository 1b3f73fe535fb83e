//! A given scene seen otherwise: another camera around what the file's camera looks at, other lights, other materials.

mod orbit;

use super::pairs::Refusal;
use super::seed::Dice;
use crate::bsdf::{Distribution, RoughCoat};
use crate::math::Rgb;
use crate::scene::material::{Model, Roughness};
use crate::scene::{Changes, LoadOptions, Scene};
use crate::texture::Texture;
use std::f64::consts::TAU;
use std::path::Path;

/// The scene of `file` with a film of that size; its camera, lights and materials drawn by `seed`.
pub(super) fn vary(file: &Path, [width, height]: [u32; 2], seed: u64) -> Result<Scene, Refusal> {
    let options = LoadOptions { size: Some((width, height)), ..LoadOptions::default() };
    let mut dice = Dice::new(seed);
    let mut variation = Variation { exposure: dice.log_uniform(0.25, 4.0), dice };
    let (mut scene, camera) = Scene::load_changed(file, &options, &mut variation)
        .map_err(|error| Refusal::Broken(error.to_string()))?;
    scene.camera = orbit::camera(&scene, &camera, &mut variation.dice)
        .ok_or_else(|| Refusal::Again("no camera that sees the scene".to_owned()))?;
    Ok(scene)
}

/// Draws what lights and materials become.
struct Variation {
    dice: Dice,
    /// Factor of all light.
    exposure: f64,
}

impl Changes for Variation {
    fn emitter(&mut self) -> Rgb {
        let strength = self.exposure * self.dice.log_uniform(0.3, 3.0);
        // From candle to blue sky and some green or magenta: red and blue go apart, green goes alone.
        let (warmth, green) = (self.dice.uniform(-0.5, 0.5), self.dice.uniform(-0.15, 0.15));
        Rgb::from([warmth, green, -warmth].map(|stops| (strength * stops.exp2()) as f32))
    }

    fn environment_turn(&mut self) -> f64 {
        self.dice.uniform(0.0, TAU)
    }

    fn model(&mut self, model: Model) -> Model {
        if self.dice.chance(0.3) {
            return model;
        }
        match model {
            Model::Diffuse(reflectance) => Model::Diffuse(self.tinted(reflectance)),
            Model::Conductor { eta, k, tint, roughness } => Model::Conductor {
                eta,
                k,
                tint: self.tinted(tint),
                roughness: self.rougher(roughness, 0.5),
            },
            Model::Dielectric { eta, reflectance, transmittance, roughness } => Model::Dielectric {
                eta,
                reflectance,
                transmittance,
                roughness: self.rougher(roughness, 0.1),
            },
            Model::Plastic { diffuse, specular, coat } if self.dice.chance(0.5) => {
                Model::Plastic { diffuse: self.tinted(diffuse), specular, coat }
            }
            Model::Plastic { diffuse, specular, .. }
            | Model::RoughPlastic { diffuse, specular, .. } => {
                let (alpha, eta) = (self.dice.log_uniform(0.02, 0.5), self.dice.uniform(1.3, 1.7));
                let coat = RoughCoat::new(Distribution::Ggx, alpha as f32, eta as f32, true);
                let diffuse = self.tinted(diffuse);
                Model::RoughPlastic { diffuse, specular, coat: Box::new(coat) }
            }
            Model::Null | Model::ThinDielectric { .. } | Model::Blend { .. } => model,
        }
    }
}

impl Variation {
    /// Another reflectance instead of a constant one; images and checks stay.
    fn tinted(&mut self, texture: Texture) -> Texture {
        if texture.constant().is_none() {
            return texture;
        }
        let (value, saturation) = (self.dice.uniform(0.05, 0.95), self.dice.uniform(0.0, 1.0));
        let colour = [(); 3].map(|()| {
            let part = 1.0 - saturation * self.dice.uniform(0.0, 1.0);
            (value * part).max(0.01) as f32
        });
        Rgb::from(colour).into()
    }

    /// Another roughness instead of a constant one; a smooth surface becomes rough with probability `from_smooth`.
    fn rougher(&mut self, roughness: Option<Roughness>, from_smooth: f64) -> Option<Roughness> {
        let is_textured =
            |roughness: &Roughness| roughness.alpha.iter().any(|alpha| alpha.constant().is_none());
        match roughness {
            Some(textured) if is_textured(&textured) => Some(textured),
            None if !self.dice.chance(from_smooth) => None,
            _ => {
                let alpha = self.dice.log_uniform(0.02, 0.6) as f32;
                Some(Roughness::isotropic(Distribution::Ggx, alpha))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Budget, RenderSettings, render};
    use glam::Vec3;
    use quietlight_denoise::{Image, LayerKind};
    use std::path::PathBuf;
    use std::sync::atomic::AtomicBool;

    fn own(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
    }

    fn varied(file: &Path, seed: u64) -> Scene {
        match vary(file, [40, 30], seed) {
            Ok(scene) => scene,
            Err(Refusal::Again(reason) | Refusal::Broken(reason)) => panic!("{reason}"),
        }
    }

    /// One sample a pixel.
    fn layer(scene: &Scene, kind: LayerKind) -> Image {
        let settings = RenderSettings { budget: Budget::Samples(1), ..RenderSettings::default() };
        let rendered = render(scene, &settings, &|_| {}, &AtomicBool::new(false));
        rendered.layers.layers[&kind].mean.clone()
    }

    #[test]
    fn a_seed_decides_camera_lights_and_materials() {
        for name in ["cornell-box", "mis-plates", "still-life"] {
            let [a, b, c] = [1, 1, 2].map(|seed| varied(&own(name), seed));
            for kind in [LayerKind::Beauty, LayerKind::Albedo, LayerKind::Position] {
                assert_eq!(layer(&a, kind), layer(&b, kind), "{name} {kind:?}");
                assert_ne!(layer(&a, kind), layer(&c, kind), "{name} {kind:?}");
            }
        }
    }

    #[test]
    fn cameras_stay_outside_of_things_and_see_them() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.xml");
        std::fs::write(
            &file,
            r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/>
            <transform name="to_world"><lookat origin="0,0,3" target="0,0,0" up="0,1,0"/></transform></sensor>
            <shape type="sphere"/><emitter type="constant"/></scene>"#,
        )
        .unwrap();
        let mut sides = [0; 2];
        for seed in 0..60 {
            let scene = varied(&file, seed);
            let place = scene.camera.center() + scene.origin.as_vec3();
            assert!(place.length() > 1.0, "{place} is inside of the sphere");
            sides[usize::from(place.x > 0.0)] += 1;
            let seen = layer(&scene, LayerKind::Depth).iter().filter(|&&depth| depth > 0.0).count();
            // A sixth of the pixels: the grid that judged is coarser than the film.
            assert!(seen > 40 * 30 / 10, "{seen} pixels of the sphere from {place}");
        }
        assert!(sides.iter().all(|&count| count > 10), "from the left and the right: {sides:?}");
    }

    #[test]
    fn most_of_what_may_change_does() {
        let original = Scene::load(&own("still-life"), &LoadOptions::default()).unwrap();
        let at = |scene: &Scene, material: usize| {
            let at = crate::geometry::Interaction {
                normal: Vec3::Z,
                shading_normal: Vec3::Z,
                uv: glam::Vec2::splat(0.3),
                dp_du: Vec3::X,
                dp_dv: Vec3::Y,
                ..Default::default()
            };
            scene.materials[material].bsdf(&at).albedo()
        };
        let changed = (0..40)
            .map(|seed| {
                let scene = varied(&own("still-life"), seed);
                assert_eq!(scene.materials.len(), original.materials.len());
                (0..scene.materials.len()).filter(|&i| at(&scene, i) != at(&original, i)).count()
            })
            .sum::<usize>();
        assert!(changed > 40, "{changed} changed albedos in 40 variations");
    }
}
