//! The claims about all scenes, over the first seeds.

use super::pattern::Pattern;
use super::*;
use crate::render::{Budget, RenderSettings, render};
use quietlight_denoise::LayerKind;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;
use std::sync::atomic::AtomicBool;

/// Seeds that all claims are about.
const SEEDS: u64 = 200;

/// What became of a seed.
struct Outcome {
    seed: u64,
    generated: Generated,
    warnings: Vec<String>,
    triangles: usize,
    bytes: u64,
    /// Of every tenth seed.
    picture: Option<Picture>,
}

/// A tiny picture.
struct Picture {
    invalid: u64,
    /// Share of pixels that are black.
    black: f64,
    mean: f64,
}

/// Generated once for all tests.
static OUTCOMES: LazyLock<Vec<Outcome>> =
    LazyLock::new(|| (0..SEEDS).into_par_iter().map(outcome).collect());

fn outcome(seed: u64) -> Outcome {
    let folder = tempfile::tempdir().unwrap();
    let generated = generate(seed, folder.path()).unwrap();
    let options = LoadOptions { size: Some((24, 18)), ..LoadOptions::default() };
    let scene = Scene::load(&generated.scene, &options).unwrap();
    Outcome {
        seed,
        warnings: scene.warnings.clone(),
        triangles: scene.geometry.triangle_count(),
        bytes: contents(folder.path()).values().map(|bytes| bytes.len() as u64).sum(),
        picture: seed.is_multiple_of(10).then(|| picture(&scene)),
        generated,
    }
}

fn picture(scene: &Scene) -> Picture {
    let settings = RenderSettings { budget: Budget::Samples(16), ..RenderSettings::default() };
    let rendered = render(scene, &settings, &|_| (), &AtomicBool::new(false));
    let beauty = &rendered.layers.layers[&LayerKind::Beauty].mean;
    assert!(beauty.iter().all(|value| value.is_finite()));
    let count = beauty.len() as f64;
    Picture {
        invalid: rendered.invalid_samples,
        black: beauty.iter().filter(|value| **value <= 0.0).count() as f64 / count,
        mean: beauty.iter().map(|value| f64::from(*value)).sum::<f64>() / count,
    }
}

/// The files of a folder and their bytes.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    files.map(|path| (name(&path), std::fs::read(&path).unwrap())).collect()
}

#[test]
fn scenes_load_without_warnings_and_are_of_modest_size() {
    for Outcome { seed, warnings, triangles, bytes, .. } in &*OUTCOMES {
        assert_eq!(*warnings, Vec::<String>::new(), "seed {seed}");
        assert!(*triangles < 250_000, "seed {seed}: {triangles} triangles");
        assert!(*bytes < 12_000_000, "seed {seed}: {bytes} bytes");
    }
    let mut triangles: Vec<usize> = OUTCOMES.iter().map(|outcome| outcome.triangles).collect();
    triangles.sort_unstable();
    assert!(triangles[9 * triangles.len() / 10] < 60_000, "{triangles:?}");
}

#[test]
fn pictures_are_finite_lit_and_neither_dark_nor_blinding() {
    let pictures: Vec<&Picture> =
        OUTCOMES.iter().filter_map(|outcome| outcome.picture.as_ref()).collect();
    assert!(pictures.iter().all(|picture| picture.invalid == 0));
    let share = |test: fn(&Picture) -> bool| {
        pictures.iter().filter(|picture| test(picture)).count() as f64 / pictures.len() as f64
    };
    assert!(share(|picture| picture.black < 0.35) >= 0.9);
    assert!(share(|picture| (0.005..10.0).contains(&picture.mean)) >= 0.95);
    assert!(share(|picture| (0.03..1.5).contains(&picture.mean)) >= 0.75);
}

#[test]
fn everything_occurs() {
    let tags: BTreeSet<&str> =
        OUTCOMES.iter().flat_map(|outcome| &outcome.generated.tags).map(String::as_str).collect();
    let wanted = [
        // Models of reflection and what is around them.
        "diffuse",
        "plastic",
        "roughplastic",
        "conductor",
        "roughconductor",
        "dielectric",
        "roughdielectric",
        "thindielectric",
        "blend",
        "mask",
        "bumpmap",
        "normalmap",
        "ggx",
        "beckmann",
        "anisotropic",
        "roughness-texture",
        "specular-texture",
        "glass",
        "mirror",
        // Lights.
        "area-light",
        "sphere-light",
        "strip-light",
        "point-light",
        "spot-light",
        "directional-light",
        "constant-environment",
        "environment-map",
        "sky",
        "sun",
        "studio",
        "night",
        "noise-environment",
        "hidden-light",
        "lampshade",
        "several-lights",
        "cove-light",
        // Sets.
        "room",
        "living-room",
        "cabinet",
        "hall",
        "bath",
        "open",
        "open-front",
        "window",
        "blinds",
        "door-ajar",
        "stairs",
        "terrace",
        "terrain",
        "backdrop",
        "plates",
        "pool",
        "still-life",
        "caustic",
        "thin",
        "dark",
        "defocus",
        "screen",
    ];
    let patterns = Pattern::ALL.map(Pattern::tag);
    let missing: Vec<&str> =
        wanted.into_iter().chain(patterns).filter(|tag| !tags.contains(tag)).collect();
    assert_eq!(missing, Vec::<&str>::new());
}

#[test]
fn no_kind_of_scene_is_rare_and_none_is_everything() {
    let share = |tag: &str| {
        let has = |outcome: &&Outcome| outcome.generated.tags.iter().any(|other| other == tag);
        OUTCOMES.iter().filter(has).count() as f64 / SEEDS as f64
    };
    // Four standard deviations of a binomial of 200 around the probabilities of the generator.
    assert!((share("room") - 0.55).abs() < 0.15, "{}", share("room"));
    assert!((share("defocus") - 0.15).abs() < 0.1, "{}", share("defocus"));
    assert!((0.2..0.8).contains(&share("glass")), "{}", share("glass"));
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let folders = [0, 0, 1].map(|_| tempfile::tempdir().unwrap());
    for (folder, seed) in folders.iter().zip([5, 5, 6]) {
        generate(seed, folder.path()).unwrap();
    }
    let [first, again, other] = folders.map(|folder| contents(folder.path()));
    assert!(first == again, "two runs of one seed differ");
    assert_ne!(first["scene.xml"], other["scene.xml"]);
}

#[test]
fn a_folder_that_cannot_be_made_is_told_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("taken");
    std::fs::write(&file, "").unwrap();
    let error = generate(1, &file).unwrap_err();
    assert!(matches!(error, Error::Io { .. }), "{error:?}");
    assert!(error.to_string().contains("taken"), "{error}");
}
