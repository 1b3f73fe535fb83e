//! What a renderer hands to a denoiser: named images with their variance and halves.

use std::collections::BTreeMap;

use crate::error::Error;

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
    /// Estimated relative squared error of the picture, smooth, `[1, height, width]`; its mean is the relative L2.
    pub error: Option<Image>,
    /// What is known of how the picture was made: scene, integrator, seed, samples, seconds, version ...
    pub metadata: BTreeMap<String, String>,
}

impl LayerKind {
    /// Every kind, in the order of declaration.
    pub const ALL: [Self; 9] = [
        Self::Beauty,
        Self::Diffuse,
        Self::Specular,
        Self::Albedo,
        Self::Normal,
        Self::Position,
        Self::Depth,
        Self::Texture2,
        Self::Visibility,
    ];

    /// Name of the layer in files and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Beauty => "noisy",
            Self::Diffuse => "diffuse",
            Self::Specular => "specular",
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Position => "position",
            Self::Depth => "depth",
            Self::Texture2 => "texture2",
            Self::Visibility => "visibility",
        }
    }

    /// Names of the layer's channels, in the order of the first axis of its images.
    pub const fn components(self) -> &'static [&'static str] {
        match self {
            Self::Beauty | Self::Diffuse | Self::Specular | Self::Albedo | Self::Texture2 => {
                &["R", "G", "B"]
            }
            Self::Normal | Self::Position => &["X", "Y", "Z"],
            Self::Depth => &["Z"],
            Self::Visibility => &["V"],
        }
    }

    /// Whether the layer is radiance (unbounded) and not a feature of the surface seen.
    pub const fn is_radiance(self) -> bool {
        matches!(self, Self::Beauty | Self::Diffuse | Self::Specular)
    }
}

impl Layers {
    /// Checks that every image has the height and width of the picture and the channels of its kind.
    ///
    /// # Errors
    /// [`Error::Shape`] naming the first image that has not.
    pub fn check_shapes(&self) -> Result<(), Error> {
        let check = |what: &dyn Fn() -> String, image: &Image, channels: usize| {
            let expected = [channels, self.height, self.width];
            let (c, h, w) = image.dim();
            if [c, h, w] == expected {
                Ok(())
            } else {
                Err(Error::Shape { what: what(), found: [c, h, w], expected })
            }
        };
        for (kind, layer) in &self.layers {
            let channels = kind.components().len();
            check(&|| kind.name().into(), &layer.mean, channels)?;
            for (suffix, image) in layer.variance.iter().map(|image| ("variance", image)) {
                check(&|| format!("{}.{suffix}", kind.name()), image, channels)?;
            }
            for (suffix, image) in
                layer.halves.iter().flat_map(|halves| ["a", "b"].into_iter().zip(halves))
            {
                check(&|| format!("{}.{suffix}", kind.name()), image, channels)?;
            }
        }
        for (name, image) in
            [("samples", &self.samples), ("invalid", &self.invalid), ("error", &self.error)]
        {
            if let Some(image) = image {
                check(&|| name.into(), image, 1)?;
            }
        }
        Ok(())
    }

    /// The error that says which layer is missing and which there are.
    pub(crate) fn missing(&self, kind: LayerKind) -> Error {
        let found: Vec<_> = self.layers.keys().map(|kind| kind.name()).collect();
        let found = if found.is_empty() { "none".into() } else { found.join(", ") };
        Error::MissingLayer { missing: kind.name().into(), found }
    }
}
