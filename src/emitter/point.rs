//! Emitters that shine from one direction only: point, spot and directional.

use super::{EmitterSample, mean};
use crate::math::{Frame, Rgb, warp};
use glam::{Vec2, Vec3};
use std::f64::consts::TAU;

/// A point of equal intensity in all directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) position: Vec3,
    /// W/sr.
    pub(super) intensity: Rgb,
}

impl Point {
    /// The only direction there is; its `pdf` is 1.
    #[inline]
    pub(super) fn sample(&self, from: Vec3) -> Option<EmitterSample> {
        let to = self.position - from;
        let inverse_square = 1.0 / to.length_squared();
        let radiance = self.intensity * inverse_square;
        let distance = to.length();
        // At the point itself there is no direction, and within 1e-19 of it no finite irradiance.
        radiance.is_finite().then(|| EmitterSample {
            direction: to / distance,
            distance,
            radiance,
            pdf: 1.0,
            is_delta: true,
        })
    }
}

/// A point that shines into a cone. The intensity falls linearly with the angle, from the beam's edge to the cut-off, as
/// that of Mitsuba 3's `spot` does.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    pub(super) point: Point,
    axis: Vec3,
    /// Radians.
    cutoff: f32,
    cutoff_cosine: f32,
    beam_cosine: f32,
    /// One over the angle between beam and cut-off, per radian; 0 when they are the same, and then it is not used.
    steepness: f32,
    /// Intensity integrated over directions, as a multiple of that along the axis, sr.
    solid_angle: f64,
}

impl Spot {
    /// Angles are in degrees.
    pub(super) fn new(
        position: Vec3,
        direction: Vec3,
        intensity: Rgb,
        cutoff_angle: f32,
        beam_width: f32,
    ) -> Self {
        let cutoff = f64::from(cutoff_angle.clamp(0.0, 180.0)).to_radians();
        let beam = f64::from(beam_width.clamp(0.0, 180.0)).to_radians().min(cutoff);
        // ∫ sin θ up to the beam, plus ∫ (c - θ) / (c - b) sin θ from there to the cut-off: by parts, 1 - (sin c - sin
        // b) / (c - b), times 2π. Where both are equal the quotient is its limit, the cosine.
        let quotient = if cutoff > beam {
            (cutoff.sin() - beam.sin()) / (cutoff - beam)
        } else {
            cutoff.cos()
        };
        Self {
            point: Point { position, intensity },
            axis: direction.normalize_or_zero(),
            cutoff: cutoff as f32,
            cutoff_cosine: cutoff.cos() as f32,
            beam_cosine: beam.cos() as f32,
            steepness: if cutoff > beam { (1.0 / (cutoff - beam)) as f32 } else { 0.0 },
            solid_angle: TAU * (1.0 - quotient),
        }
    }

    /// Watts.
    pub(super) fn power(&self) -> f64 {
        self.solid_angle * mean(self.point.intensity)
    }

    /// As that of [`Point`]; `None` outside the cone.
    #[inline]
    pub(super) fn sample(&self, from: Vec3) -> Option<EmitterSample> {
        let sample = self.point.sample(from)?;
        let falloff = self.falloff(-self.axis.dot(sample.direction))?;
        Some(EmitterSample { radiance: sample.radiance * falloff, ..sample })
    }

    /// W/sr into a unit direction, away from the emitter.
    pub(super) fn intensity(&self, direction: Vec3) -> Rgb {
        let falloff = self.falloff(self.axis.dot(direction));
        falloff.map_or(Rgb::BLACK, |falloff| self.point.intensity * falloff)
    }

    /// Share of the intensity along the axis, at an angle to it of this cosine; `None` outside the cone.
    #[inline]
    fn falloff(&self, cosine: f32) -> Option<f32> {
        if cosine >= self.beam_cosine {
            Some(1.0)
        } else if cosine > self.cutoff_cosine {
            Some(((self.cutoff - cosine.acos()) * self.steepness).max(0.0))
        } else {
            None
        }
    }

    /// A direction uniform in the cone, away from the emitter.
    pub(super) fn sample_emission(&self, u: Vec2) -> Vec3 {
        let local = warp::square_to_cone(u, self.cap() as f32);
        Frame::from_normal(self.axis).to_world(local)
    }

    /// Density of [`Spot::sample_emission`] per steradian; 0 outside the cone.
    pub(super) fn emission_pdf(&self, direction: Vec3) -> f64 {
        let (axis, direction) = (self.axis.as_dvec3(), direction.as_dvec3());
        // Not by the cosine, which in single precision has no digits left in a narrow cone. A direction rounded to
        // single precision may lie outside by this much.
        const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;
        let angle = axis.cross(direction).length().atan2(axis.dot(direction));
        if angle <= f64::from(self.cutoff) + ROUNDING { 1.0 / (TAU * self.cap()) } else { 0.0 }
    }

    /// `1 - cos` of the cut-off.
    fn cap(&self) -> f64 {
        2.0 * (0.5 * f64::from(self.cutoff)).sin().powi(2)
    }
}

/// Parallel light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Directional {
    /// Unit vector to where the light comes from.
    pub(super) source: Vec3,
    /// W/m², of a perpendicular surface.
    pub(super) irradiance: Rgb,
}

impl Directional {
    /// Light that goes into `direction`, which need not be a unit vector. None at all if it is zero.
    pub(super) fn new(direction: Vec3, irradiance: Rgb) -> Self {
        match direction.try_normalize() {
            Some(direction) => Self { source: -direction, irradiance },
            None => Self { source: Vec3::Z, irradiance: Rgb::BLACK },
        }
    }

    /// The only direction there is; its `pdf` is 1.
    #[inline]
    pub(super) fn sample(&self) -> EmitterSample {
        EmitterSample {
            direction: self.source,
            distance: f32::INFINITY,
            radiance: self.irradiance,
            pdf: 1.0,
            is_delta: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_close(actual: Rgb, expected: [f32; 3]) {
        let difference = actual - Rgb::from(expected);
        assert!(
            difference.map(f32::abs).max_component() < 1e-5,
            "{actual:?}, expected {expected:?}"
        );
    }

    #[test]
    fn a_spot_is_that_of_mitsuba() {
        // Mitsuba 3.9.1 scalar_rgb: spot with intensity 3 2 1, cutoff_angle 30, beam_width 18, to_world lookat from
        // 1 2 3 to 0 0 0 with up 0 1 0; weights of sample_direction.
        let axis = -Vec3::new(1.0, 2.0, 3.0);
        let spot = Spot::new(Vec3::new(1.0, 2.0, 3.0), axis, Rgb::new(3.0, 2.0, 1.0), 30.0, 18.0);
        for (from, expected) in SPOT_GOLDEN {
            let sample = spot.sample(Vec3::from(from));
            assert_close(sample.map_or(Rgb::BLACK, |sample| sample.radiance), expected);
        }
    }

    const SPOT_GOLDEN: [([f32; 3], [f32; 3]); 6] = [
        ([0.0, 0.0, 0.0], [0.2142857, 0.1428571, 0.0714286]),
        ([1.2, -0.5, 0.3], [0.1715808, 0.1143872, 0.0571936]),
        ([-1.0, 1.1, 0.0], [0.1268496, 0.0845664, 0.0422832]),
        ([0.1, 1.2, 0.0], [0.2858147, 0.1905432, 0.0952716]),
        ([2.2, -0.8, 0.0], [0.0, 0.0, 0.0]),
        ([3.0, 2.0, 0.0], [0.0, 0.0, 0.0]),
    ];

    #[test]
    fn the_power_of_a_spot_is_its_integral() {
        for (cutoff, beam) in [(30.0, 18.0), (90.0, 0.0), (180.0, 180.0), (20.0, 20.0)] {
            let spot = Spot::new(Vec3::ZERO, Vec3::Z, Rgb::WHITE, cutoff, beam);
            // Midpoints in the cosine, so that each has the same solid angle.
            const COUNT: u32 = 100_000;
            let cosine = |i: u32| 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(COUNT);
            let intensity = |cosine: f64| {
                let from = Vec3::new((1.0 - cosine * cosine).sqrt() as f32, 0.0, cosine as f32);
                spot.sample(from).map_or(0.0, |sample| f64::from(sample.radiance.r))
            };
            let integral: f64 = (0..COUNT).map(|i| intensity(cosine(i))).sum::<f64>() * 2.0 * TAU
                / f64::from(COUNT);
            assert!(
                (spot.power() / integral - 1.0).abs() < 1e-3,
                "{} and {integral}",
                spot.power()
            );
        }
    }

    #[test]
    fn a_point_at_the_receiver_gives_nothing() {
        let point = Point { position: Vec3::ONE, intensity: Rgb::WHITE };
        assert_eq!(point.sample(Vec3::ONE), None);
        let sample = point.sample(Vec3::new(1.0, 1.0, -1.0)).unwrap();
        assert_eq!(
            (sample.direction, sample.distance, sample.radiance),
            (Vec3::Z, 2.0, Rgb::splat(0.25))
        );
    }

    #[test]
    fn directional_light_comes_from_where_it_does_not_go() {
        let sample = Directional::new(Vec3::new(0.0, -2.0, 0.0), Rgb::WHITE).sample();
        assert_eq!((sample.direction, sample.distance), (Vec3::Y, f32::INFINITY));
        assert!(Directional::new(Vec3::ZERO, Rgb::WHITE).sample().radiance.is_black());
    }
}
