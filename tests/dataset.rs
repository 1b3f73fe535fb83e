//! Data sets: every view is what its number says, whoever makes it and however often the work is interrupted.

use ndarray::s;
use quietlight::dataset::export::export;
use quietlight::dataset::manifest::{Split, records};
use quietlight::dataset::merge::merge;
use quietlight::dataset::{
    Error, Job, Manifest, Outcome, Record, Settings, Shard, View, contact_sheet,
};
use quietlight::folder;
use quietlight::render::{Budget, RenderSettings, render};
use quietlight::scene::{LoadOptions, Scene};
use quietlight_denoise::picture::read_picture;
use quietlight_denoise::{LayerKind, exr};
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;

/// Tiny views of our own scenes: 12×12 pixels, a few samples.
fn settings() -> Settings {
    let scene = |name: &str| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    Settings {
        seed: 5,
        scenes: vec![scene("cornell-box"), scene("mis-plates")],
        crop: 12,
        noisy: 2,
        min_spp: 1,
        max_spp: 4,
        reference_spp: 8,
        reference_noise: 1e-3,
    }
}

fn job(folder: &Path, settings: &Settings, views: u32) -> Job {
    Job {
        folder: folder.to_path_buf(),
        settings: settings.clone(),
        views,
        shard: Shard::WHOLE,
        threads: 2,
        keep_scenes: false,
    }
}

fn make(job: Job) -> Outcome {
    let plan = job.plan().expect("the plan is sound");
    plan.run(&|_| {}, &AtomicBool::new(false)).expect("the views are made")
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// All views of a set, none of which may have been skipped.
fn rendered(folder: &Path) -> Vec<View> {
    let records = records(folder).expect("the views can be read").into_iter();
    let rendered = records.map(|record| match record {
        Record::Rendered(view) => view,
        Record::Skipped(view) => panic!("{} was skipped: {}", view.identity.id, view.reason),
    });
    rendered.collect()
}

/// The bytes of every file below a folder. Of `view.json` without the seconds, which no two runs share.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
                continue;
            }
            let mut bytes = fs::read(&path).expect("a file");
            if path.ends_with("view.json") {
                let text = String::from_utf8(bytes).expect("text");
                let lines = text.lines().filter(|line| !line.contains("\"seconds\""));
                bytes = lines.collect::<Vec<_>>().join("\n").into_bytes();
            }
            found.insert(path.strip_prefix(folder).expect("below").to_path_buf(), bytes);
        }
    }
    found
}

/// Two folders have the same files, to the last bit.
fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (contents(a), contents(b));
    let all: BTreeSet<&PathBuf> = a.keys().chain(b.keys()).collect();
    let different: Vec<_> = all.into_iter().filter(|path| a.get(*path) != b.get(*path)).collect();
    assert!(different.is_empty(), "{different:?} differ");
}

#[test]
fn shards_put_together_are_what_one_process_makes() {
    let (whole, first, second, merged) = (folder(), folder(), folder(), folder());
    assert_eq!(make(job(whole.path(), &settings(), 5)).rendered, 5);
    for (shard, threads, part) in [("0/2", 1, &first), ("1/2", 3, &second)] {
        let shard = shard.parse().expect("a shard");
        make(Job { shard, threads, ..job(part.path(), &settings(), 5) });
    }
    assert_eq!(rendered(first.path()).len(), 3);
    let inputs = [&first, &second].map(|part| part.path().to_path_buf());
    assert_eq!(merge(merged.path(), &inputs).expect("the shards fit").copied, 5);
    assert_same(merged.path(), whole.path());
    // Once more changes nothing.
    let again = merge(merged.path(), &inputs).expect("the shards fit");
    assert_eq!((again.copied, again.already_there), (0, 5));
}

#[test]
fn half_written_views_are_made_again_and_complete_ones_are_left() {
    let (whole, broken) = (folder(), folder());
    make(job(whole.path(), &settings(), 3));
    make(job(broken.path(), &settings(), 3));
    let view = |id: &str| View::folder(broken.path(), id);
    fs::remove_file(view("000001").join("view.json")).expect("there was one");
    fs::write(view("000001").join("noisy-0.exr"), "half of it").expect("written");
    fs::write(view("000001").join("noisy-7.exr"), "of another run").expect("written");
    let untouched = view("000000").join("reference.exr");
    let written =
        |path: &Path| fs::metadata(path).and_then(|facts| facts.modified()).expect("a time");
    let before = written(&untouched);
    assert_eq!(make(job(broken.path(), &settings(), 3)).rendered, 1);
    assert_same(broken.path(), whole.path());
    assert_eq!(written(&untouched), before);
    // A set may grow: the first views stay what they are.
    assert_eq!(make(job(broken.path(), &settings(), 4)).rendered, 1);
    assert_eq!(Manifest::read(broken.path()).expect("a manifest").views, 4);
    fs::remove_dir_all(view("000003")).expect("the new view");
    assert_same(&broken.path().join("views"), &whole.path().join("views"));
}

#[test]
fn the_disk_use_stated_is_that_of_the_views_there_are() {
    let folder = folder();
    let stated = job(folder.path(), &settings(), 10).plan().expect("the plan is sound").needed;
    // Two noisy renders of 97 channels and a reference of 51, 12×12 floats each, half of it left by compression.
    assert_eq!(stated, 10 * (2 * 97 + 51) * 144 * 4 / 2);
    make(job(folder.path(), &settings(), 8));
    let taken: u64 = (0..8)
        .flat_map(|number| {
            fs::read_dir(View::folder(folder.path(), &View::id(number))).expect("a view")
        })
        .map(|file| file.and_then(|file| file.metadata()).expect("a file").len())
        .sum();
    let plan = job(folder.path(), &settings(), 10).plan().expect("the plan is sound");
    assert_eq!((plan.len(), plan.complete, plan.needed), (2, 8, taken / 8 * 2));
    assert!(plan.free.is_none_or(|free| free > plan.needed));
}

#[test]
fn an_interrupted_run_leaves_no_half_written_view() {
    let folder = folder();
    let plan = job(folder.path(), &settings(), 4).plan().expect("the plan is sound");
    let stop = AtomicBool::new(false);
    // Asked to stop when the first view is complete, while the other worker is at its own.
    let outcome = plan.run(&|_| stop.store(true, std::sync::atomic::Ordering::Relaxed), &stop);
    let outcome = outcome.expect("stopping is no failure");
    assert!(outcome.is_interrupted && (1..=2).contains(&outcome.rendered), "{outcome:?}");
    let folders = fs::read_dir(folder.path().join("views")).expect("a folder").count();
    assert_eq!(folders, outcome.rendered);
}

#[test]
fn other_settings_are_refused_and_named() {
    let folder = folder();
    make(job(folder.path(), &settings(), 1));
    let before = contents(folder.path());
    let other = Settings { crop: 16, max_spp: 8, ..settings() };
    let error = job(folder.path(), &other, 1).plan().expect_err("the settings differ").to_string();
    assert!(error.contains("crop: 16, not 12") && error.contains("max-spp: 8, not 4"), "{error}");
    assert!(!error.contains("noisy"), "{error}");
    assert!(contents(folder.path()) == before, "a refused command changed something");
}

#[test]
fn sets_that_disagree_are_not_merged() {
    let (first, other, merged) = (folder(), folder(), folder());
    make(job(first.path(), &settings(), 2));
    make(job(other.path(), &Settings { seed: 6, ..settings() }, 2));
    let inputs = [&first, &other].map(|set| set.path().to_path_buf());
    assert!(matches!(
        merge(merged.path(), &inputs),
        Err(Error::Folder(folder::Error::Settings { .. }))
    ));
    // The same settings, but another picture under one id.
    let forged = folder();
    make(job(forged.path(), &settings(), 1));
    let path = View::folder(forged.path(), "000000").join("view.json");
    let text = fs::read_to_string(&path).expect("a view");
    let hash = &rendered(forged.path())[0].reference.sha256;
    fs::write(&path, text.replace(hash, &"0".repeat(64))).expect("written");
    let inputs = [&first, &forged].map(|set| set.path().to_path_buf());
    assert!(matches!(merge(merged.path(), &inputs), Err(Error::Conflict { .. })));
    // A file that is not what its view says.
    let inputs = [forged.path().to_path_buf()];
    assert!(matches!(
        merge(merged.path(), &inputs),
        Err(Error::Folder(folder::Error::File(quietlight_denoise::Error::Format { .. })))
    ));
    assert!(records(merged.path()).expect("a folder").is_empty(), "nothing was taken over");
}

#[test]
fn renders_of_a_view_share_no_seed_and_no_noise() {
    let folder = folder();
    let settings = Settings { noisy: 3, min_spp: 4, ..settings() };
    make(job(folder.path(), &settings, 4));
    let mut seeds = HashSet::new();
    for view in rendered(folder.path()) {
        let noisy = view.noisy.iter().map(|noisy| (noisy.seed, &noisy.file, noisy.spp));
        let mut pictures = Vec::new();
        for (seed, file, spp) in
            noisy.chain([(view.reference.seed, &view.reference.file, view.reference.spp)])
        {
            assert!(seeds.insert(seed), "{seed} twice");
            let path = View::folder(folder.path(), &view.identity.id).join(file);
            let contents = exr::read(&path).expect("an EXR");
            let layers = contents.layers;
            let facts = &layers.metadata["render"];
            assert!(facts.contains(&format!("seed {seed}, {spp} samples")), "{facts}");
            let counts = layers.samples.as_ref().expect("counts");
            assert!(counts.iter().all(|&count| count == spp as f32));
            let beauty = &layers.layers[&LayerKind::Beauty];
            assert_eq!(contents.picture.as_ref(), Some(&beauty.mean));
            for (kind, layer) in &layers.layers {
                assert!(layer.variance.is_some(), "{kind:?}");
                assert_eq!(layer.halves.is_some(), file != "reference.exr", "{kind:?} of {file}");
            }
            assert!(!pictures.contains(&beauty.mean), "{file} repeats another render");
            pictures.push(beauty.mean.clone());
        }
    }
}

#[test]
fn a_view_is_the_window_of_the_whole_frame_of_its_scene() {
    let folder = folder();
    let settings = Settings { scenes: Vec::new(), crop: 24, max_spp: 2, ..settings() };
    make(Job { keep_scenes: true, ..job(folder.path(), &settings, 2) });
    for view in rendered(folder.path()) {
        let id = &view.identity.id;
        let path = folder.path().join("scenes").join(id);
        let scene = Scene::load(&path, &LoadOptions::default()).expect("the kept scene loads");
        assert_eq!([scene.film.width, scene.film.height], view.film);
        assert_eq!(scene.film.crop, [0, 0, view.film[0], view.film[1]]);
        let noisy = &view.noisy[1];
        let whole = RenderSettings {
            budget: Budget::Samples(noisy.spp),
            seed: noisy.seed,
            ..Default::default()
        };
        let whole = render(&scene, &whole, &|_| {}, &AtomicBool::new(false)).layers;
        let file = exr::read(&View::folder(folder.path(), id).join(&noisy.file)).expect("an EXR");
        let [x, y, width, height] = view.crop;
        assert_eq!([width, height], [24, 24]);
        assert_eq!(file.frame.offset, (x as i32, y as i32));
        assert_eq!(file.frame.display, (view.film[0] as usize, view.film[1] as usize));
        let [x, y] = [x as usize, y as usize];
        for (kind, layer) in &whole.layers {
            let part = layer.mean.slice(s![.., y..y + 24, x..x + 24]);
            assert_eq!(part, file.layers.layers[kind].mean, "{kind:?} of {id}");
        }
    }
}

#[test]
fn a_reference_doubles_until_it_is_converged() {
    let counts = |reference_noise, reference_spp| {
        let folder = folder();
        let settings =
            Settings { crop: 32, noisy: 1, reference_noise, reference_spp, ..settings() };
        make(job(folder.path(), &settings, 1));
        let reference = rendered(folder.path()).remove(0).reference;
        (reference.spp, reference.exposed_relative_l2_noise)
    };
    let (least, noise) = counts(1e3, 2048);
    assert_eq!(least, 256, "enough at once");
    // A little below the noise of 256 samples: the next count does.
    let (next, less) = counts(0.9 * noise, 2048);
    assert!(next == 512 && less <= 0.9 * noise, "{next} {less} {noise}");
    assert_eq!(counts(0.0, 700).0, 700, "never enough");
}

#[test]
fn all_views_of_a_scene_are_of_one_split() {
    let folder = folder();
    make(job(folder.path(), &settings(), 4));
    let mut splits: BTreeMap<String, Split> = BTreeMap::new();
    for view in rendered(folder.path()) {
        let split = splits.entry(view.identity.scene_key.clone()).or_insert(view.identity.split);
        assert_eq!(*split, view.identity.split);
        assert_eq!(Split::of(&view.identity.scene_key), view.identity.split);
    }
    assert_eq!(splits.len(), 2);
    let validation = (0..3200u32).filter(|i| Split::of(&format!("scene {i}")) == Split::Validation);
    // 200 ± 4 standard deviations of √(3200 · 15/256).
    let count = validation.count();
    assert!((200 - 55..=200 + 55).contains(&count), "{count}");
}

#[test]
fn an_export_has_the_layout_of_open_image_denoise() {
    let (set, exported) = (folder(), folder());
    // Two renders of one sample count have to share a name's number.
    let settings = Settings { max_spp: 1, ..settings() };
    make(job(set.path(), &settings, 2));
    let total = export(set.path(), exported.path(), &|_| {}).expect("the set is exported");
    assert_eq!((total.views, total.renders), (2, 8));
    let splits: BTreeMap<String, Split> = rendered(set.path())
        .into_iter()
        .map(|view| (view.identity.id, view.identity.split))
        .collect();
    let mut expected = Vec::new();
    for (id, split) in &splits {
        let split = if *split == Split::Train { "train" } else { "valid" };
        for name in [id.clone(), format!("{id}-1")] {
            for render in ["0001spp", "ref"] {
                for feature in ["hdr", "alb", "nrm"] {
                    expected.push(PathBuf::from(format!("{split}/{name}_{render}.{feature}.exr")));
                }
            }
        }
    }
    expected.sort();
    assert_eq!(contents(exported.path()).into_keys().collect::<Vec<_>>(), expected);
    let layers =
        exr::read(&View::folder(set.path(), "000001").join("noisy-1.exr")).expect("an EXR").layers;
    let split = if splits["000001"] == Split::Train { "train" } else { "valid" };
    for (kind, feature) in
        [(LayerKind::Beauty, "hdr"), (LayerKind::Albedo, "alb"), (LayerKind::Normal, "nrm")]
    {
        let name = format!("000001-1_0001spp.{feature}.exr");
        let picture = read_picture(&exported.path().join(split).join(name)).expect("a picture");
        assert_eq!(picture, layers.layers[&kind].mean);
    }
}

#[test]
fn a_contact_sheet_shows_noisy_and_reference_side_by_side() {
    let set = folder();
    make(job(set.path(), &settings(), 3));
    let output = set.path().join("sheet.png");
    let ids = contact_sheet::write(set.path(), 100, &output).expect("a sheet");
    assert_eq!(ids, ["000000", "000001", "000002"]);
    // Two rows of two views, each two squares of 128.
    let sheet = read_picture(&output).expect("a PNG");
    assert_eq!(sheet.dim(), (3, 256, 512));
    let place =
        |y: usize, x: usize| sheet.slice(s![.., 128 * y..128 * y + 12, 128 * x..128 * x + 12]);
    for (y, x) in [(0, 0), (0, 2), (1, 0)] {
        assert!(place(y, x).iter().any(|&value| value > 0.0), "{y} {x}");
        assert_ne!(place(y, x), place(y, x + 1), "noisy and reference of {y} {x}");
    }
    assert!(place(1, 2).iter().all(|&value| value == 0.0), "there is no fourth view");
    assert_eq!(contact_sheet::write(set.path(), 2, &output).expect("a sheet").len(), 2);
}

#[test]
fn a_scene_that_breaks_is_noted_and_the_others_go_on() {
    let (set, scenes) = (folder(), folder());
    let broken = scenes.path().join("broken.xml");
    fs::write(&broken, "<scene version=\"3.0.0\"><oops/></scene>").expect("written");
    let mut settings = settings();
    settings.scenes[1] = broken;
    let outcome = make(job(set.path(), &settings, 4));
    assert_eq!((outcome.rendered, outcome.skipped), (2, 2));
    let found = records(set.path()).expect("the views can be read");
    let Record::Skipped(view) = &found[1] else { panic!("{:?}", found[1]) };
    assert!(view.reason.contains("broken.xml:1:"), "{}", view.reason);
    // It is not tried again.
    assert_eq!(make(job(set.path(), &settings, 4)), Outcome::default());
}

#[test]
fn a_view_without_anything_in_it_is_refused() {
    let (set, scenes) = (folder(), folder());
    let black = scenes.path().join("black.xml");
    fs::write(
        &black,
        r#"<scene version="3.0.0"><sensor type="perspective"/>
        <shape type="sphere"><point name="center" x="0" y="0" z="4"/></shape></scene>"#,
    )
    .expect("written");
    let settings = Settings { scenes: vec![black], ..settings() };
    assert_eq!(make(job(set.path(), &settings, 1)).skipped, 1);
    let Record::Skipped(view) = &records(set.path()).expect("views")[0] else {
        panic!("not skipped")
    };
    assert!(view.reason.contains("nearly black") || view.reason.contains("background"), "{view:?}");
    assert!(view.identity.attempts > 1);
}
