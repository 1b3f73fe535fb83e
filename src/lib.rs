//! World space: from a scene file to a noisy picture with its feature buffers.

pub mod bsdf;
pub mod emitter;
pub mod geometry;
pub mod math;
pub mod sampler;
pub mod scene;
pub mod texture;
