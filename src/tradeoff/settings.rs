//! What is measured: the settings of a measurement, and the file that holds them.

use crate::folder::{Error, read_json, write_json};
use crate::integrator::{Bdpt, CorrelatedVisibility, Erpt, Integrator, Mlt, PathTracing, Pssmlt};
use quietlight_denoise::Denoiser;
use quietlight_denoise::kpcn::Quality;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

/// What the files are of.
pub(super) const MEASUREMENT: &str = "a measurement";

/// A way to find light, with the settings that it has by default.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Path tracing.
    Path,
    /// Bidirectional path tracing.
    Bdpt,
    /// Metropolis sampling in primary sample space.
    Pssmlt,
    /// Metropolis light transport.
    Mlt,
    /// Energy redistribution path tracing.
    Erpt,
    /// Correlated visibility sampling.
    Visibility,
}

/// What is done with the noise of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// It is left in.
    None,
    /// Cross-bilateral filter with learned parameters.
    Bilateral,
    /// The smallest networks.
    KpcnFast,
    /// The networks that run by default.
    KpcnBalanced,
    /// The largest networks.
    KpcnHigh,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Path, Self::Bdpt, Self::Pssmlt, Self::Mlt, Self::Erpt, Self::Visibility];

    /// Its name on the command line and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Path => "path",
            Self::Bdpt => "bdpt",
            Self::Pssmlt => "pssmlt",
            Self::Mlt => "mlt",
            Self::Erpt => "erpt",
            Self::Visibility => "visibility",
        }
    }

    /// The integrator, as it is by default.
    pub fn integrator(self) -> Integrator {
        match self {
            Self::Path => PathTracing::default().into(),
            Self::Bdpt => Integrator::Bdpt(Bdpt::default()),
            Self::Pssmlt => Integrator::Pssmlt(Pssmlt::default()),
            Self::Mlt => Integrator::Mlt(Mlt::default()),
            Self::Erpt => Integrator::Erpt(Erpt::default()),
            Self::Visibility => Integrator::Visibility(CorrelatedVisibility::default()),
        }
    }
}

impl Filter {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::None, Self::Bilateral, Self::KpcnFast, Self::KpcnBalanced, Self::KpcnHigh];

    /// Its name on the command line and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Bilateral => "bilateral",
            Self::KpcnFast => "kpcn-fast",
            Self::KpcnBalanced => "kpcn-balanced",
            Self::KpcnHigh => "kpcn-high",
        }
    }

    /// The denoiser; `None` where the noise is left in.
    ///
    /// # Errors
    /// Where it cannot run on this machine or with this program.
    pub fn denoiser(self) -> Result<Option<Denoiser>, quietlight_denoise::Error> {
        let quality = match self {
            Self::None => return Ok(None),
            Self::Bilateral => return Ok(Some(Denoiser::bilateral())),
            Self::KpcnFast => Quality::Fast,
            Self::KpcnBalanced => Quality::Balanced,
            Self::KpcnHigh => Quality::High,
        };
        Denoiser::embedded(quality).map(Some)
    }
}

impl FromStr for Method {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        named(&Self::ALL, Self::name, text)
    }
}

impl FromStr for Filter {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        named(&Self::ALL, Self::name, text)
    }
}

fn named<T: Copy>(all: &[T], name: fn(T) -> &'static str, text: &str) -> Result<T, String> {
    let names = || all.iter().map(|&one| name(one)).collect::<Vec<_>>().join(", ");
    let found = all.iter().copied().find(|&one| name(one) == text);
    found.ok_or_else(|| format!("expected one of {}", names()))
}

/// How long each of the two halves of a reference is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReferenceBudget {
    /// Samples per pixel.
    Samples(u32),
    /// Seconds of wall time: not the same bits on another machine.
    Seconds(f64),
}

/// One scene of a measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneSettings {
    /// Short name: that of its folder or file.
    pub name: String,
    /// Where it was loaded from.
    pub path: PathBuf,
    /// SHA-256 of the scene file; the meshes and textures that it names do not count.
    pub sha256: String,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

/// What decides the pictures of a measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The scenes.
    pub scenes: Vec<SceneSettings>,
    /// The integrators.
    pub integrators: Vec<Method>,
    /// The denoisers, also those that could not run.
    pub denoisers: Vec<Filter>,
    /// Samples or mutations per pixel, rising.
    pub samples: Vec<u32>,
    /// Replicates of every integrator.
    pub seeds: u32,
    /// Seed of the first replicate; the next ones follow.
    pub seed: u64,
    /// What each half of a reference is worth.
    pub reference: ReferenceBudget,
}

const PLAN: &str = "plan.json";

impl ReferenceBudget {
    /// As the renderer takes it.
    pub fn budget(self) -> crate::render::Budget {
        match self {
            Self::Samples(samples) => crate::render::Budget::Samples(samples),
            Self::Seconds(seconds) => {
                crate::render::Budget::Time(Duration::from_secs_f64(seconds.max(0.0)))
            }
        }
    }
}

impl Settings {
    /// The file that holds them.
    pub fn path(folder: &Path) -> PathBuf {
        folder.join(PLAN)
    }

    /// Reads the settings of the measurement in `folder`.
    ///
    /// # Errors
    /// [`Error::File`] where there are none.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        read_json(&Self::path(folder), MEASUREMENT)
    }

    /// Writes them, whole or not at all.
    ///
    /// # Errors
    /// [`Error::File`] where the folder cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        write_json(&Self::path(folder), self)
    }

    /// These settings joined by those of a measurement that is there: scenes and seeds may be added, everything else
    /// must be the same.
    ///
    /// # Errors
    /// [`Error::Settings`], with each setting that differs.
    pub fn join(mut self, found: &Self, folder: &Path) -> Result<Self, Error> {
        let mut differences = Vec::new();
        let mut compare = |what: &str, is_same: bool, here: String, there: String| {
            if !is_same {
                differences.push(format!("{what} {there} there, {here} here"));
            }
        };
        macro_rules! compare {
            ($($field:ident),*) => {
                $(compare(
                    stringify!($field),
                    self.$field == found.$field,
                    format!("{:?}", self.$field),
                    format!("{:?}", found.$field),
                );)*
            };
        }
        compare!(integrators, denoisers, samples, seed, reference);
        for scene in &self.scenes {
            if let Some(other) = found.scenes.iter().find(|other| other.name == scene.name) {
                let facts = |of: &SceneSettings| {
                    format!("{}x{}, SHA-256 {}", of.width, of.height, &of.sha256)
                };
                let is_same = facts(scene) == facts(other);
                compare(&format!("scene {}", scene.name), is_same, facts(scene), facts(other));
            }
        }
        if !differences.is_empty() {
            let differences = differences.join("; ");
            return Err(Error::Settings { path: Self::path(folder), differences });
        }
        let added = self
            .scenes
            .iter()
            .filter(|scene| found.scenes.iter().all(|other| other.name != scene.name));
        self.scenes = found.scenes.iter().chain(added).cloned().collect();
        self.seeds = self.seeds.max(found.seeds);
        Ok(self)
    }
}
