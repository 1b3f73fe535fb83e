//! Estimators of the light that reaches the camera.

pub mod bdpt;
pub mod mis;
pub mod path_tracing;

pub use bdpt::Bdpt;
pub use path_tracing::{PathSample, PathTracing, Strategy, Vertex};
