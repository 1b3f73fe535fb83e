//! Training pairs: noisy renders of many views, each with a converged render of the same view.
//!
//! A data set is a folder. Its `manifest.json` holds the [`Settings`] of the whole set; each view has a folder of its own,
//! `views/ID`, with noisy renders, a reference and, written last, a `view.json` (see [`manifest`]); or a `skipped.json` where
//! no pictures could be made. A view with neither is half-written and made again.
//!
//! Views are numbered, and everything random about view `k` comes from the base seed and `k`: any machine can make any
//! view, and a [`Shard`] of the views on each of several machines gives the same bits as one machine.

pub mod contact_sheet;
pub mod export;
pub(crate) mod exposure;
pub mod generator;
mod make;
pub mod manifest;
pub mod merge;
mod pairs;
mod seed;
mod space;
mod variation;

pub use crate::render::Shard;
pub use make::{Job, Outcome, Plan};
pub use manifest::{Manifest, Record, Settings, View};

use crate::folder;
use std::path::PathBuf;

/// Why a data set cannot be made, merged or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The folder or a file of it cannot be used.
    #[error(transparent)]
    Folder(#[from] folder::Error),
    /// Two data sets hold different renders of one view.
    #[error("view {id} of {first} and of {second} differ: the sets cannot be merged")]
    Conflict {
        /// The view.
        id: String,
        /// One data set.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// The disk is too small.
    #[error(
        "{path}: about {} MB are needed and {} MB are free; ask for fewer views, or use --shard on several disks",
        needed / 1_000_000,
        free / 1_000_000
    )]
    Space {
        /// The folder of the data set.
        path: PathBuf,
        /// Bytes that the missing views will take.
        needed: u64,
        /// Bytes free on its disk.
        free: u64,
    },
    /// Threads cannot be started.
    #[error("cannot start threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

impl From<quietlight_denoise::Error> for Error {
    fn from(error: quietlight_denoise::Error) -> Self {
        Self::Folder(error.into())
    }
}
