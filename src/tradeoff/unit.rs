//! Units of work: a half of a reference, or one seed of one integrator at all its sample counts and denoisers.
//!
//! A unit's folder is made under another name and renamed when all of it is on disk.

use super::settings::{Filter, Method, ReferenceBudget, read_json, write_json};
use super::{Error, at};
use crate::integrator::Choice;
use crate::render::{Budget, RenderSettings, Rendering};
use crate::scene::Scene;
use quietlight_denoise::exr::{self, WriteOptions};
use quietlight_denoise::{Denoiser, Image, LayerKind, Layers};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

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
    /// Why it was chosen, from what the scene's light is like.
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

/// What a unit is made with.
pub(super) struct Workshop<'a> {
    /// The scene of the unit.
    pub(super) scene: &'a Scene,
    /// Sample counts, rising.
    pub(super) samples: &'a [u32],
    /// The denoisers that can run, `None` for leaving the noise in.
    pub(super) denoisers: &'a [(Filter, Option<Denoiser>)],
    /// Those that cannot, and why.
    pub(super) left_out: &'a [(Filter, String)],
    /// What a half of a reference is worth.
    pub(super) reference: ReferenceBudget,
    /// Threads to render and denoise on.
    pub(super) threads: &'a rayon::ThreadPool,
    /// Heard with the samples of the whole picture done so far.
    pub(super) progress: &'a (dyn Fn(u64) + Sync),
    /// Becomes true when the user wants to stop.
    pub(super) stop: &'a AtomicBool,
}

const REFERENCE: &str = "reference.json";
const RUN: &str = "run.json";
const PICTURE: &str = "picture.exr";

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
                    return Err(at(old)(error));
                }
                _ => {}
            }
        }
        fs::create_dir_all(&part).map_err(at(&part))?;
        let made = match self {
            Self::Reference { half, .. } => make_reference(&part, base, half, workshop),
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
    pub fn read(folder: &Path) -> Result<Self, Error> {
        read_json(&folder.join(REFERENCE))
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
    pub fn read(folder: &Path) -> Result<Self, Error> {
        read_json(&folder.join(RUN))
    }
}

fn render_settings(integrator: crate::integrator::Integrator, seed: u64) -> RenderSettings {
    RenderSettings { integrator, seed, ..RenderSettings::default() }
}

fn make_reference(
    folder: &Path,
    base: u64,
    half: u32,
    workshop: &Workshop<'_>,
) -> Result<bool, Error> {
    let Choice { integrator, reason } = workshop.threads.install(|| Choice::of(workshop.scene));
    let seed = reference_seed(base, half);
    let budget = workshop.reference.budget();
    let settings = RenderSettings { budget, ..render_settings(integrator, seed) };
    let rendered = workshop.threads.install(|| {
        let mut rendering = Rendering::new(workshop.scene, &settings);
        rendering.run(budget, workshop.progress, workshop.stop);
        rendering.finish()
    });
    if workshop.stop.load(Ordering::Relaxed) {
        return Ok(false);
    }
    write_picture(&folder.join(PICTURE), beauty(&rendered.layers)?)?;
    let record = ReferenceHalf {
        integrator: integrator.name().to_owned(),
        settings: integrator.settings(),
        reason,
        seed,
        samples: rendered.samples,
        seconds: rendered.elapsed.as_secs_f64(),
        invalid_samples: rendered.invalid_samples,
    };
    write_json(&folder.join(REFERENCE), &record)?;
    Ok(true)
}

fn make_run(
    folder: &Path,
    method: Method,
    seed: u64,
    workshop: &Workshop<'_>,
) -> Result<bool, Error> {
    let most = workshop.samples.last().copied().unwrap_or(1);
    let integrator = method.integrator();
    let settings =
        RenderSettings { budget: Budget::Samples(most), ..render_settings(integrator, seed) };
    let mut rendering = Rendering::new(workshop.scene, &settings);
    let mut stopwatch = Stopwatch::default();
    let mut measures = Vec::new();
    for &samples in workshop.samples {
        let layers = stopwatch.time(|| {
            workshop.threads.install(|| {
                rendering.advance(samples, workshop.progress, workshop.stop);
                rendering.layers()
            })
        });
        if workshop.stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        let mut pictures = Vec::new();
        for (filter, denoiser) in workshop.denoisers {
            let mut watch = Stopwatch::default();
            let denoised = match denoiser {
                None => None,
                Some(denoiser) => {
                    Some(watch.time(|| denoiser.denoise(&layers, workshop.threads, &|_| {}))?.image)
                }
            };
            let file = format!("{samples:07}-{}.exr", filter.name());
            let picture = match &denoised {
                Some(image) => image,
                None => beauty(&layers)?,
            };
            write_picture(&folder.join(&file), picture)?;
            pictures.push(Picture {
                denoiser: *filter,
                seconds: watch.wall.as_secs_f64(),
                cpu_seconds: watch.cpu_seconds(),
                file,
            });
            if workshop.stop.load(Ordering::Relaxed) {
                return Ok(false);
            }
        }
        measures.push(Measure {
            samples,
            render_seconds: stopwatch.wall.as_secs_f64(),
            render_cpu_seconds: stopwatch.cpu_seconds(),
            invalid_samples: rendering.invalid_samples(),
            pictures,
        });
    }
    let record = Run {
        integrator: method,
        settings: integrator.settings(),
        seed,
        threads: workshop.threads.current_num_threads(),
        processor: processor(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        measures,
        left_out: workshop.left_out.to_vec(),
    };
    write_json(&folder.join(RUN), &record)?;
    Ok(true)
}

fn beauty(layers: &Layers) -> Result<&Image, Error> {
    let layer = layers.layers.get(&LayerKind::Beauty);
    Ok(&layer.ok_or_else(|| Error::Nothing("a render without a picture".into()))?.mean)
}

fn write_picture(path: &Path, picture: &Image) -> Result<(), Error> {
    let (_, height, width) = picture.dim();
    let layers = Layers { width, height, ..Layers::default() };
    let options = WriteOptions { picture: Some(picture), ..WriteOptions::default() };
    Ok(exr::write(path, &layers, &options)?)
}

/// Wall time and time of all threads, over several pieces of work.
#[derive(Default)]
struct Stopwatch {
    wall: Duration,
    cpu: Option<Duration>,
}

impl Stopwatch {
    fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let (start, cpu) = (Instant::now(), cpu_time());
        let done = work();
        self.wall += start.elapsed();
        if let (Some(before), Some(after)) = (cpu, cpu_time()) {
            *self.cpu.get_or_insert_default() += after.saturating_sub(before);
        }
        done
    }

    fn cpu_seconds(&self) -> Option<f64> {
        self.cpu.map(|cpu| cpu.as_secs_f64())
    }
}

/// Time of all threads of this process so far; `None` where the system does not tell.
#[cfg(unix)]
fn cpu_time() -> Option<Duration> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(Duration::new(u64::try_from(time.tv_sec).ok()?, u32::try_from(time.tv_nsec).ok()?))
}

#[cfg(not(unix))]
fn cpu_time() -> Option<Duration> {
    None
}

/// The name of the processor; "unknown" where the system does not tell.
fn processor() -> String {
    let facts = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = facts.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == "model name").then(|| value.trim().to_owned())
    });
    name.unwrap_or_else(|| "unknown".to_owned())
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

    #[test]
    fn a_stopwatch_adds_up_what_it_timed_and_nothing_else() {
        let (start, mut watch) = (Instant::now(), Stopwatch::default());
        for _ in 0..2 {
            watch.time(|| std::thread::sleep(Duration::from_millis(20)));
            std::thread::sleep(Duration::from_millis(60));
        }
        assert!(watch.wall >= Duration::from_millis(40), "{:?}", watch.wall);
        assert!(watch.wall + Duration::from_millis(120) <= start.elapsed(), "{:?}", watch.wall);
    }
}
