//! What the mutations of the exchange are made of.

use crate::math::Frame;
use crate::sampler::Sampler;
use glam::{Vec2, Vec3};
use std::f64::consts::TAU;

/// Smallest jump of a direction, radians: a twentieth of a degree.
const SMALLEST_JUMP: f64 = 8.727e-4;

/// Largest jump, radians: five degrees, about the width of a lamp or a window; wider ones are for independent proposals.
const LARGEST_JUMP: f64 = 0.087_27;

/// Cumulative probabilities of the pixel, direction and both mutations; the rest are independent. Only the first and the third
/// take luminance from pixel to pixel, so in short chains the others do little but mix colours.
const MUTATIONS: [f32; 3] = [0.7, 0.8, 0.95];

/// Which part of a state is changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mutation {
    Pixel,
    Direction,
    Both,
    Independence,
}

/// A step of a chain, but for what depends on its state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Move {
    pub(super) kind: Mutation,
    /// Columns and rows to another pixel, in a square window without its middle.
    pub(super) offset: [i32; 2],
    /// Added to the number of the hit, modulo the number of hits.
    pub(super) hit: u32,
}

impl Move {
    /// A move of at most `window` columns and rows, among `hits` hits.
    pub(super) fn sample<S: Sampler>(window: u32, hits: u32, sampler: &mut S) -> Self {
        let choice = sampler.next_1d();
        let [pixel, direction, both] = MUTATIONS;
        let kind = if choice < pixel {
            Mutation::Pixel
        } else if choice < direction {
            Mutation::Direction
        } else if choice < both {
            Mutation::Both
        } else {
            Mutation::Independence
        };
        let side = 2 * window + 1;
        let place = index_below(side * side - 1, sampler.next_1d());
        let place = if place >= side * side / 2 { place + 1 } else { place };
        let offset = [place % side, place / side].map(|at| at as i32 - window as i32);
        Self { kind, offset, hit: index_below(hits, sampler.next_1d()) }
    }
}

/// Probability of accepting a move by `forward`, the new state's target times the reverse move's density, against the old
/// state's times the move's.
pub(super) fn accept(forward: f64, backward: f64) -> f64 {
    let ratio = forward / backward;
    // NaN is refused.
    if ratio >= 1.0 { 1.0 } else { ratio.max(0.0) }
}

fn index_below(count: u32, u: f32) -> u32 {
    ((f64::from(u) * f64::from(count)) as u32).min(count - 1)
}

/// A direction at a log-uniform angle from `around`.
pub(super) fn jump(around: Vec3, u: Vec2) -> Vec3 {
    let angle = LARGEST_JUMP * (-f64::from(u.x) * (LARGEST_JUMP / SMALLEST_JUMP).ln()).exp();
    let (sine, cosine) = angle.sin_cos();
    let turned = Vec2::from_angle((TAU * f64::from(u.y)) as f32) * sine as f32;
    Frame::from_normal(around).to_world(turned.extend(cosine as f32)).normalize()
}

/// Density of [`jump`] from `around` to `direction`, per steradian: `1 / (θ ln(θ₂/θ₁) 2π sin θ)`; 0 outside its range.
/// The angle is that of the directions as they were rounded, so that a move and its reverse agree on the range.
pub(super) fn jump_pdf(around: Vec3, direction: Vec3) -> f64 {
    let (a, b) = (around.as_dvec3(), direction.as_dvec3());
    let sine = a.cross(b).length();
    let angle = sine.atan2(a.dot(b));
    if (SMALLEST_JUMP..LARGEST_JUMP).contains(&angle) {
        1.0 / (angle * (LARGEST_JUMP / SMALLEST_JUMP).ln() * TAU * sine)
    } else {
        0.0
    }
}
