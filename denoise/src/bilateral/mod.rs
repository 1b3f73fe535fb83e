//! Cross-bilateral filtering guided by features (Kalantari, Bako and Sen 2015, "A Machine Learning Approach for
//! Filtering Monte Carlo Noise"), here with constant parameters or one set for each pixel.
//!
//! In order: sanitise, prepare the variances, prefilter the features, take the spikes out of the colour variance, filter,
//! take the spikes out of the result. A group of features that the picture has not is left out.

mod features;
mod filter;
mod prefilter;
mod spikes;
mod stack;

use std::sync::atomic::{AtomicUsize, Ordering};

pub use features::GROUPS;
use rayon::prelude::*;

use crate::error::Error;
use crate::layers::{Image, Layer, LayerKind, Layers};
use crate::sanitize::{Sanitised, sanitise};
use crate::variance;

/// The six multipliers λ₀ (pixel distance) and λ₁ to λ₅ (the [`GROUPS`]): larger is sharper, 0 ignores the term.
#[derive(Clone, Debug, PartialEq)]
pub enum Lambda {
    /// The same for all pixels.
    Constant([f32; 6]),
    /// One set for each pixel, `[6, height, width]`.
    PerPixel(Image),
}

/// What the filter can be told.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// Multipliers of the pixel distance and of the features.
    pub lambda: Lambda,
    /// Multiplier `λ_c` of the colour distance. The paper's filter has 0.01 fixed (a standard deviation of 7).
    pub colour: f32,
    /// Radius of the window, at most 27 (55×55 pixels). Smaller is faster and leaves slow noise.
    pub window_radius: usize,
    /// How many standard deviations of its 55×55 neighbourhood a colour variance may be off before it is replaced by the
    /// 3×3 median; `None` keeps all. Without it a firefly's variance accepts every neighbour.
    pub variance_spikes: Option<f32>,
    /// How many standard deviations of its 8 neighbours a filtered pixel may be off before it is replaced by the 3×3
    /// median; `None` keeps all. Smaller than 2 eats fine texture.
    pub result_spikes: Option<f32>,
}

/// Constant parameters found by `examples/grid_search.rs` on our own scenes at 8 and 64 samples per pixel; what they do on
/// each is in `models/README.md`. The colour term is stronger than the paper's and keeps edges that features do not show,
/// so that position and normal are left with nothing to add; where noise leaves it weak, the narrow spatial term holds.
impl Default for Parameters {
    fn default() -> Self {
        Self {
            lambda: Lambda::Constant([0.16, 0.0, 0.0, 0.025, 0.003, 0.07]),
            colour: 0.2,
            window_radius: filter::LARGEST_RADIUS,
            variance_spikes: Some(10.0),
            result_spikes: Some(2.0),
        }
    }
}

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
    parameters.check()?;
    Prepared::new(layers)?.filter(parameters, progress)
}

/// Layers ready to be filtered; all that does not depend on the parameters is done.
#[derive(Debug)]
pub struct Prepared {
    colour: Image,
    colour_variance: Image,
    features: Vec<features::Feature>,
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
        let features: Vec<_> = features.par_iter().map(prefilter::prefilter).collect();
        let beauty = used.layers.remove(&LayerKind::Beauty);
        let (colour, colour_variance) = beauty
            .and_then(|layer| Some((layer.mean, layer.variance?)))
            .ok_or_else(|| layers.missing(LayerKind::Beauty))?;
        let groups = features.iter().map(|feature| GROUPS[feature.group]).collect();
        let report = Report { sanitised, spatial_variance, groups, ..Default::default() };
        Ok(Self { colour, colour_variance, features, report })
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
        parameters.check()?;
        let (_, height, width) = self.colour.dim();
        if let Lambda::PerPixel(image) = &parameters.lambda
            && image.dim() != (6, height, width)
        {
            let found = image.dim().into();
            return Err(Error::Shape {
                what: "lambda".into(),
                found,
                expected: [6, height, width],
            });
        }

        let mut report = self.report.clone();
        let mut variance = self.colour_variance.clone();
        if let Some(threshold) = parameters.variance_spikes {
            report.variance_spikes =
                spikes::remove_spikes(&mut variance, VARIANCE_SPIKE_RADIUS, threshold);
        }
        let stack = stack::Stack::new(&self.colour, &variance, &self.features);
        let rows_done = AtomicUsize::new(0);
        let mut image = stack.filter(parameters, &|| {
            let rows = rows_done.fetch_add(1, Ordering::Relaxed) + 1;
            progress(rows as f32 / height as f32);
        });
        if let Some(threshold) = parameters.result_spikes {
            report.result_spikes = spikes::remove_spikes(&mut image, 1, threshold);
        }
        Ok(Denoised { image, report })
    }
}

/// Radius of the neighbourhood that tells whether a colour variance is a spike (METHODS 9.2).
const VARIANCE_SPIKE_RADIUS: usize = 27;

impl Parameters {
    fn check(&self) -> Result<(), Error> {
        let positive = |name: &str, value: f32| {
            if value >= 0.0 && value.is_finite() {
                return Ok(());
            }
            Err(Error::Parameter {
                name: name.into(),
                value: value.to_string(),
                expected: "a finite number, 0 or more",
            })
        };
        match &self.lambda {
            Lambda::Constant(values) => {
                values.iter().try_for_each(|&value| positive("lambda", value))?;
            }
            Lambda::PerPixel(image) => {
                image.iter().try_for_each(|&value| positive("lambda", value))?;
            }
        }
        positive("lambda of the colour", self.colour)?;
        for threshold in [self.variance_spikes, self.result_spikes].into_iter().flatten() {
            positive("threshold of the spikes", threshold)?;
        }
        if self.window_radius <= filter::LARGEST_RADIUS {
            return Ok(());
        }
        let (name, value) = ("radius of the window".into(), self.window_radius.to_string());
        Err(Error::Parameter { name, value, expected: "at most 27" })
    }
}

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

#[cfg(test)]
mod tests;
