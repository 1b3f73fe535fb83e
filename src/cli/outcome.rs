//! What `quietlight render` tells at the end.

use super::denoising;
use super::progress::human;
use crate::render::Rendered;
use quietlight_denoise::{Denoised, ErrorEstimate};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// What the last line tells.
pub(super) struct Outcome<'a> {
    pub(super) output: &'a Path,
    pub(super) png: &'a Path,
    pub(super) rendered: &'a Rendered,
    /// `None` where the noise was left in.
    pub(super) denoised: Option<&'a Denoised>,
    pub(super) denoising: Option<Duration>,
    /// Of the rendered picture.
    pub(super) noise: Option<f64>,
    /// Of the denoised picture.
    pub(super) error: Option<&'a ErrorEstimate>,
}

impl Outcome<'_> {
    /// Samples of the whole picture per second of wall time.
    fn speed(&self) -> f64 {
        let pixels = self.rendered.layers.width * self.rendered.layers.height;
        pixels as f64 * f64::from(self.rendered.samples)
            / self.rendered.elapsed.as_secs_f64().max(1e-9)
    }

    pub(super) fn print(&self) {
        let Self { output, png, rendered, denoised, denoising, noise, error } = self;
        if rendered.invalid_samples > 0 {
            eprintln!(
                "warning: {} samples were not finite and were dropped; layer invalid.N tells where, --replay why",
                rendered.invalid_samples
            );
        }
        for warning in &rendered.report.warnings {
            eprintln!("warning: {warning}");
        }
        for (name, value) in &rendered.report.facts {
            println!("{name}: {value}");
        }
        let noise =
            noise.map_or("unknown with one sample".to_owned(), |noise| format!("{noise:.2e}"));
        let denoised = match (denoised, denoising) {
            (Some(denoised), Some(time)) => {
                format!("denoised by {} in {:.1} s", denoised.by, time.as_secs_f64())
            }
            _ => "not denoised".to_owned(),
        };
        let error = error
            .map_or_else(String::new, |error| format!(", after {}", denoising::in_words(error)));
        println!(
            "{} and {}: {} samples per pixel in {:.1} s ({}samples/s), {denoised}; \
             relative L2, estimated from the halves: before denoising {noise}{error}",
            output.display(),
            png.display(),
            rendered.samples,
            rendered.elapsed.as_secs_f64(),
            human(self.speed()),
        );
    }

    pub(super) fn print_json(&self) {
        let json = serde_json::json!({
            "output": self.output,
            "png": self.png,
            "width": self.rendered.layers.width,
            "height": self.rendered.layers.height,
            "integrator": self.rendered.layers.metadata.get("integrator"),
            "samples": self.rendered.samples,
            "invalid_samples": self.rendered.invalid_samples,
            "render_seconds": self.rendered.elapsed.as_secs_f64(),
            "denoise_seconds": self.denoising.map(|denoising| denoising.as_secs_f64()),
            "denoiser": self.denoised.map(denoising::json),
            "samples_per_second": self.speed(),
            "estimated_noisy_relative_l2": self.noise,
            "estimated_relative_l2": self.error.map(|error| error.relative_l2),
            "estimated_relative_l2_interval": self.error.map(|error| error.interval),
            "facts": self.rendered.report.facts.iter().cloned().collect::<BTreeMap<_, _>>(),
            "warnings": self.rendered.report.warnings,
        });
        println!("{json:#}");
    }
}
