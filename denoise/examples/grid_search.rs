//! Finds the filter's constant parameters on pairs of a noisy file with its layers and a converged picture:
//!
//! `cargo run --release -p quietlight-denoise --example grid_search -- NOISY.exr REFERENCE.exr [NOISY REFERENCE ...]`
//!
//! The score is the geometric mean over the pairs of the relative L2 that the filter leaves of the noisy image's, where
//! gains beyond [`ENOUGH`] do not count, so that fireflies of one scene do not decide for all, and a loss counts
//! [`HARM`] times. One parameter after the other is tried at factors around where it is, and at 0, until a round
//! changes nothing.
#![allow(clippy::print_stdout, reason = "a program for developers")]

use quietlight_denoise::bilateral::{Lambda, Parameters, Prepared};
use quietlight_denoise::{
    Error, Image, LayerKind, exr, metrics::relative_l2, picture::read_picture,
};
use std::path::Path;

/// A tenth of the error: below it the reference's own noise and single fireflies decide.
const ENOUGH: f64 = 0.1;

/// Making a picture worse weighs as much as this power of making one better.
const HARM: f64 = 2.0;

/// Layers ready to be filtered, the truth, and the relative L2 before.
struct Pair {
    prepared: Prepared,
    reference: Image,
    before: f64,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    if paths.is_empty() || !paths.len().is_multiple_of(2) {
        return Err("expected pairs of NOISY.exr REFERENCE.exr".into());
    }
    let pairs = paths
        .chunks(2)
        .map(|pair| load(Path::new(&pair[0]), Path::new(&pair[1])))
        .collect::<Result<Vec<_>, _>>()?;

    // λ₀ to λ₅, then λ_c.
    let mut best = [0.01, 0.02, 0.1, 0.1, 0.1, 0.1, 0.2];
    let mut best_score = score(&pairs, best)?;
    println!("start {best:?}: {best_score:.4}");
    for factors in
        [[0.0, 0.0625, 0.25, 4.0, 16.0].as_slice(), [0.5, 2.0].as_slice(), [0.7, 1.4].as_slice()]
    {
        loop {
            let before = best_score;
            for parameter in 0..best.len() {
                let from = best[parameter];
                for factor in factors {
                    let mut tried = best;
                    tried[parameter] = from * factor;
                    let score = score(&pairs, tried)?;
                    if score < best_score {
                        (best, best_score) = (tried, score);
                        println!("{best:?}: {best_score:.4}");
                    }
                }
            }
            if best_score > before * 0.999 {
                break;
            }
        }
    }
    for (pair, path) in pairs.iter().zip(paths.chunks(2)) {
        println!("{}: {:.3} of {:.3e}", path[0], ratio(pair, best)?, pair.before);
    }
    Ok(())
}

fn load(noisy: &Path, reference: &Path) -> Result<Pair, Error> {
    let layers = exr::read(noisy)?.layers;
    let reference = read_picture(reference)?;
    let before = relative_l2(&layers.layers[&LayerKind::Beauty].mean, &reference)?;
    Ok(Pair { prepared: Prepared::new(&layers)?, reference, before })
}

/// Relative L2 after filtering over that before.
fn ratio(pair: &Pair, [l0, l1, l2, l3, l4, l5, colour]: [f32; 7]) -> Result<f64, Error> {
    let lambda = Lambda::Constant([l0, l1, l2, l3, l4, l5]);
    let parameters = Parameters { lambda, colour, ..Parameters::constant() };
    Ok(relative_l2(&pair.prepared.filter(&parameters, &|_| {})?.image, &pair.reference)?
        / pair.before)
}

fn score(pairs: &[Pair], parameters: [f32; 7]) -> Result<f64, Error> {
    let mut sum = 0.0;
    for pair in pairs {
        let gain = ratio(pair, parameters)?.max(ENOUGH).ln();
        sum += if gain > 0.0 { HARM * gain } else { gain };
    }
    Ok((sum / pairs.len() as f64).exp())
}
