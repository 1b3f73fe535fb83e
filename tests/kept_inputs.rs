//! Files that once made a reader panic, hang or fill the memory (`tests/fuzz/kept`), and those that fuzzing starts from.

#[path = "fuzz/input.rs"]
mod input;

use input::Kind;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use tempfile::TempDir;

#[test]
fn no_file_that_fuzzing_found_makes_a_reader_panic() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz");
    let mut failed = Vec::new();
    for kind in Kind::ALL {
        let beside = TempDir::new().expect("a temporary folder");
        kind.prepare(beside.path());
        let mut count = 0;
        for folder in ["seeds", "kept"] {
            let folder = fuzz.join(folder).join(kind.name());
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
        assert!(count > 2, "{} has no files", kind.name());
    }
    assert!(failed.is_empty(), "panics on {failed:#?}");
}
