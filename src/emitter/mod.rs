//! Where light comes from, and how to choose a direction to it.

use crate::geometry::{Interaction, Part};
use crate::math::Rgb;
use crate::texture::Texture;
use glam::{Vec2, Vec3};

/// Index of an emitter in [`Emitters`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EmitterId(pub u32);

/// A direction to an emitter, seen from a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmitterSample {
    /// Unit vector to the emitter.
    pub direction: Vec3,
    /// How far it is; infinite for environments and directional emitters.
    pub distance: f32,
    /// Radiance arriving from there when nothing is in between; irradiance (W/m²) for delta emitters.
    pub radiance: Rgb,
    /// Density of `direction` per steradian, selection included; the selection probability for delta emitters.
    pub pdf: f32,
    /// Is the direction the only one that this emitter shines from (point, spot, directional)?
    pub is_delta: bool,
}

/// One source of light.
#[derive(Clone, Debug)]
pub enum Emitter {
    /// A part of the scene that shines from the side of its normal.
    Area {
        /// Its shape, in world space.
        part: Part,
        /// Emitted radiance over the surface.
        radiance: Texture,
    },
}

/// All emitters of a scene, and the probability of choosing each: proportional to power, mixed with 5 % uniform.
#[derive(Clone, Debug, Default)]
pub struct Emitters {}

impl Emitters {
    /// `center` and `radius` are of a sphere around the scene and the camera.
    pub fn new(_emitters: Vec<Emitter>, _center: Vec3, _radius: f32) -> Self {
        todo!()
    }

    /// Chooses an emitter by `selection` and a direction to it from `from` by `u`; `None` when there is no light that way.
    pub fn sample(&self, _from: Vec3, _selection: f32, _u: Vec2) -> Option<EmitterSample> {
        todo!()
    }

    /// Radiance that the area emitter `id` sends from `at` into the unit direction `wo`.
    pub fn radiance(&self, _id: EmitterId, _at: &Interaction, _wo: Vec3) -> Rgb {
        todo!()
    }

    /// Density, selection included, with which [`Emitters::sample`] from `from` gives the direction to `at` on `id`.
    pub fn pdf(&self, _id: EmitterId, _from: Vec3, _at: &Interaction) -> f32 {
        todo!()
    }

    /// Radiance of the environment from the unit direction `direction` (pointing away from the scene).
    pub fn environment(&self, _direction: Vec3) -> Rgb {
        todo!()
    }

    /// Density, selection included, with which [`Emitters::sample`] gives that direction of the environment.
    pub fn environment_pdf(&self, _direction: Vec3) -> f32 {
        todo!()
    }

    /// Are there none?
    pub fn is_empty(&self) -> bool {
        todo!()
    }

    /// Is there one that a camera could see: an area emitter or an environment?
    pub fn has_visible(&self) -> bool {
        todo!()
    }
}
