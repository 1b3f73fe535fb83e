//! Budgets keep their word: errors are judged on the picture that is written, and nothing is spent beyond what may be.

use crate::support::scenes::scene_around;
use quietlight::render::{Budget, Ending, RenderSettings, Rendering, Target};
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
        .args(["--size", "32x32", "--denoiser", "bilateral", "--json", "-o", "out.exr"])
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
