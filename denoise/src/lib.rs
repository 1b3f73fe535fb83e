//! Image space: feature layers, denoisers and the metrics that judge them.

pub mod atomic;
pub mod bilateral;
pub mod blend;
pub mod denoiser;
pub mod error;
pub mod estimate;
mod exp;
mod exposure;
pub mod exr;
pub mod kpcn;
pub mod layers;
mod logarithm;
pub mod metrics;
pub mod picture;
pub mod png;
pub mod sanitize;
pub mod sha256;
mod simd;
pub mod srgb;
pub mod variance;
mod window;

pub use denoiser::{Denoised, Denoiser};
pub use error::Error;
pub use estimate::ErrorEstimate;
pub use layers::{Image, Layer, LayerKind, Layers};

/// Luminance of linear Rec. 709: the weights of red, green and blue (ITU-R BT.709).
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];
