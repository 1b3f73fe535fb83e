//! What is asked to be measured, and the scenes that it names.

use super::Error;
use super::settings::{Filter, Method, ReferenceBudget, SceneSettings, Settings};
use crate::folder::at;
use crate::scene::{LoadOptions, Scene, find_scene};
use quietlight_denoise::sha256::sha256;
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

/// What is asked for, before the scenes have been looked at.
#[derive(Clone, Debug)]
pub struct Request {
    /// Scene files or folders.
    pub scenes: Vec<PathBuf>,
    /// Pixels across, the height following; `None`: as the scenes say.
    pub width: Option<u32>,
    /// The integrators.
    pub integrators: Vec<Method>,
    /// The denoisers.
    pub denoisers: Vec<Filter>,
    /// Samples or mutations per pixel, in any order.
    pub samples: Vec<u32>,
    /// Replicates.
    pub seeds: u32,
    /// Seed of the first.
    pub seed: u64,
    /// What a reference, both halves together, is worth; `None`: [`REFERENCE_FACTOR`] times the largest sample count.
    pub reference: Option<ReferenceBudget>,
}

/// Samples of a whole reference for each of the largest sample count, by default: its noise is 1/32 of that of the best
/// noisy picture of the same method, and well below what denoisers leave of it.
pub const REFERENCE_FACTOR: u32 = 32;

impl Request {
    /// Loads the scenes, and says what will be measured.
    ///
    /// # Errors
    /// [`Error::Scene`] where one cannot be loaded; [`Error::Nothing`] where a list is empty.
    pub fn load(self) -> Result<(Settings, Vec<Scene>), Error> {
        let mut samples = self.samples;
        samples.sort_unstable();
        samples.dedup();
        samples.retain(|&count| count > 0);
        let lists = [
            ("scenes", self.scenes.len()),
            ("integrators", self.integrators.len()),
            ("denoisers", self.denoisers.len()),
            ("sample counts", samples.len()),
            ("seeds", self.seeds as usize),
        ];
        if let Some((what, _)) = lists.into_iter().find(|&(_, count)| count == 0) {
            return Err(Error::Nothing(format!("no {what}")));
        }
        let most = samples.last().copied().unwrap_or(1);
        let whole = self
            .reference
            .unwrap_or(ReferenceBudget::Samples(most.saturating_mul(REFERENCE_FACTOR)));
        let reference = match whole {
            ReferenceBudget::Samples(samples) => ReferenceBudget::Samples(samples.div_ceil(2)),
            ReferenceBudget::Seconds(seconds) => ReferenceBudget::Seconds(seconds / 2.0),
        };
        let (mut scenes, mut loaded, mut names) = (Vec::new(), Vec::new(), HashSet::new());
        for path in &self.scenes {
            let (mut settings, scene) = load(path, self.width)?;
            let plain = settings.name.clone();
            for number in 2.. {
                if names.insert(settings.name.clone()) {
                    break;
                }
                settings.name = format!("{plain}-{number}");
            }
            scenes.push(settings);
            loaded.push(scene);
        }
        let settings = Settings {
            scenes,
            integrators: without_repeats(self.integrators),
            denoisers: without_repeats(self.denoisers),
            samples,
            seeds: self.seeds,
            seed: self.seed,
            reference,
        };
        Ok((settings, loaded))
    }
}

fn without_repeats<T: Ord>(mut list: Vec<T>) -> Vec<T> {
    list.sort_unstable();
    list.dedup();
    list
}

fn load(path: &Path, width: Option<u32>) -> Result<(SceneSettings, Scene), Error> {
    let file = find_scene(path)?;
    let mut scene = Scene::load(&file, &LoadOptions::default())?;
    if let Some(width) = width.filter(|&width| width != scene.film.width) {
        let ratio = f64::from(scene.film.height) / f64::from(scene.film.width);
        let height = ((f64::from(width) * ratio).round() as u32).max(1);
        let options = LoadOptions { size: Some((width, height)), ..LoadOptions::default() };
        scene = Scene::load(&file, &options)?;
    }
    let absolute = std::path::absolute(&file).map_err(at(&file))?;
    let named = if file.file_stem().is_some_and(|stem| stem == "scene") {
        absolute.parent().unwrap_or(&absolute)
    } else {
        &absolute
    };
    let name = named.file_stem().map_or("scene".into(), |stem| stem.to_string_lossy());
    let letter =
        |letter: char| if letter.is_alphanumeric() || letter == '_' { letter } else { '-' };
    let settings = SceneSettings {
        name: name.chars().map(letter).collect(),
        path: path.to_path_buf(),
        sha256: sha256(&fs::read(&file).map_err(at(&file))?),
        width: scene.film.crop[2],
        height: scene.film.crop[3],
    };
    Ok((settings, scene))
}
