//! Shadow rays.

use crate::geometry::{Interaction, Ray};
use crate::scene::Scene;
use glam::Vec3;

/// Shadow rays stop this much short of the emitter, relative to its distance, so that they do not hit it. Rounding of
/// the direction moves the far end by a few ulps of the distance; a blocker nearer to the emitter than this is missed.
const SHADOW_MARGIN: f32 = 1e-4;

/// A ray from a surface to `target`, of parameter 1 there, that ends just before it.
#[inline(always)]
pub fn shadow_ray(at: &Interaction, target: Vec3) -> Ray {
    shadow_ray_from(at.offset_towards(target - at.position), target)
}

/// The same from a point that is already moved off its surface.
#[inline(always)]
pub fn shadow_ray_from(start: Vec3, target: Vec3) -> Ray {
    Ray { t_max: 1.0 - SHADOW_MARGIN, ..Ray::between(start, target) }
}

/// The part of light that masks leave of a shadow ray: 0 behind an opaque surface, 1 when nothing is in the way.
#[inline]
pub fn transmittance(scene: &Scene, mut ray: Ray) -> f32 {
    if !scene.has_masks {
        return if scene.geometry.occluded(&ray) { 0.0 } else { 1.0 };
    }
    let mut transmittance = 1.0;
    while let Some(hit) = scene.geometry.intersect(&ray) {
        let at = scene.geometry.interaction(&ray, &hit);
        let surface = scene.surfaces[at.part as usize];
        transmittance *= 1.0 - scene.materials[surface.material.0 as usize].opacity(&at);
        if transmittance <= 0.0 {
            return 0.0;
        }
        let remaining = ray.t_max - hit.t;
        ray = at.spawn(ray.direction);
        ray.t_max = remaining;
    }
    transmittance
}

/// A ray from one surface to another, from just off the one to just off the other: nothing between them is missed, and
/// neither is hit.
pub fn connecting_ray(from: &Interaction, to: &Interaction) -> Ray {
    let end = to.offset_towards(from.position - to.position);
    Ray { t_max: 1.0, ..from.spawn_to(end) }
}
