//! What is added up.

use super::marks::Seen;
use crate::math::Rgb;

/// Sums over the camera rays of one pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelSums {
    /// Radiance scattered by a diffuse lobe at the first hit.
    pub diffuse: [f64; 3],
    /// All other radiance.
    pub specular: [f64; 3],
    /// Luminance that the resampled emitters would send if nothing were in the way.
    pub unshadowed: f64,
    /// Shadow rays of the first pass.
    pub seen: Seen,
}

impl PixelSums {
    pub(super) fn add(&mut self, diffuse: Rgb, specular: Rgb, scale: f64) {
        for channel in 0..3 {
            self.diffuse[channel] += f64::from(diffuse[channel]) * scale;
            self.specular[channel] += f64::from(specular[channel]) * scale;
        }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        for channel in 0..3 {
            self.diffuse[channel] += other.diffuse[channel];
            self.specular[channel] += other.specular[channel];
        }
        self.unshadowed += other.unshadowed;
        self.seen.visible += other.seen.visible;
        self.seen.of += other.seen.of;
    }
}

/// What the two passes did. Energies are luminances summed over marked pixels and camera rays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ledger {
    /// Shadow rays of the pilot.
    pub pilot_rays: u64,
    /// Shadow rays of the first pass.
    pub shadow_rays: u64,
    /// Mutations; each traces one shadow ray at most.
    pub mutations: u64,
    /// Chains.
    pub chains: u64,
    /// Samples whose number of chains was limited.
    pub limited: u64,
    /// Energy that the first pass found in marked pixels.
    pub found: f64,
    /// Energy that chains were given: on average over their random numbers, what was found.
    pub given: f64,
    /// Energy that chains left in pixels: exactly what they were given.
    pub deposited: f64,
    /// Non-finite samples and candidates, dropped.
    pub invalid: u64,
}
