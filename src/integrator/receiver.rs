//! Where direct light is gathered.

use crate::geometry::Interaction;
use crate::math::Rgb;
use crate::scene::Scene;
use crate::transport::shading::Shading;
use crate::transport::visibility::{shadow_ray, transmittance};
use glam::{Vec2, Vec3};

/// The first surface with a smooth lobe that a camera ray meets, through delta lobes only.
#[derive(Clone, Debug)]
pub struct Receiver<'a> {
    /// Where it is.
    pub at: Interaction,
    /// The same, ready to scatter.
    pub shading: Shading<'a>,
    /// Product of the weights of the delta lobes, and of roulette, on the way there; radiance mode.
    pub throughput: Rgb,
    /// Is it the first hit, so that its diffuse lobes' light belongs to the diffuse layer?
    pub is_first: bool,
}

/// What a receiver makes of radiance from one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scattering {
    /// `throughput · f(wo, wi) |cos θi|` of the light that goes to the diffuse layer, per steradian.
    pub diffuse: Rgb,
    /// The same of all other light.
    pub specular: Rgb,
    /// Density with which the surface's own sampling chooses the direction, per steradian.
    pub pdf: f32,
}

impl Receiver<'_> {
    /// Scattering of light from the unit direction `direction` of the world; all zero where there is none.
    #[inline]
    pub fn scatter(&self, direction: Vec3) -> Scattering {
        let wi = self.shading.frame.to_local(direction);
        if !self.shading.is_consistent(wi, direction) {
            return Scattering::default();
        }
        let eval = self.shading.bsdf.eval(self.shading.wo, wi);
        let (diffuse, specular) = (self.throughput * eval.diffuse, self.throughput * eval.specular);
        let (diffuse, specular) =
            if self.is_first { (diffuse, specular) } else { (Rgb::BLACK, diffuse + specular) };
        Scattering { diffuse, specular, pdf: eval.pdf }
    }

    /// A direction of the world chosen by the surface's own sampling; `None` where light is absorbed, a delta lobe scatters, or
    /// nothing would be scattered from there.
    #[inline]
    pub fn sample_smooth(&self, lobe: f32, u: Vec2) -> Option<Vec3> {
        let scattered = self.shading.bsdf.sample(self.shading.wo, lobe, u)?;
        let direction = self.shading.frame.to_world(scattered.wi);
        (!scattered.is_delta() && self.shading.is_consistent(scattered.wi, direction))
            .then_some(direction)
    }

    /// The part of light from a point `distance` away, or from infinity, that nothing keeps from the receiver.
    #[inline]
    pub fn visibility(&self, scene: &Scene, direction: Vec3, distance: f32) -> f32 {
        let ray = if distance.is_finite() {
            shadow_ray(&self.at, self.at.position + direction * distance)
        } else {
            self.at.spawn(direction)
        };
        transmittance(scene, ray)
    }
}
