//! Patterns: fields of numbers in `[0, 1]` over a square that tiles, from which textures are made.

mod lettering;

use super::noise::Noise;
use super::random::Random;
use std::f64::consts::TAU;

/// A square of numbers in `[0, 1]`, row by row from the top; it tiles.
#[derive(Clone, Debug)]
pub(super) struct Field {
    /// Numbers across and down.
    pub(super) size: usize,
    /// `size²` of them.
    pub(super) values: Vec<f32>,
}

/// What a pattern looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Pattern {
    /// A checkerboard.
    Checks,
    /// Bands of random width, along an axis or the diagonal.
    Stripes,
    /// One coarse noise.
    Noise,
    /// Noise of many octaves.
    Fractal,
    /// Planks with rings.
    Wood,
    /// Veins.
    Marble,
    /// Square tiles with joints, each of its own shade.
    Tiles,
    /// Bricks in bond with joints.
    Bricks,
    /// Lines of strokes like writing.
    Lettering,
    /// Round spots.
    Spots,
    /// A smooth ramp up and down.
    Gradient,
    /// Cells around random points with thin borders.
    Cells,
    /// Threads over and under each other.
    Weave,
    /// Independent fine grain.
    Grain,
}

impl Pattern {
    /// All of them.
    pub(super) const ALL: [Self; 14] = [
        Self::Checks,
        Self::Stripes,
        Self::Noise,
        Self::Fractal,
        Self::Wood,
        Self::Marble,
        Self::Tiles,
        Self::Bricks,
        Self::Lettering,
        Self::Spots,
        Self::Gradient,
        Self::Cells,
        Self::Weave,
        Self::Grain,
    ];

    /// What a scene with it is tagged with.
    pub(super) fn tag(self) -> &'static str {
        match self {
            Self::Checks => "checks-texture",
            Self::Stripes => "stripes-texture",
            Self::Noise => "noise-texture",
            Self::Fractal => "fractal-texture",
            Self::Wood => "wood-texture",
            Self::Marble => "marble-texture",
            Self::Tiles => "tiles-texture",
            Self::Bricks => "bricks-texture",
            Self::Lettering => "text-texture",
            Self::Spots => "spots-texture",
            Self::Gradient => "gradient-texture",
            Self::Cells => "cells-texture",
            Self::Weave => "weave-texture",
            Self::Grain => "grain-texture",
        }
    }

    /// A random instance of the pattern, `size` numbers across.
    pub(super) fn field(self, size: usize, random: &mut Random) -> Field {
        match self {
            Self::Checks => checks(size, random),
            Self::Stripes => stripes(size, random),
            Self::Noise => noise(size, random, 1),
            Self::Fractal => {
                let octaves = random.integer(4, 6);
                noise(size, random, octaves)
            }
            Self::Wood => wood(size, random),
            Self::Marble => marble(size, random),
            Self::Tiles => tiles(size, random, 0.0),
            Self::Bricks => tiles(size, random, 0.5),
            Self::Lettering => lettering::field(size, random),
            Self::Spots => spots(size, random),
            Self::Gradient => gradient(size, random),
            Self::Cells => cells(size, random),
            Self::Weave => weave(size, random),
            Self::Grain => {
                let noise = Noise::new(random.seed());
                Field::of(size, |x, y| {
                    noise.cell((x * size as f64) as i32, (y * size as f64) as i32)
                })
            }
        }
    }
}

impl Field {
    /// Values at the centres of the cells; `value` takes coordinates in `[0, 1)²` and is clamped.
    fn of(size: usize, value: impl Fn(f64, f64) -> f64) -> Self {
        let place = |index: usize| (index as f64 + 0.5) / size as f64;
        let cells = (0..size * size).map(|i| value(place(i % size), place(i / size)));
        Self { size, values: cells.map(|value| value.clamp(0.0, 1.0) as f32).collect() }
    }

    /// The value at a cell, wrapped around.
    pub(super) fn at(&self, x: i64, y: i64) -> f32 {
        let size = self.size as i64;
        self.values[(y.rem_euclid(size) * size + x.rem_euclid(size)) as usize]
    }
}

fn checks(size: usize, random: &mut Random) -> Field {
    let count = random.pick(&[2, 2, 2, 4, 8]) as f64;
    Field::of(size, |x, y| ((x * count).floor() + (y * count).floor()).rem_euclid(2.0))
}

/// Bands with one to three harmonics of widths.
fn stripes(size: usize, random: &mut Random) -> Field {
    let count = random.pick(&[1.0, 2.0, 4.0, 8.0]);
    let slope = random.pick(&[0.0, 0.0, 0.0, 1.0]);
    let is_upright = random.chance(0.5);
    let share = random.uniform(0.15, 0.85);
    let second = if random.chance(0.5) { random.uniform(0.03, 0.2) } else { 0.0 };
    let soft = if random.chance(0.3) { 0.1 } else { 0.004 };
    Field::of(size, |x, y| {
        let (a, b) = if is_upright { (x, y) } else { (y, x) };
        let t = (a * count + b * count * slope).rem_euclid(1.0);
        let band = |centre: f64, width: f64| {
            let distance = (t - centre).abs().min(1.0 - (t - centre).abs());
            ((0.5 * width - distance) / (soft * count).min(0.4) + 0.5).clamp(0.0, 1.0)
        };
        band(0.5, share).max(0.5 * band(0.0, second))
    })
}

fn noise(size: usize, random: &mut Random, octaves: usize) -> Field {
    let noise = Noise::new(random.seed());
    let period = random.pick(&[2, 3, 4, 6, 8]);
    let (contrast, ridge) = (random.uniform(0.5, 1.6), random.chance(0.25));
    Field::of(size, |x, y| {
        let scale = f64::from(period);
        let value = noise.tiled_octaves(x * scale, y * scale, period, octaves);
        if ridge { 1.0 - contrast * value.abs() * 1.5 } else { 0.5 + 0.5 * contrast * value }
    })
}

/// Planks along x, each with its own rings and shade.
fn wood(size: usize, random: &mut Random) -> Field {
    let noise = Noise::new(random.seed());
    let planks = random.pick(&[1, 2, 4, 6]);
    let (rings, wobble) = (random.uniform(3.0, 12.0), random.uniform(0.5, 2.5));
    let (joint, shade) = (random.uniform(0.0, 0.03), random.uniform(0.0, 0.5));
    Field::of(size, |x, y| {
        let across = y * f64::from(planks);
        let plank = across.floor();
        let (inside, shift) = (across - plank, noise.cell(plank as i32, 7));
        let bend = noise.tiled_octaves(x * 2.0 + shift * 8.0, y * 8.0, 8, 3);
        let ring = (inside * rings * 0.5 + wobble * bend + shift * 5.0).rem_euclid(1.0);
        let grain = noise.tiled(x * 8.0, y * 128.0, 128);
        let tone = 0.35 + 0.35 * ring * ring + 0.12 * grain + shade * (shift - 0.5);
        if planks > 1 && (inside < joint || inside > 1.0 - joint) { 0.0 } else { tone }
    })
}

fn marble(size: usize, random: &mut Random) -> Field {
    let noise = Noise::new(random.seed());
    let (veins, warp) = (random.integer(1, 4) as f64, random.uniform(0.3, 1.0));
    let sharpness = random.uniform(0.3, 3.0);
    Field::of(size, |x, y| {
        let bend = noise.tiled_octaves(x * 3.0, y * 3.0, 3, 5);
        let wave = (TAU * (veins * x + y + warp * bend)).sin();
        (0.5 + 0.5 * wave).powf(sharpness) * (0.85 + 0.3 * bend)
    })
}

/// Tiles with joints at 0 and shades above; `bond` shifts every other row by this share of a tile.
fn tiles(size: usize, random: &mut Random, bond: f64) -> Field {
    let noise = Noise::new(random.seed());
    let rows = random.pick(&[2, 4, 8]);
    let columns = if bond > 0.0 { (rows / 2).max(1) } else { rows };
    // At least a texel wide: thinner joints would be there or not by chance.
    let joint = random.uniform(0.02, 0.09).max(1.2 * f64::from(rows) / size as f64);
    let (shades, stain) = (random.uniform(0.0, 0.6), random.uniform(0.0, 0.3));
    Field::of(size, |x, y| {
        let row = (y * f64::from(rows)).floor();
        let shifted = x * f64::from(columns) + if row as i32 % 2 == 1 { bond } else { 0.0 };
        let column = shifted.floor();
        let (u, v) = (shifted - column, y * f64::from(rows) - row);
        // Joints are as wide along as across.
        let joint_u = joint * f64::from(columns) / f64::from(rows);
        if u < joint_u || u > 1.0 - joint_u || v < joint || v > 1.0 - joint {
            return 0.0;
        }
        let shade = noise.cell((column as i32).rem_euclid(columns), row as i32 + 31);
        1.0 - shades * shade - stain * (0.5 + 0.5 * noise.tiled_octaves(x * 6.0, y * 6.0, 6, 4))
    })
}

/// Spots on a jittered lattice; some are missing.
fn spots(size: usize, random: &mut Random) -> Field {
    let noise = Noise::new(random.seed());
    let count = random.pick(&[2, 3, 5, 8]);
    let (jitter, largest) = (random.uniform(0.0, 0.45), random.uniform(0.2, 0.5));
    let (spread, missing) = (random.uniform(0.0, 0.7), random.uniform(0.0, 0.4));
    Field::of(size, |x, y| {
        let (u, v) = (x * f64::from(count), y * f64::from(count));
        let mut value: f64 = 0.0;
        for (dx, dy) in (0..9).map(|i| (i % 3 - 1, i / 3 - 1)) {
            let (column, row) = (u.floor() as i32 + dx, v.floor() as i32 + dy);
            let (a, b) = (column.rem_euclid(count), row.rem_euclid(count));
            let of = |k: i32| noise.cell(a + 64 * k, b);
            if of(3) < missing {
                continue;
            }
            let centre = |index: i32, k| f64::from(index) + 0.5 + jitter * (2.0 * of(k) - 1.0);
            let distance = (u - centre(column, 0)).hypot(v - centre(row, 1));
            let radius = largest * (1.0 - spread * of(2));
            value = value.max(((radius - distance) * 12.0 + 0.5).clamp(0.0, 1.0));
        }
        value
    })
}

fn gradient(size: usize, random: &mut Random) -> Field {
    let is_radial = random.chance(0.4);
    let power = random.log_uniform(0.5, 2.0);
    let is_upright = random.chance(0.5);
    Field::of(size, |x, y| {
        let value = if is_radial {
            1.0 - 2.0 * (x - 0.5).hypot(y - 0.5)
        } else {
            1.0 - (2.0 * if is_upright { x } else { y } - 1.0).abs()
        };
        value.max(0.0).powf(power)
    })
}

/// Distances to jittered points (Worley 1996, "A Cellular Texture Basis Function"): shades with borders, or distances.
fn cells(size: usize, random: &mut Random) -> Field {
    let noise = Noise::new(random.seed());
    let count = random.pick(&[3, 5, 8, 12]);
    let (border, is_smooth) = (random.uniform(0.02, 0.15), random.chance(0.4));
    Field::of(size, |x, y| {
        let (u, v) = (x * f64::from(count), y * f64::from(count));
        let (mut first, mut second, mut shade) = (f64::INFINITY, f64::INFINITY, 0.0);
        for (dx, dy) in (0..25).map(|i| (i % 5 - 2, i / 5 - 2)) {
            let (column, row) = (u.floor() as i32 + dx, v.floor() as i32 + dy);
            let (a, b) = (column.rem_euclid(count), row.rem_euclid(count));
            let of = |k: i32| noise.cell(a + 64 * k, b);
            let distance = (u - f64::from(column) - of(0)).hypot(v - f64::from(row) - of(1));
            if distance < first {
                (second, first, shade) = (first, distance, of(2));
            } else {
                second = second.min(distance);
            }
        }
        if is_smooth {
            first
        } else if second - first < border {
            0.0
        } else {
            0.25 + 0.75 * shade
        }
    })
}

fn weave(size: usize, random: &mut Random) -> Field {
    let count = random.pick(&[8.0, 16.0, 32.0]);
    let twill = random.pick(&[1.0, 1.0, 2.0]);
    let contrast = random.uniform(0.2, 0.8);
    Field::of(size, |x, y| {
        let (u, v) = (x * count, y * count);
        let is_warp = ((u.floor() + v.floor()) / twill).floor().rem_euclid(2.0) < 1.0;
        let thread = |t: f64| 1.0 - (2.0 * (t - t.floor()) - 1.0).powi(2);
        let height = if is_warp { thread(u) } else { thread(v) };
        (1.0 - contrast) * f64::from(u8::from(is_warp)) + contrast * height
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pattern_varies_and_stays_in_its_range() {
        for pattern in Pattern::ALL {
            for seed in 0..4 {
                let field = pattern.field(64, &mut Random::new(seed, 0));
                assert_eq!(field.values.len(), 64 * 64);
                assert!(field.values.iter().all(|value| (0.0..=1.0).contains(value)));
                let mean = field.values.iter().sum::<f32>() / 4096.0;
                let variance =
                    field.values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / 4096.0;
                assert!(variance > 2e-4, "{pattern:?} of seed {seed}: variance {variance}");
            }
        }
    }
}
