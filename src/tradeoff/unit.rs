//! Units of work: a half of a reference, or one seed of one integrator at all its sample counts and denoisers.
//!
//! A unit's folder is made under another name and renamed when all of it is on disk.

use super::Error;
use super::settings::{Filter, MEASUREMENT, Method};
use super::workshop::{Workshop, make_reference, make_run};
use crate::folder::{self, at, read_json};
use crate::integrator::LightProbe;
use quietlight_denoise::{Denoiser, Image};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// What a unit is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Half `half`, 0 or 1, of the reference of a scene.
    Reference {
        /// Index of the scene.
        scene: usize,
        /// Which half.
        half: u32,
    },
    /// One replicate of an integrator.
    Run {
        /// Index of the scene.
        scene: usize,
        /// The integrator.
        method: Method,
        /// Seed of the render.
        seed: u64,
    },
}

/// Record of a half of a reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceHalf {
    /// The integrator that made it.
    pub integrator: String,
    /// Its settings, in words.
    pub settings: String,
    /// What the scene's light is like.
    pub light: LightProbe,
    /// What follows from it for the reference, in words.
    pub reason: String,
    /// Its seed.
    pub seed: u64,
    /// Samples or mutations per pixel.
    pub samples: u32,
    /// Wall time of the render, in seconds.
    pub seconds: f64,
    /// Non-finite samples dropped.
    pub invalid_samples: u64,
}

/// Record of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The integrator.
    pub integrator: Method,
    /// Its settings, in words.
    pub settings: String,
    /// Its seed.
    pub seed: u64,
    /// Threads that it ran on.
    pub threads: usize,
    /// The processor that it ran on, by its own name.
    pub processor: String,
    /// Version of this program.
    pub version: String,
    /// One for each sample count, rising.
    pub measures: Vec<Measure>,
    /// Denoisers that could not run, and why.
    pub left_out: Vec<(Filter, String)>,
}

/// One sample count of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// Samples or mutations per pixel.
    pub samples: u32,
    /// Wall time of the render so far, in seconds: of one render that went on from count to count, without what was done
    /// between.
    pub render_seconds: f64,
    /// Time of all threads in the render so far, in seconds, where the system tells.
    pub render_cpu_seconds: Option<f64>,
    /// Non-finite samples dropped so far.
    pub invalid_samples: u64,
    /// What the denoisers made of it.
    pub pictures: Vec<Picture>,
}

/// One picture of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// What was done with the noise.
    pub denoiser: Filter,
    /// Wall time of the denoiser, in seconds, its weights loaded before.
    pub seconds: f64,
    /// Time of all threads in it, where the system tells.
    pub cpu_seconds: Option<f64>,
    /// Its file, in the folder of the run.
    pub file: String,
}

pub(super) const REFERENCE: &str = "reference.json";
pub(super) const RUN: &str = "run.json";
pub(super) const PICTURE: &str = "picture.exr";

/// Seeds of the halves of references: the upper half of all seeds, which runs do not reach.
fn reference_seed(base: u64, half: u32) -> u64 {
    (base ^ (1 << 63)).wrapping_add(u64::from(half))
}

impl Unit {
    /// Its folder, below that of the measurement, for a scene of that name.
    pub fn folder(self, measurement: &Path, scene: &str) -> PathBuf {
        match self {
            Self::Reference { half, .. } => {
                measurement.join("references").join(scene).join(["a", "b"][half as usize & 1])
            }
            Self::Run { method, seed, .. } => {
                measurement.join("runs").join(scene).join(format!("{}-{seed}", method.name()))
            }
        }
    }

    /// Index of its scene.
    pub fn scene(self) -> usize {
        match self {
            Self::Reference { scene, .. } | Self::Run { scene, .. } => scene,
        }
    }

    /// Is it in `folder`, with all that these denoisers can give?
    pub(super) fn is_done(self, folder: &Path, denoisers: &[(Filter, Option<Denoiser>)]) -> bool {
        match self {
            Self::Reference { .. } => ReferenceHalf::read(folder).is_ok(),
            Self::Run { .. } => Run::read(folder).is_ok_and(|run| {
                run.measures.iter().all(|measure| {
                    let has = |filter| measure.pictures.iter().any(|one| one.denoiser == filter);
                    denoisers.iter().all(|&(filter, _)| has(filter))
                })
            }),
        }
    }

    /// Makes it in `folder`; `base` is the first seed of the measurement. False, and nothing left of it, where `stop`
    /// became true before it was done.
    pub(super) fn make(
        self,
        folder: &Path,
        base: u64,
        workshop: &Workshop<'_>,
    ) -> Result<bool, Error> {
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let part = folder.with_file_name(format!(".{name}.part"));
        for old in [&part, folder] {
            match fs::remove_dir_all(old) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(at(old)(error).into());
                }
                _ => {}
            }
        }
        fs::create_dir_all(&part).map_err(at(&part))?;
        let made = match self {
            Self::Reference { half, .. } => {
                make_reference(&part, reference_seed(base, half), workshop)
            }
            Self::Run { method, seed, .. } => make_run(&part, method, seed, workshop),
        };
        if matches!(made, Ok(true)) {
            fs::rename(&part, folder).map_err(at(folder))?;
        } else {
            // What went wrong is told; that its folder could not be removed either would only hide it.
            let _ = fs::remove_dir_all(&part);
        }
        made
    }
}

impl ReferenceHalf {
    /// Reads the record in the folder of the half.
    ///
    /// # Errors
    /// Where there is none.
    pub fn read(folder: &Path) -> Result<Self, folder::Error> {
        read_json(&folder.join(REFERENCE), MEASUREMENT)
    }

    /// Reads the picture in the folder of the half.
    ///
    /// # Errors
    /// Where there is none.
    pub fn picture(folder: &Path) -> Result<Image, Error> {
        Ok(quietlight_denoise::picture::read_picture(&folder.join(PICTURE))?)
    }
}

impl Run {
    /// Reads the record in the folder of the run.
    ///
    /// # Errors
    /// Where there is none.
    pub fn read(folder: &Path) -> Result<Self, folder::Error> {
        read_json(&folder.join(RUN), MEASUREMENT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_and_runs_never_share_a_seed() {
        for base in [0, 7, 1 << 62, u64::MAX] {
            for half in 0..2 {
                let seed = reference_seed(base, half);
                assert!((0..1000).all(|replicate| base.wrapping_add(replicate) != seed));
            }
            assert_ne!(reference_seed(base, 0), reference_seed(base, 1));
        }
    }
}
