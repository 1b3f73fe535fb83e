//! The perspective camera: pinhole and thin lens.
//!
//! Camera space is that of Mitsuba 3: the camera looks along `+z`, `+y` is up and `+x` is to the *left* of the image.
//! The film is thought at distance 1 in front of the camera, where it has the area `A = 4 tan(fov_x/2) tan(fov_y/2)`.
//! Raster coordinates are pixels of the whole film, `(0, 0)` its upper left corner; a crop window changes nothing here.

use crate::geometry::Ray;
use crate::math::warp::square_to_disk;
use glam::{DMat3, DMat4, DVec2, DVec3, Vec2, Vec3};

/// Which side of the film the field of view is measured along.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FovAxis {
    /// The horizontal side.
    #[default]
    X,
    /// The vertical side.
    Y,
    /// The diagonal.
    Diagonal,
    /// The shorter side.
    Smaller,
    /// The longer side.
    Larger,
}

/// What a scene file says of a perspective camera. The default is Mitsuba's, with a field of view of 45° and a film of
/// 768 × 576 pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Perspective {
    /// Camera space to world space; its linear part is a rotation, or one with a reflection. In double precision and
    /// already without [`Scene::origin`](super::Scene::origin).
    pub to_world: DMat4,
    /// Field of view in degrees, between 0 and 180.
    pub fov: f64,
    /// Where the field of view is measured.
    pub fov_axis: FovAxis,
    /// Pixels across and down the whole film.
    pub film: [u32; 2],
    /// Where the optical axis meets the film, relative to its centre, as a share of the film's width and height; the
    /// image moves left and up as these grow, as in Mitsuba.
    pub principal_point_offset: DVec2,
    /// Nothing nearer than this along the optical axis is seen.
    pub near_clip: f64,
    /// Nothing farther than this along the optical axis is seen.
    pub far_clip: f64,
    /// Radius of the lens; 0 is a pinhole.
    pub aperture_radius: f64,
    /// Distance along the optical axis of what a lens shows sharply.
    pub focus_distance: f64,
}

impl Default for Perspective {
    fn default() -> Self {
        Self {
            to_world: DMat4::IDENTITY,
            fov: 45.0,
            fov_axis: FovAxis::X,
            film: [768, 576],
            principal_point_offset: DVec2::ZERO,
            near_clip: 1e-2,
            far_clip: 1e4,
            aperture_radius: 0.0,
            focus_distance: 1.0,
        }
    }
}

impl Perspective {
    /// Half-width and half-height of the film at distance 1.
    fn half_size(&self) -> DVec2 {
        let [width, height] = self.film.map(f64::from);
        let tangent = (0.5 * self.fov.to_radians()).tan();
        // The size of the film in units of the side that the field of view is measured along.
        let side = match self.fov_axis {
            FovAxis::X => width,
            FovAxis::Y => height,
            FovAxis::Diagonal => width.hypot(height),
            FovAxis::Smaller => width.min(height),
            FovAxis::Larger => width.max(height),
        };
        DVec2::new(width, height) * (tangent / side)
    }
}

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
    pub fn perspective(parameters: &Perspective) -> Self {
        let half = parameters.half_size();
        let film = DVec2::from(parameters.film.map(f64::from));
        let pixel = -2.0 * half / film;
        Self {
            rotation: DMat3::from_mat4(parameters.to_world),
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
        }
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
            direction: (self.rotation * direction).normalize().as_vec3(),
            t_max: ((self.far_clip - self.near_clip) / direction.z) as f32,
        }
    }

    /// Where light that arrives along `-direction` at the point `lens` of the aperture (see [`Camera::lens_point`]) meets
    /// the film; `None` outside. The inverse of [`Camera::ray`]; `direction` need not be a unit vector.
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
        let lens_area =
            self.lens.map_or(1.0, |lens| std::f64::consts::PI * lens.radius * lens.radius);
        1.0 / (lens_area * self.film_area * cosine.powi(4))
    }

    /// Centre of the aperture, in world space.
    pub fn center(&self) -> Vec3 {
        self.center.as_vec3()
    }

    /// Radius of the aperture; 0 for a pinhole.
    pub fn aperture_radius(&self) -> f32 {
        self.lens.map_or(0.0, |lens| lens.radius as f32)
    }

    /// Unit vector along which the camera looks, in world space.
    fn optical_axis(&self) -> DVec3 {
        self.rotation.z_axis.normalize()
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

    /// A vector of the world in camera space, up to a positive factor.
    fn to_camera(&self, world: DVec3) -> DVec3 {
        self.rotation.transpose() * world
    }
}
