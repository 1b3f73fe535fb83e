//! Whether chains have all seen the same.

use crate::integrator::Splat;
use crate::math::Sum;
use serde::{Deserialize, Serialize};

/// Where a chain was on the film, by luminance.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    weight: f64,
    sum: [f64; 2],
    squares: [f64; 2],
}

/// Where many chains were, on each axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Spread {
    /// Chains that were anywhere.
    chains: u64,
    /// Sums over the chains: of their mean places, of the squares of these, and of the variances within them.
    means: [Sum; 2],
    squares: [Sum; 2],
    within: [Sum; 2],
}

impl Moments {
    pub(super) fn add(&mut self, splat: &Splat) {
        let weight = f64::from((splat.diffuse + splat.specular).luminance());
        if !(weight.is_finite() && splat.raster.is_finite()) {
            return;
        }
        self.weight += weight;
        for (axis, place) in splat.raster.as_dvec2().to_array().into_iter().enumerate() {
            self.sum[axis] += weight * place;
            self.squares[axis] += weight * place * place;
        }
    }
}

impl Spread {
    /// Adds one chain.
    pub(super) fn add(&mut self, chain: &Moments) {
        if chain.weight <= 0.0 {
            return;
        }
        self.chains += 1;
        for axis in 0..2 {
            let mean = chain.sum[axis] / chain.weight;
            self.means[axis] += mean;
            self.squares[axis] += mean * mean;
            self.within[axis] += (chain.squares[axis] / chain.weight - mean * mean).max(0.0);
        }
    }

    /// Adds other chains.
    pub(super) fn merge(&mut self, other: &Self) {
        self.chains += other.chains;
        for axis in 0..2 {
            self.means[axis] += other.means[axis];
            self.squares[axis] += other.squares[axis];
            self.within[axis] += other.within[axis];
        }
    }

    /// The ratio `√((W + B) / W)` of the spread of the chains' mean places (variance `B`) to that within the chains (mean
    /// variance `W`), for the axis where it is larger: 1 where chains have all been everywhere, large where each stayed
    /// around its seed. `None` for fewer than two chains, or where nothing moves.
    pub(super) fn disagreement(&self) -> Option<f64> {
        let count = self.chains as f64;
        if count < 2.0 {
            return None;
        }
        let of_axis = |axis: usize| {
            let mean = self.means[axis].value() / count;
            let between = self.squares[axis].value() - count * mean * mean;
            let between = between.max(0.0) / (count - 1.0);
            let within = self.within[axis].value() / count;
            (within > 0.0).then(|| ((within + between) / within).sqrt())
        };
        of_axis(0).into_iter().chain(of_axis(1)).reduce(f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;
    use glam::Vec2;

    fn chain(places: &[f32]) -> Moments {
        let mut moments = Moments::default();
        for &x in places {
            let raster = Vec2::new(x, 1.0);
            moments.add(&Splat { raster, diffuse: Rgb::WHITE, specular: Rgb::BLACK });
        }
        moments
    }

    fn disagreement(chains: &[Moments]) -> Option<f64> {
        let mut spread = Spread::default();
        chains.iter().for_each(|chain| spread.add(chain));
        spread.disagreement()
    }

    #[test]
    fn chains_that_stay_apart_disagree() {
        let alike = [chain(&[0.0, 2.0, 4.0]), chain(&[4.0, 2.0, 0.0])];
        assert!((disagreement(&alike).unwrap() - 1.0).abs() < 1e-9);
        // Means 1 and 9: variance 32 between, 1 within.
        let apart = [chain(&[0.0, 2.0]), chain(&[8.0, 10.0])];
        assert!((disagreement(&apart).unwrap() - 33f64.sqrt()).abs() < 1e-6);
        assert_eq!(disagreement(&apart[..1]), None);
        assert_eq!(disagreement(&[chain(&[1.0]), chain(&[1.0]), chain(&[])]), None);
    }
}
