//! The command line as a person or a script uses it.

mod dataset;
mod long_renders;
mod pictures;

use quietlight::render::State;
use quietlight_denoise::picture::read_picture;
use quietlight_denoise::{LayerKind, exr};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
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

/// The numbers and metadata of a picture, but for how long it took and on how many threads.
fn contents(path: &Path) -> (exr::Contents, BTreeMap<String, String>) {
    let contents = exr::read(path).expect("the EXR is whole");
    let mut metadata = contents.layers.metadata.clone();
    metadata.retain(|name, _| !name.ends_with("seconds") && name != "threads");
    (contents, metadata)
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

/// A mistake of the user's own: exit code 2, and a message with `expected` in it.
fn assert_refused(arguments: &[&str], expected: &str, folder: &Path) {
    let done = quietlight(arguments, folder);
    assert_eq!(done.status.code(), Some(2), "{arguments:?}: {}", text(&done.stderr));
    assert!(text(&done.stderr).contains(expected), "{arguments:?}: {}", text(&done.stderr));
}

/// What Ctrl-C does.
fn interrupt(child: &Child) {
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(kill.expect("kill runs").success());
}
