//! Where files will be written, looked at before hours are spent on what goes into them.

use super::{BadInput, Failure};
use anyhow::{Context, anyhow};
use std::path::Path;

/// Refuses a picture that could not be written: an EXR with a PNG beside it.
pub(super) fn check_picture(path: &Path) -> Result<(), Failure> {
    check(path, "exr")?;
    check(&path.with_extension("png"), "png")
}

/// Refuses a file of that ending that could not be written.
pub(super) fn check(path: &Path, ending: &str) -> Result<(), Failure> {
    if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case(ending)) {
        return Err(anyhow!("the output must be named *.{ending}, not {}", path.display()))
            .bad_input();
    }
    if path.metadata().is_ok_and(|facts| facts.is_dir()) {
        return Err(anyhow!("{} is a folder", path.display())).bad_input();
    }
    let folder = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    if folder.metadata().is_ok_and(|facts| !facts.is_dir()) {
        return Err(anyhow!("{} is not a folder", folder.display())).bad_input();
    }
    // Only an attempt tells: permissions, a disk that is mounted to be read, one without a free inode.
    tempfile::tempfile_in(folder)
        .map(|_| ())
        .with_context(|| format!("cannot write into {}", folder.display()))
        .bad_input()
}

/// Refuses a picture that, or whose PNG, would replace one of the files that it is made from.
pub(super) fn check_inputs<'a>(
    path: &Path,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<(), Failure> {
    let outputs = [path.to_path_buf(), path.with_extension("png")];
    for input in inputs {
        let input = input.canonicalize().ok();
        let same =
            outputs.iter().find(|output| input.is_some() && output.canonicalize().ok() == input);
        if let Some(output) = same {
            let message = "is read, and would be replaced by what is written; name another output";
            return Err(anyhow!("{} {message}", output.display())).bad_input();
        }
    }
    Ok(())
}
