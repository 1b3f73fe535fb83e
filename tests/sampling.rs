//! Whatever can be sampled is sampled with the density it states, and no surface makes light.

mod densities;
mod energy;
mod values;

use crate::support::mean::Mean;
use crate::support::random::Random;
use crate::support::sphere::SphereGrid;
use crate::support::{LEVEL, sidak};
use glam::{Vec2, Vec3};
use quietlight::bsdf::{Bsdf, BsdfSample, Coat, Distribution, Glass, Metal, RoughCoat, metals};
use quietlight::math::Rgb;
use std::f32::consts::PI;
use std::sync::LazyLock;

/// A model and the index below it over that above it.
struct Model {
    name: String,
    bsdf: Bsdf<'static>,
    eta: f32,
}

impl Model {
    fn new(name: impl Into<String>, bsdf: Bsdf<'static>) -> Self {
        Self { name: name.into(), bsdf, eta: 1.0 }
    }

    /// The factor from radiance to energy: index where `wi` lies over that where `wo` lies, squared.
    fn compression(&self, wo: Vec3, wi: Vec3) -> f64 {
        match (wo.z > 0.0, wi.z > 0.0) {
            (true, false) => f64::from(self.eta * self.eta),
            (false, true) => f64::from(1.0 / (self.eta * self.eta)),
            _ => 1.0,
        }
    }
}

const DISTRIBUTIONS: [Distribution; 2] = [Distribution::Beckmann, Distribution::Ggx];

const WHITE_GLASS: Glass = Glass { eta: 1.5, reflectance: Rgb::WHITE, transmittance: Rgb::WHITE };

const MIRROR: Metal = Metal { eta: Rgb::BLACK, k: Rgb::WHITE, tint: Rgb::WHITE };

/// Coats of one index and several roughnesses, alike in all but the distribution, linear and not.
static COATS: LazyLock<Vec<(String, RoughCoat)>> = LazyLock::new(|| {
    let mut coats = Vec::new();
    for distribution in DISTRIBUTIONS {
        for (alpha, is_nonlinear) in [(0.05, true), (0.1, false), (0.5, true)] {
            let coat = RoughCoat::new(distribution, alpha, 1.5, is_nonlinear);
            coats.push((format!("{distribution:?} {alpha} nonlinear={is_nonlinear}"), coat));
        }
    }
    coats
});

fn gold() -> Metal {
    let (eta, k) = metals::complex_index("Au").expect("gold is known");
    Metal { eta, k, tint: Rgb::new(1.0, 0.9, 0.8) }
}

/// White models with a smooth lobe, of roughness 0.1 and more.
fn white_models() -> Vec<Model> {
    let mut models = vec![
        Model::new("diffuse", Bsdf::diffuse(Rgb::WHITE)),
        Model::new("plastic", Bsdf::plastic(Rgb::WHITE, Rgb::WHITE, Coat::new(1.5, false))),
        Model::new(
            "nonlinear plastic",
            Bsdf::plastic(Rgb::WHITE, Rgb::WHITE, Coat::new(1.9, true)),
        ),
    ];
    for distribution in DISTRIBUTIONS {
        for alpha in [Vec2::splat(0.1), Vec2::splat(0.3), Vec2::splat(0.8), Vec2::new(0.1, 0.5)] {
            let name = format!("{distribution:?} {alpha}");
            models.push(Model::new(
                format!("mirror {name}"),
                Bsdf::rough_conductor(MIRROR, distribution, alpha),
            ));
            models.push(Model {
                name: format!("glass {name}"),
                bsdf: Bsdf::rough_dielectric(WHITE_GLASS, distribution, alpha),
                eta: 1.5,
            });
        }
    }
    for (name, coat) in COATS.iter() {
        models.push(Model::new(
            format!("rough plastic {name}"),
            Bsdf::rough_plastic(Rgb::WHITE, Rgb::WHITE, coat),
        ));
    }
    models
}

/// Coloured models, and mixtures of lobes.
fn coloured_models() -> Vec<Model> {
    let colour = Rgb::new(0.8, 0.5, 0.1);
    let glass = Glass {
        eta: 1.33,
        reflectance: Rgb::new(0.9, 0.8, 0.7),
        transmittance: Rgb::new(0.3, 0.6, 0.9),
    };
    let ground = Bsdf::rough_dielectric(glass, Distribution::Ggx, Vec2::new(0.3, 0.2));
    let diffuse = Bsdf::diffuse(colour);
    let mut models = vec![
        Model::new(
            "gold",
            Bsdf::rough_conductor(gold(), Distribution::Beckmann, Vec2::new(0.4, 0.15)),
        ),
        Model { name: "water".into(), bsdf: ground.clone(), eta: 1.33 },
        Model {
            name: "mixed with a delta".into(),
            bsdf: Bsdf::blend(0.3, Bsdf::conductor(gold()), diffuse),
            eta: 1.0,
        },
        Model::new("plastic", Bsdf::plastic(colour, Rgb::splat(0.7), Coat::new(1.5, true))),
    ];
    let plastic = Bsdf::rough_plastic(colour, Rgb::splat(0.5), &COATS[4].1);
    let nested = Bsdf::blend(0.6, plastic, Bsdf::blend(0.2, ground, Bsdf::dielectric(glass)));
    models.push(Model { name: "nested".into(), bsdf: nested, eta: 1.33 });
    models
}

fn direction(theta: f32, phi: f32) -> Vec3 {
    Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// Six angles of incidence on the upper side, and on the lower side where the model is transparent.
fn directions(model: &Model) -> Vec<Vec3> {
    let above =
        [0.0f32, 15.0, 40.0, 65.0, 80.0, 88.0].map(|degrees| direction(degrees.to_radians(), 0.7));
    let below = above.iter().filter(|_| model.eta != 1.0).map(|&w| -w);
    above.into_iter().chain(below).collect()
}

/// A smooth sample; `None` where the light was absorbed or took a delta lobe.
fn smooth(sample: Option<BsdfSample>) -> Option<BsdfSample> {
    sample.filter(|sample| !sample.is_delta())
}

fn draw(bsdf: &Bsdf<'_>, wo: Vec3, random: &mut Random) -> Option<BsdfSample> {
    let lobe = random.next_f32();
    bsdf.sample(wo, lobe, random.next_vec2())
}
