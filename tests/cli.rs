//! The command line as a person or a script uses it.
#![allow(clippy::print_stdout, reason = "the log of kills is asked for with --nocapture")]

use quietlight::render::State;
use quietlight_denoise::picture::read_picture;
use quietlight_denoise::{LayerKind, exr};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

fn quietlight(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_quietlight"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn own_scene(name: &str) -> String {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).display().to_string()
}

#[test]
fn render_writes_a_denoised_exr_with_all_layers_and_a_png() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let done = quietlight(
        &["render", &scene, "--size", "48x40", "--spp", "4", "--halves", "--json"],
        folder.path(),
    );
    assert!(done.status.success(), "{}", text(&done.stderr));
    let outcome: serde_json::Value =
        serde_json::from_slice(&done.stdout).expect("JSON on standard output");
    assert_eq!((outcome["width"].as_u64(), outcome["samples"].as_u64()), (Some(48), Some(4)));
    let contents = exr::read(&folder.path().join("cornell-box.exr")).expect("the EXR is whole");
    let layers = &contents.layers;
    for kind in [
        LayerKind::Beauty,
        LayerKind::Diffuse,
        LayerKind::Specular,
        LayerKind::Albedo,
        LayerKind::Normal,
    ] {
        let layer = layers.layers.get(&kind).unwrap_or_else(|| panic!("no layer {kind:?}"));
        assert!(layer.variance.is_some() && layer.halves.is_some(), "{kind:?}");
    }
    assert!(
        layers.samples.as_ref().is_some_and(|samples| samples.iter().all(|&count| count == 4.0))
    );
    assert_eq!(layers.metadata.get("seed").map(String::as_str), Some("0"));
    let picture = contents.picture.expect("a picture");
    assert_ne!(picture, layers.layers[&LayerKind::Beauty].mean, "the picture is denoised");
    let png = read_picture(&folder.path().join("cornell-box.png")).expect("the PNG is whole");
    assert_eq!(png.dim(), (3, 40, 48));
}

#[test]
fn a_written_file_denoises_again_to_the_same_picture() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let done = quietlight(
        &["render", &scene, "--size", "32x32", "--spp", "8", "-o", "first.exr"],
        folder.path(),
    );
    assert!(done.status.success(), "{}", text(&done.stderr));
    let done = quietlight(&["denoise", "first.exr", "-o", "second.exr"], folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let done = quietlight(
        &["compare", "second.exr", "first.exr", "--json", "--map", "map.png"],
        folder.path(),
    );
    assert!(done.status.success(), "{}", text(&done.stderr));
    let scores: serde_json::Value =
        serde_json::from_slice(&done.stdout).expect("JSON on standard output");
    assert_eq!(scores["relative_l2"].as_f64(), Some(0.0));
    assert!(folder.path().join("map.png").exists());
    // The noisy layer of the same file is another picture.
    let done = quietlight(
        &["compare", "second.exr", "first.exr", "--layer", "noisy", "--json"],
        folder.path(),
    );
    let scores: serde_json::Value =
        serde_json::from_slice(&done.stdout).expect("JSON on standard output");
    assert!(scores["relative_l2"].as_f64().is_some_and(|error| error > 0.0));
}

#[test]
fn bad_input_exits_with_2_says_where_and_writes_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(
        folder.path().join("bad.xml"),
        "<scene version=\"3.0.0\">\n  <shape type=\"spere\"/>\n  <sensor type=\"perspective\"/>\n</scene>",
    )
    .expect("the scene is written");
    let scene = own_scene("cornell-box");
    for (arguments, expected) in [
        (vec!["render", "missing.xml"], "missing.xml"),
        (vec!["render", "bad.xml"], "bad.xml:2:"),
        (vec!["render", &scene, "-o", "picture.jpg"], "*.exr"),
        (vec!["render", &scene, "-o", "nowhere/picture.exr"], "nowhere"),
        (vec!["render", &scene, "-D", "no_such=1"], "no_such"),
        (vec!["render", &scene, "--size", "0x10"], "WIDTHxHEIGHT"),
        (vec!["render", &scene, "--replay", "100000,0,0"], "outside"),
        (vec!["denoise", "bad.xml", "-o", "out.exr"], "bad.xml"),
        (vec!["compare", "bad.xml", "bad.xml"], "bad.xml"),
        (vec!["inspect", "bad.xml"], "spere"),
    ] {
        let done = quietlight(&arguments, folder.path());
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {}", text(&done.stderr));
        assert!(text(&done.stderr).contains(expected), "{arguments:?}: {}", text(&done.stderr));
    }
    assert_eq!(
        std::fs::read_dir(folder.path()).expect("a folder").count(),
        1,
        "nothing was written"
    );
}

/// A tiny random network of the tests of `denoise`.
fn network(branch: &str) -> String {
    let name = format!("kpcn-unit-{branch}.onnx");
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("denoise/tests/fixtures");
    folder.join(name).display().to_string()
}

#[test]
fn networks_of_the_users_own_denoise_and_say_so() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (scene, diffuse, specular) =
        (own_scene("cornell-box"), network("diffuse"), network("specular"));
    let models = ["--model", &diffuse, "--model", &specular];
    let render = ["render", &scene, "--size", "40x30", "--spp", "4", "-o", "first.exr", "--json"];
    let done = quietlight(&[&render[..], &models].concat(), folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let outcome: serde_json::Value =
        serde_json::from_slice(&done.stdout).expect("JSON on standard output");
    assert_eq!(outcome["denoiser"]["denoiser"], "kpcn");
    let metadata =
        exr::read(&folder.path().join("first.exr")).expect("the EXR is whole").layers.metadata;
    assert_eq!(metadata["denoiser.quality"], "own files");
    for (branch, path) in [("diffuse", &diffuse), ("specular", &specular)] {
        let bytes = std::fs::read(path).expect("the fixture is there");
        let sha256 = quietlight_denoise::sha256::sha256(&bytes);
        assert_eq!(metadata[&format!("denoiser.{branch}.sha256")], sha256);
    }
    assert!(metadata["denoiser.mixture"].contains("denoised on average"));

    // The same from the file, whose halves were not written.
    let denoise = ["denoise", "first.exr", "-o", "second.exr", "--threads", "1"];
    let done = quietlight(&[&denoise[..], &models].concat(), folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("denoised by neural networks"), "{}", text(&done.stdout));
    let [first, second] = ["first.exr", "second.exr"]
        .map(|name| read_picture(&folder.path().join(name)).expect("the EXR is whole"));
    assert_eq!(first, second);
}

#[test]
fn networks_that_cannot_run_are_an_error_or_a_warning() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (scene, diffuse) = (own_scene("cornell-box"), network("diffuse"));
    std::fs::write(folder.path().join("no.onnx"), "no network").expect("the file is written");
    let render = ["render", &scene, "--size", "16x16", "--spp", "2", "-o", "out.exr"];
    for (more, said) in [
        (vec!["--model", &diffuse], "two files"),
        (vec!["--model", &diffuse, "--model", &diffuse], "the branch 'diffuse'"),
        (vec!["--model", "no.onnx", "--model", &diffuse], "no.onnx"),
        (vec!["--model", "none.onnx", "--model", &diffuse], "none.onnx"),
        (vec!["--denoiser", "bilateral", "--model", &diffuse], "--model is for"),
    ] {
        let done = quietlight(&[&render[..], &more].concat(), folder.path());
        assert_eq!(done.status.code(), Some(2), "{more:?}: {}", text(&done.stderr));
        assert!(text(&done.stderr).contains(said), "{more:?}: {}", text(&done.stderr));
        assert!(!folder.path().join("out.exr").exists(), "refused before the render");
    }
    let specular = network("specular");
    let without_library = |more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_quietlight"))
            .args([&render[..], more].concat())
            .current_dir(folder.path())
            .env("ORT_DYLIB_PATH", "/nowhere/libonnxruntime.so")
            .output()
            .expect("the binary runs")
    };
    let done = without_library(&["--denoiser", "kpcn"]);
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    let done = without_library(&["--model", &diffuse, "--model", &specular]);
    assert!(text(&done.stderr).contains("/nowhere/libonnxruntime.so"), "{}", text(&done.stderr));
    let done = without_library(&[]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("warning: the bilateral filter"), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("bilateral"), "{}", text(&done.stdout));
}

#[test]
fn inspect_doctor_completions_and_replay_answer() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let done = quietlight(&["inspect", &scene, "--json"], folder.path());
    let facts: serde_json::Value =
        serde_json::from_slice(&done.stdout).expect("JSON on standard output");
    assert_eq!(facts["has_masks"].as_bool(), Some(false));
    assert!(facts["triangles"].as_u64().is_some_and(|count| count > 10));
    assert_eq!(facts["lobes"]["diffuse"].as_u64(), Some(5));
    let cost = |name: &str| facts["cost"][name].as_f64().expect("a number");
    let parts = ["loading_seconds", "render_seconds", "denoising_seconds", "writing_seconds"];
    let sum: f64 = parts.map(cost).iter().sum();
    assert!((cost("seconds") - sum).abs() < 1e-9 * sum && cost("render_seconds") > 0.0, "{facts}");
    assert!(cost("peak_bytes") > 1e6 && cost("samples") == 64.0, "{facts}");
    let done = quietlight(&["inspect", &scene, "--json", "--no-probe"], folder.path());
    let facts: serde_json::Value =
        serde_json::from_slice(&done.stdout).expect("JSON on standard output");
    assert!(facts["cost"].is_null() && facts["light"]["hits_per_walk"].is_f64(), "{facts}");
    let done = quietlight(&["inspect", &scene], folder.path());
    assert!(text(&done.stdout).contains("left out"), "{}", text(&done.stdout));
    let done = quietlight(&["doctor"], folder.path());
    assert!(done.status.success() && text(&done.stdout).contains("SIMD"), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("onnxruntime"), "{}", text(&done.stdout));
    let done = quietlight(&["completions", "bash"], folder.path());
    assert!(text(&done.stdout).contains("quietlight"));
    let done =
        quietlight(&["render", &scene, "--size", "32x32", "--replay", "16,16,3"], folder.path());
    assert!(text(&done.stdout).contains("finite   yes"), "{}", text(&done.stdout));
}

#[cfg(unix)]
#[test]
fn ctrl_c_writes_what_there_is_and_exits_with_130() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let mut child = Command::new(env!("CARGO_BIN_EXE_quietlight"))
        .args(["render", &scene, "--size", "64x64", "--spp", "1000000", "-o", "part.exr"])
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary runs");
    std::thread::sleep(Duration::from_secs(3));
    let interrupt =
        Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(interrupt.success());
    let asked = Instant::now();
    let status = child.wait().expect("the process ends");
    assert_eq!(status.code(), Some(130));
    assert!(asked.elapsed() < Duration::from_secs(60), "a pass takes about a second");
    let contents = exr::read(&folder.path().join("part.exr")).expect("the EXR is whole");
    let samples = contents.layers.samples.expect("sample counts");
    assert!(samples[[0, 0, 0]] >= 1.0 && samples[[0, 0, 0]] < 1e6);
}

#[test]
fn inspect_says_which_layers_a_scene_does_not_require() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = |max_depth: u32, bsdf: &str| {
        let xml = format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{max_depth}"/></integrator>
            <sensor type="perspective"/><shape type="sphere"><bsdf type="{bsdf}"/></shape>
            <emitter type="point"><point name="position" x="9" y="0" z="0"/><rgb name="intensity" value="1"/></emitter></scene>"#
        );
        std::fs::write(folder.path().join("scene.xml"), xml).expect("the scene is written");
        let json = quietlight(&["inspect", "scene.xml", "--json"], folder.path());
        assert!(json.status.success(), "{}", text(&json.stderr));
        let facts: serde_json::Value =
            serde_json::from_slice(&json.stdout).expect("JSON on standard output");
        let layers: Vec<String> = facts["layers"]
            .as_array()
            .expect("a list")
            .iter()
            .map(|name| name.as_str().expect("a name").to_owned())
            .collect();
        (layers, text(&quietlight(&["inspect", "scene.xml"], folder.path()).stdout))
    };
    let (layers, told) = scene(1, "diffuse");
    assert!(!layers.iter().any(|name| name == "specular" || name == "texture2"), "{layers:?}");
    assert!(told.contains("no specular layer") && told.contains("no texture2 layer"), "{told}");
    let (layers, told) = scene(5, "plastic");
    assert!(
        layers.iter().any(|name| name == "specular")
            && layers.iter().any(|name| name == "texture2")
    );
    assert!(!told.contains("no specular layer") && !told.contains("no texture2 layer"), "{told}");
}

#[test]
fn dataset_makes_continues_merges_exports_and_shows_a_set() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let tiny = ["--crop", "12", "--max-spp", "2", "--reference-spp", "4", "--json"];
    let make = |set: &str, more: &[&str]| {
        let arguments = [&["dataset", set, &scene][..], &tiny, more].concat();
        let done = quietlight(&arguments, folder.path());
        let outcome = serde_json::from_slice::<serde_json::Value>(&done.stdout).ok();
        (
            done,
            outcome
                .map(|outcome| (outcome["rendered"].clone(), outcome["complete_before"].clone())),
        )
    };
    let (done, outcome) = make("set", &["--views", "3"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert_eq!(outcome, Some((3.into(), 0.into())));
    let said = text(&done.stderr);
    assert!(said.contains("3 views to make") && said.contains("GB are free"), "{said}");
    let (_, outcome) = make("set", &["--views", "4"]);
    assert_eq!(outcome, Some((1.into(), 3.into())), "a set grows");
    let (done, _) = make("set", &["--views", "4", "--seed", "9"]);
    assert_eq!(done.status.code(), Some(2));
    assert!(text(&done.stderr).contains("seed: 9, not 0"), "{}", text(&done.stderr));

    for shard in ["0/2", "1/2"] {
        let (done, _) = make(&shard.replace('/', "-of-"), &["--views", "4", "--shard", shard]);
        assert!(done.status.success(), "{}", text(&done.stderr));
    }
    let done = quietlight(&["dataset", "merge", "all", "0-of-2", "1-of-2"], folder.path());
    assert!(text(&done.stdout).contains("4 views copied"), "{}", text(&done.stderr));
    let file = |set: &str| folder.path().join(set).join("views/000002/reference.exr");
    assert_eq!(std::fs::read(file("all")).ok(), std::fs::read(file("set")).ok());

    let done = quietlight(&["dataset", "export", "all", "oidn"], folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let exported = ["train", "valid"].map(|split| folder.path().join("oidn").join(split));
    assert!(exported.iter().any(|split| split.join("000002_ref.hdr.exr").exists()));
    let done = quietlight(&["dataset", "sheet", "all", "-o", "sheet.png"], folder.path());
    assert!(text(&done.stdout).contains("000003"), "{}", text(&done.stderr));
    let sheet = read_picture(&folder.path().join("sheet.png")).expect("the PNG is whole");
    assert_eq!(sheet.dim(), (3, 256, 512));
}

#[test]
fn dataset_refuses_what_cannot_be_meant() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("bad.xml"), "<scene version=\"3.0.0\"/>").expect("written");
    for (arguments, expected) in [
        (vec!["dataset"], "DIR"),
        (vec!["dataset", "set", "--shard", "2/2"], "0/4"),
        (vec!["dataset", "set", "--min-spp", "9", "--max-spp", "8"], "--max-spp 8"),
        (vec!["dataset", "set", "--reference-noise", "-1"], "positive"),
        (vec!["dataset", "set", "bad.xml"], "bad.xml:1"),
        (
            vec!["dataset", "set", "--views", "999999", "--crop", "1024", "--noisy", "64"],
            "MB are free",
        ),
        (vec!["dataset", "sheet", "set"], "set"),
        (vec!["dataset", "export", "set", "out"], "set"),
        (vec!["dataset", "merge", "out", "set"], "set"),
    ] {
        let done = quietlight(&arguments, folder.path());
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {}", text(&done.stderr));
        assert!(text(&done.stderr).contains(expected), "{arguments:?}: {}", text(&done.stderr));
    }
    assert_eq!(
        std::fs::read_dir(folder.path()).expect("a folder").count(),
        1,
        "nothing was written"
    );
}

#[cfg(unix)]
#[test]
fn ctrl_c_drops_the_views_under_way_and_exits_with_130() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let child = Command::new(env!("CARGO_BIN_EXE_quietlight"))
        .args(["dataset", "set", &scene, "--views", "2", "--threads", "2"])
        .args(["--reference-spp", "1000000", "--reference-noise", "0"])
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs");
    std::thread::sleep(Duration::from_secs(4));
    let interrupt =
        Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(interrupt.success());
    let asked = Instant::now();
    let done = child.wait_with_output().expect("the process ends");
    assert_eq!(done.status.code(), Some(130), "{}", text(&done.stderr));
    assert!(asked.elapsed() < Duration::from_secs(60), "a pass takes about a second");
    let views = std::fs::read_dir(folder.path().join("set/views")).expect("a folder").count();
    assert_eq!(views, 0, "nothing half-written is left");
    assert!(folder.path().join("set/manifest.json").exists());
}

/// All that `--integrator` can name.
const INTEGRATORS: [&str; 7] = ["auto", "path", "bdpt", "pssmlt", "mlt", "erpt", "visibility"];

#[test]
fn every_integrator_renders_and_says_which_it_was() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let facts = quietlight(&["inspect", &scene, "--json"], folder.path());
    let facts: serde_json::Value =
        serde_json::from_slice(&facts.stdout).expect("JSON on standard output");
    let chosen = facts["integrator"].as_str().expect("a name");
    assert!(INTEGRATORS[1..].contains(&chosen), "{chosen}");
    for asked in INTEGRATORS {
        let output = format!("{asked}.exr");
        let render = ["render", &scene, "--size", "16x16", "--spp", "8", "--halves", "--json"];
        let more = ["--integrator", asked, "--denoiser", "bilateral", "-o", &output];
        let done = quietlight(&[&render[..], &more].concat(), folder.path());
        assert!(done.status.success(), "{asked}: {}", text(&done.stderr));
        let outcome: serde_json::Value =
            serde_json::from_slice(&done.stdout).expect("JSON on standard output");
        let name = if asked == "auto" { chosen } else { asked };
        assert_eq!(outcome["integrator"], name, "{asked}");
        assert_eq!(outcome["samples"].as_u64(), Some(8), "{asked}: --spp counts mutations, too");
        let contents = exr::read(&folder.path().join(&output)).expect("the EXR is whole");
        let metadata = &contents.layers.metadata;
        assert_eq!(metadata["integrator"], name, "{asked}");
        assert_eq!(metadata["samples"], "8", "{asked}");
        assert!(!metadata["integrator_settings"].is_empty(), "{asked}");
        // What the method tells is in the file and on standard output, and the same.
        for (fact, value) in outcome["facts"].as_object().expect("facts") {
            assert_eq!(value, &metadata[fact], "{asked}: {fact}");
        }
        let has = |fact: &str| metadata.contains_key(fact);
        assert_eq!(has("normalisation"), ["mlt", "pssmlt"].contains(&name), "{asked}");
        assert_eq!(has("energy_per_sample"), name == "erpt", "{asked}");
        for kind in [LayerKind::Beauty, LayerKind::Diffuse, LayerKind::Albedo, LayerKind::Normal] {
            let layer = contents.layers.layers.get(&kind).unwrap_or_else(|| panic!("no {kind:?}"));
            assert_eq!(layer.mean.dim(), (3, 16, 16), "{asked}");
            assert!(layer.variance.is_some(), "{asked}: {kind:?}");
            let [a, b] = layer.halves.as_ref().expect("--halves");
            assert!(a.iter().chain(b).all(|value| value.is_finite()), "{asked}: {kind:?}");
            // The first hits of a few samples may all be of one albedo.
            assert!(kind != LayerKind::Beauty || a != b, "{asked}: the halves differ");
        }
        let png = folder.path().join(format!("{asked}.png"));
        assert_eq!(read_picture(&png).expect("the PNG is whole").dim(), (3, 16, 16));
    }
}

#[test]
fn a_budget_of_time_ends_and_says_how_much_was_done() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    for asked in &INTEGRATORS[1..] {
        let render = ["render", &scene, "--size", "8x8", "--time", "1s", "--denoiser", "none"];
        let more = ["--integrator", asked, "--json", "-o", "timed.exr"];
        let done = quietlight(&[&render[..], &more].concat(), folder.path());
        assert!(done.status.success(), "{asked}: {}", text(&done.stderr));
        let outcome: serde_json::Value =
            serde_json::from_slice(&done.stdout).expect("JSON on standard output");
        // How long a round takes is the machine's business, and what is written beside it; that rendering is not cut below
        // its tenth is ours.
        let seconds = outcome["render_seconds"].as_f64().expect("seconds");
        assert!(seconds >= 0.1, "{asked}: {seconds} s");
        assert!(outcome["samples"].as_u64().is_some_and(|samples| samples > 0), "{asked}");
        let contents = exr::read(&folder.path().join("timed.exr")).expect("the EXR is whole");
        assert!(contents.layers.metadata["seconds"].parse::<f64>().is_ok_and(|s| s >= 0.1));
    }
}

#[test]
fn limits_of_erpt_tell_the_energy_lost() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let render = ["render", &scene, "--size", "16x16", "--spp", "8", "--integrator", "erpt"];
    let limits = ["--consecutive-limit", "2", "--proposal-limit", "2"];
    let more = ["--denoiser", "none", "-o", "limited.exr"];
    let done = quietlight(&[&render[..], &limits, &more].concat(), folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let metadata =
        exr::read(&folder.path().join("limited.exr")).expect("the EXR is whole").layers.metadata;
    for fact in ["energy_lost", "energy_lost_to_medians"] {
        assert!(metadata[fact].contains('%'), "{fact}: {}", metadata[fact]);
        assert!(text(&done.stdout).contains(&metadata[fact]), "{}", text(&done.stdout));
    }
    assert!(metadata["integrator_settings"].contains("consecutive_limit: Some(2)"));
}

/// The numbers and metadata of a picture, but for how long it took and on how many threads.
fn contents(path: &Path) -> (exr::Contents, BTreeMap<String, String>) {
    let contents = exr::read(path).expect("the EXR is whole");
    let mut metadata = contents.layers.metadata.clone();
    metadata.retain(|name, _| !name.ends_with("seconds") && name != "threads");
    (contents, metadata)
}

fn assert_same_picture(found: &Path, expected: &Path) {
    let ((found, told), (expected, expected_told)) = (contents(found), contents(expected));
    assert_eq!(told, expected_told);
    assert_eq!((found.picture, found.frame), (expected.picture, expected.frame));
    assert_eq!(found.layers.samples, expected.layers.samples);
    assert_eq!(found.layers.layers.len(), expected.layers.layers.len());
    for (kind, layer) in &expected.layers.layers {
        let other = &found.layers.layers[kind];
        assert_eq!(other.mean, layer.mean, "{kind:?}");
        assert_eq!(other.variance, layer.variance, "variance of {kind:?}");
        assert_eq!(other.halves, layer.halves, "halves of {kind:?}");
    }
}

/// Names in a folder, in order.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let name = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.expect("an entry").file_name().into_string().expect("a name")
    };
    let mut names: Vec<String> = entries.map(name).collect();
    names.sort();
    names
}

#[test]
fn shards_merge_into_the_picture_of_one_process() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    for integrator in ["path", "mlt"] {
        let render =
            ["render", &scene, "--size", "40x32", "--spp", "9", "--integrator", integrator];
        let run = |more: &[&str]| {
            let done = quietlight(&[&render[..], &["--seed", "3"], more].concat(), folder.path());
            assert!(done.status.success(), "{}", text(&done.stderr));
            text(&done.stdout)
        };
        run(&["-o", "one.exr", "--halves", "--denoiser", "bilateral"]);
        for (index, shard) in ["0/3", "1/3", "2/3"].into_iter().enumerate() {
            let threads = (index + 1).to_string();
            run(&["-o", "parts.exr", "--shard", shard, "--threads", &threads]);
        }
        assert!(!folder.path().join("parts.exr").exists(), "a part is no picture");
        // A task that is started again finds its work done.
        let again = run(&["-o", "parts.exr", "--shard", "1/3", "--resume"]);
        assert!(again.contains("done already"), "{again}");
        let merge = |more: &[&str]| {
            let arguments = ["merge", "merged.exr", "--halves", "--denoiser", "bilateral"];
            quietlight(&[&arguments[..], more].concat(), folder.path())
        };
        let (a, b, c) = ("parts.0-of-3.shard", "parts.1-of-3.shard", "parts.2-of-3.shard");
        for (inputs, expected) in [
            (vec![a, c], "part 1 of 3 is missing"),
            (vec![a, c, b, c], "are both part 2 of 3"),
            (vec![a, b, "one.exr"], "only EXRs, or only shards"),
            (vec!["one.exr", "one.exr"], "have the same seed, 3"),
            (vec![a, "one.png"], "one.png: found another kind"),
            (vec![a, "nothing.shard"], "nothing.shard"),
        ] {
            let refused = merge(&inputs);
            assert_eq!(refused.status.code(), Some(2), "{inputs:?}: {}", text(&refused.stderr));
            assert!(text(&refused.stderr).contains(expected), "{}", text(&refused.stderr));
        }
        assert!(!folder.path().join("merged.exr").exists());
        let done = merge(&[c, a, b]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        assert_same_picture(&folder.path().join("merged.exr"), &folder.path().join("one.exr"));
        std::fs::remove_file(folder.path().join("merged.exr")).expect("it is there");
    }
}

#[test]
fn pictures_of_two_seeds_merge_into_one_with_all_their_samples() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    for (seed, output, spp) in [("1", "a.exr", "4"), ("2", "b.exr", "12"), ("3", "c.exr", "4")] {
        let render = ["render", &scene, "--size", "32x24", "--denoiser", "none", "--halves"];
        let done = quietlight(
            &[&render[..], &["--seed", seed, "-o", output, "--spp", spp]].concat(),
            folder.path(),
        );
        assert!(done.status.success(), "{}", text(&done.stderr));
    }
    let done = quietlight(&["merge", "ab.exr", "a.exr", "b.exr", "--json"], folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let outcome: serde_json::Value =
        serde_json::from_slice(&done.stdout).expect("JSON on standard output");
    assert_eq!(outcome["samples"].as_u64(), Some(16));
    // What was merged merges again, and remembers its seeds.
    let merge = ["merge", "abc.exr", "ab.exr", "c.exr", "--denoiser", "none"];
    let done = quietlight(&merge, folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let (merged, told) = contents(&folder.path().join("abc.exr"));
    assert_eq!((&*told["samples"], &*told["seed"]), ("20", "1, 2, 3"));
    assert!(merged.layers.samples.is_some_and(|counts| counts.iter().all(|&count| count == 20.0)));
    let done = quietlight(&["merge", "abca.exr", "abc.exr", "a.exr"], folder.path());
    assert_eq!(done.status.code(), Some(2));
    assert!(text(&done.stderr).contains("same seed, 1"), "{}", text(&done.stderr));
}

/// Runs a render and kills it after so long, over and over, each time going on from what was kept; then lets it end. Returns how
/// often there was something to go on from.
#[expect(clippy::print_stdout, reason = "a log of the kills")]
fn killed(render: &[&str], folder: &Path, output: &str, times: u32, most: Duration) -> u32 {
    let (mut resumed, mut kept) = (0, 0);
    let checkpoint = Path::new(output).with_extension("checkpoint");
    for time in 0..times {
        let mut child = Command::new(env!("CARGO_BIN_EXE_quietlight"))
            .args(render)
            .args(["-o", output, "--resume", "--checkpoint", "1ms"])
            .current_dir(folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary runs");
        // Moments spread evenly (golden ratio), whatever the machine does.
        let after = most.mul_f64((f64::from(time) * 0.618_033_988_75).fract());
        std::thread::sleep(after);
        child.kill().expect("it is killed, or has ended");
        child.wait().expect("it is gone");
        for name in names(folder) {
            assert!(!name.ends_with(".part"), "{name} is left behind");
        }
        if folder.join(&checkpoint).exists() {
            let state = State::read(&folder.join(&checkpoint)).expect("the checkpoint is whole");
            assert!(state.samples() >= kept, "{kept} samples were kept, now {}", state.samples());
            kept = state.samples();
            resumed += 1;
        } else if folder.join(output).exists() {
            // It came to its end, and the next one begins anew.
            kept = 0;
        }
        println!("{time}: killed after {:.3} s; kept: {kept} samples", after.as_secs_f64());
    }
    let done =
        quietlight(&[render, &["-o", output, "--resume", "--checkpoint", "1ms"]].concat(), folder);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(!folder.join(&checkpoint).exists(), "the checkpoint is gone when all is written");
    resumed
}

#[expect(clippy::print_stdout, reason = "a log of the kills")]
fn check_killed(integrator: &str, size: &str, spp: &str, times: u32, most: Duration) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let render = ["render", &scene, "--size", size, "--spp", spp, "--integrator", integrator];
    let render = [&render[..], &["--denoiser", "none", "--halves"]].concat();
    let done = quietlight(&[&render[..], &["-o", "whole.exr"]].concat(), folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let resumed = killed(&render, folder.path(), "killed.exr", times, most);
    assert!(resumed > 0, "{integrator}: never far enough to keep anything");
    assert_same_picture(&folder.path().join("killed.exr"), &folder.path().join("whole.exr"));
    assert_eq!(names(folder.path()), ["killed.exr", "killed.png", "whole.exr", "whole.png"]);
    println!(
        "{integrator}: killed {times} times, {resumed} times there was something to go on from"
    );
}

#[test]
fn a_render_that_is_killed_goes_on_to_the_same_picture() {
    check_killed("path", "64x64", "400", 4, Duration::from_millis(400));
    check_killed("erpt", "24x24", "600", 4, Duration::from_millis(400));
}

/// Longer than the gate has time for: `cargo test --test laws -- --ignored --nocapture killed_at_fifty`.
#[test]
#[ignore = "minutes"]
fn a_render_that_is_killed_at_fifty_moments_goes_on_to_the_same_picture() {
    for integrator in ["path", "bdpt", "pssmlt", "mlt", "erpt", "visibility"] {
        check_killed(integrator, "96x96", "512", 50, Duration::from_secs(5));
    }
}

#[test]
fn an_interrupted_render_is_kept_and_goes_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let render = ["render", &scene, "--size", "32x32", "--denoiser", "none", "-o"];
    let spp = |spp: &'static str| [&render[..], &["picture.exr", "--spp", spp]].concat();
    let child = Command::new(env!("CARGO_BIN_EXE_quietlight"))
        .args(spp("10000000"))
        .current_dir(folder.path())
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("the binary runs");
    std::thread::sleep(Duration::from_millis(1500));
    let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(interrupt.expect("kill is there").success());
    let ended = child.wait_with_output().expect("it ends");
    assert_eq!(ended.status.code(), Some(130));
    assert!(text(&ended.stderr).contains("--resume goes on"), "{}", text(&ended.stderr));
    let first = contents(&folder.path().join("picture.exr")).1["samples"].clone();
    let state = State::read(&folder.path().join("picture.checkpoint")).expect("a checkpoint");
    assert_eq!(state.samples().to_string(), first);
    // Another render does not go on from it.
    let other = quietlight(&[&spp("9")[..], &["--resume", "--seed", "4"]].concat(), folder.path());
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("seed 0 and not 4"), "{}", text(&other.stderr));
    let more = (state.samples() + 3).to_string();
    let done = quietlight(
        &[&render[..], &["picture.exr", "--spp", &more, "--resume"]].concat(),
        folder.path(),
    );
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert_eq!(contents(&folder.path().join("picture.exr")).1["samples"], more);
    let done = quietlight(
        &[&render[..], &["whole.exr", "--spp", &more, "--threads", "1"]].concat(),
        folder.path(),
    );
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert_same_picture(&folder.path().join("picture.exr"), &folder.path().join("whole.exr"));
    assert!(!folder.path().join("picture.checkpoint").exists());
}

/// A limit of the size of files stands for a full disk, which a test cannot make.
#[cfg(target_os = "linux")]
#[test]
fn a_file_that_cannot_be_written_is_told_and_nothing_half_written_is_left() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let program = env!("CARGO_BIN_EXE_quietlight");
    let limited = |arguments: &str| {
        let command =
            format!("trap '' XFSZ; ulimit -f 16; exec {program} render {scene} {arguments}");
        let run = Command::new("bash").args(["-c", &command]).current_dir(folder.path()).output();
        run.expect("bash is there")
    };
    let failed = limited("--size 64x64 --spp 2 --denoiser none -o picture.exr");
    assert_eq!(failed.status.code(), Some(1), "{}", text(&failed.stderr));
    assert!(text(&failed.stderr).contains("cannot write picture.exr"), "{}", text(&failed.stderr));
    assert!(text(&failed.stderr).contains("File too large"), "{}", text(&failed.stderr));
    assert_eq!(names(folder.path()), Vec::<String>::new());
    // A checkpoint that cannot be written does not end a render.
    let warned = limited("--size 64x64 --spp 64 --checkpoint 1ms --denoiser none -o picture.exr");
    let said = text(&warned.stderr);
    assert!(said.contains("no checkpoint could be written: picture.checkpoint"), "{said}");
    assert_eq!(names(folder.path()), Vec::<String>::new());
    for (output, expected) in
        [("/sys/picture.exr", "cannot write into /sys"), ("/dev/null/picture.exr", "/dev/null")]
    {
        let refused = limited(&format!("--size 8x8 --spp 1 -o {output}"));
        assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
        assert!(text(&refused.stderr).contains(expected), "{}", text(&refused.stderr));
    }
    for arguments in ["--size 1000000x1000000", "--size 11000x11000", "--size 4000x4000 --spp 1"] {
        let command = format!("ulimit -v 4000000; exec {program} render {scene} {arguments}");
        let run = Command::new("bash").args(["-c", &command]).current_dir(folder.path()).output();
        let refused = run.expect("bash is there");
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains("pixels"), "{arguments}: {said}");
    }
    assert_eq!(names(folder.path()), Vec::<String>::new());
}
