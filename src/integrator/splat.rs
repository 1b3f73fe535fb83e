//! Light that lands where it likes.

use crate::math::Rgb;
use crate::transport::Contribution;
use glam::Vec2;

/// A contribution to whichever pixel it falls on, as light paths, Markov chains and redistributed energy make them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Splat {
    /// Where on the film, in pixels from the upper left corner of the whole film.
    pub raster: Vec2,
    /// What it adds to the pixel's diffuse layer, times the film's scale.
    pub diffuse: Rgb,
    /// What it adds to the specular layer, times the film's scale.
    pub specular: Rgb,
}

impl From<&Contribution> for Splat {
    /// The light of a contribution, without its weight.
    fn from(found: &Contribution) -> Self {
        let Contribution { raster, diffuse, specular, .. } = *found;
        Self { raster, diffuse, specular }
    }
}

impl Splat {
    /// The same light, `weight` times as much of it. A weight that takes it beyond f32 makes it non-finite, which a film
    /// drops and counts.
    #[must_use]
    pub fn weighted(&self, weight: f64) -> Self {
        let scale = |color: Rgb| color.map(|value| (f64::from(value) * weight) as f32);
        Self { raster: self.raster, diffuse: scale(self.diffuse), specular: scale(self.specular) }
    }
}
