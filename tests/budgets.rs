//! Budgets keep their word: errors are judged on the picture that is written, and nothing is spent beyond what may be.

use crate::support::scenes::scene_around;
use quietlight::render::{Budget, Ending, RenderSettings, Rendering, SamplerKind, Target};
use quietlight::scene::Scene;
use quietlight_denoise::{LayerKind, exr};
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

fn floor() -> Scene {
    scene_around(
        8,
        50.0,
        3,
        r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="5"/>
            <translate y="-1" z="-4"/></transform><bsdf type="diffuse"/></shape>
        <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>"#,
    )
}

/// Reaches for an error of `target` where the errors are those of `errors`, look by look. Returns why it ended, the samples at
/// each look, and those at the end.
fn reach(target: f64, most: Budget, errors: &[Option<f64>]) -> (Ending, Vec<u32>, u32) {
    let scene = floor();
    let threads = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
    let mut rendering = Rendering::new(&scene, &RenderSettings::default());
    let mut looks = Vec::new();
    let judge = |samples: u32, layers: &quietlight_denoise::Layers| {
        let counts = layers.samples.as_ref().expect("counts");
        assert!(counts.iter().all(|&count| count == samples as f32), "the layers are of {samples}");
        looks.push(samples);
        Ok::<_, Infallible>(errors[looks.len() - 1])
    };
    let stop = AtomicBool::new(false);
    let advance = |rendering: &mut Rendering<'_>, samples| {
        threads.install(|| rendering.advance(samples, &|_| {}, &stop));
    };
    let Ok(ending) =
        Target { error: target, most }.reach(&mut rendering, &threads, advance, &stop, judge);
    let samples = rendering.samples();
    (ending, looks, samples)
}

#[test]
fn rendering_ends_with_the_first_picture_that_is_good_enough_and_not_before() {
    let most = Budget::Samples(4096);
    // 0.0100001 is not 0.01, whatever it is printed as.
    let errors = [0.04, 0.020_000_1, 0.010_000_1, 0.01].map(Some);
    let (ending, looks, samples) = reach(0.01, most, &errors);
    assert_eq!((ending, looks.len()), (Ending::Reached, 4), "{looks:?}");
    assert_eq!(looks.last(), Some(&samples), "nothing was added after the last look");
    assert!(looks.windows(2).all(|pair| pair[1] > pair[0] && pair[1] <= 4 * pair[0]), "{looks:?}");
    assert_eq!(reach(0.01, most, &[None]).0, Ending::Unknown);
}

#[test]
fn no_more_is_spent_than_may_be() {
    let errors = [Some(1.0); 64];
    let (ending, looks, samples) = reach(1e-9, Budget::Samples(100), &errors);
    assert_eq!((ending, samples), (Ending::Spent, 100), "{looks:?}");
    assert_eq!(reach(1e-9, Budget::Samples(3), &errors).2, 3);
    // Time that is over before the first look leaves that look.
    let (ending, looks, _) = reach(1e-9, Budget::Time(Duration::ZERO), &errors);
    assert_eq!((ending, looks.len()), (Ending::Spent, 1));
}

#[test]
fn a_stop_is_heeded_between_looks() {
    let scene = floor();
    let threads = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
    let mut rendering = Rendering::new(&scene, &RenderSettings::default());
    let stop = AtomicBool::new(false);
    let mut looks = 0;
    let target = Target { error: 1e-9, most: Budget::Samples(1 << 20) };
    let advance = |rendering: &mut Rendering<'_>, samples| {
        threads.install(|| rendering.advance(samples, &|_| {}, &stop));
    };
    let Ok(ending) = target.reach(&mut rendering, &threads, advance, &stop, |_, _| {
        looks += 1;
        stop.store(looks == 2, Ordering::Relaxed);
        Ok::<_, Infallible>(Some(1.0))
    });
    assert_eq!((ending, looks), (Ending::Stopped, 2));
}

fn render(arguments: &[&str], folder: &Path) -> (serde_json::Value, Output) {
    let scene = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box");
    let done = Command::new(env!("CARGO_BIN_EXE_quietlight"))
        .arg("render")
        .arg(scene)
        .args(["--size", "32x32", "--json", "-o", "out.exr"])
        .args(if arguments.iter().any(|argument| argument.starts_with("--denoiser")) {
            &[][..]
        } else {
            &["--denoiser", "bilateral"]
        })
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the binary runs");
    let json = serde_json::from_slice(&done.stdout).unwrap_or_default();
    (json, done)
}

#[test]
fn the_error_asked_for_is_that_of_the_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (outcome, done) = render(&["--target-error", "0.02"], folder.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let estimate = outcome["estimated_relative_l2"].as_f64().expect("an estimate");
    let samples = outcome["samples"].as_u64().expect("samples");
    assert!(estimate <= 0.02 && (8..4096).contains(&samples), "{estimate} at {samples}");
    let layers = exr::read(&folder.path().join("out.exr")).expect("the EXR").layers;
    let error = layers.error.expect("the map of the error");
    let mean = f64::from(error.sum()) / error.len() as f64;
    assert!((mean / estimate - 1.0).abs() < 1e-4, "{mean} {estimate}");
    assert!(layers.metadata["estimated_relative_l2"].contains("90 %"));
    assert_eq!(f64::from(layers.samples.expect("counts")[[0, 0, 0]]), samples as f64);

    // The same number of samples asked for directly: the same picture.
    let name = samples.to_string();
    let (again, _) = render(&["--spp", &name], folder.path());
    assert_eq!(again["estimated_relative_l2"], outcome["estimated_relative_l2"]);
}

#[test]
fn an_error_out_of_reach_is_told_and_time_is_for_all_there_is_to_do() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (outcome, done) = render(&["--target-error", "1e-9", "--spp", "9"], folder.path());
    assert!(done.status.success() && outcome["samples"] == 9, "{outcome}");
    assert!(String::from_utf8_lossy(&done.stderr).contains("was not reached"));
    // A tenth of the time is left for rendering, whatever the rest takes, and at least one sample comes of it.
    let (outcome, done) = render(&["--time", "10ms"], folder.path());
    assert!(done.status.success() && outcome["samples"].as_u64() >= Some(1), "{outcome}");
    let (_, refused) = render(&["--target-error", "-1"], folder.path());
    assert_eq!(refused.status.code(), Some(2));
    let (outcome, _) = render(&["--spp", "4", "--no-estimate"], folder.path());
    assert!(outcome["estimated_relative_l2"].is_null() && outcome["denoiser"].is_object());
    let layers = exr::read(&folder.path().join("out.exr")).expect("the EXR").layers;
    assert!(layers.error.is_none() && layers.layers.contains_key(&LayerKind::Beauty));
}

/// Dark, but for a lamp that path tracing finds by chance: what a pilot sees of it tells much of its own luck.
fn lamp() -> Scene {
    scene_around(
        8,
        50.0,
        3,
        r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="5"/>
            <translate y="-1" z="-4"/></transform><bsdf type="diffuse"/></shape>
        <shape type="sphere"><point name="center" x="0" y="1" z="-4"/><float name="radius" value="0.3"/>
            <emitter type="area"><rgb name="radiance" value="20"/></emitter></shape>"#,
    )
}

#[test]
fn where_samples_go_does_not_change_the_mean() {
    // The error that is told is the brightness of the pilot itself, of four samples by chance alone: the bright pixels of a lucky
    // pilot get up to 64 times the samples of others. 400 pictures against 400 even ones, by their means; independent, so that
    // the bound is 4 standard errors.
    let scene = lamp();
    let threads = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
    let stop = AtomicBool::new(false);
    let by_chance = quietlight::integrator::PathTracing {
        strategy: quietlight::integrator::Strategy::Bsdf,
        ..Default::default()
    };
    let mean_and_error = |adapts: bool| {
        let means: Vec<f64> = (0..400)
            .map(|seed| {
                let settings = RenderSettings {
                    budget: Budget::Samples(16),
                    seed: seed + if adapts { 1000 } else { 0 },
                    sampler: SamplerKind::Independent,
                    integrator: by_chance.into(),
                    is_adaptive: true,
                    ..RenderSettings::default()
                };
                let rendered = threads.install(|| {
                    let mut rendering = Rendering::new(&scene, &settings);
                    rendering.run(settings.budget, &|_| {}, &stop);
                    let pilot = &rendering.layers().layers[&LayerKind::Beauty].mean;
                    let brightness = pilot.slice(ndarray::s![0..1, .., ..]).to_owned();
                    rendering.spread(adapts.then_some(&brightness));
                    rendering.run(settings.budget, &|_| {}, &stop);
                    rendering.finish()
                });
                assert!(rendered.samples > 4, "beyond the pilot");
                let layer = &rendered.layers.layers[&LayerKind::Beauty];
                let [a, b] = layer.halves.as_ref().expect("halves");
                let difference = (a + b) * 0.5 - &layer.mean;
                assert!(difference.iter().all(|difference| difference.abs() < 1e-4));
                f64::from(layer.mean.sum()) / layer.mean.len() as f64
            })
            .collect();
        let count = means.len() as f64;
        let mean = means.iter().sum::<f64>() / count;
        let variance = means.iter().map(|m| (m - mean) * (m - mean)).sum::<f64>() / (count - 1.0);
        (mean, (variance / count).sqrt())
    };
    let ((even, even_error), (found, error)) = (mean_and_error(false), mean_and_error(true));
    let bound = 4.0 * even_error.hypot(error);
    assert!((found - even).abs() < bound, "{found} and {even}, bound {bound}");
    assert!(bound < 0.1 * even, "{bound} sees no bias worth the name, of {even}");
}

#[test]
fn adaptive_pictures_have_all_layers_and_whole_counts() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (outcome, done) = render(&["--spp", "32", "--adaptive"], folder.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let layers = exr::read(&folder.path().join("out.exr")).expect("the EXR").layers;
    let counts = layers.samples.as_ref().expect("counts");
    let mean = f64::from(counts.sum()) / counts.len() as f64;
    // Counts are rounded up to pairs, by less than one sample on average.
    assert!((mean - 32.0).abs() <= 1.5, "{mean} samples on average");
    assert!(counts.iter().any(|&count| count > 40.0) && counts.iter().any(|&count| count < 28.0));
    assert!(outcome["facts"]["adaptive"].is_string());
    let sum = &layers.layers[&LayerKind::Diffuse].mean + &layers.layers[&LayerKind::Specular].mean;
    assert_eq!(sum, layers.layers[&LayerKind::Beauty].mean);
    let (_, again) = render(&["--spp", "32", "--adaptive", "--threads", "1"], folder.path());
    assert!(again.status.success());
    let same = exr::read(&folder.path().join("out.exr")).expect("the EXR").layers;
    assert_eq!(same.layers[&LayerKind::Beauty].mean, layers.layers[&LayerKind::Beauty].mean);
    for refused in [["--adaptive", "--denoiser=none"], ["--adaptive", "--integrator=bdpt"]] {
        assert_eq!(render(&refused, folder.path()).1.status.code(), Some(2));
    }
}

#[test]
fn a_budget_of_time_is_spent_adaptively_where_there_is_enough_of_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = ["--integrator", "path", "--threads", "1"];
    for (asked, adapts) in [
        // A millisecond of a thread for a pixel, or a tenth of one.
        (&["--time", "1s"][..], true),
        (&["--time", "100ms"], false),
        (&["--time", "1s", "--adaptive=off"], false),
        (&["--time", "1s", "--denoiser", "none"], false),
        (&["--spp", "64"], false),
    ] {
        let (outcome, done) = render(&[&path[..], asked].concat(), folder.path());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        assert_eq!(outcome["facts"]["adaptive"].is_string(), adapts, "{asked:?}: {outcome}");
    }
}

#[test]
fn merged_adaptive_pictures_are_weighted_by_what_was_not_found() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut pictures = Vec::new();
    for (seed, samples) in [("1", "16"), ("2", "48")] {
        let asked = ["--adaptive", "--seed", seed, "--spp", samples, "--halves"];
        let (outcome, done) = render(&asked, folder.path());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let name = format!("{seed}.exr");
        std::fs::rename(folder.path().join("out.exr"), folder.path().join(&name)).expect("renamed");
        let contents = exr::read(&folder.path().join(&name)).expect("the EXR");
        let samples = outcome["samples"].as_u64().expect("samples") as f32;
        pictures.push((samples, contents.layers));
    }
    let done = Command::new(env!("CARGO_BIN_EXE_quietlight"))
        .args(["merge", "both.exr", "1.exr", "2.exr", "--denoiser", "none"])
        .current_dir(folder.path())
        .output()
        .expect("the binary runs");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let merged = exr::read(&folder.path().join("both.exr")).expect("the EXR").layers;
    assert!(merged.metadata.contains_key("adaptive"), "merged again, it is still known");
    let of = |layers: &quietlight_denoise::Layers| layers.layers[&LayerKind::Beauty].mean.clone();
    let [(n, a), (m, b)] = &pictures[..] else { unreachable!("two pictures") };
    let expected = (of(a) * *n + of(b) * *m) / (n + m);
    let worst = (of(&merged) - &expected) / (&expected + 1e-3);
    assert!(worst.iter().all(|difference| difference.abs() < 1e-5), "weights are those of counts");
}
