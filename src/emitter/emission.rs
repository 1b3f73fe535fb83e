//! Where light starts, and where it goes from there.

use super::area::shining_normal;
use super::{EmitterId, Emitters, Source};
use crate::geometry::{Interaction, Ray};
use crate::math::float::offset_point;
use crate::math::{Frame, Rgb, warp};
use glam::{Vec2, Vec3};
use std::f64::consts::{FRAC_1_PI, PI};

/// Where light starts: the light's end of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightPoint {
    /// A point of an area emitter.
    Surface {
        /// The point, in world space.
        position: Vec3,
        /// Absolute bound of its rounding error, per axis, as [`Interaction::error`].
        error: Vec3,
        /// Unit geometric normal on the side that shines.
        normal: Vec3,
        /// Surface coordinates, where the emitted radiance depends on them.
        uv: Vec2,
    },
    /// A point or spot emitter.
    Point {
        /// Where it is, in world space.
        position: Vec3,
    },
    /// A place infinitely far away: an environment or a directional emitter.
    Infinite {
        /// Unit vector to the place; its light goes the other way.
        direction: Vec3,
        /// Is it the only direction that the emitter shines from (directional)?
        is_delta: bool,
    },
}

/// Density of a direction uniform on the sphere, per steradian.
const SPHERE_PDF: f64 = 0.25 * FRAC_1_PI;

/// Rays from infinity start this many radii of the bounding sphere from its centre: outside it, whatever rounds.
const START: f32 = 1.001;

impl Emitters {
    /// Chooses an emitter by `selection` with the probabilities of [`Emitters::probability`], and by `u` a place on it where
    /// light starts. The density of both: per unit of area on area emitters, which are sampled uniformly whatever their
    /// texture; per steradian for environments; discrete for others. `None` where there is nothing to choose.
    pub fn sample_point(&self, selection: f32, u: Vec2) -> Option<(EmitterId, LightPoint, f64)> {
        let choice = self.selection.as_ref()?.sample(selection);
        let point = match &self.sources[choice.index] {
            Source::Area(area) => {
                let (point, error) = area.sample_point(choice.remainder, u)?;
                let uv = area.uv(choice.remainder, u);
                LightPoint::Surface { position: point.position, error, normal: point.normal, uv }
            }
            Source::Point(point) => LightPoint::Point { position: point.position },
            Source::Spot(spot) => LightPoint::Point { position: spot.point.position },
            Source::Directional(directional) => {
                LightPoint::Infinite { direction: directional.source, is_delta: true }
            }
            Source::Environment(environment) => {
                let direction = environment.sample(u)?.direction;
                LightPoint::Infinite { direction, is_delta: false }
            }
        };
        let id = EmitterId(choice.index as u32);
        let pdf = self.point_pdf(id, &point);
        (pdf > 0.0 && pdf.is_finite()).then_some((id, point, pdf))
    }

    /// Density with which [`Emitters::sample_point`] gives that place on the emitter `id`, found in whatever way.
    pub fn point_pdf(&self, id: EmitterId, at: &LightPoint) -> f64 {
        let pdf = match (&self.sources[id.0 as usize], at) {
            (Source::Area(area), LightPoint::Surface { .. }) => area.point_pdf(),
            (Source::Environment(environment), LightPoint::Infinite { direction, .. }) => {
                f64::from(environment.radiance_and_pdf(*direction).1)
            }
            (Source::Point(_) | Source::Spot(_), LightPoint::Point { .. })
            | (Source::Directional(_), LightPoint::Infinite { .. }) => 1.0,
            _ => 0.0,
        };
        f64::from(self.probability(id)) * pdf
    }

    /// The place where light starts at a hit of the area emitter `id`.
    pub fn surface_point(&self, id: EmitterId, at: &Interaction) -> LightPoint {
        debug_assert!(matches!(self.sources[id.0 as usize], Source::Area(_)), "{id:?}");
        LightPoint::Surface {
            position: at.position,
            error: at.error,
            normal: shining_normal(at),
            uv: at.uv,
        }
    }

    /// Chooses a ray of light that leaves the emitter `id` at that place, and its density: per steradian where the place is
    /// somewhere, proportional to the cosine on area emitters, uniform in a spot's cone, uniform on the sphere around
    /// points. From infinity all rays are parallel; they are uniform on the disk that the bounding sphere shows them, start
    /// outside the sphere, and the density is that per unit of the disk's area. `None` where no light goes.
    pub fn sample_emission(&self, id: EmitterId, at: &LightPoint, u: Vec2) -> Option<(Ray, f64)> {
        let ray = match (at, &self.sources[id.0 as usize]) {
            (LightPoint::Surface { position, error, normal, .. }, _) => {
                let local = warp::square_to_cosine_hemisphere(u);
                let direction = Frame::from_normal(*normal).to_world(local);
                Ray::new(offset_point(*position, *error, *normal, direction), direction)
            }
            (LightPoint::Point { position }, Source::Spot(spot)) => {
                Ray::new(*position, spot.sample_emission(u))
            }
            (LightPoint::Point { position }, _) => Ray::new(*position, warp::square_to_sphere(u)),
            (LightPoint::Infinite { direction, .. }, _) => {
                let disk = warp::square_to_disk(u);
                let frame = Frame::from_normal(*direction);
                let start = frame.to_world(disk.extend(START)) * self.target.radius;
                Ray::new(self.target.center + start, -*direction)
            }
        };
        let pdf = self.emission_pdf(id, at, ray.direction);
        (pdf > 0.0 && pdf.is_finite()).then_some((ray, pdf))
    }

    /// Density with which [`Emitters::sample_emission`] gives the unit vector `direction`, which points away from the light;
    /// from infinity, that of any ray through the bounding sphere.
    pub fn emission_pdf(&self, id: EmitterId, at: &LightPoint, direction: Vec3) -> f64 {
        match (&self.sources[id.0 as usize], at) {
            (Source::Area(_), LightPoint::Surface { normal, .. }) => {
                normal.as_dvec3().dot(direction.as_dvec3()).max(0.0) * FRAC_1_PI
            }
            (Source::Point(_), LightPoint::Point { .. }) => SPHERE_PDF,
            (Source::Spot(spot), LightPoint::Point { .. }) => spot.emission_pdf(direction),
            (Source::Directional(_) | Source::Environment(_), LightPoint::Infinite { .. }) => {
                1.0 / (PI * f64::from(self.target.radius).powi(2))
            }
            _ => 0.0,
        }
    }

    /// What the emitter `id` sends from that place into the unit vector `direction`, which points away from the light:
    /// radiance of area emitters and environments, intensity (W/sr) of points and spots, irradiance of a perpendicular
    /// surface (W/m²) by directional emitters. Black behind the side that shines.
    pub fn emitted(&self, id: EmitterId, at: &LightPoint, direction: Vec3) -> Rgb {
        match (&self.sources[id.0 as usize], at) {
            (Source::Area(area), LightPoint::Surface { normal, uv, .. })
                if normal.dot(direction) > 0.0 =>
            {
                area.radiance(*uv)
            }
            (Source::Point(point), LightPoint::Point { .. }) => point.intensity,
            (Source::Spot(spot), LightPoint::Point { .. }) => spot.intensity(direction),
            (Source::Directional(directional), LightPoint::Infinite { .. }) => {
                directional.irradiance
            }
            (Source::Environment(environment), LightPoint::Infinite { direction, .. }) => {
                environment.radiance(*direction)
            }
            _ => Rgb::BLACK,
        }
    }

    /// Which emitter is the environment.
    pub fn environment_id(&self) -> Option<EmitterId> {
        self.environment_source().map(|(id, _)| id)
    }

    /// Is the emitter one that no ray can meet: a point, a spot, a directional one?
    pub fn is_delta(&self, id: EmitterId) -> bool {
        match &self.sources[id.0 as usize] {
            Source::Point(_) | Source::Spot(_) | Source::Directional(_) => true,
            Source::Area(_) | Source::Environment(_) => false,
        }
    }
}
