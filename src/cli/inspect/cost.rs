//! What rendering and denoising a scene will take of this machine.

use super::facts::Facts;
use super::{megabytes, say};
use crate::cli::Failure;
use crate::render::probe::{self, Cost, DenoisingCost};
use crate::render::{Budget, RenderSettings};
use crate::scene::Scene;
use anyhow::Context;
use quietlight_denoise::exr::{self, WriteOptions};
use quietlight_denoise::{Denoiser, LayerKind, png};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// How long the render is tried.
const LENGTH: Duration = Duration::from_millis(500);

/// Side of the square that is written for a trial, in pixels.
const WRITTEN: u32 = 128;

/// Predictions for the samples and the size that the scene asks for.
pub(super) struct Costs {
    samples: u32,
    threads: usize,
    loading: f64,
    render: Cost,
    denoising: Option<(DenoisingCost, &'static str)>,
    writing: f64,
    /// Bytes that the process had before anything was rendered.
    resident: Option<u64>,
}

impl Costs {
    pub(super) fn of(
        scene: &Scene,
        facts: &Facts,
        denoiser: Option<&Denoiser>,
        threads: &rayon::ThreadPool,
        loading: f64,
    ) -> Result<Self, Failure> {
        let resident = resident();
        let settings = RenderSettings {
            budget: Budget::Samples(scene.samples),
            integrator: facts.choice.integrator,
            ..RenderSettings::default()
        };
        let render = threads.install(|| probe::cost(scene, &settings, LENGTH));
        let denoising = match denoiser {
            Some(denoiser) => {
                let cost = probe::denoising(scene, &settings, denoiser, threads)
                    .map_err(|error| Failure::Failed(error.into()))?;
                Some((cost, denoiser.name()))
            }
            None => None,
        };
        let writing = threads.install(|| writing(scene, &settings))? * render.pixels as f64;
        Ok(Self {
            samples: scene.samples,
            threads: threads.current_num_threads(),
            loading,
            render,
            denoising,
            writing,
            resident,
        })
    }

    fn denoising_seconds(&self) -> f64 {
        self.denoising.as_ref().map_or(0.0, |(cost, _)| cost.seconds(self.render.pixels))
    }

    fn seconds(&self) -> f64 {
        self.loading + self.render.seconds(self.samples) + self.denoising_seconds() + self.writing
    }

    /// Most memory at once, in bytes.
    fn peak(&self) -> u64 {
        let of_denoiser = self.denoising.map_or(0, |(cost, _)| cost.bytes);
        let most = self.render.bytes.max(self.render.layer_bytes + of_denoiser);
        self.resident.unwrap_or(0) + most
    }

    pub(super) fn json(&self) -> Value {
        json!({
            "threads": self.threads,
            "samples": self.samples,
            "seconds": self.seconds(),
            "uncertainty": self.render.uncertainty,
            "loading_seconds": self.loading,
            "render_seconds": self.render.seconds(self.samples),
            "render_fixed_seconds": self.render.fixed_seconds,
            "seconds_per_sample_per_pixel": self.render.seconds_per_sample_per_pixel,
            "seconds_per_feature_per_pixel": self.render.seconds_per_feature_per_pixel,
            "denoiser": self.denoising.map(|(_, name)| name),
            "denoising_seconds": self.denoising_seconds(),
            "writing_seconds": self.writing,
            "peak_bytes": self.peak(),
        })
    }

    pub(super) fn print(&self) {
        let Self { samples, threads, render, .. } = self;
        let denoised = match self.denoising {
            Some((_, name)) => {
                format!("{} denoising by {name}, ", seconds(self.denoising_seconds()))
            }
            None => String::new(),
        };
        say(
            "cost",
            format!(
                "{} ± {:.0} %: {} loading, {} rendering {samples} samples per pixel, {denoised}{} writing; on {threads} threads",
                seconds(self.seconds()),
                100.0 * render.uncertainty,
                seconds(self.loading),
                seconds(render.seconds(*samples)),
                seconds(self.writing),
            ),
        );
        let per_sample = render.seconds_per_sample_per_pixel * render.pixels as f64;
        say("", format!("{} for each sample per pixel", seconds(per_sample)));
        say("memory", format!("{} at most", megabytes(self.peak())));
    }
}

/// Seconds of writing one pixel of the picture with all its layers.
fn writing(scene: &Scene, settings: &RenderSettings) -> Result<f64, Failure> {
    let layers = probe::middle(scene, settings, WRITTEN);
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let start = Instant::now();
    let path = folder.path().join("probe.exr");
    exr::write(&path, &layers, &WriteOptions::default()).context("cannot write a trial")?;
    if let Some(beauty) = layers.layers.get(&LayerKind::Beauty) {
        png::write(&path.with_extension("png"), &beauty.mean, 0.0)
            .context("cannot write a trial")?;
    }
    Ok(start.elapsed().as_secs_f64() / (layers.width * layers.height) as f64)
}

/// Memory of this process; `None` where the system does not tell.
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}

fn seconds(seconds: f64) -> String {
    match seconds {
        long if long >= 7200.0 => format!("{:.1} h", long / 3600.0),
        long if long >= 120.0 => format!("{:.1} min", long / 60.0),
        short if short >= 9.95 => format!("{short:.0} s"),
        short if short >= 0.0995 => format!("{short:.1} s"),
        short => format!("{:.1} ms", 1e3 * short),
    }
}
