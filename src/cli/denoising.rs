//! Which denoiser runs, and what it tells of itself.

use super::args::{Denoiser as Asked, Networks, Quality};
use super::progress::Progress;
use super::{BadInput, Failure};
use anyhow::anyhow;
use quietlight_denoise::{Denoised, Denoiser, Error, ErrorEstimate, Layers, kpcn};

/// Name of the estimated error in the metadata.
const ESTIMATE: &str = "estimated_relative_l2";

/// The denoiser that the arguments ask for; `None` for none. `auto` falls back on the bilateral filter, with a warning, where
/// the networks cannot run.
pub(super) fn choose(
    asked: Asked,
    networks: &Networks,
    threads: &rayon::ThreadPool,
) -> Result<Option<Denoiser>, Failure> {
    let has_models = !networks.models.is_empty();
    match asked {
        Asked::None | Asked::Bilateral | Asked::BilateralConstant if has_models => {
            Err(anyhow!("--model is for --denoiser kpcn or auto")).bad_input()
        }
        Asked::None => Ok(None),
        Asked::Bilateral => Ok(Some(Denoiser::bilateral())),
        Asked::BilateralConstant => Ok(Some(Denoiser::bilateral_constant())),
        Asked::Auto | Asked::Kpcn if has_models => {
            let [first, second] = &networks.models[..] else {
                return Err(anyhow!(
                    "--model was given {} times; two files are needed, one for each branch",
                    networks.models.len()
                ))
                .bad_input();
            };
            match Denoiser::from_files([first, second], threads.current_num_threads()) {
                Ok(denoiser) => Ok(Some(denoiser)),
                Err(error @ Error::OnnxRuntime(_)) => Err(Failure::Failed(error.into())),
                Err(error) => Err(error).bad_input(),
            }
        }
        Asked::Kpcn => match Denoiser::embedded(quality(networks.quality)) {
            Ok(denoiser) => Ok(Some(denoiser)),
            Err(error) => Err(Failure::Failed(error.into())),
        },
        Asked::Auto => match Denoiser::embedded(quality(networks.quality)) {
            Ok(denoiser) => Ok(Some(denoiser)),
            Err(error) => {
                eprintln!(
                    "warning: the bilateral filter is used, for the networks cannot run: {error}"
                );
                Ok(Some(Denoiser::bilateral()))
            }
        },
    }
}

/// Denoises with a progress bar; what had to be mended is told. To be called outside of the threads of the pool.
pub(super) fn run(
    denoiser: &Denoiser,
    layers: &Layers,
    threads: &rayon::ThreadPool,
) -> anyhow::Result<Denoised> {
    let progress = Progress::new("denoise", "steps", 1000);
    let outcome = denoiser.denoise(layers, threads, &|part| progress.at((part * 1000.0) as u64));
    progress.finish();
    let denoised = outcome?;
    let mended = denoised.sanitised.total();
    if mended > 0 {
        eprintln!("warning: {mended} values of the layers were not usable and were replaced");
    }
    Ok(denoised)
}

/// Estimates the error of the denoised picture from the halves, with a progress bar; `None` where there are none. To be called
/// outside of the threads of the pool.
pub(super) fn estimate(
    denoised: &Denoised,
    denoiser: &Denoiser,
    layers: &Layers,
    threads: &rayon::ThreadPool,
) -> anyhow::Result<Option<ErrorEstimate>> {
    let progress = Progress::new("error", "steps", 1000);
    let heard = |part: f32| progress.at((part * 1000.0) as u64);
    let estimate = ErrorEstimate::of(&denoised.image, denoiser, layers, threads, &heard);
    progress.finish();
    Ok(estimate?)
}

/// Writes into the layers what denoised them and what error is estimated; what an earlier denoiser left is replaced.
pub(super) fn describe(
    layers: &mut Layers,
    denoised: Option<&Denoised>,
    error: Option<&ErrorEstimate>,
) {
    layers.metadata.extend(denoised.into_iter().flat_map(Denoised::facts));
    layers.metadata.remove(ESTIMATE);
    layers.metadata.extend(error.map(|error| (ESTIMATE.to_owned(), in_words(error))));
    layers.error = error.map(|error| error.map.clone());
}

/// For the metadata and the last line: the estimate and what it lies between.
pub(super) fn in_words(estimate: &ErrorEstimate) -> String {
    let [from, to] = estimate.interval;
    format!("{:.2e} (90 %: {from:.1e} to {to:.1e})", estimate.relative_l2)
}

/// For the outcome as JSON.
pub(super) fn json(denoised: &Denoised) -> serde_json::Value {
    denoised.facts().map(|(name, value)| (name, serde_json::Value::from(value))).collect()
}

fn quality(quality: Quality) -> kpcn::Quality {
    match quality {
        Quality::Fast => kpcn::Quality::Fast,
        Quality::Balanced => kpcn::Quality::Balanced,
        Quality::High => kpcn::Quality::High,
    }
}
