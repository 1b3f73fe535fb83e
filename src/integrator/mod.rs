//! Estimators of the light that reaches the camera.

pub mod correlated_visibility;
pub mod mis;
pub mod path_tracing;
pub mod receiver;
pub mod roulette;

pub use correlated_visibility::CorrelatedVisibility;
pub use path_tracing::{PathSample, PathTracing, Strategy, Vertex};
pub use receiver::Receiver;
