//! `quietlight merge`: several renders of one scene in, one picture out.

use super::args::Merge;
use super::render::{describe, thread_pool};
use super::{BadInput, Failure, denoising, output};
use crate::render::{Average, State};
use anyhow::{Context, anyhow};
use quietlight_denoise::exr::{self, Frame, WriteOptions};
use quietlight_denoise::{LayerKind, Layers, png};
use std::path::Path;

pub(super) fn run(arguments: &Merge) -> Result<(), Failure> {
    let output = &arguments.output;
    output::check_picture(output)?;
    let is_picture = |path: &Path| {
        path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"))
    };
    let pictures = arguments.inputs.iter().filter(|path| is_picture(path)).count();
    if pictures > 0 && pictures < arguments.inputs.len() {
        return Err(anyhow!("pictures and shards are two things: give only EXRs, or only shards"))
            .bad_input();
    }
    let threads = thread_pool(arguments.finish.threads)?;
    let denoiser = denoising::choose(arguments.denoiser, &arguments.networks, &threads)?;
    let (mut layers, frame, warnings) =
        if pictures > 0 { average(arguments)? } else { join(arguments)? };
    for warning in &warnings {
        eprintln!("warning: {warning}");
    }
    let denoised = match &denoiser {
        Some(denoiser) => Some(denoising::run(denoiser, &layers, &threads)?),
        None => None,
    };
    let error = match (&denoiser, &denoised) {
        (Some(denoiser), Some(denoised)) if !arguments.finish.no_estimate => {
            denoising::estimate(denoised, denoiser, &layers, &threads)?
        }
        _ => None,
    };
    denoising::describe(&mut layers, denoised.as_ref(), error.as_ref());
    let png = output.with_extension("png");
    let options = WriteOptions {
        picture: denoised.as_ref().map(|denoised| &denoised.image),
        halves: arguments.halves,
        frame: Some(frame),
    };
    exr::write(output, &layers, &options)
        .with_context(|| format!("cannot write {}", output.display()))?;
    let picture = match &denoised {
        Some(denoised) => &denoised.image,
        None => &layers.layers[&LayerKind::Beauty].mean,
    };
    png::write(&png, picture, arguments.finish.exposure)
        .with_context(|| format!("cannot write {}", png.display()))?;

    let samples = layers.metadata.get("samples").map_or("?", String::as_str);
    if arguments.finish.json {
        let json = serde_json::json!({
            "output": output,
            "png": png,
            "inputs": arguments.inputs,
            "width": layers.width,
            "height": layers.height,
            "samples": samples.parse::<u64>().ok(),
            "denoiser": denoised.as_ref().map(denoising::json),
            "estimated_relative_l2": error.as_ref().map(|error| error.relative_l2),
            "estimated_relative_l2_interval": error.as_ref().map(|error| error.interval),
            "warnings": warnings,
        });
        println!("{json:#}");
    } else {
        println!(
            "{} and {}: {samples} samples per pixel from {} files, {}",
            output.display(),
            png.display(),
            arguments.inputs.len(),
            denoised.map_or("not denoised".to_owned(), |by| format!("denoised by {}", by.by))
        );
        if let Some(error) = &error {
            println!("relative L2, estimated from the halves: {}", denoising::in_words(error));
        }
    }
    Ok(())
}

/// What goes into the file, and what the user should know.
type Merged = (Layers, Frame, Vec<String>);

/// The mean of pictures of different seeds.
fn average(arguments: &Merge) -> Result<Merged, Failure> {
    let mut average: Option<Average> = None;
    for path in &arguments.inputs {
        let (name, contents) = (path.display().to_string(), exr::read(path).bad_input()?);
        match &mut average {
            Some(average) => average.add(&name, contents).bad_input()?,
            None => average = Some(Average::new(&name, contents).bad_input()?),
        }
    }
    let (layers, frame) =
        average.ok_or_else(|| anyhow!("there is nothing to merge")).bad_input()?.finish();
    Ok((layers, frame, Vec::new()))
}

/// The picture that all shards of a render are together.
fn join(arguments: &Merge) -> Result<Merged, Failure> {
    let state = State::merged(&arguments.inputs).bad_input()?;
    let (notes, film) = (state.header.notes.clone(), state.header.plan.film);
    let mut rendered = state.finish();
    rendered.layers.metadata.extend(notes);
    describe(&mut rendered);
    let [left, top, ..] = film.crop.map(|number| number as i32);
    let frame = Frame {
        offset: (left, top),
        display_offset: (0, 0),
        display: (film.width as usize, film.height as usize),
    };
    Ok((rendered.layers, frame, rendered.report.warnings))
}
