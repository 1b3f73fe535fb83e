//! `--strategies`: the pyramid of what each strategy of bidirectional path tracing finds.

use quietlight_denoise::picture::read_picture;
use quietlight_denoise::{Image, LayerKind, exr};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs `quietlight render` on the Cornell box, small, with paths of at most three edges.
fn render(arguments: &[&str], folder: &Path) -> Output {
    let scene = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes").join("cornell-box");
    Command::new(env!("CARGO_BIN_EXE_quietlight"))
        .arg("render")
        .arg(scene)
        .args(["--size", "24x20", "--spp", "16", "--max-depth", "3", "--denoiser", "none"])
        .args(["-o", "whole.exr"])
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the binary runs")
}

fn picture(path: &Path) -> Image {
    exr::read(path).expect("the EXR is whole").picture.expect("a picture")
}

#[test]
fn weighted_images_of_all_strategies_sum_to_the_picture_and_lie_on_a_sheet() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let done = render(&["--integrator", "bdpt", "--strategies", "all/of/them"], folder.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let pyramid = folder.path().join("all/of/them");
    let strategies = [
        "k1-s0-t2", "k2-s0-t3", "k2-s1-t2", "k2-s2-t1", "k3-s0-t4", "k3-s1-t3", "k3-s2-t2",
        "k3-s3-t1",
    ];
    let files = std::fs::read_dir(&pyramid).expect("the folder").count();
    assert_eq!(files, 2 * strategies.len() + 2);

    let mut sum = Image::zeros((3, 20, 24));
    for name in strategies {
        sum += &picture(&pyramid.join(format!("weighted-{name}.exr")));
    }
    let whole = exr::read(&folder.path().join("whole.exr")).expect("the EXR is whole");
    // The picture adds in another order, and some of it in half the precision.
    let beauty = &whole.layers.layers[&LayerKind::Beauty].mean;
    for (found, expected) in sum.iter().zip(beauty) {
        assert!((found - expected).abs() < 1e-4 * (1.0 + expected), "{found} {expected}");
    }

    // All strategies of one length see the same: connections vary by a few percent over the whole picture.
    let mean = |name: &str| {
        let image = picture(&pyramid.join(format!("unweighted-{name}.exr")));
        image.mean().expect("pixels")
    };
    for (a, b) in [("k2-s1-t2", "k2-s2-t1"), ("k3-s1-t3", "k3-s2-t2"), ("k3-s1-t3", "k3-s3-t1")] {
        assert!((mean(a) / mean(b) - 1.0).abs() < 0.25, "{a} {}, {b} {}", mean(a), mean(b));
    }
    for name in ["unweighted.png", "weighted.png"] {
        let sheet = read_picture(&pyramid.join(name)).expect("the PNG is whole");
        // Three rows, four pictures across, with their labels.
        assert!(sheet.dim().1 > 3 * 40 && sheet.dim().2 > 4 * 60, "{:?}", sheet.dim());
        assert!(sheet.iter().any(|&value| value == 1.0), "no letter on {name}");
    }
}

#[test]
fn only_bidirectional_path_tracing_has_strategies() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let done = render(&["--integrator", "path", "--strategies", "all"], folder.path());
    assert_eq!(done.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&done.stderr).contains("--integrator bdpt"));
    assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 0);
}
