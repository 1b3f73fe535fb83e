//! `quietlight compare`: how far an image is from what it should be.

use super::args::Compare;
use super::{BadInput, Failure, output};
use anyhow::Context;
use quietlight_denoise::picture::read_picture;
use quietlight_denoise::{Image, LayerKind, exr, metrics, png};
use std::path::Path;

pub(super) fn run(arguments: &Compare) -> Result<(), Failure> {
    if let Some(path) = &arguments.map {
        output::check(path, "png")?;
        output::check_inputs(path, [arguments.image.as_path(), arguments.reference.as_path()])?;
    }
    let image = match &arguments.layer {
        Some(name) => read_layer(&arguments.image, name)?,
        None => read_picture(&arguments.image).bad_input()?,
    };
    let reference = read_picture(&arguments.reference).bad_input()?;
    let relative_l2 = metrics::relative_l2(&image, &reference).bad_input()?;
    let one_minus_ssim = metrics::one_minus_ssim(&image, &reference).bad_input()?;
    let psnr = metrics::psnr(&image, &reference).bad_input()?;
    let flip =
        metrics::flip_map(&image, &reference, metrics::DEFAULT_PIXELS_PER_DEGREE).bad_input()?;
    let mean_flip = flip.iter().map(|&error| f64::from(error)).sum::<f64>() / flip.len() as f64;
    if let Some(path) = &arguments.map {
        png::write_map(path, &flip).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if arguments.json {
        let json = serde_json::json!({
            "relative_l2": relative_l2,
            "relative_l2_epsilon": metrics::RELATIVE_L2_EPSILON,
            "one_minus_ssim": one_minus_ssim,
            "psnr": psnr,
            "flip": mean_flip,
        });
        println!("{json:#}");
        return Ok(());
    }
    println!(
        "relative L2  {relative_l2:.6e}   mean of (x - r)² / (r² + {}), linear",
        metrics::RELATIVE_L2_EPSILON
    );
    match one_minus_ssim {
        Some(error) => println!("1 - SSIM     {:.6}       sRGB, 11x11 Gaussian window", error),
        None => println!("1 - SSIM     undefined: the image is smaller than 3x3"),
    }
    println!("PSNR         {psnr:.3} dB     sRGB, clamped");
    println!("FLIP         {mean_flip:.6}       LDR, 67 pixels per degree");
    Ok(())
}

/// The mean of the layer of that name.
fn read_layer(path: &Path, name: &str) -> Result<Image, Failure> {
    let mut contents = exr::read(path).bad_input()?;
    let kind = LayerKind::ALL.into_iter().find(|kind| kind.name() == name);
    match kind.and_then(|kind| contents.layers.layers.remove(&kind)) {
        Some(layer) => Ok(layer.mean),
        None => {
            let known: Vec<&str> = contents.layers.layers.keys().map(|kind| kind.name()).collect();
            Err(anyhow::anyhow!(
                "{} has no layer {name}; it has {}",
                path.display(),
                known.join(", ")
            ))
            .bad_input()
        }
    }
}
