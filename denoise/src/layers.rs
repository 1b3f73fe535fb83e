//! What a renderer hands to a denoiser: named images with their variance and halves.

use std::collections::BTreeMap;

/// Planar image, shape `[channel, row, column]`; row 0 is the top.
pub type Image = ndarray::Array3<f32>;

/// The layers that a render may have, in the order in which they are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LayerKind {
    /// The whole radiance, 3 channels; equals diffuse + specular exactly where both exist. Named `noisy` in files.
    Beauty,
    /// Radiance scattered by a diffuse lobe at the first non-delta surface, 3 channels.
    Diffuse,
    /// All other radiance: glossy lobes, emission, background, what is seen through delta chains; 3 channels.
    Specular,
    /// Reflectance in `[0, 1]` at the first non-delta surface, 3 channels.
    Albedo,
    /// Unit shading normal in world space, turned to the viewer, at the first non-delta surface; 3 channels.
    Normal,
    /// World position of the first hit, in scene units, 3 channels.
    Position,
    /// Length of the path from the camera to the first non-delta surface, in scene units, 1 channel.
    Depth,
    /// Albedo at the second hit, 3 channels.
    Texture2,
    /// Fraction of unoccluded shadow rays at the first hit, 1 channel.
    Visibility,
}

/// One layer: the mean over the samples of each pixel, and how sure it is.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Mean over samples, `[channels, height, width]`.
    pub mean: Image,
    /// Variance of that mean, same shape; `None` where the source gives none.
    pub variance: Option<Image>,
    /// Means of two independent halves of the samples, same shape; `mean` is their average.
    pub halves: Option<[Image; 2]>,
}

/// All layers of a picture. Every image has the same height and width.
#[derive(Clone, Debug, Default)]
pub struct Layers {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// The layers there are.
    pub layers: BTreeMap<LayerKind, Layer>,
    /// Samples taken in each pixel, `[1, height, width]`.
    pub samples: Option<Image>,
    /// Non-finite samples dropped in each pixel, `[1, height, width]`.
    pub invalid: Option<Image>,
    /// What is known of how the picture was made: scene, integrator, seed, samples, seconds, version ...
    pub metadata: BTreeMap<String, String>,
}
