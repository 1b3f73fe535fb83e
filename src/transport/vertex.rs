//! The vertices of a path, and what scattering at a surface is worth in either direction.

use super::Shading;
use super::visibility::{connecting_ray, transmittance};
use crate::bsdf::DeltaLobe;
use crate::emitter::{EmitterId, LightPoint};
use crate::geometry::{Interaction, Ray};
use crate::math::Rgb;
use crate::sampler::Sampler;
use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// Which end a walk began at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lens: it gathers radiance.
    Eye,
    /// An emitter: it spreads power.
    Light,
}

/// A point on a surface, seen from where its path came.
#[derive(Clone, Debug)]
pub struct Surface<'s> {
    /// The point.
    pub at: Interaction,
    /// Its model and frame.
    pub shading: Shading<'s>,
    /// Set where it shines.
    pub emitter: Option<EmitterId>,
}

/// Where light starts.
#[derive(Clone, Copy, Debug)]
pub struct LightVertex {
    /// Which emitter.
    pub id: EmitterId,
    /// The point on it.
    pub point: LightPoint,
}

/// A vertex of a path.
#[derive(Clone, Debug)]
pub enum Vertex<'s> {
    /// On the aperture: raster position in pixels, and the point's place in the unit square.
    Lens {
        /// Position on the whole film, in pixels.
        raster: Vec2,
        /// What chose the point of the aperture.
        lens: Vec2,
        /// World space.
        position: Vec3,
    },
    /// On an emitter, where light starts.
    Light(LightVertex),
    /// On a surface.
    Surface(Surface<'s>),
}

/// A smooth event as the finished path has it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scattering {
    /// Part of `f̄ = f_s |n_s·ω_l| / |n_g·ω_l|` of diffuse lobes, per steradian.
    pub diffuse: Rgb,
    /// Part of all other smooth lobes.
    pub specular: Rgb,
    /// Density of sampling the direction to the light's side given the other, per steradian.
    pub pdf_light: f64,
}

impl Scattering {
    /// The whole value.
    pub fn value(&self) -> Rgb {
        self.diffuse + self.specular
    }
}

/// A delta event as the finished path has it; weights are of radiance.
#[derive(Clone, Copy, Debug)]
pub struct DeltaScattering {
    /// Reflectance, with the factor `(n_o/n_i)²` of a refraction.
    pub reflectance: Rgb,
    /// Reflectance that a walk from the light multiplies with, over that of a walk from the eye: without the factor of the
    /// refraction, with the cosines of shading normals (METHODS 1.7).
    pub light_over_eye: f64,
    /// Probability of the lobe for a walk from the eye.
    pub probability_light: f64,
    /// Probability of the lobe for a walk from the light.
    pub probability_eye: f64,
}

impl<'s> Surface<'s> {
    /// The surface at `at`, seen from the unit direction `wo`.
    pub fn new(scene: &'s Scene, at: Interaction, wo: Vec3) -> Self {
        let surface = scene.surfaces[at.part as usize];
        let material = &scene.materials[surface.material.0 as usize];
        Self { at, shading: Shading::new(material, &at, wo), emitter: surface.emitter }
    }

    /// The nearest surface along `ray` that does not let it pass.
    pub fn find<S: Sampler + ?Sized>(
        scene: &'s Scene,
        mut ray: Ray,
        sampler: &mut S,
    ) -> Option<Self> {
        loop {
            let hit = scene.geometry.intersect(&ray)?;
            let at = scene.geometry.interaction(&ray, &hit);
            if scene.has_masks {
                let surface = scene.surfaces[at.part as usize];
                let opacity = scene.materials[surface.material.0 as usize].opacity(&at);
                if opacity < 1.0 && sampler.next_1d() >= opacity {
                    let remaining = ray.t_max - hit.t;
                    ray = at.spawn(ray.direction);
                    ray.t_max = remaining;
                    continue;
                }
            }
            return Some(Self::new(scene, at, -ray.direction));
        }
    }

    /// Absolute cosine of a unit direction with the geometric normal.
    #[inline]
    pub fn cosine(&self, direction: Vec3) -> f64 {
        f64::from(self.at.normal.dot(direction).abs())
    }

    /// A unit direction in the local frame; `None` where the two normals disagree about its side.
    #[inline]
    pub fn local(&self, world: Vec3) -> Option<Vec3> {
        let local = self.shading.frame.to_local(world);
        self.shading.is_consistent(local, world).then_some(local)
    }

    /// The smooth event between the unit directions `eye` and `light`, both away from the surface.
    pub fn scattering(&self, eye: Vec3, light: Vec3) -> Scattering {
        let (Some(wo), Some(wi)) = (self.local(eye), self.local(light)) else {
            return Scattering::default();
        };
        let eval = self.shading.bsdf.eval(wo, wi);
        let scale = 1.0 / self.at.normal.dot(light).abs();
        Scattering {
            diffuse: eval.diffuse * scale,
            specular: eval.specular * scale,
            pdf_light: f64::from(eval.pdf),
        }
    }

    /// Density of sampling the direction `to` given the direction `from`, per steradian.
    pub fn pdf(&self, from: Vec3, to: Vec3) -> f64 {
        match (self.local(from), self.local(to)) {
            (Some(wo), Some(wi)) => f64::from(self.shading.bsdf.pdf(wo, wi)),
            _ => 0.0,
        }
    }

    /// The delta event of that lobe between the unit directions `eye` and `light`, of which one follows from the other.
    pub fn delta_scattering(
        &self,
        lobe: DeltaLobe,
        eye: Vec3,
        light: Vec3,
    ) -> Option<DeltaScattering> {
        let (wo, wi) = (self.local(eye)?, self.local(light)?);
        let forward = self.shading.bsdf.delta(wo, lobe)?;
        let backward = self.shading.bsdf.delta(wi, lobe)?;
        let cosines =
            f64::from(wi.z.abs()) * self.cosine(eye) / (self.cosine(light) * f64::from(wo.z.abs()));
        Some(DeltaScattering {
            reflectance: forward.reflectance,
            light_over_eye: f64::from(forward.eta).powi(2) * cosines,
            probability_light: f64::from(forward.probability),
            probability_eye: f64::from(backward.probability),
        })
    }

    /// Transmittance between two surfaces.
    pub fn transmittance(&self, scene: &Scene, other: &Self) -> f64 {
        f64::from(transmittance(scene, connecting_ray(&self.at, &other.at)))
    }
}
