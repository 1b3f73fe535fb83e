//! Data sets.

use super::*;

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
        assert_refused(&arguments, expected, folder.path());
    }
    assert_eq!(names(folder.path()).len(), 1, "nothing was written");
}

#[test]
fn a_temporary_folder_that_is_missing_ends_the_run_and_skips_no_view() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let make = |temporary: &Path| {
        Command::new(env!("CARGO_BIN_EXE_quietlight"))
            .args(["dataset", "set", "--views", "1", "--crop", "32", "--reference-spp", "2"])
            .args(["--noisy", "1", "--max-spp", "1"])
            .current_dir(folder.path())
            .env("TMPDIR", temporary)
            .output()
            .expect("the binary runs")
    };
    let done = make(Path::new("/nowhere"));
    assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("/nowhere"), "{}", text(&done.stderr));
    let done = make(folder.path());
    assert!(text(&done.stdout).contains("1 views rendered"), "{}", text(&done.stdout));
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
    interrupt(&child);
    let asked = Instant::now();
    let done = child.wait_with_output().expect("the process ends");
    assert_eq!(done.status.code(), Some(130), "{}", text(&done.stderr));
    assert!(asked.elapsed() < Duration::from_secs(60), "a pass takes about a second");
    let views = std::fs::read_dir(folder.path().join("set/views")).expect("a folder").count();
    assert_eq!(views, 0, "nothing half-written is left");
    assert!(folder.path().join("set/manifest.json").exists());
}
