//! The camera seen from the scene: which point of the film a point of the scene, or a ray of light, falls on.

use super::{Camera, Lens};
use crate::geometry::Ray;
use crate::math::warp::{disk_to_square, square_to_disk};
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::PI;

/// How a point of the lens sees a point of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensView {
    /// Where on the film, in pixels; inside it.
    pub raster: Vec2,
    /// Unit vector from the lens to the point.
    pub direction: Vec3,
    /// How far the point is from the lens.
    pub distance: f32,
    /// Where on that line the near plane is and [`Camera::ray`] begins; only what lies beyond it hides the point.
    pub start: Vec3,
}

/// Where a ray of light meets the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensHit {
    /// The point of the lens.
    pub position: Vec3,
    /// The coordinates for which [`Camera::lens_point`] is that point.
    pub lens: Vec2,
    /// How it sees the ray's origin.
    pub view: LensView,
}

impl Camera {
    /// How the point `lens` of the aperture (see [`Camera::lens_point`]) sees `point`. `None` where it falls beside the film,
    /// or does not lie between the near and the far plane, beyond which [`Camera::ray`] does not reach.
    pub fn view(&self, point: Vec3, lens: Vec2) -> Option<LensView> {
        let radius = self.lens.map_or(0.0, |lens| lens.radius);
        let from = (square_to_disk(lens).as_dvec2() * radius).extend(0.0);
        self.view_from(from, self.point_in_camera(point))
    }

    /// Density, in the measure that gives the whole film 1, of the raster points seen in a cone of unit solid angle around
    /// the unit vector `direction`: `1 / (A cos³θ)`, per steradian; the same for every point of the lens (METHODS 1.2). 0
    /// behind the camera; whether the direction meets the film is for [`Camera::raster_of`] to say.
    pub fn raster_pdf(&self, direction: Vec3) -> f64 {
        let cosine = self.optical_axis().dot(direction.as_dvec3());
        if cosine > 0.0 { 1.0 / (self.film_area * cosine.powi(3)) } else { 0.0 }
    }

    /// Cosine of the angle between the unit vector `direction` and the optical axis.
    pub fn cosine(&self, direction: Vec3) -> f64 {
        self.optical_axis().dot(direction.as_dvec3())
    }

    /// Density of the points of the lens per unit of area, which are uniform; 1, and discrete, for a pinhole.
    pub fn lens_pdf(&self) -> f64 {
        self.lens.map_or(1.0, |lens| 1.0 / (PI * lens.radius * lens.radius))
    }

    /// Where a ray of light, on its way to the camera, meets the lens and then the film. `None` for a pinhole, which no ray
    /// meets, and where [`Camera::view`] from there to the ray's origin gives none.
    pub fn lens_hit(&self, ray: &Ray) -> Option<LensHit> {
        let (position, lens) = self.aperture_hit(ray)?;
        let view = self.view_from(position, self.point_in_camera(ray.origin))?;
        Some(LensHit { position: self.point_in_world(position), lens, view })
    }

    /// As [`Camera::lens_hit`] for light from infinity, to which the planes do not matter: wherever the ray starts, the
    /// distance is infinite.
    pub fn lens_hit_from_infinity(&self, ray: &Ray) -> Option<LensHit> {
        let (position, lens) = self.aperture_hit(ray)?;
        let view = self.look(position, -self.to_camera(ray.direction.as_dvec3()))?;
        let view = LensView { distance: f32::INFINITY, ..view };
        Some(LensHit { position: self.point_in_world(position), lens, view })
    }

    /// Where a ray crosses the aperture from the front, in camera space, and its coordinates there.
    fn aperture_hit(&self, ray: &Ray) -> Option<(DVec3, Vec2)> {
        let Lens { radius, .. } = self.lens?;
        let origin = self.point_in_camera(ray.origin);
        let direction = self.to_camera(ray.direction.as_dvec3());
        let t = -origin.z / direction.z;
        if !(direction.z < 0.0 && t > 0.0 && t < f64::from(ray.t_max)) {
            return None;
        }
        let disk = (origin + direction * t).truncate() / radius;
        (disk.length_squared() < 1.0).then(|| ((disk * radius).extend(0.0), disk_to_square(disk)))
    }

    /// How `from`, on the aperture, sees `point`, both in camera space.
    fn view_from(&self, from: DVec3, point: DVec3) -> Option<LensView> {
        if !(point.z > self.near_clip && point.z < self.far_clip) {
            return None;
        }
        self.look(from, point - from)
    }

    /// What `from`, on the aperture, sees at the tip of the vector `to_point`, which points to the front.
    fn look(&self, from: DVec3, to_point: DVec3) -> Option<LensView> {
        let film = match self.lens {
            None => to_point,
            Some(Lens { focus_distance, .. }) => from + to_point * (focus_distance / to_point.z),
        };
        let raster = self.raster(film)?.as_vec2();
        let distance = to_point.length();
        let direction = to_point / distance;
        Some(LensView {
            // Rounding may not move it off the film.
            raster: raster.min(last_before(self.film)),
            direction: (self.rotation * direction).as_vec3(),
            distance: distance as f32,
            start: self.point_in_world(from + direction * (self.near_clip / direction.z)),
        })
    }

    fn point_in_camera(&self, world: Vec3) -> DVec3 {
        self.to_camera(world.as_dvec3() - self.center)
    }

    fn point_in_world(&self, local: DVec3) -> Vec3 {
        (self.center + self.rotation * local).as_vec3()
    }
}

/// The largest raster coordinates inside a film of that size.
fn last_before(film: DVec2) -> Vec2 {
    film.as_vec2().map(f32::next_down)
}

#[cfg(test)]
mod tests;
