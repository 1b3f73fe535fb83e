//! `quietlight compare`: how far an image is from what it should be.

use super::args::Compare;
use super::{BadInput, Failure};
use anyhow::Context;
use quietlight_denoise::{exr, metrics, png};

pub(super) fn run(arguments: &Compare) -> Result<(), Failure> {
    let image = exr::read_image(&arguments.image, arguments.layer.as_deref()).bad_input()?;
    let reference = exr::read_image(&arguments.reference, None).bad_input()?;
    let relative_l2 = metrics::relative_l2(&image, &reference).bad_input()?;
    let ssim = metrics::ssim(&image, &reference).bad_input()?;
    let psnr = metrics::psnr(&image, &reference).bad_input()?;
    let flip = metrics::flip_map(&image, &reference).bad_input()?;
    let mean_flip = flip.iter().map(|&error| f64::from(error)).sum::<f64>() / flip.len() as f64;
    if let Some(path) = &arguments.map {
        png::write_map(path, &flip).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if arguments.json {
        let json = serde_json::json!({
            "relative_l2": relative_l2,
            "relative_l2_epsilon": metrics::EPSILON,
            "one_minus_ssim": ssim.map(|ssim| 1.0 - ssim),
            "psnr": psnr,
            "flip": mean_flip,
        });
        println!("{json:#}");
        return Ok(());
    }
    println!("relative L2  {relative_l2:.6e}   mean of (x - r)² / (r² + {}), linear", metrics::EPSILON);
    match ssim {
        Some(ssim) => println!("1 - SSIM     {:.6}       sRGB, 11x11 Gaussian window", 1.0 - ssim),
        None => println!("1 - SSIM     undefined: the image is smaller than 3x3"),
    }
    println!("PSNR         {psnr:.3} dB     sRGB, clamped");
    println!("FLIP         {mean_flip:.6}       LDR, 67 pixels per degree");
    Ok(())
}
