//! The trade of speed for accuracy, measured: integrators × sample counts × denoisers, each replicated over seeds, against a
//! converged reference; scores, a Pareto front, and what to choose.
//!
//! A measurement is a folder. Its `plan.json` holds the [`Settings`]; each unit of work ([`mod@unit`]), a half of a reference or one seed
//! of one integrator, has a folder of its own with pictures, and a record that the times stand in. A unit is there whole or
//! not at all, any machine can make any of them, and folders put together ([`merge`]) are what one process makes. What is
//! told of them ([`scores`], [`page`]) comes from the folder alone.

pub mod curve;
mod job;
mod judge;
pub mod merge;
pub mod page;
mod pictures;
mod request;
pub mod scores;
pub mod settings;
pub mod statistics;
mod table;
pub mod unit;
mod verdict;
mod words;
mod workshop;

pub use job::{Job, Outcome, Plan};
pub use request::{REFERENCE_FACTOR, Request};
pub use scores::Scores;
pub use settings::{Filter, Method, ReferenceBudget, Settings};
pub use verdict::{Choice, Standing, Verdict};

use crate::folder;

/// Name of the file of scores, one row for each integrator, denoiser and sample count of a scene.
pub const CSV: &str = "scores.csv";
/// Name of the file of all that was found.
pub const JSON: &str = "scores.json";
/// Name of the page.
pub const PAGE: &str = "tradeoff.html";

/// Why a measurement cannot be made, merged or told of.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The folder or a file of it cannot be used.
    #[error(transparent)]
    Folder(#[from] folder::Error),
    /// Nothing of what was asked for can be measured.
    #[error("nothing can be measured: {0}")]
    Nothing(String),
    /// A scene cannot be loaded.
    #[error(transparent)]
    Scene(#[from] crate::scene::SceneError),
    /// Threads cannot be started.
    #[error("cannot start threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

impl From<quietlight_denoise::Error> for Error {
    fn from(error: quietlight_denoise::Error) -> Self {
        Self::Folder(error.into())
    }
}
