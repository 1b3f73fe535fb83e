//! Every method over the ranges of numbers that a scene may come in, one axis at a time: is all finite, is the mean right, how
//! long does it take, do the denoisers still work? The short form takes the ends of the axes, the long one many values and
//! writes a table:
//!
//! ```text
//! QUIETLIGHT_EXTREMES=tests/extremes.md cargo test --release --test laws sweep -- --ignored
//! ```

mod axes;
mod table;

use super::denoisers::{denoisers, threads};
use super::{Mean, by_path, parts};
use crate::support::scenes::{layer, settings};
use crate::support::{LEVEL, sidak};
use axes::{Axis, Expected, Form, Point, Room, axes};
use quietlight::integrator::{
    Bdpt, CorrelatedVisibility, Erpt, Integrator, Mlt, PathTracing, Pssmlt, Strategy,
};
use quietlight::render::{RenderSettings, Rendered, render};
use quietlight_denoise::metrics::relative_l2;
use quietlight_denoise::{Denoiser, LayerKind, Layers};
use rayon::prelude::*;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use table::{Cell, axis_table};

/// The methods as a user gets them.
fn methods() -> [(&'static str, Integrator); 6] {
    [
        ("path", PathTracing::default().into()),
        ("bdpt", Integrator::Bdpt(Bdpt::default())),
        ("visibility", Integrator::Visibility(CorrelatedVisibility::default())),
        ("pssmlt", Integrator::Pssmlt(Pssmlt { bootstrap_samples: 4000, ..Pssmlt::default() })),
        ("mlt", Integrator::Mlt(Mlt { bootstrap_pairs: 4000, ..Mlt::default() })),
        ("erpt", Integrator::Erpt(Erpt::default())),
    ]
}

/// Fewer renders where they are of very many samples.
const MANY_SAMPLES: u32 = 10_000;

/// Comparisons of the long form, about: values × methods × parts of a picture.
const COMPARISONS: usize = 45 * 6 * 3;

/// Seconds of a processor that this process has used: fields 14 and 15 of Linux's `/proc/self/stat`, in hundredths. 0 elsewhere.
fn processor_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = text.rsplit(')').next().unwrap_or_default();
    let ticks = after_name.split_whitespace().skip(11).take(2);
    ticks.filter_map(|word| word.parse::<f64>().ok()).sum::<f64>() / 100.0
}

fn rendered(point: &Point, integrator: Integrator, seed: u64) -> Rendered {
    let settings = RenderSettings { integrator, ..settings(point.samples, seed, Strategy::Mis) };
    render(&point.scene, &settings, &|_| {}, &AtomicBool::new(false))
}

/// Is every number of the layers finite?
fn is_finite(layers: &Layers) -> bool {
    layers.layers.values().all(|layer| {
        let halves = layer.halves.iter().flatten();
        let mut images = halves.chain([&layer.mean]).chain(&layer.variance);
        images.all(|image| image.iter().all(|value| value.is_finite()))
    })
}

/// What path tracing, or a formula, says of the [`parts`] of pictures.
struct Expectations {
    /// Samples per pixel of path tracing.
    samples: u32,
    /// What was traced already.
    traced: Vec<(Room, [Mean; 3])>,
}

impl Expectations {
    fn of(&mut self, point: &Point) -> [Mean; 3] {
        match point.expected {
            Expected::Traced { room, factor } => {
                let known = self.traced.iter().find(|(other, _)| *other == room);
                let means = known.map(|(_, means)| *means).unwrap_or_else(|| {
                    let means = by_path(&room.scene(), self.samples.max(point.samples));
                    self.traced.push((room, means));
                    means
                });
                means.map(|mean| mean.times(factor))
            }
            Expected::Radiance(value) => {
                // The part of the pixels that belong to the upper and to the left half.
                let half = |side: u32| f64::from(side.div_ceil(2)) / f64::from(side);
                let film = point.scene.film;
                [1.0, half(film.height), half(film.width)]
                    .map(|part| [value * part].into_iter().collect())
            }
        }
    }
}

fn cell(
    point: &Point,
    integrator: Integrator,
    expected: &[Mean; 3],
    replicas: u64,
    denoisers: &[(&'static str, Denoiser)],
) -> Cell {
    let replicas = if point.samples > MANY_SAMPLES { replicas / 2 } else { replicas };
    let start = processor_seconds();
    let renders: Vec<Rendered> = (0..replicas)
        .into_par_iter()
        .map(|seed| rendered(point, integrator, 10_000 + seed))
        .collect();
    let samples: f64 = renders.iter().map(|one| f64::from(one.samples)).sum();
    let work = samples * point.scene.film.crop_pixels() as f64;
    let seconds = (processor_seconds() - start) / work;
    let found: Vec<[f64; 3]> = renders.iter().map(parts).collect();
    let found: [Mean; 3] = [0, 1, 2].map(|part| found.iter().map(|parts| parts[part]).collect());
    let mut cell = Cell {
        deviation: found[0].mean() / expected[0].mean() - 1.0,
        error: (found[0].variance_of_mean() + expected[0].variance_of_mean()).sqrt()
            / expected[0].mean(),
        z: 0.0,
        p: 1.0,
        invalid: renders.iter().map(|one| one.invalid_samples).sum(),
        is_finite: renders.iter().all(|one| is_finite(&one.layers)),
        seconds,
    };
    for (found, expected) in found.iter().zip(expected) {
        let difference = found.mean() - expected.mean();
        // Pixels of f32 are right to 1e-6 of what they have, and a sum of the layers, or what a scene's units are rounded
        // to, may lose ten times that.
        if difference.abs() <= 1e-5 * expected.mean().abs() {
            continue;
        }
        let error = (found.variance_of_mean() + expected.variance_of_mean()).sqrt();
        if error == 0.0 || !error.is_finite() {
            (cell.z, cell.p) = (f64::INFINITY, 0.0);
            continue;
        }
        let p = match expected.count() {
            1 => found.p_against(expected.mean()),
            _ => found.p_same_as(expected),
        };
        cell.z = cell.z.max((difference / error).abs());
        cell.p = cell.p.min(p);
    }
    for (_, denoiser) in denoisers {
        let layers = &renders[0].layers;
        let denoised = denoiser.denoise(layers, &threads(), &|_| {}).expect("denoised");
        let sane = denoised.image.iter().all(|value| value.is_finite());
        cell.is_finite &= sane && denoised.sanitised.total() == 0;
    }
    cell
}

/// Renders everything; returns the tables and what is wrong.
fn sweep(form: Form, axes: Vec<Axis>, replicas: u64, level: f64) -> (String, Vec<String>) {
    let [learned, _, fast, ..] = denoisers();
    let denoisers = [learned, fast];
    let names: Vec<&str> = methods().iter().map(|(name, _)| *name).collect();
    let (mut text, mut wrong) = (String::new(), Vec::new());
    let samples = if form == Form::Long { 1024 } else { 64 };
    let mut expectations = Expectations { samples, traced: Vec::new() };
    for Axis { name, meaning, points } in axes {
        let mut rows = Vec::new();
        for point in points {
            let expected = expectations.of(&point);
            let cells: Vec<Cell> = methods()
                .into_iter()
                .map(|(method, integrator)| {
                    let cell = cell(&point, integrator, &expected, replicas, &denoisers);
                    if !cell.is_good(level) {
                        wrong.push(format!("{name} {}, {method}: {cell:?}", point.value));
                    }
                    cell
                })
                .collect();
            rows.push((point.value, point.is_base, cells));
        }
        text += &axis_table(name, meaning, &names, &rows, level);
    }
    (text, wrong)
}

/// What denoising makes of a picture whose light is multiplied: relative L2 of the exposed result against the result at 1, and
/// how much of the error against many samples is left, both exposed, so that all rows are of one picture.
fn denoisers_table() -> String {
    let room = Room { size: [96, 64], ..Room::default() }.scene();
    let picture = |samples, seed| {
        render(&room, &settings(samples, seed, Strategy::Mis), &|_| {}, &AtomicBool::new(false))
    };
    let (noisy, truth) = (picture(16, 1), picture(1024, 2));
    let truth = layer(&truth, LayerKind::Beauty).0;
    let before = relative_l2(layer(&noisy, LayerKind::Beauty).0, truth).expect("a score");
    let mut text = "\n## Denoising light times a factor\n\nA picture of the room at 16 samples and all its layers of light times the \
        value, denoised, divided by it: the relative L2 of that against what comes of the picture as it is, and the part of \
        the noisy picture's error against 1024 samples that is left.\n\n| factor |"
        .to_owned();
    let denoisers = denoisers();
    denoisers.iter().for_each(|(name, _)| write!(text, " {name} |").expect("a string"));
    text += &format!("\n|{}\n", "---|".repeat(denoisers.len() + 1));
    let plain: Vec<_> = denoisers
        .iter()
        .map(|(_, denoiser)| {
            denoiser.denoise(&noisy.layers, &threads(), &|_| {}).expect("denoised").image
        })
        .collect();
    for factor in [1.0f32, 1e-8, 1e-4, 1e-2, 1e2, 1e4, 1e8] {
        let mut layers = noisy.layers.clone();
        for (_, layer) in layers.layers.iter_mut().filter(|(kind, _)| kind.is_radiance()) {
            layer.mean *= factor;
            layer.halves.iter_mut().flatten().for_each(|half| *half *= factor);
            layer.variance.iter_mut().for_each(|variance| *variance *= factor * factor);
        }
        write!(text, "| {factor:e} |").expect("a string");
        for ((_, denoiser), plain) in denoisers.iter().zip(&plain) {
            let image =
                denoiser.denoise(&layers, &threads(), &|_| {}).expect("denoised").image / factor;
            let difference = relative_l2(&image, plain).expect("finite");
            let left = relative_l2(&image, truth).expect("finite") / before;
            write!(text, " {difference:.1e}, {left:.3} |").expect("a string");
        }
        text += "\n";
    }
    text
}

#[test]
fn the_ends_of_all_axes_are_finite_and_unbiased() {
    let level = sidak(LEVEL, COMPARISONS);
    let (text, wrong) = sweep(Form::Short, axes(Form::Short), 8, level);
    assert!(wrong.is_empty(), "{wrong:#?}\n{text}");
}

#[test]
#[ignore = "half an hour of two processors"]
fn a_sweep_over_all_axes_is_finite_and_unbiased() {
    let level = sidak(LEVEL, COMPARISONS);
    let only = std::env::var("QUIETLIGHT_EXTREMES_AXIS").unwrap_or_default();
    let mut axes = axes(Form::Long);
    axes.retain(|axis| axis.name.contains(&only));
    let (mut text, wrong) = sweep(Form::Long, axes, 16, level);
    if "Denoising".contains(&only) {
        text += &denoisers_table();
    }
    let file = std::env::var_os("QUIETLIGHT_EXTREMES").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("target/extremes.md"),
        PathBuf::from,
    );
    let text = format!("{}{text}", include_str!("sweep/head.md"));
    std::fs::write(&file, text).expect("the table is written");
    assert!(wrong.is_empty(), "{wrong:#?}");
}
