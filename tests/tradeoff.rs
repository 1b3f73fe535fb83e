//! The trade of speed for accuracy: the same whoever measures it and however often the work is interrupted, its errors split as
//! they were made, its page whole.

use quietlight::dataset::Shard;
use quietlight::folder;
use quietlight::integrator::{Choice, Purpose};
use quietlight::scene::{LoadOptions, Scene};
use quietlight::tradeoff::merge::merge;
use quietlight::tradeoff::scores::{Point, SceneScores};
use quietlight::tradeoff::statistics::Reference;
use quietlight::tradeoff::unit::{ReferenceHalf, Run};
use quietlight::tradeoff::{
    CSV, Error, Filter, Job, Method, Outcome, PAGE, ReferenceBudget, Request, Scores, page,
};
use quietlight_denoise::Image;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use tempfile::TempDir;

use crate::support::random::Random;

const PIXELS: u32 = 12;

/// Tiny pictures of two of our own scenes.
fn request() -> Request {
    let scene = |name: &str| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    Request {
        scenes: vec![scene("cornell-box"), scene("mis-plates")],
        width: Some(PIXELS),
        integrators: vec![Method::Path, Method::Bdpt],
        denoisers: vec![Filter::None, Filter::Bilateral],
        samples: vec![8, 1, 2, 8],
        seeds: 2,
        seed: 3,
        reference: Some(ReferenceBudget::Samples(64)),
    }
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn job(folder: &Path, shard: &str) -> Job {
    let shard: Shard = shard.parse().expect("a shard");
    Job { folder: folder.to_path_buf(), request: request(), shard }
}

fn threads() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads start")
}

fn make(job: Job) -> Outcome {
    let plan = job.plan().expect("the plan is sound");
    plan.run(&threads(), &|_| {}, &AtomicBool::new(false)).expect("it is measured")
}

fn scores(folder: &Path) -> Scores {
    Scores::of(folder, &|_, _| {}).expect("the measurement can be read")
}

/// Everything but times, of all points.
fn facts(scores: &Scores) -> Vec<String> {
    let told = |scene: &SceneScores, point: &Point| {
        format!(
            "{} {} {} {} {:?} {:?} {:?} {:?} {:?} {:?}",
            scene.name,
            point.combination,
            point.samples,
            point.seeds,
            point.error,
            point.bias2,
            point.variance,
            point.psnr,
            point.flip,
            scene.reference.noise
        )
    };
    let scenes = scores.scenes.iter();
    scenes.flat_map(|scene| scene.points.iter().map(move |point| told(scene, point))).collect()
}

/// The bytes of all pictures.
fn pictures(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut found, mut open) = (BTreeMap::new(), vec![folder.to_path_buf()]);
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|ending| ending == "exr") {
                let below = path.strip_prefix(folder).expect("below").to_path_buf();
                found.insert(below, fs::read(&path).expect("a file"));
            }
        }
    }
    found
}

#[test]
fn shards_put_together_and_a_measurement_that_was_interrupted_are_what_one_run_makes() {
    let (whole, first, second, merged, stopped) =
        (folder(), folder(), folder(), folder(), folder());
    // Two halves of a reference and two seeds of two integrators, of two scenes.
    assert_eq!(make(job(whole.path(), "0/1")).made, 12);
    assert_eq!(make(job(first.path(), "0/2")).made + make(job(second.path(), "1/2")).made, 12);
    let inputs = [&first, &second].map(|part| part.path().to_path_buf());
    assert_eq!(merge(merged.path(), &inputs).expect("the shards fit").copied, 12);
    assert_eq!(merge(merged.path(), &inputs).expect("once more").already_there, 12);

    // Stopped in the first sample of the first run, and gone on with: four halves of references take 32 samples each, and
    // eight runs 8.
    let (calls, stop) = (AtomicU64::new(0), AtomicBool::new(false));
    let plan = job(stopped.path(), "0/1").plan().expect("the plan is sound");
    let share = plan.work() * (4 * 32) / (4 * 32 + 8 * 8);
    let heard = |done: u64| {
        calls.fetch_max(done, Ordering::Relaxed);
        stop.fetch_or(done > share, Ordering::Relaxed);
    };
    let outcome = plan.run(&threads(), &heard, &stop).expect("what there is stays");
    assert_eq!(outcome, Outcome { made: 4, is_interrupted: true });
    let plan = job(stopped.path(), "0/1").plan().expect("the plan is sound");
    assert_eq!((plan.complete, plan.len()), (outcome.made, 12 - outcome.made));
    let part = scores(stopped.path());
    assert_eq!(part.units, [outcome.made, 12]);
    assert_eq!(make(job(stopped.path(), "0/1")).made, 12 - outcome.made);
    assert!(make(job(stopped.path(), "0/1")) == Outcome::default(), "nothing is left to do");

    let expected = (facts(&scores(whole.path())), pictures(whole.path()));
    assert_eq!(expected.0.len(), 2 * 2 * 2 * 3);
    for other in [&merged, &stopped] {
        assert!(facts(&scores(other.path())) == expected.0, "the scores differ");
        assert!(pictures(other.path()) == expected.1, "the pictures differ");
    }
    other_settings_are_refused_and_more_seeds_are_added(whole.path());
    the_files_and_the_page_are_whole(merged.path());
}

fn other_settings_are_refused_and_more_seeds_are_added(whole: &Path) {
    let other = Request { samples: vec![1, 2], ..request() };
    let refused = Job { request: other, ..job(whole, "0/1") }.plan();
    let Err(Error::Folder(folder::Error::Settings { differences, .. })) = refused else {
        panic!("{refused:?}")
    };
    assert!(differences.contains("samples [1, 2, 8] there, [1, 2] here"), "{differences}");
    let wider = Request { width: Some(16), ..request() };
    assert!(matches!(
        Job { request: wider, ..job(whole, "0/1") }.plan(),
        Err(Error::Folder(folder::Error::Settings { .. }))
    ));
    let more = Request { seeds: 3, ..request() };
    let plan = Job { request: more, ..job(whole, "0/1") }.plan().expect("seeds may be added");
    assert_eq!((plan.complete, plan.len()), (12, 4));
}

fn the_files_and_the_page_are_whole(folder: &Path) {
    let scores = scores(folder);
    scores.write_csv(folder).expect("the table is written");
    scores.write_json(folder).expect("the scores are written");
    page::write(folder, &scores).expect("the page is written");

    let table = fs::read_to_string(folder.join(CSV)).expect("a table");
    let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert!(lines.len() == 25 && lines.iter().all(|line| line.len() == lines[0].len()));
    let json = fs::read_to_string(folder.join("scores.json")).expect("scores");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["scenes"][1]["points"].as_array().map(Vec::len), Some(12));

    let html = fs::read_to_string(folder.join(PAGE)).expect("a page");
    assert!(html.len() < 8_000_000, "{} bytes", html.len());
    let (frame, scripts) = without_scripts(&html);
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(&frame, options)
        .unwrap_or_else(|error| panic!("the page is not well formed: {error}"));
    let ids: Vec<&str> = document.descendants().filter_map(|node| node.attribute("id")).collect();
    assert_eq!(ids, ["cornell-box", "mis-plates", "data"]);
    // Nothing is fetched: every address is in the page itself, and browsers are told to fetch nothing.
    for node in document.descendants() {
        for name in ["src", "href", "srcset", "action", "data"] {
            let address = node.attribute(name).unwrap_or("#");
            assert!(address.starts_with('#') || address.starts_with("data:"), "{address}");
        }
        let text = node.text().unwrap_or_default();
        assert!(!text.contains("url(") && !text.contains("@import"), "{}", node.tag_name().name());
    }
    let policy = document
        .descendants()
        .find(|node| node.attribute("http-equiv") == Some("Content-Security-Policy"));
    let policy = policy.and_then(|node| node.attribute("content")).expect("a policy");
    assert!(policy.starts_with("default-src 'none'") && !policy.contains("http"), "{policy}");
    let data: serde_json::Value = serde_json::from_str(&scripts[0]).expect("the data are JSON");
    for scene in data.as_array().expect("scenes") {
        let shown = scene["pictures"]["shown"].as_array().expect("pictures");
        assert!(
            !shown.is_empty() && scene["front"].as_array().is_some_and(|front| !front.is_empty())
        );
        for picture in shown {
            let source = picture["map"].as_str().expect("a map");
            assert!(source.starts_with("data:image/png;base64,iVBOR"), "{source}");
        }
    }
}

/// The page without what stands in its scripts, and that.
fn without_scripts(html: &str) -> (String, Vec<String>) {
    let (mut frame, mut scripts, mut rest) = (String::new(), Vec::new(), html);
    while let Some(start) = rest.find("<script") {
        let begin = start + rest[start..].find('>').expect("a tag ends") + 1;
        let end = begin + rest[begin..].find("</script>").expect("a script ends");
        frame.push_str(&rest[..begin]);
        scripts.push(rest[begin..end].to_owned());
        rest = &rest[end..];
    }
    frame.push_str(rest);
    (frame, scripts)
}

#[test]
fn a_run_is_what_render_makes_of_its_seed_and_a_reference_has_seeds_of_its_own() {
    let folder = folder();
    let scene = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box");
    let request = Request {
        scenes: vec![scene.clone()],
        integrators: vec![Method::Path, Method::Pssmlt],
        denoisers: vec![Filter::None],
        seeds: 1,
        ..request()
    };
    make(Job { request, ..job(folder.path(), "0/1") });
    let options = LoadOptions { size: Some((PIXELS, PIXELS)), ..LoadOptions::default() };
    let scene = Scene::load(&scene, &options).expect("the scene loads");
    let settings = crate::support::scenes::settings(2, 3, quietlight::integrator::Strategy::Mis);
    let settings = quietlight::render::RenderSettings {
        sampler: quietlight::render::SamplerKind::Sobol,
        ..settings
    };
    let rendered = crate::support::scenes::render_finite(&scene, &settings);
    let run = folder.path().join("runs/cornell-box/path-3");
    let record = Run::read(&run).expect("a record");
    let two = &record.measures[1];
    assert_eq!((two.samples, two.pictures[0].file.as_str()), (2, "0000002-none.exr"));
    let picture = quietlight_denoise::picture::read_picture(&run.join(&two.pictures[0].file));
    let (mean, _) = crate::support::scenes::layer(&rendered, quietlight_denoise::LayerKind::Beauty);
    assert_eq!(&picture.expect("a picture"), mean);
    // Times of one render that goes on can only rise.
    assert!(
        record.measures.windows(2).all(|pair| pair[0].render_seconds <= pair[1].render_seconds)
    );

    let halves = ["a", "b"].map(|half| folder.path().join("references/cornell-box").join(half));
    let [a, b] = [&halves[0], &halves[1]].map(|half| ReferenceHalf::read(half).expect("a half"));
    assert_eq!((a.samples, b.samples), (32, 32));
    assert!(a.seed != b.seed && a.seed > 1 << 62 && b.seed > 1 << 62);
    assert_eq!(a.integrator, Choice::of(&scene, Purpose::default()).integrator.name());
}

/// A picture of `truth`, off by `bias` and by noise of that deviation, uniform so that its variance is exact.
fn noisy(truth: &Image, bias: f32, deviation: f32, random: &mut Random) -> Image {
    let half_width = deviation * 3f32.sqrt();
    truth.mapv(|value| value + bias + half_width * (2.0 * random.next_f32() - 1.0))
}

#[test]
fn known_bias_and_variance_are_found_whatever_the_noise_of_the_reference() {
    let mut random = Random::new(11);
    let truth = Image::from_shape_fn((3, 200, 200), |(channel, y, x)| {
        0.2 + 0.1 * channel as f32 + ((x + 2 * y) % 7) as f32 / 10.0
    });
    let scale = truth.mapv(|r| f64::from(1.0 / (r * r + 0.01)));
    let per_square = scale.mean().expect("pixels");
    let (bias, deviation, of_reference) = (0.02f32, 0.05f32, 0.01f32);
    let halves = [(); 2].map(|()| noisy(&truth, 0.0, of_reference, &mut random));
    let reference = Reference::new(halves);
    let replicates: Vec<Image> =
        (0..4).map(|_| noisy(&truth, bias, deviation, &mut random)).collect();
    let split = reference.split(&replicates);
    // b², σ² and ρ²: of bias, replicates, and halves of the reference.
    let square = |value: f32| f64::from(value) * f64::from(value);
    let (b2, sigma2, rho2) = (square(bias), square(deviation), square(of_reference));
    // The sum of n = 120 000 terms of deviation d with the weights w = 1/(r² + 0.01), over n, deviates by d √(〈w²〉/n).
    let weight = (scale.mapv(|w| w * w).mean().expect("pixels") / truth.len() as f64).sqrt();

    // Each term is a sample variance of four, of a relative variance below 2/3 (that of normal noise; uniform noise has
    // less). The mean of the halves, of variance ρ²/2, stands in the denominator and raises w on average by w'' ρ²/4: at most
    // 1760/4 · 1e-4 = 0.044 of 20, at r = 0.2.
    let found = split.variance.expect("four replicates");
    let bound = 4.0 * (2.0f64 / 3.0).sqrt() * sigma2 * weight + 0.0025 * sigma2 * per_square;
    assert!((found / per_square - sigma2).abs() < bound / per_square, "{found}, ± {bound}");
    assert!(bound < 0.03 * sigma2 * per_square, "the test would see nothing");

    // bias² is (m − r₁)(m − r₂) − v/4, where m has a variance of σ²/4: a term has a variance of at most
    // b²(2ρ² + 4 σ²/4) + 3(σ²/4 + ρ²)². With the denominator it shares the noise of the halves: − b(e₁ + e₂) · w'(e₁ + e₂)/2
    // is on average − b w' ρ², relative to b² w at most 2r/(r² + 0.01) ρ²/b = 0.04, at r = 0.2; the second orders are
    // ρ² w''/4w = 0.0022 and w'' ρ⁴/4 / (b² w) = 0.0006.
    let term = b2 * (2.0 * rho2 + sigma2) + 3.0 * (sigma2 / 4.0 + rho2).powi(2);
    let found = split.bias2.expect("four replicates");
    let bound = 4.0 * term.sqrt() * weight + 0.043 * b2 * per_square;
    assert!((found / per_square - b2).abs() < bound / per_square, "{found}, ± {bound}");
    assert!(bound < 0.2 * b2 * per_square, "the test would see nothing: {bound}");
    // Without taking v/4 away it would be σ²/4 = 6.25e-4 more than b² = 4e-4.

    // The parts are the whole.
    let mean = split.errors.iter().sum::<f64>() / 4.0;
    assert!((mean - found - split.variance.expect("four")).abs() < 1e-6 * mean);
    // The noise of the mean of both halves is ρ²/2, and a picture without noise or bias has no error: e₁ e₂ has a variance of
    // ρ⁴ and, with the denominator, a mean of w'' ρ⁴/4 = 4.4e-6 at most.
    assert!((reference.noise / (rho2 / 2.0 * per_square) - 1.0).abs() < 0.05);
    let bound = 4.0 * rho2 * weight + 4.4e-6;
    let none = reference.error(&truth);
    assert!(none.abs() < bound && bound < 0.1 * reference.noise, "{none} of {}", reference.noise);
}
