//! Files that once made a reader panic, hang or fill the memory (`tests/fuzz/kept`), and those that fuzzing starts from.

#[path = "fuzz/input.rs"]
#[allow(unreachable_pub, reason = "it is public in the fuzz targets, which have the same file")]
mod input;

use input::Kind;
use quietlight::texture::Image;
use quietlight_denoise::exr;
use quietlight_denoise::picture::read_picture;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use tempfile::TempDir;

/// What can be read, each with the name of its target and of its folders.
const KINDS: [(Kind, &str); 5] = [
    (Kind::Xml, "xml"),
    (Kind::Obj, "obj"),
    (Kind::Ply, "ply"),
    (Kind::Image, "image"),
    (Kind::Exr, "exr"),
];

#[test]
fn no_file_that_fuzzing_found_makes_a_reader_panic() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz");
    let mut failed = Vec::new();
    for (kind, name) in KINDS {
        let beside = TempDir::new().expect("a temporary folder");
        kind.prepare(beside.path());
        let mut count = 0;
        for folder in ["seeds", "kept"] {
            let folder = fuzz.join(folder).join(name);
            for entry in fs::read_dir(&folder).into_iter().flatten() {
                let path = entry.expect("a folder that can be read").path();
                let bytes = fs::read(&path).expect("a file that can be read");
                let run = AssertUnwindSafe(|| kind.try_file(beside.path(), &bytes));
                if catch_unwind(run).is_err() {
                    failed.push(path);
                }
                count += 1;
            }
        }
        assert!(count > 2, "{name} has no files");
    }
    assert!(failed.is_empty(), "panics on {failed:#?}");
}

#[test]
fn headers_that_promise_more_than_the_file_holds_are_refused_before_memory_is_asked_for() {
    let folder = TempDir::new().expect("a temporary folder");
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).expect("a file");
        path
    };
    // Fuzzing found it: a tile of 2·10⁹ bytes in a picture of 5×4 pixels.
    let tile = write("tile.exr", include_bytes!("fuzz/kept/exr/huge-tile.exr"));
    let expected = "bytes of one block in a file of 992 bytes";
    let error = exr::read(&tile).expect_err("a tile of gigabytes").to_string();
    assert!(error.contains(expected), "{error}");
    let error = Image::load(&tile, false).expect_err("a tile of gigabytes").to_string();
    assert!(error.contains(expected), "{error}");

    // 11 000 × 11 000 pixels, a third of a gigabyte, in a file of 77 bytes; the checksum of the header is that of zlib.
    let mut bytes = include_bytes!("fuzz/seeds/image/rgb.png").to_vec();
    bytes[16..24].copy_from_slice(&[0, 0, 0x2a, 0xf8, 0, 0, 0x2a, 0xf8]);
    bytes[29..33].copy_from_slice(&0x414d_0dddu32.to_be_bytes());
    let png = write("a.png", &bytes);
    let expected = "promises 11000x11000 pixels, which 77 bytes cannot hold";
    for error in [
        Image::load(&png, false).expect_err("pixels from nowhere").to_string(),
        read_picture(&png).expect_err("pixels from nowhere").to_string(),
    ] {
        assert!(error.contains(expected), "{error}");
    }
}
