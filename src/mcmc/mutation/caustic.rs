//! The caustic perturbation: paths whose last vertex before the lens is smooth (Veach and Guibas 1997, section 5.3.3;
//! METHODS 5.6).
//!
//! With `x_l` the last smooth vertex before `x_{k-1}`, the direction that light leaves `x_l` in turns by an angle `θ`, and
//! `C ∝ lum(L_e ∏ f̄ ∏ ρ) |cos θ_l| ∏ (corrections of delta events) G W_e`. The density of `θ` is the same both ways, if both
//! allow it: each path has its own range of angles.

use super::super::{Failure, LogUniform, Proposal};
use super::MutationSettings;
use super::trace::{Walk, check, is_smooth, offset, smooth_before, turned};
use crate::emitter::LightPoint;
use crate::geometry::Ray;
use crate::math::Frame;
use crate::math::float::offset_point;
use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::transport::{LightVertex, Path, Side, Vertex};
use std::f64::consts::FRAC_PI_2;

/// Rays of light from infinity start this many radii of the bounding sphere from its centre: outside it.
const START: f32 = 1.001;

pub(super) fn is_suitable(path: &Path<'_>) -> bool {
    path.k() >= 2 && is_smooth(path, path.k() - 1)
}

pub(super) fn propose<'s, S: Sampler>(
    scene: &'s Scene,
    settings: &MutationSettings,
    path: &Path<'s>,
    sampler: &mut S,
) -> Result<Proposal<Path<'s>>, Failure> {
    let k = path.k();
    let l = smooth_before(path, k - 1);
    let jumps = jumps(settings, path, l).ok_or(Failure::Impossible)?;
    let jump = jumps.sample(f64::from(sampler.next_1d()));
    let ray = departure(scene, path, l, jump, sampler.next_1d())?;
    let mut walk = Walk::new(scene, path, sampler);
    let (ray, _) = walk.chain(ray, l + 1, Side::Light)?;
    walk.smooth(ray)?;
    let state = walk.from_light(l)?;
    if !self::jumps(settings, &state, l).is_some_and(|jumps| jumps.contains(jump)) {
        return Err(Failure::NoReturn);
    }
    check(scene, path, &state, k - 1)?;
    let [forward, backward] = [&state, path].map(|path| {
        let walked: f64 = (l..k - 1).map(|i| path.ln_light_factor(i)).sum();
        path.ln_value() + walked + path.ln_connection(k - 1)
    });
    Ok(Proposal { state, forward, backward })
}

/// How far the ray of light that leaves `x_l` may move: by an angle, in radians, or, from infinity, by a distance.
fn jumps(settings: &MutationSettings, path: &Path<'_>, l: usize) -> Option<LogUniform> {
    let k = path.k();
    let on_surface = settings.pixel_angle * path.length(k - 1);
    if let Vertex::Light(LightVertex { point: LightPoint::Infinite { .. }, .. }) =
        path.vertices()[l]
    {
        return distances(settings.raster, on_surface);
    }
    let chain: f64 = (l..k - 1).map(|i| path.length(i)).sum();
    angles(settings.raster, on_surface / chain)
}

/// The distances times that factor, if that can be.
fn distances(jumps: LogUniform, factor: f64) -> Option<LogUniform> {
    (factor > 1e-150 && factor < 1e150).then(|| jumps.scaled(factor))
}

/// Angles that are the distances times that factor, all of them less if the largest were beyond a right one.
fn angles(jumps: LogUniform, factor: f64) -> Option<LogUniform> {
    distances(jumps, factor.min(FRAC_PI_2 / jumps.high()))
}

/// The ray of light that leaves `x_l`, moved by `jump`, around the old one by `u`.
fn departure(scene: &Scene, path: &Path<'_>, l: usize, jump: f64, u: f32) -> Result<Ray, Failure> {
    let old = path.direction(l);
    match &path.vertices()[l] {
        Vertex::Surface(surface) => {
            let direction = turned(old, jump, u);
            surface.local(direction).ok_or(Failure::Dark)?;
            Ok(surface.at.spawn(direction))
        }
        Vertex::Light(LightVertex { point, .. }) => match *point {
            LightPoint::Surface { position, error, normal, .. } => {
                let direction = turned(old, jump, u);
                if normal.dot(direction) <= 0.0 {
                    return Err(Failure::Dark);
                }
                Ok(Ray::new(offset_point(position, error, normal, direction), direction))
            }
            LightPoint::Point { position } => Ok(Ray::new(position, turned(old, jump, u))),
            LightPoint::Infinite { direction, .. } => {
                let Vertex::Surface(surface) = &path.vertices()[l + 1] else {
                    return Err(Failure::Impossible);
                };
                let target = scene.emitters.target();
                let aside = Frame::from_normal(direction).to_world(offset(jump, u).extend(0.0));
                let start = surface.at.position + aside;
                let depth = (start - target.center).dot(direction);
                let origin = start + direction * (START * target.radius - depth);
                Ok(Ray::new(origin, -direction))
            }
        },
        Vertex::Lens { .. } => Err(Failure::Impossible),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_of_angles_is_that_of_the_worked_example() {
        // METHODS N.8: 2 from the lens, a chain of 1 + 3, 1e-3 radians a pixel, 0.1 to 20 pixels; then a chain of 1 + 30.
        let jumps = LogUniform::new(0.1, 20.0);
        let near = angles(jumps, 1e-3 * 2.0 / 4.0).expect("a range");
        assert!((near.high() - 1e-2).abs() < 1e-15 && near.contains(5.01e-5));
        assert!(!near.contains(4.99e-5) && near.contains(5e-3));
        let far = angles(jumps, 1e-3 * 2.0 / 31.0).expect("a range");
        assert!((far.high() - 1.29e-3).abs() < 1e-5 && !far.contains(5e-3));
        assert!(far.contains(6.46e-6) && !far.contains(6.44e-6));
    }

    #[test]
    fn no_angle_is_beyond_a_right_one_and_the_ratio_stays() {
        let jumps = LogUniform::new(0.1, 20.0);
        let wide = angles(jumps, 1.0).expect("a range");
        assert!((wide.high() - FRAC_PI_2).abs() < 1e-15);
        assert!(wide.contains(FRAC_PI_2 / 199.9) && !wide.contains(FRAC_PI_2 / 200.1));
        assert_eq!(angles(jumps, 0.0), None);
        assert_eq!(distances(jumps, f64::INFINITY), None);
        assert_eq!(distances(jumps, f64::NAN), None);
    }
}
