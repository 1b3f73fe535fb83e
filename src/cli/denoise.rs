//! `quietlight denoise`: buffers of this or another renderer in, a picture out.

use super::args::Denoise;
use super::render::{check_output, filter, thread_pool};
use super::{BadInput, Failure};
use anyhow::Context;
use quietlight_denoise::{Saved, exr, png};
use std::time::Instant;

pub(super) fn run(arguments: &Denoise) -> Result<(), Failure> {
    check_output(&arguments.output)?;
    let layers =
        exr::read_with_features(&arguments.input, arguments.albedo.as_deref(), arguments.normal.as_deref())
            .bad_input()?;
    let threads = thread_pool(arguments.threads)?;
    let start = Instant::now();
    let picture = threads.install(|| filter(&layers)).bad_input()?;
    let seconds = start.elapsed().as_secs_f64();

    let output = &arguments.output;
    let png = output.with_extension("png");
    let saved = Saved { picture: Some(&picture), halves: false };
    exr::write(output, &layers, &saved).with_context(|| format!("cannot write {}", output.display()))?;
    png::write(&png, &picture, arguments.exposure).with_context(|| format!("cannot write {}", png.display()))?;

    let used: Vec<String> = layers.layers.keys().map(|kind| format!("{kind:?}").to_lowercase()).collect();
    if arguments.json {
        let json = serde_json::json!({
            "output": output,
            "png": png,
            "width": layers.width,
            "height": layers.height,
            "layers": used,
            "denoise_seconds": seconds,
        });
        println!("{json:#}");
    } else {
        let (output, png) = (output.display(), png.display());
        println!("{output} and {png}: denoised in {seconds:.1} s from {}", used.join(", "));
    }
    Ok(())
}
