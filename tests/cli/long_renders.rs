//! Renders that are cut into parts, ended and gone on with.
#![allow(clippy::print_stdout, reason = "the log of kills is asked for with --nocapture")]

use super::*;

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
    interrupt(&child);
    let asked = Instant::now();
    let status = child.wait().expect("the process ends");
    assert_eq!(status.code(), Some(130));
    assert!(asked.elapsed() < Duration::from_secs(60), "a pass takes about a second");
    let contents = exr::read(&folder.path().join("part.exr")).expect("the EXR is whole");
    let samples = contents.layers.samples.expect("sample counts");
    assert!(samples[[0, 0, 0]] >= 1.0 && samples[[0, 0, 0]] < 1e6);
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
    interrupt(&child);
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
