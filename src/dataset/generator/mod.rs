//! Scenes out of a seed: rooms and open sets with things in them, materials, textures, lights and a camera that looks at
//! something.
//!
//! Lengths are metres, `y` is up. A scene is built on a `stage` by `room` or `open`, which put down what `object` makes of
//! the meshes of `solid`; `material` gives each role of an object a material with the textures of `pattern`, and
//! `lighting` the light that no surface sends. Then the scene is loaded as a user's would be: `camera` chooses a view by
//! rays, and `exposure` the strength of all light by a small trial picture.

mod camera;
mod colour;
mod error;
mod exposure;
mod floor_plan;
mod form;
mod lighting;
mod material;
mod mesh;
mod noise;
mod object;
mod open;
mod pattern;
mod picture;
mod random;
mod room;
mod solid;
mod stage;
mod xml;

pub use error::Error;

use crate::scene::{FilmSettings, LoadOptions, Scene};
use camera::{Aim, View};
use random::Random;
use stage::Stage;
use std::path::{Path, PathBuf};

/// A generated scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Generated {
    /// The scene file; the files that it names lie beside it.
    pub scene: PathBuf,
    /// Pixels across and down the film.
    pub film: [u32; 2],
    /// What it contains, in alphabetical order: "room", "open", "glass", "sun", "defocus", …
    pub tags: Vec<String>,
}

/// Candidates among which the camera is chosen.
const CANDIDATES: usize = 20;

/// Scenes built in vain, because nearly nothing in view is lit, before one is taken as it is.
const ATTEMPTS: u32 = 6;

/// Share of the pixels of the trial picture that must not be black.
const LIT_SHARE: f64 = 0.7;

/// Generates the scene of `seed` in `folder`, which is made if it is not there. The same seed gives the same files, byte
/// by byte; `scene.xml` is written last.
///
/// # Errors
/// The folder or a file in it cannot be written.
pub fn generate(seed: u64, folder: &Path) -> Result<Generated, Error> {
    std::fs::create_dir_all(folder).map_err(|source| Error::io(folder, source))?;
    let mut attempt = 0;
    loop {
        let is_last = attempt + 1 == ATTEMPTS;
        if let Some(generated) = try_generate(seed, attempt, folder, is_last)? {
            return Ok(generated);
        }
        attempt += 1;
    }
}

/// One attempt; `None` when its picture would be black and it need not be taken.
fn try_generate(
    seed: u64,
    attempt: u32,
    folder: &Path,
    is_last: bool,
) -> Result<Option<Generated>, Error> {
    let mut random = Random::new(seed, attempt);
    let mut stage = Stage::new(folder);
    let film = film(&mut random);
    let max_depth = random.integer(8, 12) as u32;
    if random.chance(0.55) {
        room::build(&mut stage, &mut random)?;
    } else {
        open::build(&mut stage, &mut random)?;
    }
    let shapes = stage.write_meshes()?;
    let path = folder.join("scene.xml");
    let write = |stage: &Stage, view: &View, exposure: f64| {
        use std::io::Write;
        let text = stage.document(&shapes, &view.element(film), max_depth, exposure);
        quietlight_denoise::atomic::write(&path, |file| {
            file.write_all(text.as_bytes())
                .map_err(|source| quietlight_denoise::Error::Io { path: path.clone(), source })
        })
    };
    write(&stage, &View::any(), 1.0)?;
    let mut scene = Scene::load(&path, &LoadOptions::default())?;

    let mut view = choose_view(&scene, &stage, &mut random);
    if random.chance(0.15) {
        view = view.defocused(random.log_uniform(0.008, 0.05));
        stage.tag("defocus");
    }
    let trial = [48, 48 * film[1] / film[0]];
    if let Some(camera) = view.camera(&scene, trial) {
        scene.camera = camera;
    }
    let [width, height] = trial;
    scene.film = FilmSettings { width, height, crop: [0, 0, width, height] };
    let luminances = exposure::luminances(&scene);
    let lit = luminances.iter().filter(|value| **value > 0.0).count();
    if (lit as f64) < LIT_SHARE * luminances.len() as f64 && !is_last {
        stage.remove_files()?;
        return Ok(None);
    }
    let wanted = if stage.tags.contains("dark") {
        random.log_uniform(0.01, 0.04)
    } else {
        random.log_uniform(0.06, 0.7)
    };
    write(&stage, &view, exposure::factor(&luminances, wanted))?;
    let tags = stage.tags.iter().map(|tag| (*tag).to_owned()).collect();
    Ok(Some(Generated { scene: path, film, tags }))
}

/// About 256 pixels across, in proportions from upright to wide.
fn film(random: &mut Random) -> [u32; 2] {
    let [x, y] = random.pick(&[[4, 3], [4, 3], [3, 2], [16, 9], [1, 1], [3, 4], [5, 4]]);
    let width = 256.0_f64;
    let height = (width * f64::from(y) / f64::from(x)).round();
    [width as u32, height as u32]
}

/// The best of some candidates.
fn choose_view(scene: &Scene, stage: &Stage, random: &mut Random) -> View {
    let aim = random.weighted(&[(0.3, Aim::Thing), (0.35, Aim::Group), (0.35, Aim::Surroundings)]);
    let mut best = (f64::NEG_INFINITY, View::any());
    for _ in 0..CANDIDATES {
        let view = View::candidate(stage, aim, random);
        let score = view.score(scene);
        if score > best.0 {
            best = (score, view);
        }
    }
    best.1
}

#[cfg(test)]
mod tests;
