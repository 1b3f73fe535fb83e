//! Prepares noisy images for the training of the bilateral filter: `denoise/training/preprocess.py bilateral` runs
//!
//! `cargo run --release -p quietlight-denoise --example bilateral_examples -- IN.exr OUT.npy [IN OUT ...]`
//!
//! Each OUT is an array for `numpy.load`, `[channels, height, width]` of 32-bit floats. The names of the channels go to standard output
//! as a JSON array. So the trainer sees what the filter sees, and the prefilter is written once.
#![allow(clippy::print_stdout, reason = "a program for developers")]

use std::io::Write;
use std::path::Path;

use quietlight_denoise::atomic;
use quietlight_denoise::bilateral::{Prepared, example_channels};
use quietlight_denoise::{Error, Image, exr};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    if paths.is_empty() || !paths.len().is_multiple_of(2) {
        return Err("expected pairs of IN.exr OUT.npy".into());
    }
    println!("{}", serde_json::json!(example_channels()));
    for pair in paths.chunks(2) {
        let example = Prepared::new(&exr::read(Path::new(&pair[0]))?.layers)?.example();
        let path = Path::new(&pair[1]);
        atomic::write(path, |file| {
            file.write_all(&npy(&example)).map_err(|source| Error::Io { path: path.into(), source })
        })?;
    }
    Ok(())
}

/// The file of an array (format 1.0 of `numpy.lib.format`): magic number and version, the length of the header, the header filled up to a
/// multiple of 64 bytes, the numbers.
fn npy(image: &Image) -> Vec<u8> {
    let (channels, height, width) = image.dim();
    let shape = format!("({channels}, {height}, {width})");
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    let length = (header.len() + 11).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(length).expect("a short header").to_le_bytes());
    bytes.extend(format!("{header:<width$}\n", width = length - 1).bytes());
    bytes.extend(image.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}
