//! Cross-bilateral filtering guided by features, its parameters learned (Kalantari, Bako and Sen 2015, "A Machine Learning
//! Approach for Filtering Monte Carlo Noise").
//!
//! In order: sanitise, prepare the variances, prefilter the features, see what the surroundings of each pixel look like and
//! let the network choose its parameters, take the spikes out of the colour variance, filter, take the spikes out of the
//! result. A group of features that the picture has not is left out.

mod block;
mod detail;
mod features;
mod filter;
mod mlp;
mod parameters;
mod prefilter;
mod secondary;
mod spikes;
mod stack;

use std::sync::atomic::{AtomicUsize, Ordering};

pub use features::GROUPS;
use filter::{Multipliers, Settings};
pub use mlp::Network;
use ndarray::s;
pub use parameters::{Lambda, Parameters};
use rayon::prelude::*;

use crate::error::Error;
use crate::exposure::binary_exposure;
use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::sanitize::{LARGEST_VARIANCE, Sanitised, sanitise};
use crate::simd::vectorise;
use crate::variance;

/// What was done to the layers and to the result, beside filtering.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Values that had to be replaced before anything else.
    pub sanitised: Sanitised,
    /// Layers whose variance is that of the 3×3 neighbours, for want of samples to tell.
    pub spatial_variance: Vec<LayerKind>,
    /// Feature groups that were there.
    pub groups: Vec<LayerKind>,
    /// Pixels whose colour variance was a spike.
    pub variance_spikes: usize,
    /// Pixels whose filtered colour was a spike.
    pub result_spikes: usize,
}

/// A filtered picture.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// The picture, `[3, height, width]`.
    pub image: Image,
    /// What was done beside filtering.
    pub report: Report,
}

/// Denoises the beauty layer; where there is none, the sum of the diffuse and the specular layer. `progress` hears the
/// part that is done, in `[0, 1]`, from any thread.
///
/// # Errors
/// [`Error::MissingLayer`] where there is no beauty, [`Error::Shape`] where an image (or λ) has not the size of the
/// layers or the picture has no pixel, [`Error::Parameter`] where a parameter is out of its range.
pub fn denoise(
    layers: &Layers,
    parameters: &Parameters,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Denoised, Error> {
    parameters.check(layers.height, layers.width)?;
    Prepared::new(layers)?.filter(parameters, progress)
}

/// Layers ready to be filtered; all that does not depend on the parameters is done.
#[derive(Debug)]
pub struct Prepared {
    colour: Image,
    colour_variance: Image,
    features: Vec<features::Feature>,
    secondary: secondary::Secondary,
    report: Report,
}

impl Prepared {
    /// Sanitises the layers, prepares their variances and prefilters the features.
    ///
    /// # Errors
    /// [`Error::MissingLayer`] and [`Error::Shape`] as [`denoise`].
    pub fn new(layers: &Layers) -> Result<Self, Error> {
        layers.check_shapes()?;
        if layers.width * layers.height == 0 {
            let found = [3, layers.height, layers.width];
            let expected = [3, layers.height.max(1), layers.width.max(1)];
            return Err(Error::Shape { what: "the picture".into(), found, expected });
        }
        let mut used = Layers {
            width: layers.width,
            height: layers.height,
            samples: layers.samples.clone(),
            ..Default::default()
        };
        used.layers.insert(LayerKind::Beauty, beauty(layers)?);
        let copies: Vec<_> = GROUPS
            .into_par_iter()
            .filter_map(|kind| Some((kind, layers.layers.get(&kind)?.clone())))
            .collect();
        used.layers.extend(copies);

        let sanitised = sanitise(&mut used);
        let spatial_variance = variance::complete(&mut used);
        let features = features::features(&used);
        let secondary = secondary::Secondary::new(&features, used.samples.as_ref());
        let features: Vec<_> = features.par_iter().map(prefilter::prefilter).collect();
        let beauty = used.layers.remove(&LayerKind::Beauty);
        let (colour, colour_variance) = beauty
            .and_then(|layer| Some((layer.mean, layer.variance?)))
            .ok_or_else(|| layers.missing(LayerKind::Beauty))?;
        let groups = features.iter().map(|feature| GROUPS[feature.group]).collect();
        let report = Report { sanitised, spatial_variance, groups, ..Default::default() };
        Ok(Self { colour, colour_variance, features, secondary, report })
    }

    /// The parameters that `network` chooses for each pixel, `[6, height, width]`.
    pub fn lambda(&self, network: &Network) -> Image {
        let (_, height, width) = self.colour.dim();
        let present = self.secondary.present(&self.features);
        let mut rows = vec![0.0; height * mlp::OUTPUTS * width];
        rows.par_chunks_mut(mlp::OUTPUTS * width).enumerate().for_each(|(y, out)| {
            let features = &mut self.secondary.row(&self.features, y, width);
            vectorise(mlp::RowOfPixels { network, features, present: &present, out });
        });
        image_of_rows(rows, (mlp::OUTPUTS, height, width))
    }

    /// All that a trainer needs, the channels as [`example_channels`] names them; 0 where the picture has no such group.
    /// The variances of the colour are without their spikes, as [`Parameters::constant`] removes them.
    pub fn example(&self) -> Image {
        let (_, height, width) = self.colour.dim();
        let mut variance = self.colour_variance.clone();
        if let Some(threshold) = Parameters::constant().variance_spikes {
            spikes::remove_spikes(&mut variance, VARIANCE_SPIKE_RADIUS, threshold);
        }
        let mut rows = Vec::new();
        for y in 0..height {
            let mut add = |image: &Image| rows.extend(image.slice(s![.., y, ..]).iter().copied());
            add(&self.colour);
            add(&variance);
            for (group, kind) in GROUPS.into_iter().enumerate() {
                let missing = Image::zeros((kind.components().len(), height, width));
                let feature = self.features.iter().find(|feature| feature.group == group);
                add(feature.map_or(&missing, |feature| &feature.mean));
                add(feature.map_or(&missing, |feature| &feature.variance));
            }
            rows.extend(self.secondary.row(&self.features, y, width));
        }
        image_of_rows(rows, (example_channels().len(), height, width))
    }

    /// Filters with `parameters`; `progress` hears the part that is done, in `[0, 1]`, from any thread.
    ///
    /// # Errors
    /// [`Error::Parameter`] and [`Error::Shape`] as [`denoise`].
    pub fn filter(
        &self,
        parameters: &Parameters,
        progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Denoised, Error> {
        let (_, height, width) = self.colour.dim();
        parameters.check(height, width)?;
        let learned;
        let lambda = match &parameters.lambda {
            Lambda::Learned => {
                learned = self.lambda(Network::embedded());
                Multipliers::PerPixel(&learned)
            }
            Lambda::Constant(values) => Multipliers::Constant(*values),
            Lambda::PerPixel(image) => Multipliers::PerPixel(image),
        };
        let settings =
            Settings { lambda, colour: parameters.colour, radius: parameters.window_radius };

        let mut report = self.report.clone();
        let mut variance = self.colour_variance.clone();
        if let Some(threshold) = parameters.variance_spikes {
            report.variance_spikes =
                spikes::remove_spikes(&mut variance, VARIANCE_SPIKE_RADIUS, threshold);
        }
        // Exposed, so that the ε of the colour distance is as small against dark pictures as against bright ones.
        let exposure = binary_exposure(&self.colour);
        variance.mapv_inplace(|value| (value * exposure * exposure).min(LARGEST_VARIANCE));
        let stack = stack::Stack::new(&(&self.colour * exposure), &variance, &self.features);
        let rows_done = AtomicUsize::new(0);
        let mut image = stack.filter(&settings, &|| {
            let rows = rows_done.fetch_add(1, Ordering::Relaxed) + 1;
            progress(rows as f32 / height as f32);
        });
        image /= exposure;
        if let Some(threshold) = parameters.result_spikes {
            report.result_spikes = spikes::remove_spikes(&mut image, 1, threshold);
        }
        Ok(Denoised { image, report })
    }
}

/// Radius of the neighbourhood that tells whether a colour variance is a spike (METHODS 9.2).
const VARIANCE_SPIKE_RADIUS: usize = 27;

/// The beauty layer, or the sum of its parts: their halves add up, their variances do not where they are correlated, so
/// that the halves alone tell the variance of a sum.
fn beauty(layers: &Layers) -> Result<Layer, Error> {
    let get = |kind| layers.layers.get(&kind);
    let parts = get(LayerKind::Diffuse).zip(get(LayerKind::Specular));
    match (get(LayerKind::Beauty), parts) {
        (Some(beauty), _) => Ok(beauty.clone()),
        (None, Some((diffuse, specular))) => {
            let halves = diffuse.halves.as_ref().zip(specular.halves.as_ref());
            Ok(Layer {
                mean: &diffuse.mean + &specular.mean,
                variance: None,
                halves: halves.map(|([a, b], [c, d])| [a + c, b + d]),
            })
        }
        (None, None) => Err(layers.missing(LayerKind::Beauty)),
    }
}

/// Names of the channels of [`Prepared::example`]: colour, its variance, mean and variance of each of the [`GROUPS`], and
/// the 36 secondary features.
pub fn example_channels() -> Vec<String> {
    let channels = |prefix: String, kind: LayerKind| {
        kind.components().iter().map(move |component| format!("{prefix}.{component}"))
    };
    [LayerKind::Beauty]
        .into_iter()
        .chain(GROUPS)
        .flat_map(|kind| {
            let name = kind.name();
            channels(name.into(), kind).chain(channels(format!("{name}.variance"), kind))
        })
        .chain(secondary::names())
        .collect()
}

/// An image whose channels lie one after the other in each row.
fn image_of_rows(rows: Vec<f32>, (channels, height, width): (usize, usize, usize)) -> Image {
    let mut image = Image::from_shape_vec((height, channels, width), rows)
        .expect("one row of each channel for each row");
    image.swap_axes(0, 1);
    image.as_standard_layout().into_owned()
}

#[cfg(test)]
mod tests;
