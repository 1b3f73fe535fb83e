//! Rendering, denoising and what is told of scenes.

use super::*;

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
    // The file has more layers than the networks look at.
    assert!(text(&done.stdout).contains("diffuse, specular, albedo, normal, depth\n"));
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
    for name in ["is-a-folder.exr", "png-is-a-folder.png"] {
        std::fs::create_dir(folder.path().join(name)).expect("a folder is made");
    }
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
        (vec!["render", &scene, "-o", "is-a-folder.exr"], "is-a-folder.exr is a folder"),
        (vec!["render", &scene, "-o", "png-is-a-folder.exr"], "png-is-a-folder.png is a folder"),
        (vec!["render", &scene, "--exposure", "nan"], "a number of stops"),
        (vec!["merge", "first.exr", "second.exr"], "2 values required"),
        (vec!["compare", "a.exr", "b.exr", "--map", "map.exr"], "*.png"),
        (vec!["dataset", "sheet", "set", "-o", "sheet.exr"], "*.png"),
        (vec!["dataset", "bad.xml", "--views", "1"], "bad.xml"),
        (vec!["inspect", &scene, "--no-probe", "--model", "one.onnx"], "two files"),
    ] {
        assert_refused(&arguments, expected, folder.path());
    }
    assert_eq!(names(folder.path()).len(), 3, "nothing was written");
}

#[test]
fn what_is_read_is_not_replaced() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name);
    let scene = own_scene("cornell-box");
    let done = quietlight(
        &["render", &scene, "--spp", "1", "--size", "16x16", "-o", "sky.exr"],
        folder.path(),
    );
    assert!(done.status.success(), "{}", text(&done.stderr));
    let xml = r#"<scene version="3.0.0"><sensor type="perspective"/><emitter type="envmap">
        <string name="filename" value="sky.exr"/></emitter></scene>"#;
    std::fs::write(at("sky.xml"), xml).expect("the scene is written");
    let before = ["sky.exr", "sky.png"].map(|name| std::fs::read(at(name)).expect("a file"));
    // Named after the scene, the picture would replace the light.
    for (arguments, expected) in [
        (vec!["render", "sky.xml", "--spp", "1"], "sky.exr is read"),
        (vec!["denoise", "sky.png", "-o", "sky.exr"], "sky.png is read"),
        (vec!["denoise", "other.exr", "-o", "sky.exr", "--albedo", "sky.png"], "sky.png is read"),
        (vec!["compare", "sky.exr", "sky.png", "--map", "sky.png"], "sky.png is read"),
    ] {
        assert_refused(&arguments, expected, folder.path());
    }
    let after = ["sky.exr", "sky.png"].map(|name| std::fs::read(at(name)).expect("a file"));
    assert!(before == after);
    // In its own place a picture may be denoised.
    let done = quietlight(&["denoise", "./sky.exr", "-o", "sky.exr"], folder.path());
    assert!(done.status.success(), "{}", text(&done.stderr));
}

#[test]
fn one_sample_tells_nothing_of_its_noise() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let render = ["render", &scene, "--spp", "1", "--size", "16x16", "--integrator", "path"];
    let done = quietlight(&[&render[..], &["--json"]].concat(), folder.path());
    let outcome: serde_json::Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert!(outcome["estimated_noisy_relative_l2"].is_null(), "{outcome}");
    let target = ["--target-error", "1e-9", "--denoiser", "none"];
    let done = quietlight(&[&render[..], &target].concat(), folder.path());
    assert!(text(&done.stderr).contains("cannot be estimated"), "{}", text(&done.stderr));
}

#[cfg(unix)]
#[test]
fn a_reader_who_goes_away_ends_no_render_and_a_full_disk_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = own_scene("cornell-box");
    let start = |out: Stdio, error: Stdio| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_quietlight"));
        command.args(["render", &scene, "--spp", "1", "--size", "16x16", "-o", "picture.exr"]);
        command.current_dir(folder.path()).stdout(out).stderr(error);
        command.spawn().expect("the binary runs")
    };
    let mut child = start(Stdio::piped(), Stdio::piped());
    drop((child.stdout.take(), child.stderr.take()));
    assert_eq!(child.wait().expect("the process ends").code(), Some(0));
    assert_eq!(names(folder.path()), ["picture.exr", "picture.png"]);
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").map(Stdio::from);
    if let (Ok(out), Ok(error)) = (full(), full()) {
        assert_eq!(start(Stdio::null(), error).wait().expect("the process ends").code(), Some(0));
        let done = start(out, Stdio::piped()).wait_with_output().expect("the process ends");
        assert_eq!(done.status.code(), Some(1));
        assert!(text(&done.stderr).contains("standard output"), "{}", text(&done.stderr));
    }
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
    for (asked, expected) in [
        (vec!["--denoiser", "none"], "none: the noise stays"),
        (vec!["--denoiser", "bilateral"], "filter (bilateral)"),
        (vec!["--quality", "fast"], "fast quality: diffuse"),
    ] {
        let arguments = [vec!["inspect", &scene, "--no-probe"], asked].concat();
        let said = text(&quietlight(&arguments, folder.path()).stdout);
        assert!(said.contains(expected), "{said}");
    }
    let done = quietlight(&["doctor"], folder.path());
    assert!(done.status.success() && text(&done.stdout).contains("SIMD"), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("onnxruntime"), "{}", text(&done.stdout));
    let done = quietlight(&["completions", "bash"], folder.path());
    assert!(text(&done.stdout).contains("quietlight"));
    let done =
        quietlight(&["render", &scene, "--size", "32x32", "--replay", "16,16,3"], folder.path());
    assert!(text(&done.stdout).contains("finite   yes"), "{}", text(&done.stdout));
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
