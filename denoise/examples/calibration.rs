//! How often the truth lies in the interval of the error estimate: `cargo run --release -p quietlight-denoise --example
//! calibration -- kpcn|fast|bilateral|bilateral-constant NOISY.exr REFERENCE.exr ...`.
//!
//! The noisy files need their halves (`render --halves`, or those of a data set); references should have the variance of
//! their mean, whose part of the squared difference is taken off. Pairs whose reference is too noisy to tell are left out.

#![allow(clippy::print_stdout, reason = "this is what it is for")]

use std::error::Error;
use std::path::Path;

use quietlight_denoise::kpcn::Quality;
use quietlight_denoise::metrics::RELATIVE_L2_EPSILON;
use quietlight_denoise::{Denoiser, ErrorEstimate, Image, LayerKind, Layers, exr};

/// References whose own noise is more than this part of the error to be known, or leaves it uncertain by more than that.
const MOST_NOISE: f64 = 0.4;
const MOST_UNCERTAIN: f64 = 0.1;

/// Bounds of the groups of sample counts.
const GROUPS: [f32; 5] = [2.0, 8.0, 32.0, 128.0, f32::INFINITY];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (denoiser, pairs) = arguments.split_first().ok_or("expected a denoiser and pairs")?;
    let denoiser = match denoiser.as_str() {
        "kpcn" => Denoiser::embedded(Quality::Balanced)?,
        "fast" => Denoiser::embedded(Quality::Fast)?,
        "bilateral" => Denoiser::bilateral(),
        "bilateral-constant" => Denoiser::bilateral_constant(),
        other => return Err(format!("{other} is no denoiser").into()),
    };
    let threads = rayon::ThreadPoolBuilder::new().build()?;
    let mut found: Vec<(f32, f64, ErrorEstimate)> = Vec::new();
    println!("samples  true       estimated  from       to         file");
    for pair in pairs.chunks_exact(2) {
        let layers = exr::read(Path::new(&pair[0]))?.layers;
        let reference = exr::read(Path::new(&pair[1]))?.layers;
        let picture = denoiser.denoise(&layers, &threads, &|_| ())?.image;
        let estimate = ErrorEstimate::of(&picture, &denoiser, &layers, &threads, &|_| ())?;
        let (Some(estimate), Some(truth)) = (estimate, truth(&picture, &reference)) else {
            continue;
        };
        let samples = layers.samples.as_ref().map_or(0.0, |samples| samples[[0, 0, 0]]);
        let [from, to] = estimate.interval;
        println!(
            "{samples:7}  {truth:.3e}  {:.3e}  {from:.3e}  {to:.3e}  {}",
            estimate.relative_l2, pair[0]
        );
        found.push((samples, truth, estimate));
    }
    println!(
        "\nsamples    pictures  in the interval  within 20 %  10 %, 50 %, 90 % of estimate/truth"
    );
    for bounds in GROUPS.windows(2) {
        let group: Vec<_> =
            found.iter().filter(|one| (bounds[0]..bounds[1]).contains(&one.0)).collect();
        summarise(&format!("{} to {}", bounds[0], bounds[1]), &group);
    }
    summarise("all", &found.iter().collect::<Vec<_>>());
    Ok(())
}

fn summarise(name: &str, group: &[&(f32, f64, ErrorEstimate)]) {
    if group.is_empty() {
        return;
    }
    let count = group.len() as f64;
    let inside = group.iter().filter(|(_, truth, estimate)| {
        (estimate.interval[0]..=estimate.interval[1]).contains(truth)
    });
    let mut ratios: Vec<f64> =
        group.iter().map(|(_, truth, estimate)| estimate.relative_l2 / truth).collect();
    ratios.sort_by(f64::total_cmp);
    let near = ratios.iter().filter(|ratio| (*ratio - 1.0).abs() < 0.2).count() as f64;
    let quantile = |part: f64| ratios[(part * (count - 1.0)).round() as usize];
    println!(
        "{name:10} {:8}  {:14.0}%  {:10.0}%  {:.2}, {:.2}, {:.2}",
        group.len(),
        100.0 * inside.count() as f64 / count,
        100.0 * near / count,
        quantile(0.1),
        quantile(0.5),
        quantile(0.9),
    );
}

/// Relative L2 against the reference without the part of its noise; `None` where that hides it.
fn truth(picture: &Image, reference: &Layers) -> Option<f64> {
    let beauty = reference.layers.get(&LayerKind::Beauty)?;
    let (mut error, mut noise, mut uncertain) = (0.0, 0.0, 0.0);
    for (index, &x) in picture.indexed_iter() {
        let (x, r) = (f64::from(x), f64::from(beauty.mean[index]));
        let variance = beauty.variance.as_ref().map_or(0.0, |variance| f64::from(variance[index]));
        let each = 1.0 / (r * r + RELATIVE_L2_EPSILON);
        let squared = (x - r) * (x - r);
        error += each * (squared - variance);
        noise += each * variance;
        uncertain += each * each * variance * (2.0 * variance + 4.0 * squared);
    }
    let is_known = noise < MOST_NOISE * error && uncertain.sqrt() < MOST_UNCERTAIN * error;
    is_known.then_some(error / picture.len() as f64)
}
