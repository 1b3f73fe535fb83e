//! `quietlight render`: a scene in, a denoised EXR with all layers and a PNG out.

use super::args::{Adaptive, Denoiser, Render, Sampler, SceneArguments};
use super::keep::Keeper;
use super::outcome::Outcome;
use super::spending::{Finished, Spending, Spent};
use super::strategies::Pyramid;
use super::{BadInput, Failure, denoising, integrator, output, replay};
use crate::integrator::Integrator;
use crate::render::{Budget, RenderSettings, Rendered, SamplerKind, check_memory};
use crate::scene::{LoadOptions, Scene};
use anyhow::Context;
use quietlight_denoise::exr::{self, Frame, WriteOptions};
use quietlight_denoise::variance::estimated_noise;
use quietlight_denoise::{LayerKind, png};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Seconds of one thread on a pixel from which on a budget of time is spent adaptively, where nothing else is said: denoising the
/// pilot and its halves then takes less than a twentieth of it.
const ADAPTIVE_FROM: f64 = 2.5e-4;

/// True once the user asked to stop.
pub(super) static STOP: AtomicBool = AtomicBool::new(false);

pub(super) fn run(arguments: &Render) -> Result<(), Failure> {
    let start = Instant::now();
    let scene = load(&arguments.scene)?;
    let threads = thread_pool(arguments.finish.threads)?;
    let settings = settings(arguments, &scene, threads.current_num_threads());
    if let Some([x, y, sample]) = arguments.replay {
        if !settings.integrator.is_path() {
            return Err(anyhow::anyhow!(
                "only samples of path tracing can be replayed: --integrator path"
            ))
            .bad_input();
        }
        return replay::run(&scene, &settings, [x, y], sample);
    }
    check_memory(&scene, &settings).bad_input()?;
    if arguments.adaptive == Adaptive::On && !can_adapt(arguments, settings.integrator) {
        return Err(anyhow::anyhow!(
            "--adaptive is for path tracing with a denoiser; here it is {} with --denoiser {:?}",
            settings.integrator.name(),
            arguments.denoiser
        ))
        .bad_input();
    }
    let output = output_path(arguments, &scene)?;
    let pyramid = Pyramid::prepare(arguments.strategies.as_deref(), &settings)?;
    heed_ctrl_c("finishing this pass, then writing what there is")?;
    // Before the render, so that hours are not spent for a file that is not a network.
    let denoiser = denoising::choose(arguments.denoiser, &arguments.networks, &threads)?;

    let keeper = Keeper::new(arguments, &output, notes(arguments, &scene, &settings));
    let spending = Spending {
        scene: &scene,
        settings,
        threads: &threads,
        arguments,
        output: &output,
        keeper: &keeper,
    };
    if keeper.is_part() {
        return spending.render_part();
    }
    let Spent { mut rendered, finished, note } = spending.spend(denoiser.as_ref(), start)?;
    let noise = estimated_noise(&rendered.layers);
    let is_interrupted = STOP.load(Ordering::Relaxed);
    let Finished { denoised, denoising, error } = finished;

    let threads_used = ("threads".to_owned(), threads.current_num_threads().to_string());
    rendered.layers.metadata.extend(keeper.notes().clone());
    rendered.layers.metadata.extend([threads_used]);
    describe(&mut rendered);
    denoising::describe(&mut rendered.layers, denoised.as_ref(), error.as_ref());
    let png = output.with_extension("png");
    let [left, top, ..] = scene.film.crop.map(|number| number as i32);
    let frame = Frame {
        offset: (left, top),
        display_offset: (0, 0),
        display: (scene.film.width as usize, scene.film.height as usize),
    };
    let options = WriteOptions {
        picture: denoised.as_ref().map(|denoised| &denoised.image),
        halves: arguments.halves,
        frame: Some(frame),
    };
    exr::write(&output, &rendered.layers, &options)
        .with_context(|| format!("cannot write {}", output.display()))?;
    let picture = match &denoised {
        Some(denoised) => &denoised.image,
        None => &rendered.layers.layers[&LayerKind::Beauty].mean,
    };
    png::write(&png, picture, arguments.finish.exposure)
        .with_context(|| format!("cannot write {}", png.display()))?;

    if let Some(pyramid) = pyramid.filter(|_| !is_interrupted) {
        threads.install(|| pyramid.write(&scene, &settings, rendered.samples, frame))?;
    }

    let outcome = Outcome {
        output: &output,
        png: &png,
        rendered: &rendered,
        denoised: denoised.as_ref(),
        denoising,
        noise,
        error: error.as_ref(),
    };
    if let Some(note) = note {
        eprintln!("{note}");
    }
    if arguments.finish.json {
        outcome.print_json();
    } else {
        outcome.print();
    }
    if is_interrupted {
        return Err(Failure::Interrupted);
    }
    keeper.forget();
    Ok(())
}

/// Can samples go where the denoised picture needs them?
fn can_adapt(arguments: &Render, integrator: Integrator) -> bool {
    integrator.is_path() && arguments.denoiser != Denoiser::None && arguments.replay.is_none()
}

/// Loads a scene and tells its warnings.
pub(super) fn load(arguments: &SceneArguments) -> Result<Scene, Failure> {
    let options = LoadOptions { definitions: arguments.definitions.clone(), size: arguments.size };
    let mut scene = Scene::load(&arguments.scene, &options).bad_input()?;
    if let Some(depth) = arguments.max_depth {
        scene.limits.max_depth = Some(depth);
    }
    for warning in &scene.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(scene)
}

fn settings(arguments: &Render, scene: &Scene, threads: usize) -> RenderSettings {
    let integrator = integrator::of(arguments, scene, threads);
    let is_adaptive = match arguments.adaptive {
        Adaptive::On => true,
        Adaptive::Off => false,
        Adaptive::Auto => {
            can_adapt(arguments, integrator)
                && arguments.target_error.is_none()
                && integrator::seconds_per_pixel(arguments, scene, threads)
                    .is_some_and(|seconds| seconds >= ADAPTIVE_FROM)
        }
    };
    RenderSettings {
        budget: match arguments.time {
            Some(time) => Budget::Time(time),
            None => Budget::Samples(arguments.spp.unwrap_or(scene.samples)),
        },
        seed: arguments.seed,
        sampler: match arguments.sampler {
            Sampler::Sobol => SamplerKind::Sobol,
            Sampler::Independent => SamplerKind::Independent,
        },
        integrator,
        shard: arguments.shard,
        is_adaptive,
        ..RenderSettings::default()
    }
}

/// Where to write: as asked, else named after the scene (its folder, if the file is a `scene.xml`).
fn output_path(arguments: &Render, scene: &Scene) -> Result<PathBuf, Failure> {
    let path = match &arguments.output {
        Some(path) => path.clone(),
        None => {
            let scene = &arguments.scene.scene;
            let named = if scene.file_stem().is_some_and(|stem| stem == "scene") {
                scene.parent()
            } else {
                None
            };
            let absolute = std::path::absolute(named.unwrap_or(scene)).bad_input()?;
            PathBuf::from(absolute.file_stem().unwrap_or("picture".as_ref())).with_extension("exr")
        }
    };
    output::check_picture(&path)?;
    output::check_inputs(&path, scene.image_files.iter().map(PathBuf::as_path))?;
    Ok(path)
}

/// The first Ctrl-C sets [`STOP`] and says what happens now; the second ends the process at once.
pub(super) fn heed_ctrl_c(reaction: &'static str) -> Result<(), Failure> {
    let handler = move || {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        eprintln!("\n{reaction} (Ctrl-C again to quit at once)");
    };
    ctrlc::set_handler(handler).context("cannot heed Ctrl-C").map_err(Failure::Failed)
}

/// A pool of that many threads; all of them by default.
pub(super) fn thread_pool(threads: Option<u16>) -> Result<rayon::ThreadPool, Failure> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, usize::from))
        .build()
        .context("cannot start threads")
        .map_err(Failure::Failed)
}

/// What is known of the picture before it is made.
fn notes(arguments: &Render, scene: &Scene, settings: &RenderSettings) -> BTreeMap<String, String> {
    let facts = [
        ("scene", arguments.scene.scene.display().to_string()),
        ("integrator", settings.integrator.name().to_owned()),
        ("integrator_settings", settings.integrator.settings()),
        ("strategy", format!("{:?}", settings.integrator.path_tracing().strategy)),
        ("sampler", format!("{:?}", settings.sampler)),
        ("seed", settings.seed.to_string()),
        ("scene_identity", scene.identity()),
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
    ];
    facts.map(|(name, value)| (name.to_owned(), value)).into()
}

/// Writes down what came of it.
pub(super) fn describe(rendered: &mut Rendered) {
    let facts = [
        ("samples", rendered.samples.to_string()),
        ("invalid_samples", rendered.invalid_samples.to_string()),
        ("seconds", format!("{:.3}", rendered.elapsed.as_secs_f64())),
    ];
    rendered.layers.metadata.extend(facts.map(|(name, value)| (name.to_owned(), value)));
    rendered.layers.metadata.extend(rendered.report.facts.iter().cloned());
}
