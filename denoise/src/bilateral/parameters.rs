//! What the filter can be told.

use super::filter::LARGEST_RADIUS;
use super::mlp::Network;
use crate::error::Error;
use crate::layers::Image;

/// The six multipliers λ₀ (pixel distance) and λ₁ to λ₅ (the [`GROUPS`](super::GROUPS)): larger is sharper, 0 ignores the
/// term.
#[derive(Clone, Debug, PartialEq)]
pub enum Lambda {
    /// What the embedded network makes of each pixel's surroundings.
    Learned,
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

impl Default for Parameters {
    fn default() -> Self {
        Self::learned()
    }
}

impl Parameters {
    /// The trained network, with the colour multiplier that it was trained with; `models/bilateral.md` tells what it does.
    pub fn learned() -> Self {
        let colour = Network::embedded().colour();
        Self { lambda: Lambda::Learned, colour, ..Self::constant() }
    }

    /// Constant parameters found by `examples/grid_search.rs` on our own scenes at 8 and 64 samples per pixel; what they do
    /// on each is in `models/README.md`. The colour term is stronger than the paper's and keeps edges that features do not
    /// show, so that position and normal are left with nothing to add; where noise leaves it weak, the narrow spatial term
    /// holds.
    pub fn constant() -> Self {
        Self {
            lambda: Lambda::Constant([0.16, 0.0, 0.0, 0.025, 0.003, 0.07]),
            colour: 0.2,
            window_radius: LARGEST_RADIUS,
            variance_spikes: Some(10.0),
            result_spikes: Some(2.0),
        }
    }

    /// Checks that every parameter is in its range, and λ of a picture of its size.
    pub(super) fn check(&self, height: usize, width: usize) -> Result<(), Error> {
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
            Lambda::Learned => {}
            Lambda::Constant(values) => {
                values.iter().try_for_each(|&value| positive("lambda", value))?;
            }
            Lambda::PerPixel(image) => {
                image.iter().try_for_each(|&value| positive("lambda", value))?;
                let expected = [6, height, width];
                if image.dim() != expected.into() {
                    let (what, found) = ("lambda".into(), image.dim().into());
                    return Err(Error::Shape { what, found, expected });
                }
            }
        }
        positive("lambda of the colour", self.colour)?;
        for threshold in [self.variance_spikes, self.result_spikes].into_iter().flatten() {
            positive("threshold of the spikes", threshold)?;
        }
        if self.window_radius <= LARGEST_RADIUS {
            return Ok(());
        }
        let (name, value) = ("radius of the window".into(), self.window_radius.to_string());
        Err(Error::Parameter { name, value, expected: "at most 27" })
    }
}
