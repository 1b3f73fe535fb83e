//! One measurement out of the shards of several machines.

use super::Error;
use super::settings::Settings;
use super::unit::{ReferenceHalf, Run};
use crate::folder::at;
use std::fs;
use std::path::{Path, PathBuf};

/// What [`merge`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Merged {
    /// Units copied.
    pub copied: usize,
    /// Units that `output` had already.
    pub already_there: usize,
}

/// Copies the units of `inputs` into `output`, which may hold some already; a unit that is there stays as it is, for two
/// machines make the same pictures of it, in times of their own.
///
/// # Errors
/// [`Settings`](crate::folder::Error::Settings) where two of them are of different settings, before anything is copied.
pub fn merge(output: &Path, inputs: &[PathBuf]) -> Result<Merged, Error> {
    let mut settings = match Settings::path(output).exists() {
        true => Some(Settings::read(output)?),
        false => None,
    };
    for input in inputs {
        let found = Settings::read(input)?;
        settings = Some(match settings {
            Some(first) => found.join(&first, input)?,
            None => found,
        });
    }
    let Some(settings) = settings else { return Ok(Merged::default()) };
    fs::create_dir_all(output).map_err(at(output))?;
    settings.write(output)?;
    let mut merged = Merged::default();
    for input in inputs {
        for kind in ["references", "runs"] {
            for scene in folders(&input.join(kind))? {
                for unit in folders(&scene)? {
                    if ReferenceHalf::read(&unit).is_err() && Run::read(&unit).is_err() {
                        continue;
                    }
                    let below = unit.strip_prefix(input).unwrap_or(&unit);
                    match copy(&unit, &output.join(below))? {
                        true => merged.copied += 1,
                        false => merged.already_there += 1,
                    }
                }
            }
        }
    }
    Ok(merged)
}

/// The whole folders in a folder, by name; none where it is not there.
fn folders(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(at(folder))?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let entry = entry.map_err(at(folder))?;
        // A dot begins the names of folders that are not whole.
        let is_whole = !entry.file_name().to_string_lossy().starts_with('.');
        if is_whole && entry.path().is_dir() {
            found.push(entry.path());
        }
    }
    found.sort_unstable();
    Ok(found)
}

/// Copies the files of a folder, under another name until all are there; false where `to` is there already.
fn copy(from: &Path, to: &Path) -> Result<bool, Error> {
    if to.exists() {
        return Ok(false);
    }
    let name = to.file_name().unwrap_or_default().to_string_lossy();
    let part = to.with_file_name(format!(".{name}.part"));
    fs::create_dir_all(&part).map_err(at(&part))?;
    for entry in fs::read_dir(from).map_err(at(from))? {
        let file = entry.map_err(at(from))?;
        let target = part.join(file.file_name());
        fs::copy(file.path(), &target).map_err(at(&target))?;
    }
    fs::rename(&part, to).map_err(at(to))?;
    Ok(true)
}
