//! Estimators of the light that reaches the camera.

pub mod mis;
pub mod path_tracing;
pub mod roulette;

pub use path_tracing::{PathSample, PathTracing, Strategy, Vertex};
