use super::*;
use std::collections::BTreeMap;

/// The files of a folder and their bytes.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files
        .map(|path| {
            (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(&path).unwrap())
        })
        .collect()
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let folders = [0, 0, 1].map(|_| tempfile::tempdir().unwrap());
    let seeds = [5, 5, 6];
    for (folder, seed) in folders.iter().zip(seeds) {
        generate(seed, folder.path()).unwrap();
    }
    let [first, again, other] = folders.map(|folder| contents(folder.path()));
    assert!(first == again, "two runs of one seed differ");
    assert_ne!(first["scene.xml"], other["scene.xml"]);
}
