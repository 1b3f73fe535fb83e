//! One data set out of shards that were made on several machines.

use super::Error;
use super::manifest::{Manifest, Record, View, records};
use crate::folder::{self, at};
use quietlight_denoise::sha256::sha256;
use std::fs;
use std::path::{Path, PathBuf};

/// What [`merge`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Merged {
    /// Views copied.
    pub copied: usize,
    /// Views that `output` had already, the same to the last bit.
    pub already_there: usize,
}

/// Copies the views of `inputs` that are done into `output`, which may be one of them or hold views already. `view.json`
/// comes last, so that an interrupted merge can be done again.
///
/// # Errors
/// [`folder::Error::Settings`] where two sets have different settings, [`Error::Conflict`] where they hold different renders of
/// one view, both before anything is copied; [`Format`](quietlight_denoise::Error::Format) where a copied file has not the
/// hash that its view says.
pub fn merge(output: &Path, inputs: &[PathBuf]) -> Result<Merged, Error> {
    let mut all: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    if Manifest::path(output).exists() {
        all.insert(0, output);
    }
    let mut manifest: Option<Manifest> = None;
    // Each view with the set that it comes from.
    let mut found: Vec<(Record, &Path)> = Vec::new();
    for folder in all {
        let read = Manifest::read(folder)?;
        match &mut manifest {
            None => manifest = Some(read),
            Some(first) => {
                let differences = read.settings.differences(&first.settings);
                if !differences.is_empty() {
                    return Err(folder::Error::Settings {
                        path: Manifest::path(folder),
                        differences,
                    }
                    .into());
                }
                first.views = first.views.max(read.views);
            }
        }
        found.extend(records(folder)?.into_iter().map(|record| (record, folder)));
    }
    // Stable: of equal ids the first set's comes first.
    found.sort_by(|(a, _), (b, _)| a.identity().id.cmp(&b.identity().id));
    let mut merged = Merged::default();
    let mut chosen: Vec<(Record, &Path)> = Vec::new();
    for (record, folder) in found {
        match chosen.last() {
            Some((other, first)) if other.identity().id == record.identity().id => {
                if !is_same(other, &record) {
                    return Err(Error::Conflict {
                        id: record.identity().id.clone(),
                        first: first.to_path_buf(),
                        second: folder.to_path_buf(),
                    });
                }
            }
            _ => chosen.push((record, folder)),
        }
    }
    fs::create_dir_all(output).map_err(at(output))?;
    if let Some(manifest) = manifest {
        manifest.write(output)?;
    }
    for (record, folder) in chosen {
        if folder == output {
            merged.already_there += 1;
        } else {
            copy(&record, folder, output)?;
            merged.copied += 1;
        }
    }
    Ok(merged)
}

/// Are the pictures the same? How long they took may differ.
fn is_same(a: &Record, b: &Record) -> bool {
    match (a, b) {
        (Record::Rendered(a), Record::Rendered(b)) => {
            a.noisy == b.noisy && a.reference == b.reference
        }
        (Record::Skipped(a), Record::Skipped(b)) => a.reason == b.reason,
        _ => false,
    }
}

fn copy(record: &Record, from: &Path, to: &Path) -> Result<(), Error> {
    let id = &record.identity().id;
    let (from, folder) = (View::folder(from, id), View::folder(to, id));
    fs::create_dir_all(&folder).map_err(at(&folder))?;
    if let Record::Rendered(view) = record {
        let noisy = view.noisy.iter().map(|noisy| (&noisy.file, &noisy.sha256));
        for (file, expected) in noisy.chain([(&view.reference.file, &view.reference.sha256)]) {
            let (from, to) = (from.join(file), folder.join(file));
            let bytes = fs::read(&from).map_err(at(&from))?;
            let found = sha256(&bytes);
            if found != *expected {
                let found = format!("the SHA-256 {found}");
                let expected = expected.clone();
                return Err(
                    quietlight_denoise::Error::Format { path: from, found, expected }.into()
                );
            }
            fs::write(&to, bytes).map_err(at(&to))?;
        }
    }
    Ok(record.write(to)?)
}
