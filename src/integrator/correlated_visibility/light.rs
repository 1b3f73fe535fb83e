//! Where direct light comes from, as the resampling and the exchange see it.

use crate::emitter::{EmitterId, EmitterSample, Emitters};
use crate::geometry::{Geometry, Interaction};
use crate::math::Rgb;
use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// A place that light may come from. Environments are measured in steradians, area emitters in units of area.
#[derive(Clone, Copy, Debug)]
pub(super) enum Light {
    /// A direction of the environment, a unit vector to it.
    Environment(Vec3),
    /// A point of an area emitter.
    Area { id: EmitterId, at: Interaction },
}

impl Light {
    /// Unit vector from `position` to the light and its distance, which may be infinite.
    #[inline]
    pub(super) fn seen_from(&self, position: Vec3) -> (Vec3, f32) {
        match self {
            Self::Environment(direction) => (*direction, f32::INFINITY),
            Self::Area { at, .. } => {
                let span = at.position - position;
                let distance = span.length();
                (span / distance, distance)
            }
        }
    }

    /// Steradians at the receiver for each unit of the light's own measure: `|cos θ| / distance²` for a point of a
    /// surface, 1 for the environment.
    #[inline]
    pub(super) fn solid_angle(&self, direction: Vec3, distance: f32) -> f64 {
        match self {
            Self::Environment(_) => 1.0,
            Self::Area { at, .. } => {
                f64::from(at.normal.dot(direction).abs()) / f64::from(distance).powi(2)
            }
        }
    }
}

/// The emitters that direct light is resampled from, and the surfaces of those that can be walked into.
#[derive(Debug)]
pub(super) struct Lights<'a> {
    emitters: &'a Emitters,
    /// Area emitters alone, and which each part is: finds the light in a direction without regard to blockers.
    surfaces: Geometry,
    ids: Vec<EmitterId>,
    /// Are area emitters and environments absent, so that there is nothing to resample?
    pub(super) is_dark: bool,
    /// Probability of a candidate being chosen by the emitters' sampling rather than by the surface's.
    pub(super) share: f64,
}

/// Half of the candidates come from the emitters and half from the surface: whichever fits the product of the two
/// better, its density is at least half of what it would be alone.
const EMITTER_SHARE: f64 = 0.5;

impl<'a> Lights<'a> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        let (mut parts, mut ids, mut is_masked) = (Vec::new(), Vec::new(), false);
        for (part, surface) in scene.geometry.parts().iter().zip(&scene.surfaces) {
            let Some(id) = surface.emitter else { continue };
            // Behind an emitter with holes there may be another: a direction would not tell which of them is meant. Points on
            // such emitters are therefore only found by choosing them, and the exchange leaves them where they are.
            if scene.materials[surface.material.0 as usize].is_opaque() {
                parts.push(part.clone());
                ids.push(id);
            } else {
                is_masked = true;
            }
        }
        Self {
            emitters: &scene.emitters,
            surfaces: Geometry::new(parts),
            ids,
            is_dark: scene.emitters.is_dark() || !scene.emitters.has_visible(),
            share: if is_masked { 1.0 } else { EMITTER_SHARE },
        }
    }

    /// A direction to an area emitter or the environment; `None` where there is no light that way, or where another kind of
    /// emitter was chosen.
    #[inline]
    pub(super) fn sample(
        &self,
        from: &Interaction,
        selection: f32,
        u: Vec2,
    ) -> Option<EmitterSample> {
        self.emitters.sample(from.position, selection, u).filter(|sample| !sample.is_delta)
    }

    /// Density of a candidate, per steradian, by those of both ways of sampling it.
    #[inline]
    pub(super) fn mixture(&self, emitter_pdf: f32, surface_pdf: f32) -> f64 {
        self.share * f64::from(emitter_pdf) + (1.0 - self.share) * f64::from(surface_pdf)
    }

    /// What shines on a surface from a direction when nothing but emitters is in the way.
    #[inline]
    pub(super) fn along(&self, from: &Interaction, direction: Vec3) -> Light {
        if self.ids.is_empty() {
            return Light::Environment(direction);
        }
        let ray = from.spawn(direction);
        match self.surfaces.intersect(&ray) {
            Some(hit) => {
                let at = self.surfaces.interaction(&ray, &hit);
                Light::Area { id: self.ids[at.part as usize], at }
            }
            None => Light::Environment(direction),
        }
    }

    /// Radiance that the light sends to a surface, and the density with which the emitters' sampling chooses the direction
    /// to it, per steradian.
    #[inline]
    pub(super) fn radiance_and_pdf(
        &self,
        from: &Interaction,
        light: &Light,
        direction: Vec3,
    ) -> (Rgb, f32) {
        match light {
            Light::Environment(_) => self.emitters.environment_with_pdf(direction),
            Light::Area { id, at } => (
                self.emitters.radiance(*id, at, -direction),
                self.emitters.pdf(*id, from.position, at),
            ),
        }
    }

    /// Radiance that the light sends to a surface.
    #[inline]
    pub(super) fn radiance(&self, light: &Light, direction: Vec3) -> Rgb {
        match light {
            Light::Environment(_) => self.emitters.environment(direction),
            Light::Area { id, at } => self.emitters.radiance(*id, at, -direction),
        }
    }
}
