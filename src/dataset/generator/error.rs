//! Why a scene could not be generated.

use crate::scene::SceneError;
use std::path::{Path, PathBuf};

/// Why a scene could not be generated.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// An image could not be encoded.
    #[error("{}: the image could not be written: {reason}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        reason: String,
    },
    /// The scene file could not be written.
    #[error(transparent)]
    Write(#[from] quietlight_denoise::Error),
    /// The scene that was written cannot be read again: a fault of the generator.
    #[error("the generated scene cannot be read: {0}")]
    Scene(#[from] SceneError),
}

impl Error {
    pub(super) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_path_buf(), source }
    }

    pub(super) fn image(path: &Path, reason: impl ToString) -> Self {
        Self::Image { path: path.to_path_buf(), reason: reason.to_string() }
    }
}
