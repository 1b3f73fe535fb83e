//! Image space: feature layers, denoisers and the metrics that judge them.

pub mod layers;

pub use layers::{Image, Layer, LayerKind, Layers};

/// Luminance of linear Rec. 709: the weights of red, green and blue (ITU-R BT.709).
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];
