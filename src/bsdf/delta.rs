//! Delta lobes by name: what a mirror or a smooth boundary does to light, without drawing a number.

use crate::math::Rgb;
use glam::Vec3;

/// What a delta lobe does with the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DeltaKind {
    /// Mirrors it.
    Reflection,
    /// Bends it into the medium on the other side.
    Refraction,
    /// Lets it go straight on: where there is no boundary, where the media match, through a thin sheet.
    Pass,
}

/// Which of a surface's delta lobes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DeltaLobe {
    /// Which model of a blend, counted depth-first in the order in which they are mixed; 0 where nothing is mixed. More than
    /// 255 models cannot be told apart.
    pub leaf: u8,
    /// What it does.
    pub kind: DeltaKind,
}

impl From<DeltaKind> for DeltaLobe {
    /// The lobe of a model that is not a blend.
    fn from(kind: DeltaKind) -> Self {
        Self { leaf: 0, kind }
    }
}

/// Where a delta lobe sends the walk, and how much of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeltaEval {
    /// Where the walk goes, a unit vector of the local frame.
    pub wi: Vec3,
    /// Part of the radiance that is scattered, whole: not divided by the probability. A refraction contains `1 / eta²`.
    pub reflectance: Rgb,
    /// Probability with which [`Bsdf::sample`](super::Bsdf::sample) chooses the lobe, positive.
    pub probability: f32,
    /// Refractive index of the medium that `wi` lies in over that of `wo`: 1 unless the light is refracted.
    pub eta: f32,
}

impl DeltaEval {
    /// `None` where `probability` is 0, since there the lobe does not exist.
    pub(super) fn new(wi: Vec3, reflectance: Rgb, probability: f32, eta: f32) -> Option<Self> {
        (probability > 0.0).then_some(Self { wi, reflectance, probability, eta })
    }
}

/// The mirror image of a direction about the normal of the local frame.
pub(super) fn mirrored(wo: Vec3) -> Vec3 {
    Vec3::new(-wo.x, -wo.y, wo.z)
}
