//! What is added up.

use super::marks::Seen;
use crate::math::{Rgb, Sum};
use serde::{Deserialize, Serialize};

/// Sums over the camera rays of one pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PixelSums {
    /// Radiance scattered by a diffuse lobe at the first hit.
    pub diffuse: [Sum; 3],
    /// All other radiance.
    pub specular: [Sum; 3],
    /// Luminance that the resampled emitters would send if nothing were in the way.
    pub unshadowed: f64,
    /// Shadow rays of the first pass.
    pub seen: Seen,
    /// Luminance that the camera rays found before any exchange: diffuse and all other.
    pub(super) luminance: [Sum; 2],
    /// Squares of that of each ray, of both together, diffuse and other; and of what chains left.
    pub(super) squares: [Sum; 3],
}

impl PixelSums {
    pub(super) fn add(&mut self, diffuse: Rgb, specular: Rgb, scale: f64) {
        for channel in 0..3 {
            self.diffuse[channel] += f64::from(diffuse[channel]) * scale;
            self.specular[channel] += f64::from(specular[channel]) * scale;
        }
    }

    /// Takes down what one camera ray found before any exchange.
    pub(super) fn observe(&mut self, diffuse: Rgb, specular: Rgb) {
        let found = [diffuse, specular].map(|light| f64::from(light.luminance()));
        self.luminance.iter_mut().zip(found).for_each(|(sum, one)| *sum += one);
        self.add_squares(found);
    }

    /// Adds what a chain left.
    pub(super) fn deposit(&mut self, diffuse: Rgb, specular: Rgb, energy: f64) {
        self.add(diffuse, specular, energy);
        self.add_squares([diffuse, specular].map(|light| f64::from(light.luminance()) * energy));
    }

    fn add_squares(&mut self, [diffuse, specular]: [f64; 2]) {
        let all = [diffuse + specular, diffuse, specular];
        self.squares.iter_mut().zip(all).for_each(|(sum, one)| *sum += one * one);
    }

    /// What the variance of the pixel's radiance, of its diffuse and of its other part is in proportion to from pixel to pixel,
    /// of so many camera rays: how much these differ, and what chains left. How large it is the halves tell, for rays of
    /// neighbours depend on each other through the exchange.
    pub fn spread(&self, rays: u32) -> [f64; 3] {
        let [diffuse, specular] = self.luminance.map(Sum::value);
        let sums = [diffuse + specular, diffuse, specular];
        let rays = f64::from(rays.max(1));
        std::array::from_fn(|part| {
            (self.squares[part].value() - sums[part] * sums[part] / rays).max(0.0)
        })
    }

    /// Adds the sums over other camera rays.
    pub fn merge(&mut self, other: &Self) {
        for channel in 0..3 {
            self.diffuse[channel] += other.diffuse[channel];
            self.specular[channel] += other.specular[channel];
        }
        for (sum, more) in self.luminance.iter_mut().zip(other.luminance) {
            *sum += more;
        }
        for (sum, more) in self.squares.iter_mut().zip(other.squares) {
            *sum += more;
        }
        self.unshadowed += other.unshadowed;
        self.seen.visible += other.seen.visible;
        self.seen.of += other.seen.of;
    }
}

/// What the two passes did. Energies are luminances summed over marked pixels and camera rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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

impl Ledger {
    /// Adds what other rounds of the same half did; the pilot was the same.
    pub fn merge(&mut self, other: &Self) {
        self.pilot_rays = self.pilot_rays.max(other.pilot_rays);
        self.shadow_rays += other.shadow_rays;
        self.mutations += other.mutations;
        self.chains += other.chains;
        self.limited += other.limited;
        self.found += other.found;
        self.given += other.given;
        self.deposited += other.deposited;
        self.invalid += other.invalid;
    }
}
