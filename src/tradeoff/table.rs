//! `scores.csv`: one row for each scene, integrator, denoiser and sample count, for programs and spreadsheets.

use super::statistics::Estimate;
use super::{CSV, Error, Scores};
use crate::folder::at;
use quietlight_denoise::atomic;
use serde::Serialize;
use std::path::Path;

/// Columns of the file. What is not known is empty. `low` and `high` are the ends of the 95 % confidence interval over seeds.
#[derive(Serialize)]
struct Row<'a> {
    /// Name of the scene.
    scene: &'a str,
    width: u32,
    height: u32,
    integrator: &'static str,
    denoiser: &'static str,
    /// Samples or mutations per pixel.
    samples: u32,
    /// Replicates.
    seeds: usize,
    /// Wall time of the render and of the denoiser, their sum, and the time of all threads.
    render_seconds: f64,
    denoise_seconds: f64,
    seconds: f64,
    seconds_low: Option<f64>,
    seconds_high: Option<f64>,
    cpu_seconds: Option<f64>,
    /// Squared error against the truth, `mean (x − r₁)(x − r₂) / (r̄² + 0.01)`.
    relative_l2: f64,
    relative_l2_low: Option<f64>,
    relative_l2_high: Option<f64>,
    /// Its parts.
    bias2: Option<f64>,
    variance: Option<f64>,
    /// Relative L2 of the reference's noise; `is_known` is false where the error is below.
    reference_noise: f64,
    is_known: bool,
    /// Does no other row of the scene beat this one in both seconds and error?
    is_on_front: bool,
    one_minus_ssim: Option<f64>,
    psnr: f64,
    flip: f64,
    /// Non-finite samples dropped, of all seeds.
    invalid_samples: u64,
}

impl Scores {
    /// Writes `scores.csv`.
    ///
    /// # Errors
    /// Where the folder cannot be written.
    pub fn write_csv(&self, folder: &Path) -> Result<(), Error> {
        let path = folder.join(CSV);
        let bytes = self.csv().map_err(|error| at(&path)(error.into()))?;
        Ok(atomic::write(&path, |file| std::io::Write::write_all(file, &bytes).map_err(at(&path)))?)
    }

    fn csv(&self) -> Result<Vec<u8>, csv::Error> {
        let ends = |estimate: &Estimate| {
            let end = |index: usize| estimate.interval.map(|ends| ends[index]);
            [end(0), end(1)]
        };
        let mut writer = csv::Writer::from_writer(Vec::new());
        for scene in &self.scenes {
            for (index, point) in scene.points.iter().enumerate() {
                let [seconds_low, seconds_high] = ends(&point.seconds);
                let [relative_l2_low, relative_l2_high] = ends(&point.error);
                writer.serialize(Row {
                    scene: &scene.name,
                    width: scene.size[0],
                    height: scene.size[1],
                    integrator: point.combination.integrator.name(),
                    denoiser: point.combination.denoiser.name(),
                    samples: point.samples,
                    seeds: point.seeds,
                    render_seconds: point.render_seconds.mean,
                    denoise_seconds: point.denoise_seconds.mean,
                    seconds: point.seconds.mean,
                    seconds_low,
                    seconds_high,
                    cpu_seconds: point.cpu_seconds,
                    relative_l2: point.error.mean,
                    relative_l2_low,
                    relative_l2_high,
                    bias2: point.bias2,
                    variance: point.variance,
                    reference_noise: scene.reference.noise,
                    is_known: point.is_known,
                    is_on_front: scene.front.contains(&index),
                    one_minus_ssim: point.one_minus_ssim.map(|estimate| estimate.mean),
                    psnr: point.psnr.mean,
                    flip: point.flip.mean,
                    invalid_samples: point.invalid_samples,
                })?;
            }
        }
        writer.into_inner().map_err(|error| error.into_error().into())
    }
}
