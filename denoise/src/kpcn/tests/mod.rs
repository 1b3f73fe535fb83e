//! Proof tests of METHODS 13.8 and the extremes of METHODS 14 that concern the networks.

mod fixtures;
mod kernels;
mod models;
mod whole;

use std::ops::Range;

use super::tile::Tile;

/// Repeatable numbers in `[0, 1)`.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / 16_777_216.0
    }

    fn uniforms(&mut self, count: usize, range: Range<f32>) -> Vec<f32> {
        (0..count).map(|_| range.start + (range.end - range.start) * self.uniform()).collect()
    }
}

/// A whole picture as one tile.
fn whole(width: usize, height: usize, multiple: usize) -> Tile {
    Tile {
        rows: 0..height,
        columns: 0..width,
        core_rows: 0..height,
        core_columns: 0..width,
        padded: [height.next_multiple_of(multiple), width.next_multiple_of(multiple)],
    }
}
