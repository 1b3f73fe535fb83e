//! Scores the bilateral filter on pairs of a noisy file and a converged one: `denoise/training/evaluate.py bilateral` runs
//!
//! `cargo run --release -p quietlight-denoise --example bilateral_scores -- WEIGHTS.json CONSTANTS NOISY.exr REFERENCE.exr ...`
//!
//! CONSTANTS are λ₀ to λ₅ and `λ_c`, joined by commas. A line of JSON for each pair has the relative L2 of the noisy image, of
//! it blurred by Gaussians of several widths, and of the filter with those constants, with the program's own, and with the
//! network of WEIGHTS.
#![allow(clippy::print_stdout, reason = "a program for developers")]

use std::path::Path;

use quietlight_denoise::bilateral::{Lambda, Network, Parameters, Prepared};
use quietlight_denoise::metrics::relative_l2;
use quietlight_denoise::picture::read_picture;
use quietlight_denoise::{Image, LayerKind, exr};

/// Standard deviations of the Gaussians, in pixels.
const WIDTHS: [f32; 9] = [0.3, 0.4, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [weights, constants, files @ ..] = arguments.as_slice() else {
        return Err("expected WEIGHTS.json CONSTANTS NOISY.exr REFERENCE.exr ...".into());
    };
    let network = Network::parse(&std::fs::read_to_string(weights)?, weights.as_ref())?;
    let constants: Vec<f32> = constants.split(',').map(str::parse).collect::<Result<_, _>>()?;
    let [lambda @ .., colour] =
        <[f32; 7]>::try_from(constants).map_err(|_| "expected 7 constants")?;
    for pair in files.chunks_exact(2) {
        let layers = exr::read(Path::new(&pair[0]))?.layers;
        let reference = read_picture(Path::new(&pair[1]))?;
        let noisy = &layers.layers[&LayerKind::Beauty].mean;
        let prepared = Prepared::new(&layers)?;
        let filtered = |parameters: &Parameters| {
            relative_l2(&prepared.filter(parameters, &|_| ())?.image, &reference)
        };
        let of_widths = WIDTHS
            .iter()
            .map(|&width| relative_l2(&gaussian(noisy, width), &reference))
            .collect::<Result<Vec<_>, _>>()?;
        let own = Parameters::constant();
        let fitted = Parameters { lambda: Lambda::Constant(lambda), colour, ..own.clone() };
        let lambda = Lambda::PerPixel(prepared.lambda(&network));
        let learned = Parameters { lambda, colour: network.colour(), ..own.clone() };
        let scores = serde_json::json!({
            "noisy": relative_l2(noisy, &reference)?,
            "gaussian": of_widths,
            "widths": WIDTHS,
            "constant": filtered(&fitted)?,
            "shipped_constant": filtered(&own)?,
            "learned": filtered(&learned)?,
        });
        println!("{scores}");
    }
    Ok(())
}

/// A Gaussian blur cut at four standard deviations and renormalised at the borders.
fn gaussian(image: &Image, deviation: f32) -> Image {
    let radius = (4.0 * deviation).ceil() as isize;
    let weight = |offset: isize| (-0.5 * (offset as f32 / deviation).powi(2)).exp();
    let (_, height, width) = image.dim();
    let blurred = |length: usize, at: usize, value: &dyn Fn(usize) -> f32| {
        let (mut sum, mut weights) = (0.0, 0.0);
        for offset in -radius..=radius {
            if let Some(other) = at.checked_add_signed(offset).filter(|&other| other < length) {
                sum += weight(offset) * value(other);
                weights += weight(offset);
            }
        }
        sum / weights
    };
    let rows = Image::from_shape_fn(image.dim(), |(channel, y, x)| {
        blurred(width, x, &|x| image[[channel, y, x]])
    });
    Image::from_shape_fn(image.dim(), |(channel, y, x)| {
        blurred(height, y, &|y| rows[[channel, y, x]])
    })
}
