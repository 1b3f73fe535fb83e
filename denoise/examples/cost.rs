//! What the networks cost: `cargo run --release -p quietlight-denoise --example cost -- DIFFUSE.onnx SPECULAR.onnx
//! WIDTH HEIGHT`.
//!
//! Denoises noise of that size, with all layers that the networks use, and prints CPU seconds of all threads a megapixel
//! and the memory at its peak, as Linux counts them (`/proc/self`): for the layers alone, and at the end.

#![allow(clippy::print_stdout, reason = "this is what it is for")]

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use quietlight_denoise::kpcn::{Denoiser, LAYERS};
use quietlight_denoise::{Image, Layer, Layers};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [diffuse, specular, width, height] = &arguments[..] else {
        return Err("expected DIFFUSE.onnx SPECULAR.onnx WIDTH HEIGHT".into());
    };
    let layers = noise(width.parse()?, height.parse()?);
    let megapixels = (layers.width * layers.height) as f64 / 1e6;
    let threads = rayon::ThreadPoolBuilder::new().build()?;
    let denoiser = Denoiser::from_files(
        [Path::new(diffuse), Path::new(specular)],
        threads.current_num_threads(),
    )?;
    println!("layers          {:.2} GB", peak_memory()?);
    let start = cpu_seconds()?;
    let denoised = denoiser.denoise(&layers, &threads, &|_| ())?;
    let seconds = cpu_seconds()? - start;
    println!("at the peak     {:.2} GB", peak_memory()?);
    println!("tiles           {}", denoised.report.tiles);
    println!("CPU             {:.2} s a megapixel", seconds / megapixels);
    let share = |time: std::time::Duration| time.as_secs_f64() / megapixels;
    println!("wall clock      {:.2} s a megapixel", share(denoised.report.time));
    println!("  in networks   {:.2} s a megapixel", share(denoised.report.network_time));
    Ok(())
}

/// Uniform noise on all layers that the networks use.
fn noise(width: usize, height: usize) -> Layers {
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0
    };
    let mut layers = BTreeMap::new();
    for kind in LAYERS {
        let shape = (kind.components().len(), height, width);
        let mean = Image::from_shape_simple_fn(shape, &mut random);
        let variance = Some(Image::from_elem(shape, 1.0 / 12.0));
        layers.insert(kind, Layer { mean, variance, halves: None });
    }
    Layers { width, height, layers, ..Default::default() }
}

/// Of this process, user and system (fields 14 and 15 of `stat`, in hundredths of a second).
fn cpu_seconds() -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/self/stat")?;
    let after_name = text.rsplit(')').next().unwrap_or_default();
    let ticks: Vec<f64> =
        after_name.split_whitespace().skip(11).take(2).map(str::parse).collect::<Result<_, _>>()?;
    Ok(ticks.iter().sum::<f64>() / 100.0)
}

/// Largest resident memory so far, in GB.
fn peak_memory() -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/self/status")?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:")).ok_or("no VmHWM")?;
    Ok(line.trim().trim_end_matches("kB").trim().parse::<f64>()? / 1e6)
}
