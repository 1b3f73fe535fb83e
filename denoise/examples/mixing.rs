//! What mixing does: `cargo run --release -p quietlight-denoise --example mixing -- DIFFUSE.onnx SPECULAR.onnx NOISY.exr
//! REFERENCE.exr ...`.
//!
//! For each pair the relative L2 of the noisy picture, of what the networks make of it, and of the mixture of both (see
//! `blend.rs`), with the mean part of the denoised picture.

#![allow(clippy::print_stdout, reason = "this is what it is for")]

use std::error::Error;
use std::path::Path;

use quietlight_denoise::kpcn::Denoiser;
use quietlight_denoise::metrics::relative_l2;
use quietlight_denoise::picture::read_picture;
use quietlight_denoise::{LayerKind, exr};

fn main() -> Result<(), Box<dyn Error>> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let ([diffuse, specular], pairs) =
        files.split_first_chunk().ok_or("expected DIFFUSE.onnx SPECULAR.onnx and pairs of EXR")?;
    let threads = rayon::ThreadPoolBuilder::new().build()?;
    let models = [Path::new(diffuse), Path::new(specular)];
    let mixing = Denoiser::from_files(models, threads.current_num_threads())?;
    let plain = mixing.clone().without_mixing();
    println!("noisy      denoised   mixed      denoised part");
    for pair in pairs.chunks_exact(2) {
        let layers = exr::read(Path::new(&pair[0]))?.layers;
        let reference = read_picture(Path::new(&pair[1]))?;
        let noisy = &layers.layers[&LayerKind::Beauty].mean;
        let denoised = plain.denoise(&layers, &threads, &|_| ())?;
        let mixed = mixing.denoise(&layers, &threads, &|_| ())?;
        let error = |image| relative_l2(image, &reference);
        let part = mixed.report.fractions.map_or("-".into(), |parts| format!("{:.3}", parts.mean));
        println!(
            "{:.3e}  {:.3e}  {:.3e}  {part}  {}",
            error(noisy)?,
            error(&denoised.image)?,
            error(&mixed.image)?,
            pair[0]
        );
    }
    Ok(())
}
