//! `quietlight denoise`: buffers of this or another renderer in, a picture out.

use super::args::Denoise;
use super::render::thread_pool;
use super::{BadInput, Failure, denoising, output};
use anyhow::Context;
use quietlight_denoise::exr::{self, Role, SeparateFile, WriteOptions};
use quietlight_denoise::{LayerKind, png};
use std::time::Instant;

pub(super) fn run(arguments: &Denoise) -> Result<(), Failure> {
    output::check_picture(&arguments.output)?;
    let features = [(LayerKind::Albedo, &arguments.albedo), (LayerKind::Normal, &arguments.normal)];
    let files: Vec<SeparateFile> = features
        .into_iter()
        .filter_map(|(kind, path)| {
            Some(SeparateFile { kind, role: Role::Mean, path: path.clone()? })
        })
        .collect();
    let others = files.iter().map(|file| file.path.as_path());
    // Only the EXR itself may be denoised in its place, however it is spelt.
    let [read, written] =
        [&arguments.input, &arguments.output].map(|path| path.canonicalize().ok());
    let colour = (read != written).then_some(arguments.input.as_path());
    output::check_inputs(&arguments.output, others.chain(colour))?;
    let mut contents = exr::read_separate(&arguments.input, &files).bad_input()?;
    // Whatever picture is there will be replaced, and is not kept in memory until then.
    contents.picture = None;
    let mut layers = contents.layers;
    for name in &contents.ignored {
        eprintln!("warning: channel {name} is not one that a denoiser uses; it is left out");
    }
    let threads = thread_pool(arguments.finish.threads)?;
    let denoiser = denoising::choose(arguments.denoiser, &arguments.networks, &threads)?;
    let Some(denoiser) = denoiser else { return Ok(()) };
    // Half of the memory is that of the halves. They are not written again; the estimate needs those of what is looked at,
    // and where there is no variance they tell it.
    for (kind, layer) in &mut layers.layers {
        let is_needed = denoiser.uses(*kind) && !arguments.finish.no_estimate;
        if !is_needed && layer.variance.is_some() {
            layer.halves = None;
        }
    }
    let start = Instant::now();
    let denoised = denoising::run(&denoiser, &layers, &threads).bad_input()?;
    let seconds = start.elapsed().as_secs_f64();
    let error = match arguments.finish.no_estimate {
        true => None,
        false => denoising::estimate(&denoised, &denoiser, &layers, &threads)?,
    };
    denoising::describe(&mut layers, Some(&denoised), error.as_ref());

    let output = &arguments.output;
    let png = output.with_extension("png");
    let options =
        WriteOptions { picture: Some(&denoised.image), halves: false, frame: Some(contents.frame) };
    exr::write(output, &layers, &options)
        .with_context(|| format!("cannot write {}", output.display()))?;
    png::write(&png, &denoised.image, arguments.finish.exposure)
        .with_context(|| format!("cannot write {}", png.display()))?;

    let used = layers.layers.keys().filter(|kind| denoiser.uses(**kind));
    let used: Vec<String> = used.map(|kind| kind.name().to_owned()).collect();
    if arguments.finish.json {
        let json = serde_json::json!({
            "output": output,
            "png": png,
            "width": layers.width,
            "height": layers.height,
            "layers": used,
            "denoise_seconds": seconds,
            "denoiser": denoising::json(&denoised),
            "estimated_relative_l2": error.as_ref().map(|error| error.relative_l2),
            "estimated_relative_l2_interval": error.as_ref().map(|error| error.interval),
        });
        println!("{json:#}");
    } else {
        let (output, png) = (output.display(), png.display());
        println!(
            "{output} and {png}: denoised by {} in {seconds:.1} s from {}",
            denoised.by,
            used.join(", ")
        );
        if let Some(error) = &error {
            println!("relative L2, estimated from the halves: {}", denoising::in_words(error));
        }
    }
    Ok(())
}
