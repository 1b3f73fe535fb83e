//! The page: one file that needs nothing else, to be looked at.

use super::curve::Reach;
use super::pictures::Pictures;
use super::scores::{Combination, Point, SceneScores};
use super::settings::{Filter, Method};
use super::statistics::Estimate;
use super::verdict;
use super::words::{relative_l2, seconds as time};
use super::{CSV, Error, JSON, PAGE, Scores};
use crate::folder::at;
use askama::Template;
use quietlight_denoise::{atomic, png};
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Bytes that the pictures of all scenes may take together, as text: with the charts' library the page stays below 15 MB.
const PICTURE_BYTES: usize = 9_000_000;

#[derive(Template)]
#[template(path = "page.html", config = "src/tradeoff/page/askama.toml")]
struct Page<'a> {
    style: &'static str,
    script: &'static str,
    library: &'a str,
    /// For the script, as JSON that may stand in a page.
    data: String,
    facts: String,
    warnings: Vec<String>,
    left_out: Vec<String>,
    scenes: Vec<SceneView<'a>>,
    colours: String,
    csv: &'static str,
    json: &'static str,
}

/// A scene, its numbers as they are to be read.
struct SceneView<'a> {
    name: &'a str,
    facts: String,
    scene: &'a SceneScores,
    choices: Vec<ChoiceView>,
    targets: Vec<String>,
    reaches: Vec<ReachView>,
    rows: Vec<RowView>,
    range: [String; 2],
    pictures_note: String,
}

struct ChoiceView {
    seconds: String,
    take: String,
    error: String,
    note: String,
    is_auto: bool,
}

struct ReachView {
    integrator: &'static str,
    denoiser: &'static str,
    cells: Vec<Cell>,
}

struct Cell {
    text: String,
    is_best: bool,
}

struct RowView {
    integrator: &'static str,
    denoiser: &'static str,
    samples: u32,
    seconds: String,
    error: String,
    interval: String,
    /// Part of the error that is bias, in percent; `None` where it is not known.
    bias: Option<u32>,
    bias_title: String,
    ssim: String,
    psnr: String,
    flip: String,
    is_on_front: bool,
    is_known: bool,
}

/// What the script needs of a scene.
#[derive(Serialize)]
struct Data<'a> {
    name: &'a str,
    noise: f64,
    auto: Combination,
    take: Option<Combination>,
    points: Vec<Dot>,
    front: &'a [usize],
    pictures: Pictures,
}

/// A point of the charts.
#[derive(Serialize)]
struct Dot {
    integrator: Method,
    denoiser: Filter,
    samples: u32,
    seconds: f64,
    error: f64,
    interval: Option<[f64; 2]>,
    bias2: Option<f64>,
    variance: Option<f64>,
    is_known: bool,
}

/// Writes the page of the measurement in `folder`, on the threads of the current rayon pool.
///
/// # Errors
/// Where pictures cannot be read or the page cannot be written.
pub fn write(folder: &Path, scores: &Scores) -> Result<(), Error> {
    let limit = PICTURE_BYTES / scores.scenes.len().max(1);
    let pictures = scores
        .scenes
        .par_iter()
        .map(|scene| Pictures::of(folder, scene, limit))
        .collect::<Result<Vec<Pictures>, Error>>()?;
    let scenes = scores
        .scenes
        .iter()
        .zip(&pictures)
        .map(|(scene, pictures)| view(scene, pictures))
        .collect();
    let data: Vec<Data<'_>> =
        scores.scenes.iter().zip(pictures).map(|(scene, pictures)| data(scene, pictures)).collect();
    let path = folder.join(PAGE);
    let json = serde_json::to_string(&data).map_err(|error| at(&path)(error.into()))?;
    let sources = plotly::Plot::offline_js_sources();
    let page = Page {
        style: include_str!("page/page.css"),
        script: include_str!("page/page.js"),
        library: library(&sources),
        // A name could end the script; nothing else in JSON can.
        data: json.replace('<', "\\u003c"),
        facts: facts(scores),
        warnings: warnings(scores),
        left_out: left_out(scores),
        scenes,
        colours: colours(),
        csv: CSV,
        json: JSON,
    };
    atomic::write(&path, |file| page.write_into(file).map_err(at(&path)))?;
    Ok(())
}

/// The library of charts alone: what comes with it sets formulas, of which the page has none.
fn library(sources: &str) -> &str {
    let start = sources.find('>').map_or(0, |end| end + 1);
    let end = sources.find("</script>").unwrap_or(sources.len());
    sources.get(start..end).unwrap_or_default()
}

/// The colours of the maps, for a gradient.
fn colours() -> String {
    let colour = |[red, green, blue]: [f32; 3]| format!("rgb({red},{green},{blue})");
    png::MAGMA.map(colour).join(",")
}

fn facts(scores: &Scores) -> String {
    let settings = &scores.settings;
    let names = |all: &[&str]| all.join(", ");
    let integrators: Vec<&str> = settings.integrators.iter().map(|one| one.name()).collect();
    let counts: Vec<String> = settings.samples.iter().map(u32::to_string).collect();
    let threads: Vec<String> = scores.threads.iter().map(usize::to_string).collect();
    format!(
        "{} at {} samples per pixel, {} seeds each; {} threads of {}",
        names(&integrators),
        counts.join(", "),
        settings.seeds,
        threads.join(" or "),
        scores.processors.join(" or ")
    )
}

fn warnings(scores: &Scores) -> Vec<String> {
    let mut warnings = Vec::new();
    let [there, asked] = scores.units;
    if there < asked {
        warnings.push(format!(
            "Not complete: {there} of {asked} parts are there; the same command goes on."
        ));
    }
    if scores.threads.len() > 1 || scores.processors.len() > 1 {
        warnings.push("Made on unlike machines: the times cannot be compared.".to_owned());
    }
    let dropped = |scene: &&SceneScores| scene.points.iter().any(|point| point.invalid_samples > 0);
    for scene in scores.scenes.iter().filter(dropped) {
        warnings.push(format!("{}: samples that were not finite were dropped.", scene.name));
    }
    warnings
}

fn left_out(scores: &Scores) -> Vec<String> {
    let told = |(filter, why): &(Filter, String)| format!("{}: {why}", filter.name());
    scores.left_out.iter().map(told).collect()
}

fn data(scene: &SceneScores, pictures: Pictures) -> Data<'_> {
    let dot = |point: &Point| Dot {
        integrator: point.combination.integrator,
        denoiser: point.combination.denoiser,
        samples: point.samples,
        seconds: point.seconds.mean,
        error: point.error.mean,
        interval: point.error.interval,
        bias2: point.bias2,
        variance: point.variance,
        is_known: point.is_known,
    };
    Data {
        name: &scene.name,
        noise: scene.reference.noise,
        auto: scene.auto,
        take: scene.verdict.choices.last().map(|choice| choice.take),
        points: scene.points.iter().map(dot).collect(),
        front: &scene.front,
        pictures,
    }
}

fn view<'a>(scene: &'a SceneScores, pictures: &Pictures) -> SceneView<'a> {
    let reference = &scene.reference;
    let [first, second] = reference.samples;
    let facts = format!(
        "{}×{} pixels. Errors are measured against {} + {} samples of {} ({}), whose own noise, relative L2 {}, is taken \
         out; an error below it is not known.",
        scene.size[0],
        scene.size[1],
        first,
        second,
        reference.integrator,
        time(reference.seconds),
        relative_l2(reference.noise)
    );
    let mut notes = Vec::new();
    if let Some(last) = scene.verdict.choices.last() {
        notes.push(format!("The most samples that fit into {}, first seed.", time(last.seconds)));
    }
    if pictures.exposure != 0 {
        notes.push(format!("Shown {:+} stops brighter.", pictures.exposure));
    }
    if pictures.reduced > 1 {
        notes.push(format!("Reduced to 1/{} of the size.", pictures.reduced));
    }
    SceneView {
        name: &scene.name,
        facts,
        choices: scene.verdict.choices.iter().map(choice_view).collect(),
        targets: scene.targets.iter().map(|&target| round(target)).collect(),
        reaches: reaches(scene),
        rows: scene
            .points
            .iter()
            .enumerate()
            .map(|(index, point)| row(scene, index, point))
            .collect(),
        range: pictures.range.map(round),
        pictures_note: notes.join(" "),
        scene,
    }
}

/// A round error.
fn round(error: f64) -> String {
    if error >= 9e-5 { format!("{error}") } else { format!("{error:.0e}") }
}

fn choice_view(choice: &verdict::Choice) -> ChoiceView {
    let error_of = |combination| match combination {
        one if one == choice.best => Some(choice.error),
        one if one == choice.auto => choice.auto_error,
        _ => None,
    };
    let note = match choice.rival {
        _ if choice.take != choice.best => {
            format!("not told apart from {}, {}", choice.best, relative_l2(choice.error))
        }
        Some((rival, error)) if choice.is_clear => {
            format!("next: {rival}, {:.1} times as much", error / choice.error)
        }
        Some((rival, error)) => format!("next, nearly the same: {rival}, {}", relative_l2(error)),
        None => String::new(),
    };
    ChoiceView {
        seconds: time(choice.seconds),
        take: choice.take.to_string(),
        error: error_of(choice.take).map_or_else(String::new, relative_l2),
        note,
        is_auto: choice.take == choice.auto,
    }
}

fn reaches(scene: &SceneScores) -> Vec<ReachView> {
    let reached = |reach: &Reach| match *reach {
        Reach::After(seconds) | Reach::Within(seconds) => seconds,
        Reach::Not(_) => f64::INFINITY,
    };
    let best = |target: usize| {
        let times =
            scene.curves.iter().filter_map(|curve| curve.reach[target].as_ref()).map(reached);
        times.fold(f64::INFINITY, f64::min)
    };
    let fastest: Vec<f64> = (0..scene.targets.len()).map(best).collect();
    let cell = |(target, reach): (usize, &Option<Reach>)| Cell {
        text: match reach {
            None => "not known".to_owned(),
            Some(Reach::After(seconds)) => time(*seconds),
            Some(Reach::Within(seconds)) => format!("≤ {}", time(*seconds)),
            Some(Reach::Not(seconds)) => format!("> {}", time(*seconds)),
        },
        is_best: reach.as_ref().is_some_and(|reach| {
            !matches!(reach, Reach::Not(_)) && reached(reach) <= fastest[target]
        }),
    };
    let row = |curve: &super::scores::CurveScores| ReachView {
        integrator: curve.combination.integrator.name(),
        denoiser: curve.combination.denoiser.name(),
        cells: curve.reach.iter().enumerate().map(cell).collect(),
    };
    scene.curves.iter().map(row).collect()
}

fn row(scene: &SceneScores, index: usize, point: &Point) -> RowView {
    let ends = |estimate: &Estimate, text: fn(f64) -> String| match estimate.interval {
        Some([low, high]) => format!("{} … {}", text(low), text(high)),
        None => "one seed".to_owned(),
    };
    let parts = point.bias2.zip(point.variance);
    let bias = parts.and_then(|(bias2, variance)| {
        let part = bias2.max(0.0) / (bias2.max(0.0) + variance);
        part.is_finite().then(|| (100.0 * part).round() as u32)
    });
    let bias_title = match parts {
        Some((bias2, variance)) => format!("bias² {bias2:.2e}, variance {variance:.2e}"),
        None => "not known of one seed".to_owned(),
    };
    RowView {
        integrator: point.combination.integrator.name(),
        denoiser: point.combination.denoiser.name(),
        samples: point.samples,
        seconds: time(point.seconds.mean),
        error: format!("{:.2e}", point.error.mean),
        interval: ends(&point.error, relative_l2),
        bias,
        bias_title,
        ssim: point.one_minus_ssim.map_or_else(String::new, |ssim| format!("{:.4}", ssim.mean)),
        psnr: format!("{:.1}", point.psnr.mean),
        flip: format!("{:.4}", point.flip.mean),
        is_on_front: scene.front.contains(&index),
        is_known: point.is_known,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_one_whole_script() {
        let sources = plotly::Plot::offline_js_sources();
        let library = library(&sources);
        assert!(library.len() > 1_000_000 && library.contains("plotly.js v"));
        assert!(!library.contains("<script type") && !library.contains("MathJax.loader"));
    }
}
