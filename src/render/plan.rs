//! What must agree for two renders to be of the same picture.

use super::{RenderSettings, SamplerKind};
use crate::integrator::Integrator;
use crate::scene::{FilmSettings, Scene};
use serde::{Deserialize, Serialize};

/// Everything that the numbers of a render depend on, but for how many there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of the program.
    pub program: String,
    /// [`Scene::identity`].
    pub scene: String,
    /// Size of the picture and the part of it to render.
    pub film: FilmSettings,
    /// What the scene was moved by.
    pub origin: [f64; 3],
    /// Name of the integrator.
    pub integrator: String,
    /// Its settings, in words.
    pub settings: String,
    /// Seed of the random numbers.
    pub seed: u64,
    /// What makes them.
    pub sampler: SamplerKind,
    /// Do the first samples depend on how many there will be, as chains and deposits do? Then such a render cannot go on to
    /// more than it was begun for.
    pub depends_on_budget: bool,
}

impl Plan {
    /// What these settings make of the scene.
    pub fn of(scene: &Scene, settings: &RenderSettings) -> Self {
        let integrator = &settings.integrator;
        Self {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            scene: scene.identity(),
            film: scene.film,
            origin: scene.origin.to_array(),
            integrator: integrator.name().to_owned(),
            settings: match settings.is_adaptive {
                true => format!("{}, adaptive", integrator.settings()),
                false => integrator.settings(),
            },
            seed: settings.seed,
            sampler: settings.sampler,
            depends_on_budget: settings.is_adaptive
                || !matches!(integrator, Integrator::Path(_) | Integrator::Bdpt(_)),
        }
    }

    /// What is different about another one, a line each: `seed 1 and not 2`.
    pub fn differences(&self, wanted: &Self) -> Vec<String> {
        let size = |film: &FilmSettings| {
            let [x, y, columns, rows] = film.crop;
            format!("{columns}x{rows} at {x},{y} of {}x{}", film.width, film.height)
        };
        let facts = [
            ("version", self.program.clone(), wanted.program.clone()),
            ("picture", size(&self.film), size(&wanted.film)),
            ("integrator", self.integrator.clone(), wanted.integrator.clone()),
            ("settings", self.settings.clone(), wanted.settings.clone()),
            ("seed", self.seed.to_string(), wanted.seed.to_string()),
            ("sampler", format!("{:?}", self.sampler), format!("{:?}", wanted.sampler)),
        ];
        let mut found: Vec<String> = facts
            .into_iter()
            .filter(|(_, is, wanted)| is != wanted)
            .map(|(what, is, wanted)| format!("{what} {is} and not {wanted}"))
            .collect();
        // The identity holds the size, too.
        if found.is_empty() && self.scene != wanted.scene {
            found.push("another scene, or one whose files or definitions have changed".to_owned());
        }
        found
    }
}
