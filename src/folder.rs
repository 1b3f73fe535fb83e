//! Folders that long work is kept in: records as JSON, each whole or not at all, and settings that must agree.

use quietlight_denoise::atomic;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Why a folder of long work cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a file or folder.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file is not what it must be.
    #[error("{path}: found {found}, expected {expected}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// A folder holds work of other settings.
    #[error(
        "{path}: was made with other settings: {differences}; use the same settings or another folder"
    )]
    Settings {
        /// The file of its settings.
        path: PathBuf,
        /// Each setting that differs, with both values.
        differences: String,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] quietlight_denoise::Error),
}

impl Error {
    /// Did the user name a folder or a file that cannot do, rather than the machine fail?
    pub fn is_of_the_user(&self) -> bool {
        match self {
            Self::Io { source, .. } => source.kind() == std::io::ErrorKind::NotFound,
            Self::Format { .. } | Self::Settings { .. } => true,
            Self::Write(_) => false,
        }
    }
}

/// Says which file an operation of the system was about.
pub(crate) fn at(path: &Path) -> impl FnOnce(std::io::Error) -> Error {
    let path = path.to_path_buf();
    move |source| Error::Io { path, source }
}

/// Reads a record of a folder; `of` says what folder it is, such as "a data set".
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path, of: &str) -> Result<T, Error> {
    let text = fs::read_to_string(path).map_err(at(path))?;
    serde_json::from_str(&text).map_err(|error| Error::Format {
        path: path.to_path_buf(),
        found: error.to_string(),
        expected: format!("a file of {of} of this version"),
    })
}

/// Writes a record, whole or not at all.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let io = |source| quietlight_denoise::Error::Io { path: path.to_path_buf(), source };
    atomic::write(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value).map_err(|error| io(error.into()))?;
        file.write_all(b"\n").map_err(io)
    })?;
    Ok(())
}
