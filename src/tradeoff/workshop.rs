//! Rendering, denoising and timing one unit of work, one thing at a time.

use super::Error;
use super::settings::{Filter, Method, ReferenceBudget};
use super::unit::{Measure, PICTURE, Picture, REFERENCE, RUN, ReferenceHalf, Run};
use crate::folder::write_json;
use crate::integrator::{Choice, Integrator, LightProbe, Purpose};
use crate::render::{Budget, RenderSettings, Rendering};
use crate::scene::Scene;
use quietlight_denoise::exr::{self, WriteOptions};
use quietlight_denoise::{Denoiser, Image, LayerKind, Layers};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

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

fn render_settings(integrator: Integrator, seed: u64) -> RenderSettings {
    RenderSettings { integrator, seed, ..RenderSettings::default() }
}

/// Makes half a reference in `folder`; false where it was stopped.
pub(super) fn make_reference(
    folder: &Path,
    seed: u64,
    workshop: &Workshop<'_>,
) -> Result<bool, Error> {
    let light = workshop.threads.install(|| LightProbe::of(workshop.scene));
    let Choice { integrator, reason } = Choice::by(&light, Purpose::default());
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
        light,
        reason,
        seed,
        samples: rendered.samples,
        seconds: rendered.elapsed.as_secs_f64(),
        invalid_samples: rendered.invalid_samples,
    };
    write_json(&folder.join(REFERENCE), &record)?;
    Ok(true)
}

/// Makes a run in `folder`; false where it was stopped.
pub(super) fn make_run(
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
