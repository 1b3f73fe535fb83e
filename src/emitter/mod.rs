//! Where light comes from, and how to choose a direction to it.
//!
//! [`Emitters::sample`] chooses an emitter (in proportion to its power, mixed with 5 % uniform) and then a direction to
//! it; [`Emitters::pdf`] and [`Emitters::environment_pdf`] are the density of just that, for directions found in another
//! way. Densities are per steradian. An emitter that is black or has no area is never chosen, and its density is 0.
//!
//! Walks that begin at the light take a [`LightPoint`] from [`Emitters::sample_point`] and a ray from
//! [`Emitters::sample_emission`]; [`Emitters::point_pdf`] and [`Emitters::emission_pdf`] are the densities of these two.
//!
//! Area emitters shine from one side only, that of their shading normal (the normals of a mesh's vertices, where it has
//! any, as in Mitsuba 3): behind it both the radiance and the density are 0.

mod area;
mod bounding_sphere;
mod emission;
mod environment;
mod point;

pub use bounding_sphere::BoundingSphere;
pub use emission::LightPoint;
pub use environment::{Environment, EnvironmentError, EnvironmentMap};

use crate::geometry::{Interaction, Part};
use crate::math::Rgb;
use crate::math::distribution::AliasTable;
use crate::texture::Texture;
use area::AreaEmitter;
use glam::{Vec2, Vec3};
use point::{Directional, Point, Spot};
use std::f64::consts::PI;

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
    /// A part of the scene that shines from the side of its shading normal.
    Area {
        /// Its shape, in world space.
        part: Part,
        /// Emitted radiance over the surface.
        radiance: Texture,
    },
    /// A point that shines equally into all directions.
    Point {
        /// Where it is, in world space.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Rgb,
    },
    /// A point that shines into a cone, linearly darker with the angle between the beam and the cut-off.
    Spot {
        /// Where it is, in world space.
        position: Vec3,
        /// Axis of the cone, away from the emitter; need not be a unit vector.
        direction: Vec3,
        /// Radiant intensity along the axis, W/sr.
        intensity: Rgb,
        /// Angle between the axis and the first direction without light, in degrees.
        cutoff_angle: f32,
        /// Angle between the axis and the last direction of full intensity, in degrees; at most `cutoff_angle`.
        beam_width: f32,
    },
    /// Parallel light from infinitely far away.
    Directional {
        /// Where the light goes, in world space; need not be a unit vector.
        direction: Vec3,
        /// Irradiance of a surface perpendicular to it, W/m².
        irradiance: Rgb,
    },
    /// Light from infinitely far away in all directions.
    Environment(Environment),
}

/// What an emitter is, without its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmitterKind {
    /// A part of the scene.
    Area,
    /// A point.
    Point,
    /// A point with a cone.
    Spot,
    /// Parallel light.
    Directional,
    /// The same radiance from everywhere.
    Constant,
    /// An image of all directions.
    Map,
}

/// Share of the choices that goes to all emitters equally. More would waste samples on dim emitters; less would make
/// their light noisier where no bright emitter reaches, since a sample's weight is at most the number of emitters
/// divided by this share.
const UNIFORM_SHARE: f64 = 0.05;

/// All emitters of a scene, and the probability of choosing each: proportional to power, mixed with 5 % uniform.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    sources: Vec<Source>,
    /// Missing when there is no light at all.
    selection: Option<AliasTable>,
    /// Which source is the environment.
    environment: Option<usize>,
    /// What light from infinity falls on.
    target: BoundingSphere,
}

/// An emitter with what sampling it needs, computed once.
#[derive(Clone, Debug)]
enum Source {
    Area(AreaEmitter),
    Point(Point),
    Spot(Spot),
    Directional(Directional),
    Environment(Environment),
}

impl Emitters {
    /// `target` is a sphere around the scene and the camera, which light from infinity falls on. [`EmitterId`]s count along
    /// `emitters`.
    ///
    /// # Panics
    /// When there is more than one environment.
    pub fn new(emitters: Vec<Emitter>, target: BoundingSphere) -> Self {
        let sources: Vec<Source> = emitters.into_iter().map(Source::new).collect();
        let mut environments =
            (0..sources.len()).filter(|&i| matches!(sources[i], Source::Environment(_)));
        let environment = environments.next();
        assert!(environments.next().is_none(), "a scene has at most one environment");

        let powers: Vec<f64> =
            sources.iter().map(|source| source.power(f64::from(target.radius))).collect();
        Self {
            selection: AliasTable::new(&selection_weights(&powers)),
            sources,
            environment,
            target,
        }
    }

    /// The same emitters, of the same probabilities, with light from infinity that falls on this sphere, too: for the lens of
    /// a camera, whose size shall not change which emitters a path tracer chooses.
    pub fn reaching(self, sphere: BoundingSphere) -> Self {
        Self { target: self.target.holding(sphere), ..self }
    }

    /// Chooses an emitter by `selection` and a direction to it from `from` by `u`; `None` when there is no light that
    /// way.
    #[inline(always)]
    pub fn sample(&self, from: Vec3, selection: f32, u: Vec2) -> Option<EmitterSample> {
        let choice = self.selection.as_ref()?.sample(selection);
        let mut sample = match &self.sources[choice.index] {
            Source::Area(area) => area.sample(from, choice.remainder, u)?,
            // Taken apart, what area emitters give stays in registers.
            other => {
                let EmitterSample { direction, distance, radiance, pdf, is_delta } =
                    other.sample_others(from, u)?;
                EmitterSample { direction, distance, radiance, pdf, is_delta }
            }
        };
        sample.pdf *= choice.pmf;
        // A density that single precision cannot hold comes from points nearer than about 1e-19, or seen edge-on.
        (!sample.radiance.is_black() && sample.pdf > 0.0 && sample.pdf.is_finite())
            .then_some(sample)
    }

    /// Light of every point, spot and directional emitter at `from`; each with a `pdf` of 1.
    pub fn delta_samples(&self, from: Vec3) -> impl Iterator<Item = EmitterSample> + '_ {
        self.sources.iter().filter_map(move |source| match source {
            Source::Point(point) => point.sample(from),
            Source::Spot(spot) => spot.sample(from),
            Source::Directional(directional) => Some(directional.sample()),
            Source::Area(_) | Source::Environment(_) => None,
        })
    }

    /// Radiance that the area emitter `id` sends from `at` into the unit direction `wo`.
    #[inline]
    pub fn radiance(&self, id: EmitterId, at: &Interaction, wo: Vec3) -> Rgb {
        match &self.sources[id.0 as usize] {
            Source::Area(area) if area::shining_normal(at).dot(wo) > 0.0 => area.radiance(at.uv),
            _ => Rgb::BLACK,
        }
    }

    /// Density, selection included, with which [`Emitters::sample`] from `from` gives the direction to `at` on `id`.
    #[inline]
    pub fn pdf(&self, id: EmitterId, from: Vec3, at: &Interaction) -> f32 {
        match &self.sources[id.0 as usize] {
            Source::Area(area) => self.probability(id) * area.pdf(from, at),
            _ => 0.0,
        }
    }

    /// Radiance of the environment from the unit direction `direction` (pointing away from the scene).
    #[inline]
    pub fn environment(&self, direction: Vec3) -> Rgb {
        self.environment_source()
            .map_or(Rgb::BLACK, |(_, environment)| environment.radiance(direction))
    }

    /// Density, selection included, with which [`Emitters::sample`] gives that direction of the environment.
    #[inline]
    pub fn environment_pdf(&self, direction: Vec3) -> f32 {
        self.environment_with_pdf(direction).1
    }

    /// [`Emitters::environment`] and [`Emitters::environment_pdf`] of one direction, looked up once.
    #[inline]
    pub fn environment_with_pdf(&self, direction: Vec3) -> (Rgb, f32) {
        self.environment_source().map_or((Rgb::BLACK, 0.0), |(id, environment)| {
            let (radiance, pdf) = environment.radiance_and_pdf(direction);
            (radiance, self.probability(id) * pdf)
        })
    }

    /// Probability of choosing the emitter `id`.
    #[inline]
    pub fn probability(&self, id: EmitterId) -> f32 {
        self.selection.as_ref().map_or(0.0, |selection| selection.pmf(id.0 as usize))
    }

    /// The sphere that light from infinity falls on: around the scene and the camera.
    pub fn target(&self) -> BoundingSphere {
        self.target
    }

    /// Is there nothing to sample?
    pub fn is_dark(&self) -> bool {
        self.selection.is_none()
    }

    #[inline]
    fn environment_source(&self) -> Option<(EmitterId, &Environment)> {
        let index = self.environment?;
        match &self.sources[index] {
            Source::Environment(environment) => Some((EmitterId(index as u32), environment)),
            _ => None,
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.sources.len()
    }

    /// Texels across and down of the environment map, if there is one.
    pub fn map_size(&self) -> Option<[usize; 2]> {
        match self.environment_source()? {
            (_, Environment::Map(map)) => Some(map.size()),
            (_, Environment::Constant(_)) => None,
        }
    }

    /// What each is and its power in watts, mean of the three colours: of light from infinity, what enters
    /// [`Emitters::target`].
    pub fn kinds(&self) -> impl Iterator<Item = (EmitterKind, f64)> + '_ {
        let radius = f64::from(self.target.radius);
        self.sources.iter().map(move |source| (source.kind(), source.power(radius)))
    }

    /// Are there none?
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    /// Is there one that a camera could see: an area emitter or an environment?
    pub fn has_visible(&self) -> bool {
        self.sources.iter().any(|source| matches!(source, Source::Area(_) | Source::Environment(_)))
    }
}

impl Source {
    fn new(emitter: Emitter) -> Self {
        match emitter {
            Emitter::Area { part, radiance } => Self::Area(AreaEmitter::new(part, radiance)),
            Emitter::Point { position, intensity } => Self::Point(Point { position, intensity }),
            Emitter::Spot { position, direction, intensity, cutoff_angle, beam_width } => {
                Self::Spot(Spot::new(position, direction, intensity, cutoff_angle, beam_width))
            }
            Emitter::Directional { direction, irradiance } => {
                Self::Directional(Directional::new(direction, irradiance))
            }
            Emitter::Environment(environment) => Self::Environment(environment),
        }
    }

    /// [`Emitters::sample`] of all sources but area emitters, without the choice.
    fn sample_others(&self, from: Vec3, u: Vec2) -> Option<EmitterSample> {
        match self {
            Self::Area(_) => None,
            Self::Point(point) => point.sample(from),
            Self::Spot(spot) => spot.sample(from),
            Self::Directional(directional) => Some(directional.sample()),
            Self::Environment(environment) => environment.sample(u),
        }
    }

    fn kind(&self) -> EmitterKind {
        match self {
            Self::Area(_) => EmitterKind::Area,
            Self::Point(_) => EmitterKind::Point,
            Self::Spot(_) => EmitterKind::Spot,
            Self::Directional(_) => EmitterKind::Directional,
            Self::Environment(Environment::Constant(_)) => EmitterKind::Constant,
            Self::Environment(Environment::Map(_)) => EmitterKind::Map,
        }
    }

    /// Power in watts, mean of the three colours; of light from infinity, that which enters a sphere of radius `radius`.
    fn power(&self, radius: f64) -> f64 {
        let cross_section = PI * radius * radius;
        match self {
            Self::Area(area) => area.power(),
            Self::Point(point) => 4.0 * PI * mean(point.intensity),
            Self::Spot(spot) => spot.power(),
            Self::Directional(directional) => cross_section * mean(directional.irradiance),
            Self::Environment(environment) => cross_section * environment.fluence(),
        }
    }
}

/// Probabilities of choosing emitters of the given powers. What has no power is never chosen.
fn selection_weights(powers: &[f64]) -> Vec<f64> {
    let usable = |power: f64| if power > 0.0 { power.min(f64::MAX) } else { 0.0 };
    let largest = powers.iter().copied().map(usable).fold(0.0, f64::max);
    let total: f64 = powers.iter().map(|&power| usable(power) / largest).sum();
    let count = powers.iter().filter(|&&power| power > 0.0).count() as f64;
    let weight = |power: f64| {
        if power > 0.0 {
            (1.0 - UNIFORM_SHARE) * (usable(power) / largest / total) + UNIFORM_SHARE / count
        } else {
            0.0
        }
    };
    powers.iter().map(|&power| weight(power)).collect()
}

/// Mean of the three colours, in double precision.
fn mean(colour: Rgb) -> f64 {
    colour.to_array().iter().map(|&value| f64::from(value)).sum::<f64>() / 3.0
}
