//! Estimators of the light that reaches the camera.
//!
//! Each is a small struct of documented settings, with the algorithm for one sample or one mutation as its methods. How
//! many of them, on which threads, is for [`crate::render`] to say.

pub mod bdpt;
mod changes;
mod choice;
pub mod correlated_visibility;
pub mod erpt;
mod markov;
pub mod mis;
pub mod mlt;
pub mod path_tracing;
pub mod pssmlt;
pub mod receiver;
mod splat;

pub use bdpt::Bdpt;
pub use changes::Mutations;
pub use choice::{Choice, Effort, LightProbe, Purpose};
pub use correlated_visibility::CorrelatedVisibility;
pub use erpt::Erpt;
pub use markov::MarkovChains;
pub use mlt::Mlt;
pub use path_tracing::{Batch, PathSample, PathTracing, Strategy, Vertex};
pub use pssmlt::{PrimaryPaths, Pssmlt};
pub use receiver::Receiver;
pub use splat::Splat;

/// How light is found. All methods have the same mean, where they can find the light at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Integrator {
    /// Walks from the camera.
    Path(PathTracing),
    /// Walks from the camera and from emitters, joined in every way.
    Bdpt(Bdpt),
    /// Metropolis sampling of the random numbers of another method.
    Pssmlt(Pssmlt),
    /// Metropolis sampling of whole paths.
    Mlt(Mlt),
    /// Path tracing whose energy short chains spread over the film.
    Erpt(Erpt),
    /// Resampled direct light, exchanged between neighbouring pixels; path tracing of all other light.
    Visibility(CorrelatedVisibility),
}

impl Default for Integrator {
    fn default() -> Self {
        Self::Path(PathTracing::default())
    }
}

impl Integrator {
    /// Its name on the command line and in files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Path(_) => "path",
            Self::Bdpt(_) => "bdpt",
            Self::Pssmlt(_) => "pssmlt",
            Self::Mlt(_) => "mlt",
            Self::Erpt(_) => "erpt",
            Self::Visibility(_) => "visibility",
        }
    }

    /// Its settings, in words for a file's metadata.
    pub fn settings(&self) -> String {
        match self {
            Self::Path(settings) => format!("{settings:?}"),
            Self::Bdpt(settings) => format!("{settings:?}"),
            Self::Pssmlt(settings) => format!("{settings:?}"),
            Self::Mlt(settings) => format!("{settings:?}"),
            Self::Erpt(settings) => format!("{settings:?}"),
            Self::Visibility(settings) => format!("{settings:?}"),
        }
    }

    /// Is it path tracing, whose samples have radiance and features at once?
    pub fn is_path(&self) -> bool {
        matches!(self, Self::Path(_))
    }

    /// The path tracer that walks for the feature layers, and for all layers where it is the integrator.
    pub fn features(&self) -> PathTracing {
        match self {
            Self::Path(settings) => *settings,
            _ => PathTracing { strategy: Strategy::Features, ..PathTracing::default() },
        }
    }

    /// The path tracer that finds light where this one leaves that to it.
    pub fn path_tracing(&self) -> PathTracing {
        match self {
            Self::Path(settings) => *settings,
            Self::Bdpt(_)
            | Self::Pssmlt(_)
            | Self::Mlt(_)
            | Self::Erpt(_)
            | Self::Visibility(_) => PathTracing::default(),
        }
    }
}

impl From<PathTracing> for Integrator {
    fn from(settings: PathTracing) -> Self {
        Self::Path(settings)
    }
}
