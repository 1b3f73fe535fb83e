//! The layers that the networks use, made safe and complete.

use std::borrow::Cow;
use std::collections::BTreeMap;

use ndarray::Zip;

use super::network::Branch;
use super::orientation::Orientation;
use super::transform::{demodulation, remodulation};
use crate::error::Error;
use crate::exposure::exposure;
use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::sanitize::{Sanitised, is_sane, sanitise};
use crate::variance;

/// The layers that there may be use of.
pub const LAYERS: [LayerKind; 6] = [
    LayerKind::Beauty,
    LayerKind::Diffuse,
    LayerKind::Specular,
    LayerKind::Albedo,
    LayerKind::Normal,
    LayerKind::Depth,
];

/// Exposed specular (or diffuse) light that is nowhere brighter than this is not worth a network: a millionth of the
/// picture's brightness.
const DARK: f32 = 1e-6;

/// The part of the light that diffuse and specular layers may lack: more, and the picture is not their sum.
const MISSING: f64 = 0.01;

/// What the networks see of a picture. Every layer has a variance; whatever was fit for use already is borrowed.
pub(super) struct Buffers<'a> {
    /// Pixels across.
    pub(super) width: usize,
    /// Pixels down.
    pub(super) height: usize,
    /// The noisy picture, `[3, height, width]`.
    pub(super) beauty: Cow<'a, Image>,
    /// The factor that brings the picture near 1.
    pub(super) exposure: f32,
    layers: BTreeMap<LayerKind, Cow<'a, Layer>>,
    /// The layer whose light the diffuse branch filters: the beauty where the picture is not split.
    diffuse: LayerKind,
    /// Values that had to be replaced.
    pub(super) sanitised: Sanitised,
    /// Layers whose variance is that of the 3×3 neighbours, for want of samples to tell.
    pub(super) spatial_variance: Vec<LayerKind>,
    /// How the picture was turned.
    orientation: Orientation,
}

/// Mean and variance of a layer as planes, row after row.
#[derive(Clone, Copy)]
pub(super) struct Planes<'a> {
    mean: &'a [f32],
    variance: &'a [f32],
    plane: usize,
}

impl<'a> Planes<'a> {
    /// Mean of one channel.
    #[inline(always)]
    pub(super) fn mean(&self, channel: usize) -> &'a [f32] {
        &self.mean[channel * self.plane..][..self.plane]
    }

    /// Variance of the mean of one channel.
    #[inline(always)]
    pub(super) fn variance(&self, channel: usize) -> &'a [f32] {
        &self.variance[channel * self.plane..][..self.plane]
    }
}

impl<'a> Buffers<'a> {
    /// Takes the layers that are needed: the radiance as diffuse and specular where both are there, else whole.
    ///
    /// # Errors
    /// [`Error::MissingLayer`] where there is no radiance, [`Error::Shape`] where an image has not the size of the picture
    /// or the picture has no pixel.
    pub(super) fn new(layers: &'a Layers) -> Result<Self, Error> {
        layers.check_shapes()?;
        if layers.width * layers.height == 0 {
            let found = [3, layers.height, layers.width];
            let expected = [3, layers.height.max(1), layers.width.max(1)];
            return Err(Error::Shape { what: "the picture".into(), found, expected });
        }
        let mut buffers = Self {
            width: layers.width,
            height: layers.height,
            beauty: Cow::Owned(Image::zeros((0, 0, 0))),
            exposure: 1.0,
            layers: BTreeMap::new(),
            diffuse: LayerKind::Diffuse,
            sanitised: Sanitised::default(),
            spatial_variance: Vec::new(),
            orientation: Orientation::default(),
        };
        for kind in LAYERS {
            buffers.take(layers, kind);
        }

        let has = |kind| buffers.layers.contains_key(&kind);
        let is_split = has(LayerKind::Diffuse) && has(LayerKind::Specular) && buffers.is_whole();
        buffers.diffuse = match (is_split, has(LayerKind::Beauty)) {
            (true, _) => LayerKind::Diffuse,
            (false, true) => LayerKind::Beauty,
            // A scene without specular light may come without a beauty layer: it would be the diffuse one.
            (false, false) if has(LayerKind::Diffuse) => LayerKind::Diffuse,
            (false, false) => return Err(layers.missing(LayerKind::Beauty)),
        };
        if !is_split {
            buffers.layers.remove(&LayerKind::Specular);
        }
        buffers.beauty = match buffers.layers.get(&LayerKind::Beauty) {
            Some(Cow::Borrowed(layer)) => Cow::Borrowed(&layer.mean),
            Some(Cow::Owned(layer)) => Cow::Owned(layer.mean.clone()),
            None => {
                let mut sum = buffers.layers[&buffers.diffuse].mean.clone();
                if let Some(specular) = buffers.layers.get(&LayerKind::Specular) {
                    sum += &specular.mean;
                }
                Cow::Owned(sum)
            }
        };
        buffers.exposure = exposure(&buffers.beauty);
        Ok(buffers)
    }

    /// The same picture turned.
    pub(super) fn turned(&self, orientation: Orientation) -> Buffers<'static> {
        let [height, width] = orientation.size([self.height, self.width]);
        let turn = |layer: &Layer| Layer {
            mean: orientation.turn(&layer.mean),
            variance: layer.variance.as_ref().map(|variance| orientation.turn(variance)),
            halves: None,
        };
        let layers = self.layers.iter().map(|(kind, layer)| (*kind, Cow::Owned(turn(layer))));
        Buffers {
            width,
            height,
            // Only the picture as it is gets mixed with it.
            beauty: Cow::Owned(Image::zeros((0, 0, 0))),
            exposure: self.exposure,
            layers: layers.collect(),
            diffuse: self.diffuse,
            sanitised: self.sanitised,
            spatial_variance: self.spatial_variance.clone(),
            orientation,
        }
    }

    /// Where a pixel was before the picture was turned.
    #[inline]
    pub(super) fn source(&self, pixel: usize) -> usize {
        if self.orientation == Orientation::default() {
            return pixel;
        }
        let size = [self.height, self.width];
        let [y, x] = self.orientation.source([pixel / self.width, pixel % self.width], size);
        y * self.orientation.size(size)[1] + x
    }

    /// Where a pixel `[y, x]` of the picture before it was turned is now.
    #[inline]
    pub(super) fn place(&self, pixel: [usize; 2]) -> [usize; 2] {
        self.orientation.place(pixel, [self.height, self.width])
    }

    /// Takes one layer over, as it is where that is good enough.
    fn take(&mut self, layers: &'a Layers, kind: LayerKind) {
        let Some(layer) = layers.layers.get(&kind) else { return };
        let is_single =
            layers.samples.iter().flatten().any(|&samples| samples.is_nan() || samples < 2.0);
        let is_plain = |image: &Image| image.is_standard_layout();
        let is_complete = layer.variance.as_ref().is_some_and(is_plain);
        if is_complete && is_plain(&layer.mean) && !is_single && is_sane(layer) {
            self.layers.insert(kind, Cow::Borrowed(layer));
            return;
        }
        let mut one = Layers {
            width: layers.width,
            height: layers.height,
            layers: [(kind, layer.clone())].into(),
            samples: layers.samples.clone(),
            ..Default::default()
        };
        self.sanitised = self.sanitised + sanitise(&mut one);
        self.spatial_variance.extend(variance::complete(&mut one));
        if let Some(layer) = one.layers.remove(&kind) {
            let plain = |image: Image| image.as_standard_layout().into_owned();
            let (mean, variance) = (plain(layer.mean), layer.variance.map(plain));
            self.layers.insert(kind, Cow::Owned(Layer { mean, variance, halves: None }));
        }
    }

    /// Whether diffuse and specular light make up the picture, where all three are there. Other renderers may have more:
    /// emission, transmission.
    fn is_whole(&self) -> bool {
        let [beauty, diffuse, specular] =
            [LayerKind::Beauty, LayerKind::Diffuse, LayerKind::Specular]
                .map(|k| self.layers.get(&k));
        let (Some(beauty), Some(diffuse), Some(specular)) = (beauty, diffuse, specular) else {
            return true;
        };
        let (mut missing, mut all) = (0.0, 0.0);
        Zip::from(&beauty.mean).and(&diffuse.mean).and(&specular.mean).for_each(|beauty, d, s| {
            missing += f64::from(d + s - beauty).abs();
            all += f64::from(*beauty).abs();
        });
        // Other renderers round to halves, and ours that are not finite are mended one by one.
        missing <= MISSING * all
    }

    /// A layer that is there.
    pub(super) fn planes(&self, kind: LayerKind) -> Option<Planes<'_>> {
        let layer = self.layers.get(&kind)?;
        let mean = layer.mean.as_slice().expect("layers are made plain when they are taken");
        let variance = layer.variance.as_ref().and_then(|variance| variance.as_slice());
        let variance = variance.expect("every layer is given a plain variance when it is taken");
        Some(Planes { mean, variance, plane: self.width * self.height })
    }

    /// The light of a branch; `None` where the picture is not split.
    pub(super) fn light(&self, branch: Branch) -> Option<Planes<'_>> {
        self.planes(match branch {
            Branch::Diffuse => self.diffuse,
            Branch::Specular => LayerKind::Specular,
        })
    }

    /// Whether a branch has light worth filtering.
    pub(super) fn needs(&self, branch: Branch) -> bool {
        let exposed = |&value: &f32| value.abs() * self.exposure > DARK;
        self.light(branch).is_some_and(|light| light.mean.iter().any(exposed))
    }

    /// Whether the variances of the radiance tell of noise: not where they are of the 3×3 neighbours.
    pub(super) fn knows_noise(&self) -> bool {
        !self.spatial_variance.iter().any(|kind| kind.is_radiance())
    }

    /// How the light of a branch becomes its signal and back, under an exposure.
    pub(super) fn modulation(&self, branch: Branch, exposure: f32) -> Modulation<'_> {
        match branch {
            Branch::Diffuse => Modulation::Diffuse(self.planes(LayerKind::Albedo), exposure),
            Branch::Specular => Modulation::Specular(exposure),
        }
    }
}

/// The factor between radiance and signal in each pixel and channel.
#[derive(Clone, Copy)]
pub(super) enum Modulation<'a> {
    /// The albedo, taken as 1 where there is none, is divided out; and the exposure.
    Diffuse(Option<Planes<'a>>, f32),
    /// Only the exposure.
    Specular(f32),
}

impl Modulation<'_> {
    /// What radiance is multiplied by to become a signal.
    #[inline(always)]
    pub(super) fn to_signal(self, channel: usize, pixel: usize) -> f32 {
        match self {
            Self::Diffuse(Some(albedo), exposure) => {
                demodulation(albedo.mean(channel)[pixel], exposure)
            }
            Self::Diffuse(None, exposure) => demodulation(1.0, exposure),
            Self::Specular(exposure) => exposure,
        }
    }

    /// What a signal is multiplied by to become radiance.
    #[inline(always)]
    pub(super) fn to_radiance(self, channel: usize, pixel: usize) -> f32 {
        match self {
            Self::Diffuse(Some(albedo), exposure) => {
                remodulation(albedo.mean(channel)[pixel], exposure)
            }
            Self::Diffuse(None, exposure) => remodulation(1.0, exposure),
            Self::Specular(exposure) => exposure.recip(),
        }
    }
}
