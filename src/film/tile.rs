//! Square parts of a film, each filled by one worker at a time.

use super::{Counts, Sums, values};
use crate::integrator::PathSample;
use serde::{Deserialize, Serialize};

/// Pixels along the side of a tile: small enough that the last tiles of a pass keep all threads busy, large enough that
/// neighbouring rays share the cache.
const SIDE: u32 = 16;

/// The samples of a square of pixels.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Tile {
    /// First column and row within the crop window, columns, rows.
    area: [u32; 4],
    /// First column and row of the crop window in the whole film.
    crop_start: [u32; 2],
    pub(super) counts: Vec<Counts>,
    /// Row by row, the sums of each pixel's kept numbers.
    pub(super) sums: Vec<Sums>,
}

/// The tiles that cover a crop window, row by row.
pub fn tiles(crop: [u32; 4], numbers: usize) -> Vec<Tile> {
    let [x0, y0, width, height] = crop;
    let mut tiles = Vec::new();
    for y in (0..height).step_by(SIDE as usize) {
        for x in (0..width).step_by(SIDE as usize) {
            let area = [x, y, SIDE.min(width - x), SIDE.min(height - y)];
            let pixels = (area[2] * area[3]) as usize;
            tiles.push(Tile {
                area,
                crop_start: [x0, y0],
                counts: vec![Counts::default(); pixels],
                sums: vec![Sums::default(); pixels * numbers],
            });
        }
    }
    tiles
}

impl Tile {
    /// How many pixels.
    pub fn len(&self) -> usize {
        self.counts.len()
    }

    /// Are there none?
    pub fn is_empty(&self) -> bool {
        self.counts.is_empty()
    }

    /// Column and row of each pixel within the crop window, in the order of the sums.
    pub fn pixels(&self) -> impl Iterator<Item = [u32; 2]> + use<> {
        let [x0, y0, width, height] = self.area;
        (y0..y0 + height).flat_map(move |y| (x0..x0 + width).map(move |x| [x, y]))
    }

    /// Column and row of each pixel in the whole film.
    pub fn film_pixels(&self) -> impl Iterator<Item = [u32; 2]> + use<> {
        let [x0, y0] = self.crop_start;
        self.pixels().map(move |[x, y]| [x + x0, y + y0])
    }

    /// Adds the samples of the same tile of another film.
    pub(super) fn merge(&mut self, other: &Self) {
        for (counts, more) in self.counts.iter_mut().zip(&other.counts) {
            counts.half[0] += more.half[0];
            counts.half[1] += more.half[1];
            counts.invalid += more.invalid;
        }
        for (sums, more) in self.sums.iter_mut().zip(&other.sums) {
            sums.half[0] += more.half[0];
            sums.half[1] += more.half[1];
            sums.squares += more.squares;
        }
    }

    /// Adds one sample to the pixel of that index; `half` is 0 or 1. A sample with anything non-finite in it is counted
    /// as invalid and dropped whole.
    pub(crate) fn add(&mut self, pixel: usize, half: usize, sample: &PathSample, kept: &[usize]) {
        let counts = &mut self.counts[pixel];
        if !sample.is_finite() {
            counts.invalid += 1;
            return;
        }
        counts.half[half] += 1;
        let values = values(sample);
        let sums = &mut self.sums[pixel * kept.len()..][..kept.len()];
        for (sum, &number) in sums.iter_mut().zip(kept) {
            let value = f64::from(values[number]);
            sum.half[half] += value;
            sum.squares += value * value;
        }
    }
}
