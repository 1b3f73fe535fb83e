//! The perspective camera: pinhole and thin lens.
//!
//! Camera space is that of Mitsuba 3: the camera looks along `+z`, `+y` is up and `+x` is to the *left* of the image.
//! The film is thought at distance 1 in front of the camera, where it has the area `A = 4 tan(fov_x/2) tan(fov_y/2)`.
//! Raster coordinates are pixels of the whole film, `(0, 0)` its upper left corner; a crop window changes nothing here.

mod perspective;
mod view;

pub use perspective::{CameraError, FovAxis, Perspective};
pub use view::{LensHit, LensView};

use crate::geometry::Ray;
use crate::math::rigid::rotation_and_scale;
use crate::math::warp::square_to_disk;
use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};

/// A perspective camera.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Camera space to world space.
    rotation: DMat3,
    center: DVec3,
    /// Upper left corner of the film at distance 1, in camera space; `x` to the left.
    corner: DVec2,
    /// From one pixel to the next, to the right and down, in camera space.
    pixel: DVec2,
    film: DVec2,
    /// Area of the film at distance 1.
    film_area: f64,
    near_clip: f64,
    far_clip: f64,
    lens: Option<Lens>,
}

#[derive(Clone, Copy, Debug)]
struct Lens {
    radius: f64,
    focus_distance: f64,
}

impl Camera {
    /// The camera that a scene file describes.
    ///
    /// # Errors
    /// When a parameter is outside its range, or `to_world` does more than rotate, mirror and move.
    pub fn perspective(parameters: &Perspective) -> Result<Self, CameraError> {
        parameters.check()?;
        let axes = DMat3::from_mat4(parameters.to_world);
        let rotation = rotation_and_scale(axes)
            .and_then(|(rotation, scale)| ((scale - 1.0).abs() < 1e-3).then_some(rotation))
            .ok_or_else(|| CameraError::Transform { axes: axes.to_cols_array_2d() })?;
        let half = parameters.half_size();
        let film = DVec2::from(parameters.film.map(f64::from));
        let pixel = -2.0 * half / film;
        Ok(Self {
            rotation,
            center: parameters.to_world.w_axis.truncate(),
            corner: half + pixel * film * parameters.principal_point_offset,
            pixel,
            film,
            film_area: 4.0 * half.x * half.y,
            near_clip: parameters.near_clip,
            far_clip: parameters.far_clip,
            lens: (parameters.aperture_radius > 0.0).then_some(Lens {
                radius: parameters.aperture_radius,
                focus_distance: parameters.focus_distance,
            }),
        })
    }

    /// The ray through `raster` (pixels, `(0, 0)` the upper left corner of the whole film); `lens` in `[0, 1)²` chooses
    /// the point on a thin lens. Direction is a unit vector.
    ///
    /// As in Mitsuba the ray starts on the near plane and ends on the far plane.
    pub fn ray(&self, raster: Vec2, lens: Vec2) -> Ray {
        let film = self.film_point(raster.as_dvec2());
        let (start, to_film) = match self.lens {
            None => (DVec3::ZERO, film),
            Some(Lens { radius, focus_distance }) => {
                let start = (square_to_disk(lens).as_dvec2() * radius).extend(0.0);
                (start, film * focus_distance - start)
            }
        };
        let direction = to_film.normalize();
        let origin = start + direction * (self.near_clip / direction.z);
        Ray {
            origin: (self.center + self.rotation * origin).as_vec3(),
            direction: (self.rotation * direction).as_vec3(),
            t_max: ((self.far_clip - self.near_clip) / direction.z) as f32,
        }
    }

    /// Where light that arrives along `-direction` at the point `lens` of the aperture (see [`Camera::lens_point`])
    /// meets the film; `None` outside. The inverse of [`Camera::ray`]; `direction` need not be a unit vector.
    pub fn raster_of(&self, direction: Vec3, lens: Vec2) -> Option<Vec2> {
        let local = self.to_camera(direction.as_dvec3());
        let film = match self.lens {
            None => local,
            Some(Lens { radius, focus_distance }) => {
                let start = square_to_disk(lens).as_dvec2() * radius;
                (start + local.truncate() * (focus_distance / local.z)).extend(focus_distance)
            }
        };
        if local.z > 0.0 { self.raster(film).map(|raster| raster.as_vec2()) } else { None }
    }

    /// The point of the aperture that `lens` in `[0, 1)²` chooses, in world space; the centre of a pinhole.
    pub fn lens_point(&self, lens: Vec2) -> Vec3 {
        let radius = self.lens.map_or(0.0, |lens| lens.radius);
        let local = (square_to_disk(lens).as_dvec2() * radius).extend(0.0);
        (self.center + self.rotation * local).as_vec3()
    }

    /// Importance `W_e` emitted into the unit direction `direction`: `p_lens / (A cos⁴θ)`, where `θ` is the angle to the
    /// optical axis and `p_lens` one over the area of the lens, or 1 for a pinhole (Veach 1997, section 8.3.2.1, and
    /// METHODS 1.2). Integrated with the cosine over the film's solid angle and the lens it is 1. It is 0 behind the
    /// camera; whether the direction meets the film is for [`Camera::raster_of`] to say.
    pub fn importance(&self, direction: Vec3) -> f64 {
        let cosine = self.optical_axis().dot(direction.as_dvec3());
        if cosine <= 0.0 {
            return 0.0;
        }
        self.lens_pdf() / (self.film_area * cosine.powi(4))
    }

    /// Centre of the aperture, in world space.
    pub fn center(&self) -> Vec3 {
        self.center.as_vec3()
    }

    /// Is the aperture of finite size?
    pub fn has_lens(&self) -> bool {
        self.lens.is_some()
    }

    /// Radius of the aperture; 0 for a pinhole.
    pub fn aperture_radius(&self) -> f32 {
        self.lens.map_or(0.0, |lens| lens.radius as f32)
    }

    /// Unit vector along which the camera looks, in world space.
    fn optical_axis(&self) -> DVec3 {
        self.rotation.z_axis
    }

    /// The point of the film at distance 1, in camera space.
    fn film_point(&self, raster: DVec2) -> DVec3 {
        (self.corner + self.pixel * raster).extend(1.0)
    }

    /// The inverse of [`Camera::film_point`] for any multiple of it; `None` outside the film.
    fn raster(&self, local: DVec3) -> Option<DVec2> {
        let raster = (local.truncate() / local.z - self.corner) / self.pixel;
        let is_inside = raster.cmpge(DVec2::ZERO).all() && raster.cmplt(self.film).all();
        is_inside.then_some(raster)
    }

    /// A vector of the world in camera space.
    fn to_camera(&self, world: DVec3) -> DVec3 {
        self.rotation.transpose() * world
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::{Sampler, SobolSampler};
    use glam::DMat4;

    /// As Mitsuba's `look_at([1, 2, 3], [0, 0.5, -1], [0, 1, 0])`: the columns are left, up, forward, position.
    fn look_at() -> DMat4 {
        let position = DVec3::new(1.0, 2.0, 3.0);
        let forward = (DVec3::new(0.0, 0.5, -1.0) - position).normalize();
        let left = DVec3::Y.cross(forward).normalize();
        let up = forward.cross(left);
        DMat4::from_cols(
            left.extend(0.0),
            up.extend(0.0),
            forward.extend(0.0),
            position.extend(1.0),
        )
    }

    /// Origin, direction and length of a ray.
    type Seen = ([f32; 3], [f32; 3], f32);

    fn parameters() -> Perspective {
        Perspective {
            to_world: look_at(),
            fov: 40.0,
            film: [64, 48],
            near_clip: 0.5,
            far_clip: 100.0,
            ..Perspective::default()
        }
    }

    #[test]
    fn rays_are_those_of_mitsuba() {
        // Mitsuba 3.9.1 scalar_rgb: sensor.sample_ray(0, 0, [0.25, 0.125], [0.3, 0.7]) with near_clip 0.5, far_clip 100, a
        // film of 64 × 48 and the transform above: ray.o, ray.d, ray.maxt.
        let axis = |fov_axis| Perspective { fov_axis, ..parameters() };
        let offset = Perspective { principal_point_offset: DVec2::new(0.1, -0.2), ..parameters() };
        let lens = Perspective { aperture_radius: 0.25, focus_distance: 4.0, ..parameters() };
        let x = ([0.789276, 1.92526, 2.53227], [-0.406475, -0.144174, -0.902215], 103.165_44);
        let y = ([0.757021, 1.95732, 2.52831], [-0.456466, -0.080173, -0.886122], 105.928_68);
        let cases: [(Perspective, Seen); 7] = [
            (parameters(), x),
            (axis(FovAxis::Larger), x),
            (axis(FovAxis::Y), y),
            (axis(FovAxis::Smaller), y),
            (
                axis(FovAxis::Diagonal),
                ([0.808628, 1.90602, 2.53465], [-0.373872, -0.183608, -0.909125], 101.861_08),
            ),
            (offset, ([0.820059, 1.97656, 2.50534], [-0.341513, -0.044481, -0.938824], 104.852)),
            (lens, ([0.84417, 1.9834, 2.49675], [-0.421637, -0.16021, -0.892499], 103.156_85)),
        ];
        for (parameters, (origin, direction, t_max)) in cases {
            let camera = Camera::perspective(&parameters).unwrap();
            let ray = camera.ray(Vec2::new(0.25 * 64.0, 0.125 * 48.0), Vec2::new(0.3, 0.7));
            assert!((ray.origin - Vec3::from(origin)).length() < 1e-5, "{parameters:?} {ray:?}");
            assert!(
                (ray.direction - Vec3::from(direction)).length() < 2e-6,
                "{parameters:?} {ray:?}"
            );
            assert!((ray.t_max - t_max).abs() < 1e-3, "{parameters:?} {ray:?}");
        }
    }

    #[test]
    fn raster_and_direction_are_inverse() {
        let lens = Perspective { aperture_radius: 0.25, focus_distance: 4.0, ..parameters() };
        let offset = Perspective { principal_point_offset: DVec2::new(0.1, -0.2), ..parameters() };
        for parameters in [parameters(), lens, offset] {
            let camera = Camera::perspective(&parameters).unwrap();
            for i in 0..1000 {
                let mut sampler = SobolSampler::new(1, 2, i);
                let raster = sampler.next_2d() * Vec2::new(64.0, 48.0);
                let lens = sampler.next_2d();
                let found = camera.raster_of(camera.ray(raster, lens).direction, lens);
                // Directions are rounded to 6e-8, of which a pixel is 1e-2; a raster position to 4e-6.
                assert!(
                    found.is_some_and(|found| (found - raster).length() < 5e-5),
                    "{raster} {found:?}"
                );
                let exact = camera.raster(camera.film_point(raster.as_dvec2()) * 3.7).unwrap();
                assert!((exact - raster.as_dvec2()).length() < 1e-12);
            }
            for raster in [Vec2::new(-0.01, 10.0), Vec2::new(64.01, 10.0), Vec2::new(5.0, 48.01)] {
                assert_eq!(
                    camera.raster_of(camera.ray(raster, Vec2::ZERO).direction, Vec2::ZERO),
                    None
                );
            }
            assert_eq!(
                camera.raster_of(camera.ray(Vec2::ONE, Vec2::ZERO).direction * -1.0, Vec2::ZERO),
                None
            );
        }
    }

    #[test]
    fn importance_integrates_to_one() {
        // ∫ W_e cos θ dω over the film, with uniform raster points: dω = A cos³θ dρ, where dρ sums to 1.
        for parameters in [parameters(), Perspective { fov: 120.0, ..parameters() }] {
            let camera = Camera::perspective(&parameters).unwrap();
            let [width, height] = parameters.film;
            let cells = (0..height)
                .flat_map(|y| (0..width).map(move |x| Vec2::new(x as f32 + 0.5, y as f32 + 0.5)));
            // The solid angle of each cell by the exact formula of a rectangle seen from distance 1.
            let corner_angle = |x: f64, y: f64| (x * y / (1.0 + x * x + y * y).sqrt()).atan();
            let solid_angle = |raster: DVec2| {
                let (low, high) =
                    (camera.film_point(raster - 0.5), camera.film_point(raster + 0.5));
                (corner_angle(low.x, low.y)
                    - corner_angle(high.x, low.y)
                    - corner_angle(low.x, high.y)
                    + corner_angle(high.x, high.y))
                .abs()
            };
            let total: f64 = cells
                .map(|raster| {
                    let direction = camera.ray(raster, Vec2::ZERO).direction;
                    let cosine = camera.optical_axis().dot(direction.as_dvec3());
                    camera.importance(direction) * cosine * solid_angle(raster.as_dvec2())
                })
                .sum();
            // Midpoints over 64 × 48 cells are right to about a thousandth of the cells' squared size.
            assert!((total - 1.0).abs() < 1e-3, "{total}");
        }
    }

    #[test]
    fn importance_of_a_right_angle() {
        // METHODS N.15: A = 4, so 1/4 on the axis and 1/4 · 16 = 4 at 60°.
        let camera = Camera::perspective(&Perspective {
            fov: 90.0,
            film: [10, 10],
            ..Perspective::default()
        })
        .unwrap();
        assert!((camera.importance(Vec3::Z) - 0.25).abs() < 1e-12);
        let slanted = Vec3::new(0.75f32.sqrt(), 0.0, 0.5);
        assert!((camera.importance(slanted) - 4.0).abs() < 1e-5);
        assert_eq!(camera.importance(-Vec3::Z), 0.0);
    }

    #[test]
    fn rays_of_a_lens_meet_in_the_focal_plane() {
        let lens = Perspective { aperture_radius: 0.25, focus_distance: 4.0, ..parameters() };
        let camera = Camera::perspective(&lens).unwrap();
        let pinhole = Camera::perspective(&Perspective { aperture_radius: 0.0, ..lens }).unwrap();
        let raster = Vec2::new(10.0, 40.0);
        let at_focus = |camera: &Camera, lens| {
            let ray = camera.ray(raster, lens);
            let along = |vector: Vec3| camera.optical_axis().dot(vector.as_dvec3()) as f32;
            ray.at((4.0 - along(ray.origin - camera.center())) / along(ray.direction))
        };
        let expected = at_focus(&pinhole, Vec2::ZERO);
        for u in [Vec2::new(0.1, 0.2), Vec2::new(0.9, 0.5), Vec2::new(0.5, 0.99)] {
            assert!((at_focus(&camera, u) - expected).length() < 1e-5);
            assert!((camera.lens_point(u) - camera.center()).length() <= camera.aperture_radius());
        }
        // A lens without radius is a pinhole, whatever the numbers.
        let rays = [Vec2::ZERO, Vec2::ONE * 0.7].map(|u| pinhole.ray(raster, u));
        assert_eq!((rays[0].origin, rays[0].direction), (rays[1].origin, rays[1].direction));
    }
}
