//! Gradient noise (Perlin 2002, "Improving Noise", with hashed gradients): in the plane with a period, so that textures
//! tile, and in space for displacements.

use glam::{DVec2, DVec3};
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// Gradients in the plane: sixteen are enough to hide the lattice.
static DIRECTIONS: LazyLock<[DVec2; 16]> =
    LazyLock::new(|| std::array::from_fn(|k| DVec2::from_angle(TAU * k as f64 / 16.0)));

/// Noise with its own hash.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    seed: u32,
}

impl Noise {
    /// The noise of this seed.
    pub(super) fn new(seed: u32) -> Self {
        Self { seed }
    }

    /// 32 bits for a lattice point (the finaliser of `MurmurHash3` over a combination of the coordinates).
    fn hash(self, x: i32, y: i32, z: i32) -> u32 {
        let mut bits = self.seed
            ^ (x as u32).wrapping_mul(0x8da6_b343)
            ^ (y as u32).wrapping_mul(0xd816_3841)
            ^ (z as u32).wrapping_mul(0xcb1a_b31f);
        bits = (bits ^ (bits >> 16)).wrapping_mul(0x85eb_ca6b);
        bits = (bits ^ (bits >> 13)).wrapping_mul(0xc2b2_ae35);
        bits ^ (bits >> 16)
    }

    /// A number in `[0, 1)` for a lattice point.
    pub(super) fn cell(self, x: i32, y: i32) -> f64 {
        f64::from(self.hash(x, y, 0)) / 4_294_967_296.0
    }

    /// Noise in about `[-1, 1]` at a point of the plane, repeating every `period` units.
    pub(super) fn tiled(self, x: f64, y: f64, period: i32) -> f64 {
        let (column, row) = (x.floor(), y.floor());
        let offset = DVec2::new(x - column, y - row);
        let directions = &*DIRECTIONS;
        let corner = |dx: i32, dy: i32| {
            let wrap = |index: f64, step: i32| (index as i32 + step).rem_euclid(period);
            let bits = self.hash(wrap(column, dx), wrap(row, dy), 0);
            let step = DVec2::new(f64::from(dx), f64::from(dy));
            directions[(bits >> 28) as usize].dot(offset - step)
        };
        let (u, v) = (fade(offset.x), fade(offset.y));
        let along = |dy| lerp(u, corner(0, dy), corner(1, dy));
        1.5 * lerp(v, along(0), along(1))
    }

    /// Octaves of [`Noise::tiled`], each twice as fine and half as strong; in about `[-1, 1]`.
    pub(super) fn tiled_octaves(self, x: f64, y: f64, period: i32, octaves: usize) -> f64 {
        let mut sum = 0.0;
        let (mut scale, mut weight, mut total) = (1, 1.0, 0.0);
        for _ in 0..octaves {
            let factor = f64::from(scale);
            sum += weight * self.tiled(x * factor, y * factor, period * scale);
            total += weight;
            scale *= 2;
            weight *= 0.5;
        }
        sum / total * 1.3
    }

    /// Noise in about `[-1, 1]` at a point of space.
    pub(super) fn space(self, p: DVec3) -> f64 {
        let base = p.floor();
        let f = p - base;
        let corner = |dx: i32, dy: i32, dz: i32| {
            let bits = self.hash(base.x as i32 + dx, base.y as i32 + dy, base.z as i32 + dz);
            let offset = f - DVec3::new(f64::from(dx), f64::from(dy), f64::from(dz));
            // The twelve edges of a cube, four of them twice.
            let (u, v) = match bits >> 30 {
                0 => (offset.x, offset.y),
                1 => (offset.x, offset.z),
                2 => (offset.y, offset.z),
                _ => (offset.x, offset.y),
            };
            (if bits & 1 == 0 { u } else { -u }) + (if bits & 2 == 0 { v } else { -v })
        };
        let (u, v, w) = (fade(f.x), fade(f.y), fade(f.z));
        let along = |dy, dz| lerp(u, corner(0, dy, dz), corner(1, dy, dz));
        let across = |dz| lerp(v, along(0, dz), along(1, dz));
        lerp(w, across(0), across(1))
    }

    /// Octaves of [`Noise::space`]; in about `[-1, 1]`.
    pub(super) fn space_octaves(self, p: DVec3, octaves: usize) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for octave in 0..octaves {
            let scale = f64::from(1u32 << octave);
            sum += self.space(p * scale) / scale;
            total += 1.0 / scale;
        }
        sum / total
    }
}

/// `6t⁵ − 15t⁴ + 10t³`: first and second derivatives vanish at lattice points.
fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

fn lerp(t: f64, a: f64, b: f64) -> f64 {
    a + t * (b - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_vanishes_at_lattice_points_repeats_and_keeps_its_range() {
        let noise = Noise::new(5);
        for i in 0..200 {
            let (x, y) = (f64::from(i) * 0.37, f64::from(i) * 0.73);
            let value = noise.tiled_octaves(x, y, 4, 4);
            assert!((value - noise.tiled_octaves(x + 4.0, y - 8.0, 4, 4)).abs() < 1e-9);
            assert!(value.abs() < 1.6, "{value}");
            let p = DVec3::new(x, y, x - y);
            assert!(noise.space(p).abs() <= 1.1 && noise.space(p.floor()).abs() < 1e-12);
        }
        assert_ne!(Noise::new(6).tiled(0.4, 0.6, 4), noise.tiled(0.4, 0.6, 4));
    }
}
