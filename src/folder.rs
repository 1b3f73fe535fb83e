//! Folders that long work is kept in: records as JSON, each whole or not at all, and settings that must agree.

use quietlight_denoise::atomic;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Why a folder of long work cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or the folder cannot be read or written, or is not what it must be.
    #[error(transparent)]
    File(#[from] quietlight_denoise::Error),
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
}

impl Error {
    /// Did the user name a folder or a file that cannot do, rather than the machine fail?
    pub fn is_of_the_user(&self) -> bool {
        use quietlight_denoise::Error::{Format, Io};
        match self {
            Self::File(Io { source, .. }) => {
                use io::ErrorKind::{AlreadyExists, NotADirectory, NotFound};
                matches!(source.kind(), NotFound | NotADirectory | AlreadyExists)
            }
            Self::File(Format { .. }) | Self::Settings { .. } => true,
            Self::File(_) => false,
        }
    }
}

/// Says which file an operation of the system was about.
pub(crate) fn at(path: &Path) -> impl Fn(io::Error) -> quietlight_denoise::Error + Copy {
    move |source| quietlight_denoise::Error::Io { path: path.to_path_buf(), source }
}

/// Reads a record of a folder; `of` says what folder it is, such as "a data set".
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path, of: &str) -> Result<T, Error> {
    let text = fs::read_to_string(path).map_err(at(path))?;
    let record = serde_json::from_str(&text);
    Ok(record.map_err(|error| quietlight_denoise::Error::Format {
        path: path.to_path_buf(),
        found: error.to_string(),
        expected: format!("a file of {of} of this version"),
    })?)
}

/// Writes a record, whole or not at all.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    atomic::write(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value).map_err(|error| at(path)(error.into()))?;
        file.write_all(b"\n").map_err(at(path))
    })?;
    Ok(())
}
