//! Light from infinitely far away: the same in all directions, or an image wrapped around the scene.

mod map;

pub use map::{EnvironmentError, EnvironmentMap};

use super::{EmitterSample, mean};
use crate::math::{Rgb, warp};
use glam::{Vec2, Vec3};
use std::f64::consts::PI;

/// Light that arrives from infinity.
#[derive(Clone, Debug)]
pub enum Environment {
    /// The same radiance from everywhere.
    Constant(Rgb),
    /// An image of all directions.
    Map(Box<EnvironmentMap>),
}

impl From<EnvironmentMap> for Environment {
    fn from(map: EnvironmentMap) -> Self {
        Self::Map(Box::new(map))
    }
}

impl Environment {
    /// Radiance from the unit direction `direction`.
    #[inline]
    pub(super) fn radiance(&self, direction: Vec3) -> Rgb {
        match self {
            Self::Constant(colour) => *colour,
            Self::Map(map) => map.radiance(direction),
        }
    }

    /// Radiance from the unit direction `direction`, and its density per steradian.
    #[inline]
    pub(super) fn radiance_and_pdf(&self, direction: Vec3) -> (Rgb, f32) {
        match self {
            Self::Constant(colour) => (*colour, warp::SPHERE_PDF),
            Self::Map(map) => map.radiance_and_pdf(direction),
        }
    }

    /// A direction and its radiance.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> Option<EmitterSample> {
        let (direction, radiance, pdf) = match self {
            Self::Constant(colour) => (warp::square_to_sphere(u), *colour, warp::SPHERE_PDF),
            Self::Map(map) => map.sample(u)?,
        };
        Some(EmitterSample { direction, distance: f32::INFINITY, radiance, pdf, is_delta: false })
    }

    /// Radiance integrated over all directions, mean of the three colours, W/m².
    pub(super) fn fluence(&self) -> f64 {
        match self {
            Self::Constant(colour) => 4.0 * PI * mean(*colour),
            Self::Map(map) => map.fluence,
        }
    }
}
