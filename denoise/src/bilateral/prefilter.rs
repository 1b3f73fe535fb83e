//! Non-local means of the features (METHODS 9.3): noise of depth of field and motion leaves them before they guide.
//!
//! For each offset δ in an 11×11 window, the squared difference of a pixel and its partner at δ, in units of their
//! variances, is averaged over a patch of 7×7; `e^−` of it, averaged over 5×5, weighs the partner. Means and variances
//! are filtered alike (Rousselle, Knaus and Zwicker 2012, section 5, with the constants of Kalantari, Bako and Sen
//! 2015). The averages are over the pixels whose partner exists.

use std::ops::Range;

use rayon::prelude::*;

use super::features::Feature;
use crate::exp::exp_negative;
use crate::layers::Image;
use crate::simd::{Kernel, vectorise};

/// Partners are sought within this distance, in pixels, on each axis.
const WINDOW: usize = 5;
/// Radius of the patch that is compared.
const PATCH: usize = 3;
/// Radius of the average of the weights.
const SMOOTHING: usize = 2;
/// Side of a tile: its buffers (74² numbers, 22 kB each) stay in the innermost caches.
const TILE: usize = 64;

const HALO: usize = PATCH + SMOOTHING;
const SIDE: usize = TILE + 2 * HALO;

/// Added to the variances, so that equal pixels of no variance are equal.
const EPSILON: f32 = 1e-10;

/// Filters the mean and the variance of a feature.
pub(super) fn prefilter(feature: &Feature) -> Feature {
    let (channels, height, width) = feature.mean.dim();
    let planes =
        Planes { feature, mean: standard(&feature.mean), variance: standard(&feature.variance) };
    let corners: Vec<(usize, usize)> = (0..height)
        .step_by(TILE)
        .flat_map(|y| (0..width).step_by(TILE).map(move |x| (y, x)))
        .collect();
    let tiles: Vec<Tile> = corners
        .into_par_iter()
        .map(|corner| vectorise(TileKernel { planes: &planes, corner }))
        .collect();

    let mut result = feature.clone();
    for tile in tiles {
        for channel in 0..channels {
            for (local_y, y) in tile.rows.clone().enumerate() {
                for (local_x, x) in tile.columns.clone().enumerate() {
                    let at = local_y * TILE + local_x;
                    result.mean[[channel, y, x]] = tile.sums[channel][at] / tile.weight[at];
                    result.variance[[channel, y, x]] =
                        tile.sums[channels + channel][at] / tile.weight[at];
                }
            }
        }
    }
    result
}

fn standard(image: &Image) -> Vec<f32> {
    image.iter().copied().collect()
}

struct Planes<'a> {
    feature: &'a Feature,
    mean: Vec<f32>,
    variance: Vec<f32>,
}

/// Weighted sums of a tile: the channels of the mean, then those of the variance, `TILE` numbers a row.
struct Tile {
    rows: Range<usize>,
    columns: Range<usize>,
    weight: Vec<f32>,
    sums: Vec<Vec<f32>>,
}

struct TileKernel<'a> {
    planes: &'a Planes<'a>,
    corner: (usize, usize),
}

impl Kernel for TileKernel<'_> {
    type Output = Tile;

    #[inline(always)]
    fn run(self) -> Tile {
        let (channels, height, width) = self.planes.feature.mean.dim();
        let (top, left) = self.corner;
        let mut tile = Tile {
            rows: top..(top + TILE).min(height),
            columns: left..(left + TILE).min(width),
            weight: vec![0.0; TILE * TILE],
            sums: vec![vec![0.0; TILE * TILE]; 2 * channels],
        };
        let mut buffers = Buffers {
            distance: vec![0.0; SIDE * SIDE],
            rows: vec![0.0; SIDE * SIDE],
            columns: [0.0; SIDE],
        };
        let reach = WINDOW as isize;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                // The pixels that have a partner at (dx, dy).
                let valid = Area { rows: shifted(dy, height), columns: shifted(dx, width) };
                if !valid.rows.is_empty() && !valid.columns.is_empty() {
                    self.add_offset(&mut tile, &mut buffers, &valid, (dy, dx));
                }
            }
        }
        tile
    }
}

/// A rectangle of pixels.
struct Area {
    rows: Range<usize>,
    columns: Range<usize>,
}

impl Area {
    /// The part within `margin` of the tile.
    #[inline(always)]
    fn near(&self, tile: &Tile, margin: usize) -> Self {
        Self {
            rows: overlap(&self.rows, &tile.rows, margin),
            columns: overlap(&self.columns, &tile.columns, margin),
        }
    }
}

#[inline(always)]
fn overlap(valid: &Range<usize>, tile: &Range<usize>, margin: usize) -> Range<usize> {
    let start = valid.start.max(tile.start.saturating_sub(margin));
    start..valid.end.min(tile.end + margin).max(start)
}

/// Indices `i` in `0..length` whose `i + offset` is in it too.
#[inline(always)]
fn shifted(offset: isize, length: usize) -> Range<usize> {
    let start = (-offset).max(0) as usize;
    start..length.saturating_sub(offset.max(0) as usize)
}

/// Planes of `SIDE` numbers a row, whose first pixel is `HALO` above and left of the tile.
struct Buffers {
    distance: Vec<f32>,
    rows: Vec<f32>,
    /// What the columns of an area contribute to the size of a clipped window, inverse.
    columns: [f32; SIDE],
}

/// Fills `inverse` with one over the number of valid indices within `radius` of each index of `part`.
#[inline(always)]
fn inverse_counts<'a>(
    inverse: &'a mut [f32],
    valid: &Range<usize>,
    part: &Range<usize>,
    radius: usize,
) -> &'a [f32] {
    let inverse = &mut inverse[..part.len()];
    for (index, inverse) in part.clone().zip(&mut *inverse) {
        *inverse = 1.0 / overlap(valid, &(index..index + 1), radius).len() as f32;
    }
    inverse
}

impl TileKernel<'_> {
    #[inline(always)]
    fn add_offset(
        &self,
        tile: &mut Tile,
        buffers: &mut Buffers,
        valid: &Area,
        (dy, dx): (isize, isize),
    ) {
        let (channels, height, width) = self.planes.feature.mean.dim();
        let (mean, variance) = (&self.planes.mean, &self.planes.variance);
        let row = |plane: usize, y: usize, columns: &Range<usize>| {
            let start = (plane * height + y) * width;
            start + columns.start..start + columns.end
        };
        let partner = |range: &Range<usize>| {
            let shift = dy * width as isize + dx;
            range.start.wrapping_add_signed(shift)..range.end.wrapping_add_signed(shift)
        };
        let (top, left) = self.corner;
        let local = |y: usize, columns: &Range<usize>| {
            let start = (y + HALO - top) * SIDE + HALO - left;
            start + columns.start..start + columns.end
        };

        // Squared differences in units of the variance, wherever a patch of the tile may need them.
        let area = valid.near(tile, HALO);
        let scale = 1.0 / channels as f32;
        buffers.distance.fill(0.0);
        for y in area.rows.clone() {
            let distance = &mut buffers.distance[local(y, &area.columns)];
            for channel in 0..channels {
                let here = row(channel, y, &area.columns);
                let there = partner(&here);
                let means = mean[here.clone()].iter().zip(&mean[there.clone()]);
                let variances = variance[here].iter().zip(&variance[there]);
                for ((distance, (f, g)), (v, w)) in distance.iter_mut().zip(means).zip(variances) {
                    *distance += (g - f) * (g - f) / (EPSILON + w + v) * scale;
                }
            }
        }

        // Mean over the patch, then the weight; pixels without a partner weigh nothing.
        box_sum::<PATCH>(buffers);
        let area = valid.near(tile, SMOOTHING);
        let columns = inverse_counts(&mut buffers.columns, &valid.columns, &area.columns, PATCH);
        for y in area.rows.clone() {
            let row = 1.0 / overlap(&valid.rows, &(y..y + 1), PATCH).len() as f32;
            for (value, column) in buffers.distance[local(y, &area.columns)].iter_mut().zip(columns)
            {
                *value = exp_negative(*value * (row * column));
            }
        }
        keep(&mut buffers.distance, &area, self.corner);

        // Mean of the weights, then the sums.
        box_sum::<SMOOTHING>(buffers);
        let area = valid.near(tile, 0);
        let columns =
            inverse_counts(&mut buffers.columns, &valid.columns, &area.columns, SMOOTHING);
        for y in area.rows.clone() {
            let row_count = 1.0 / overlap(&valid.rows, &(y..y + 1), SMOOTHING).len() as f32;
            let weights = &mut buffers.distance[local(y, &area.columns)];
            weights
                .iter_mut()
                .zip(columns)
                .for_each(|(weight, column)| *weight *= row_count * column);
            let start = (y - top) * TILE + area.columns.start - left;
            let at = start..start + area.columns.len();
            tile.weight[at.clone()]
                .iter_mut()
                .zip(&*weights)
                .for_each(|(sum, weight)| *sum += weight);
            for channel in 0..channels {
                let there = partner(&row(channel, y, &area.columns));
                for (source, sums) in [(mean, channel), (variance, channels + channel)] {
                    let sums = tile.sums[sums][at.clone()].iter_mut();
                    for ((sum, weight), value) in sums.zip(&*weights).zip(&source[there.clone()]) {
                        *sum += weight * value;
                    }
                }
            }
        }
    }
}

/// Sets everything outside `area` to zero, so that it adds nothing to the next sums.
#[inline(always)]
fn keep(plane: &mut [f32], area: &Area, (top, left): (usize, usize)) {
    let local_rows = area.rows.start + HALO - top..area.rows.end + HALO - top;
    let local_columns = area.columns.start + HALO - left..area.columns.end + HALO - left;
    for (y, row) in plane.chunks_exact_mut(SIDE).enumerate() {
        if local_rows.contains(&y) {
            row[..local_columns.start].fill(0.0);
            row[local_columns.end..].fill(0.0);
        } else {
            row.fill(0.0);
        }
    }
}

/// Replaces `distance` by its sums over windows of radius `R`, except in the outermost `R` pixels of the buffer.
#[inline(always)]
fn box_sum<const R: usize>(buffers: &mut Buffers) {
    let Buffers { distance, rows, .. } = buffers;
    for (sums, row) in rows.chunks_exact_mut(SIDE).zip(distance.chunks_exact(SIDE)) {
        let sums = &mut sums[R..SIDE - R];
        sums.copy_from_slice(&row[..SIDE - 2 * R]);
        for tap in 1..=2 * R {
            sums.iter_mut().zip(&row[tap..]).for_each(|(sum, value)| *sum += value);
        }
    }
    for y in R..SIDE - R {
        let (sums, start) = (&mut distance[y * SIDE..(y + 1) * SIDE], (y - R) * SIDE);
        sums.copy_from_slice(&rows[start..start + SIDE]);
        for tap in 1..=2 * R {
            let start = start + tap * SIDE;
            sums.iter_mut().zip(&rows[start..start + SIDE]).for_each(|(sum, value)| *sum += value);
        }
    }
}
