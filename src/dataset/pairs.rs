//! One view: its scene, its window, its noisy renders and its reference.

#[cfg(test)]
mod tests;

use super::exposure;
use super::generator::{self, generate};
use super::make::Job;
use super::manifest::{
    Identity, NoisyFile, Record, ReferenceFile, Settings, SkippedView, Source, Split, View,
};
use super::seed::{Dice, Purpose, ViewSeed};
use super::{Error, variation};
use crate::folder::at;
use crate::render::{Budget, RenderSettings, Rendered, Rendering, render};
use crate::scene::{LoadOptions, Scene};
use quietlight_denoise::exr::{self, Frame, WriteOptions};
use quietlight_denoise::sha256::sha256;
use quietlight_denoise::variance::estimated_relative_l2;
use quietlight_denoise::{Image, Layer, LayerKind, Layers};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Fewest samples per pixel of a reference, if its settings allow as many: with fewer, rare light may not have been met
/// at all, and the estimate of the noise would not know of it.
const FEWEST_REFERENCE_SAMPLES: u32 = 256;

/// Samples per pixel by which a view is judged.
const PILOT_SAMPLES: u32 = 4;

/// A generator that fails as often as this to show something fails always.
const MOST_ATTEMPTS: u32 = 16;

/// A scene with what is known of it.
struct Candidate {
    scene: Scene,
    tags: Vec<String>,
}

/// Why there is no candidate.
pub(super) enum Refusal {
    /// Another seed may do better.
    Again(String),
    /// The scene itself is broken.
    Broken(String),
}

/// Makes view `number` of `job`: its files, and last the one that says that it is done. `None` when `stop` became true before it was complete;
/// then nothing is left of it.
///
/// # Errors
/// Only where files cannot be written. A scene that fails makes a [`Record::Skipped`].
pub(super) fn make_view(
    job: &Job,
    number: u32,
    stop: &AtomicBool,
) -> Result<Option<Record>, Error> {
    let start = Instant::now();
    let id = View::id(number);
    let folder = View::folder(&job.folder, &id);
    let clear = || match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(at(&folder)(error)),
        _ => Ok(()),
    };
    clear()?;
    fs::create_dir_all(&folder).map_err(at(&folder))?;

    let mut attempts = 0;
    let record = loop {
        let seed = ViewSeed::new(job.settings.seed, number, attempts);
        attempts += 1;
        let source = source(&job.settings, number, seed);
        let scene_key = source.scene_key();
        let split = Split::of(&scene_key);
        let identity = Identity { id: id.clone(), source, scene_key, split, attempts };
        let refusal = match attempt(job, &folder, &identity, seed, stop)? {
            Tried::Rendered(mut view) => {
                view.seconds = start.elapsed().as_secs_f64();
                break Record::Rendered(*view);
            }
            Tried::Interrupted => {
                clear()?;
                return Ok(None);
            }
            Tried::Refused(refusal) => refusal,
        };
        let reason = match refusal {
            Refusal::Again(_) if attempts < MOST_ATTEMPTS => continue,
            Refusal::Again(reason) => format!("{attempts} attempts failed, the last: {reason}"),
            Refusal::Broken(reason) => reason,
        };
        let seconds = start.elapsed().as_secs_f64();
        break Record::Skipped(SkippedView { identity, reason, seconds });
    };
    record.write(&job.folder)?;
    Ok(Some(record))
}

/// Where a view comes from: the given scenes in turn, or the generator.
fn source(settings: &Settings, number: u32, seed: ViewSeed) -> Source {
    match settings.scenes.len() {
        0 => Source::Generated { generated: seed.derive(Purpose::Scene) },
        count => Source::File {
            file: settings.scenes[number as usize % count].clone(),
            variation: seed.derive(Purpose::Variation),
        },
    }
}

/// The scene of a source.
///
/// # Errors
/// Only where files of a generated scene cannot be written: another time, they can be.
fn candidate(
    job: &Job,
    identity: &Identity,
    seed: ViewSeed,
) -> Result<Result<Candidate, Refusal>, Error> {
    match &identity.source {
        Source::Generated { generated } => {
            // Not kept unless asked for: it goes away with `temporary`.
            let temporary = tempfile::tempdir().map_err(at(&std::env::temp_dir()))?;
            let kept = job.folder.join("scenes").join(&identity.id);
            if job.keep_scenes && kept.exists() {
                fs::remove_dir_all(&kept).map_err(at(&kept))?;
            }
            let folder = if job.keep_scenes { &kept } else { temporary.path() };
            let generated = match generate(*generated, folder) {
                Err(generator::Error::Io { path, source }) => return Err(at(&path)(source).into()),
                Err(generator::Error::Write(error)) => return Err(error.into()),
                Err(error) => return Ok(Err(Refusal::Broken(error.to_string()))),
                Ok(generated) => generated,
            };
            let size = large_enough(generated.film, job.settings.crop);
            let options = LoadOptions { size, ..LoadOptions::default() };
            let scene = Scene::load(&generated.scene, &options);
            Ok(match scene {
                Ok(scene) => Ok(Candidate { scene, tags: generated.tags }),
                Err(error) => Err(Refusal::Broken(error.to_string())),
            })
        }
        Source::File { file, variation } => {
            let film = film(job.settings.crop, &mut Dice::new(seed.derive(Purpose::Film)));
            let scene = variation::vary(file, film, *variation);
            Ok(scene.map(|scene| Candidate { scene, tags: Vec::new() }))
        }
    }
}

/// Another size for a film that is smaller than the crop window, of the same format.
fn large_enough(film: [u32; 2], crop: u32) -> Option<(u32, u32)> {
    let short = film[0].min(film[1]);
    let scaled = |side: u32| (u64::from(side) * u64::from(crop)).div_ceil(u64::from(short)) as u32;
    (short > 0 && short < crop).then(|| (scaled(film[0]), scaled(film[1])))
}

/// Width and height of a film about twice as long as the crop window, in a format from square to 16:9, sometimes upright.
fn film(crop: u32, dice: &mut Dice) -> [u32; 2] {
    let long = 2.0 * f64::from(crop) * dice.uniform(0.9, 1.1);
    let short = (long / dice.log_uniform(1.0, 16.0 / 9.0)).max(f64::from(crop));
    let (long, short) = (long.round() as u32, short.round() as u32);
    if dice.chance(0.2) { [short, long] } else { [long, short] }
}

/// What became of an attempt.
enum Tried {
    Rendered(Box<View>),
    Refused(Refusal),
    Interrupted,
}

/// Makes the scene and renders it. A panic on the way is a fault of the program, but no reason to end a run of days: it is
/// noted like a broken scene.
fn attempt(
    job: &Job,
    folder: &Path,
    identity: &Identity,
    seed: ViewSeed,
    stop: &AtomicBool,
) -> Result<Tried, Error> {
    or_panic_noted(|| match candidate(job, identity, seed)? {
        Ok(candidate) => try_view(job, folder, candidate, identity, seed, stop),
        Err(refusal) => Ok(Tried::Refused(refusal)),
    })
}

/// Does the work; a panic becomes a refusal.
fn or_panic_noted(work: impl FnOnce() -> Result<Tried, Error>) -> Result<Tried, Error> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<String>().map(String::as_str);
        let said = said.or(panic.downcast_ref::<&str>().copied()).unwrap_or("without a message");
        Ok(Tried::Refused(Refusal::Broken(format!("the program panicked: {said}"))))
    })
}

/// Places the window, judges the view by a few samples, and renders it.
fn try_view(
    job: &Job,
    folder: &Path,
    candidate: Candidate,
    identity: &Identity,
    seed: ViewSeed,
    stop: &AtomicBool,
) -> Result<Tried, Error> {
    let Candidate { mut scene, tags } = candidate;
    let settings = &job.settings;
    let mut dice = Dice::new(seed.derive(Purpose::Choices));
    scene.film.crop = window([scene.film.width, scene.film.height], settings.crop, &mut dice);
    let mut counts: Vec<u32> = Vec::new();
    for _ in 0..settings.noisy {
        counts.push(sample_count(settings, &mut dice));
    }

    let of = |samples, purpose| RenderSettings {
        budget: Budget::Samples(samples),
        seed: seed.derive(purpose),
        ..RenderSettings::default()
    };
    let pilot = render(&scene, &of(PILOT_SAMPLES, Purpose::Pilot), &|_| {}, stop);
    if stop.load(Ordering::Relaxed) {
        return Ok(Tried::Interrupted);
    }
    if let Some(reason) = fault(&pilot.layers) {
        return Ok(Tried::Refused(Refusal::Again(reason.to_owned())));
    }

    let mut noisy = Vec::new();
    for (index, &samples) in (0..).zip(&counts) {
        let settings = of(samples, Purpose::Noisy(index));
        let rendered = render(&scene, &settings, &|_| {}, stop);
        if stop.load(Ordering::Relaxed) {
            return Ok(Tried::Interrupted);
        }
        let file = format!("noisy-{index}.exr");
        let sha256 = write(folder, &file, rendered, &scene, identity, &settings)?;
        noisy.push(NoisyFile { file, spp: samples, seed: settings.seed, sha256 });
    }

    let most = settings.reference_spp;
    let reference_settings = of(most, Purpose::Reference);
    let mut reference = Rendering::new(&scene, &reference_settings);
    let mut samples = FEWEST_REFERENCE_SAMPLES.min(most);
    let noise = loop {
        reference.advance(samples, &|_| {}, stop);
        if stop.load(Ordering::Relaxed) {
            return Ok(Tried::Interrupted);
        }
        let noise = Noise::of(&reference.layers().layers[&LayerKind::Beauty]);
        if noise.exposed <= settings.reference_noise || samples >= most {
            break noise;
        }
        samples = samples.saturating_mul(2).min(most);
    };
    let file = "reference.exr".to_owned();
    let reference_seed = reference_settings.seed;
    let sha256 = write(folder, &file, reference.finish(), &scene, identity, &reference_settings)?;
    let reference = ReferenceFile {
        file,
        spp: samples,
        seed: reference_seed,
        sha256,
        relative_l2_noise: noise.plain,
        exposed_relative_l2_noise: noise.exposed,
    };
    Ok(Tried::Rendered(Box::new(View {
        identity: identity.clone(),
        tags,
        film: [scene.film.width, scene.film.height],
        crop: scene.film.crop,
        noisy,
        reference,
        seconds: 0.0,
    })))
}

/// A square of `side` pixels, or as much of it as the film has, anywhere on the film.
fn window(film: [u32; 2], side: u32, dice: &mut Dice) -> [u32; 4] {
    let [width, height] = film.map(|pixels| pixels.min(side));
    [dice.up_to(film[0] - width), dice.up_to(film[1] - height), width, height]
}

/// Samples per pixel of a noisy render: log-uniform, rounded.
fn sample_count(settings: &Settings, dice: &mut Dice) -> u32 {
    let (fewest, most) = (f64::from(settings.min_spp), f64::from(settings.max_spp));
    (dice.log_uniform(fewest, most).round() as u32).clamp(settings.min_spp, settings.max_spp)
}

/// Noise left in a picture, as an estimated relative L2.
struct Noise {
    /// Of the picture as it is.
    plain: f64,
    /// Of the picture brightened to middle grey if it is darker: in a dark picture the constant in the denominator hides the
    /// noise, but a denoiser sees the picture brightened.
    exposed: f64,
}

impl Noise {
    fn of(beauty: &Layer) -> Self {
        let plain = estimated_relative_l2(beauty).unwrap_or(f64::INFINITY);
        let gain = exposure::gain(&beauty.mean).max(1.0) as f32;
        let exposed = Layer {
            mean: &beauty.mean * gain,
            variance: beauty.variance.as_ref().map(|variance| variance * gain * gain),
            halves: None,
        };
        Self { plain, exposed: estimated_relative_l2(&exposed).unwrap_or(f64::INFINITY) }
    }
}

/// What makes a view worthless to learn from, if anything does.
fn fault(layers: &Layers) -> Option<&'static str> {
    let beauty = &layers.layers[&LayerKind::Beauty].mean;
    let depth = &layers.layers[&LayerKind::Depth].mean;
    let pixels = (layers.width * layers.height) as f64;
    let surfaces = depth.iter().filter(|&&depth| depth > 0.0).count() as f64;
    if surfaces < 0.05 * pixels {
        return Some("nothing but background in view");
    }
    let lit = beauty.lanes(ndarray::Axis(0)).into_iter();
    let lit = lit.filter(|pixel| pixel.iter().any(|&value| value > 0.0)).count() as f64;
    if lit < 0.05 * pixels {
        return Some("nearly black");
    }
    let is_flat =
        |kind: LayerKind| layers.layers.get(&kind).is_none_or(|layer| spread(&layer.mean) < 0.01);
    let is_even = spread(beauty) < 0.05 * exposure::brightness(beauty);
    (is_even && is_flat(LayerKind::Albedo) && is_flat(LayerKind::Normal)).then_some("constant")
}

/// Largest standard deviation of any channel among the means of about 8×8 blocks of the image, of any size: large enough
/// that the noise of few samples averages out.
fn spread(image: &Image) -> f64 {
    let (_, height, width) = image.dim();
    let block = (height.div_ceil(8), width.div_ceil(8));
    let deviation = |plane: ndarray::ArrayView2<'_, f32>| {
        let means: Vec<f64> = plane
            .exact_chunks(block)
            .into_iter()
            .map(|block| {
                block.iter().map(|&value| f64::from(value)).sum::<f64>() / block.len() as f64
            })
            .collect();
        let count = means.len().max(1) as f64;
        let mean = means.iter().sum::<f64>() / count;
        (means.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
    };
    image.outer_iter().map(deviation).fold(0.0, f64::max)
}

/// Writes a render into `folder` and gives the SHA-256 of the file. Nothing that differs from run to run goes into it.
fn write(
    folder: &Path,
    file: &str,
    mut rendered: Rendered,
    scene: &Scene,
    identity: &Identity,
    settings: &RenderSettings,
) -> Result<String, Error> {
    // One attribute for all facts: the order of several in an EXR file is not the same from run to run.
    let facts = format!(
        "view {} of {}, path tracing, {:?}, {:?}, seed {}, {} samples, {} invalid, version {}",
        identity.id,
        identity.scene_key,
        settings.integrator.path_tracing().strategy,
        settings.sampler,
        settings.seed,
        rendered.samples,
        rendered.invalid_samples,
        env!("CARGO_PKG_VERSION"),
    );
    rendered.layers.metadata.insert("render".to_owned(), facts);
    let [left, top, ..] = scene.film.crop.map(|number| number as i32);
    let frame = Frame {
        offset: (left, top),
        display_offset: (0, 0),
        display: (scene.film.width as usize, scene.film.height as usize),
    };
    let halves = file != "reference.exr";
    let options = WriteOptions { picture: None, halves, frame: Some(frame) };
    let path = folder.join(file);
    exr::write(&path, &rendered.layers, &options)?;
    Ok(sha256(&fs::read(&path).map_err(at(&path))?))
}
