//! Non-local means of the features (METHODS 9.3): noise of depth of field and motion leaves them before they guide.
//!
//! For each offset δ in an 11×11 window, the squared difference of a pixel and its partner at δ, in units of their
//! variances, is averaged over a patch of 7×7; `e^−` of it, averaged over 5×5, weighs the partner. Means and variances
//! are filtered alike (Rousselle, Knaus and Zwicker 2012, section 5, with the constants of Kalantari, Bako and Sen
//! 2015). The averages are over the pixels whose partner exists.

use std::ops::Range;

use ndarray::s;
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

/// Side of the square of pixels that a tile computes with: a multiple of all vector widths, small enough for its buffers
/// (37 kB each) to stay in the second cache.
const SIDE: usize = 96;
/// Pixels around a tile that its averages need.
const HALO: usize = PATCH + SMOOTHING;
/// Side of a tile.
const TILE: usize = SIDE - 2 * HALO;

/// Added to the variances, so that equal pixels of no variance are equal.
const EPSILON: f32 = 1e-10;

/// A number for each column of a tile and its halo.
type Row = [f32; SIDE];

/// Filters the mean and the variance of a feature.
pub(super) fn prefilter(feature: &Feature) -> Feature {
    let (channels, height, width) = feature.mean.dim();
    let planes = Padded::new(&feature.mean, &feature.variance);
    let corners: Vec<(usize, usize)> = (0..height)
        .step_by(TILE)
        .flat_map(|y| (0..width).step_by(TILE).map(move |x| (y, x)))
        .collect();
    let tiles: Vec<Sums> =
        corners.par_iter().map(|&corner| vectorise(Tile { planes: &planes, corner })).collect();

    let mut result = feature.clone();
    for ((top, left), sums) in corners.into_iter().zip(tiles) {
        let (rows, columns) = (top..(top + TILE).min(height), left..(left + TILE).min(width));
        for (row, y) in rows.enumerate() {
            let weight = &sums.weight[row][HALO..];
            for (plane, values) in sums.values.iter().enumerate() {
                let image = if plane < channels { &mut result.mean } else { &mut result.variance };
                let pixels = image.slice_mut(s![plane % channels, y, columns.clone()]);
                for ((pixel, value), weight) in
                    pixels.into_iter().zip(&values[row][HALO..]).zip(weight)
                {
                    *pixel = value / weight;
                }
            }
        }
    }
    result
}

/// The channels of the mean, then those of the variance, with room on all sides for the halo and the partners of the
/// outermost tiles.
struct Padded {
    channels: usize,
    height: usize,
    width: usize,
    stride: usize,
    planes: Vec<Vec<f32>>,
}

impl Padded {
    fn new(mean: &Image, variance: &Image) -> Self {
        const BEFORE: usize = HALO + WINDOW;
        let (channels, height, width) = mean.dim();
        let stride = width + SIDE + 2 * WINDOW;
        let planes = mean.outer_iter().chain(variance.outer_iter()).map(|plane| {
            let mut values = vec![0.0; (height + SIDE + 2 * WINDOW) * stride];
            for (y, row) in plane.outer_iter().enumerate() {
                let start = (y + BEFORE) * stride + BEFORE;
                values[start..start + width]
                    .iter_mut()
                    .zip(row)
                    .for_each(|(value, &pixel)| *value = pixel);
            }
            values
        });
        Self { channels, height, width, stride, planes: planes.collect() }
    }
}

/// Weights, and weighted values of each plane, for the rows of a tile.
struct Sums {
    weight: Vec<Row>,
    values: Vec<Vec<Row>>,
}

/// The tile whose first pixel is `corner`, row and column.
struct Tile<'a> {
    planes: &'a Padded,
    corner: (usize, usize),
}

/// An offset and what it means for a tile.
struct Offset {
    dy: isize,
    dx: isize,
    /// Rows and columns whose partner is in the picture.
    rows: Range<usize>,
    columns: Range<usize>,
    /// 1 in those columns of the tile, 0 elsewhere.
    inside: Row,
    /// One over the number of those columns in a patch, and in the window that smooths.
    patch: Row,
    smoothing: Row,
}

impl Kernel for Tile<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run(self) -> Sums {
        let zeros = || vec![[0.0; SIDE]; TILE];
        let mut sums = Sums {
            weight: zeros(),
            values: (0..2 * self.planes.channels).map(|_| zeros()).collect(),
        };
        let mut buffers = [(); 2].map(|()| vec![[0.0; SIDE]; SIDE]);
        let reach = WINDOW as isize;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let offset = self.offset(dy, dx);
                if !offset.rows.is_empty() && !offset.columns.is_empty() {
                    self.weigh(&mut buffers, &offset);
                    self.add(&mut sums, &buffers[1], &offset);
                }
            }
        }
        sums
    }
}

impl Tile<'_> {
    #[inline(always)]
    fn offset(&self, dy: isize, dx: isize) -> Offset {
        let (rows, columns) = (shifted(dy, self.planes.height), shifted(dx, self.planes.width));
        let (_, left) = self.corner;
        let mut offset = Offset {
            dy,
            dx,
            rows,
            columns,
            inside: [0.0; SIDE],
            patch: [0.0; SIDE],
            smoothing: [0.0; SIDE],
        };
        for local in 0..SIDE {
            // Columns left of the picture have no number.
            let Some(x) = (left + local).checked_sub(HALO).filter(|x| offset.columns.contains(x))
            else {
                continue;
            };
            offset.inside[local] = 1.0;
            offset.patch[local] = inverse_count(&offset.columns, x, PATCH);
            offset.smoothing[local] = inverse_count(&offset.columns, x, SMOOTHING);
        }
        offset
    }

    /// Row of the picture that a row of the buffers is, if its partner is in the picture too.
    #[inline(always)]
    fn row_of(&self, local: usize, offset: &Offset) -> Option<usize> {
        (self.corner.0 + local).checked_sub(HALO).filter(|y| offset.rows.contains(y))
    }

    /// Sums of the smoothed weights over the columns of a window, into the second buffer.
    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        reason = "one index for all arrays is the form that vectorises"
    )]
    fn weigh(&self, [distances, weights]: &mut [Vec<Row>; 2], offset: &Offset) {
        for (local, sums) in distances.iter_mut().enumerate() {
            *sums = match self.row_of(local, offset) {
                Some(_) if self.planes.channels == 3 => {
                    sum_columns::<PATCH>(&self.distance::<3>(local, offset))
                }
                Some(_) => sum_columns::<PATCH>(&self.distance::<1>(local, offset)),
                None => [0.0; SIDE],
            };
        }
        for local in PATCH..SIDE - PATCH {
            weights[local] = match self.row_of(local, offset) {
                Some(y) => {
                    let mut weight = sum_rows::<PATCH>(distances, local);
                    let count = inverse_count(&offset.rows, y, PATCH);
                    for column in 0..SIDE {
                        let distance = weight[column] * (count * offset.patch[column]);
                        weight[column] =
                            if offset.inside[column] != 0.0 { exp_negative(distance) } else { 0.0 };
                    }
                    sum_columns::<SMOOTHING>(&weight)
                }
                None => [0.0; SIDE],
            };
        }
    }

    /// Squared differences in units of the variance, mean over the channels; 0 where there is no partner.
    #[inline(always)]
    fn distance<const CHANNELS: usize>(&self, local: usize, offset: &Offset) -> Row {
        let mean: [_; CHANNELS] = std::array::from_fn(|channel| self.pixels(channel, local));
        let variance: [_; CHANNELS] =
            std::array::from_fn(|channel| self.pixels(CHANNELS + channel, local));
        let partner_mean: [_; CHANNELS] =
            std::array::from_fn(|channel| self.partners(channel, local, offset));
        let partner_variance: [_; CHANNELS] =
            std::array::from_fn(|channel| self.partners(CHANNELS + channel, local, offset));
        let mut distance = [0.0; SIDE];
        for column in 0..SIDE {
            let mut sum = 0.0;
            for channel in 0..CHANNELS {
                let difference = partner_mean[channel][column] - mean[channel][column];
                let variance =
                    EPSILON + (partner_variance[channel][column] + variance[channel][column]);
                sum += difference * difference / variance;
            }
            distance[column] =
                if offset.inside[column] != 0.0 { sum * (1.0 / CHANNELS as f32) } else { 0.0 };
        }
        distance
    }

    /// Adds the partners to the sums of the tile.
    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        reason = "one index for all arrays is the form that vectorises"
    )]
    fn add(&self, sums: &mut Sums, weights: &[Row], offset: &Offset) {
        for local in HALO..SIDE - HALO {
            let Some(y) = self.row_of(local, offset) else { continue };
            let count = inverse_count(&offset.rows, y, SMOOTHING);
            let mut weight = sum_rows::<SMOOTHING>(weights, local);
            for column in 0..SIDE {
                weight[column] *= count * offset.smoothing[column];
            }
            let row = local - HALO;
            for (sum, weight) in sums.weight[row].iter_mut().zip(&weight) {
                *sum += weight;
            }
            for (plane, sums) in sums.values.iter_mut().enumerate() {
                let partners = self.partners(plane, local, offset);
                let sums = &mut sums[row];
                for column in 0..SIDE {
                    sums[column] += weight[column] * partners[column];
                }
            }
        }
    }

    /// A row of the tile and its halo.
    #[inline(always)]
    fn pixels(&self, plane: usize, local: usize) -> &Row {
        let start = (self.corner.0 + local + WINDOW) * self.planes.stride + self.corner.1 + WINDOW;
        first(&self.planes.planes[plane][start..])
    }

    /// The partners of [`Tile::pixels`].
    #[inline(always)]
    fn partners(&self, plane: usize, local: usize, offset: &Offset) -> &Row {
        let start = (self.corner.0 + local + WINDOW) * self.planes.stride + self.corner.1 + WINDOW;
        let shift = offset.dy * self.planes.stride as isize + offset.dx;
        first(&self.planes.planes[plane][start.wrapping_add_signed(shift)..])
    }
}

#[inline(always)]
fn first(values: &[f32]) -> &Row {
    values.first_chunk().expect("the planes are padded")
}

/// Indices `i` in `0..length` whose `i + offset` is in it too.
#[inline(always)]
fn shifted(offset: isize, length: usize) -> Range<usize> {
    offset.min(0).unsigned_abs()..length.saturating_sub(offset.max(0).unsigned_abs())
}

/// One over the number of indices of `valid` within `radius` of `centre`, which is one of them.
#[inline(always)]
fn inverse_count(valid: &Range<usize>, centre: usize, radius: usize) -> f32 {
    1.0 / ((centre + radius + 1).min(valid.end) - centre.saturating_sub(radius).max(valid.start))
        as f32
}

/// Sums over `R` columns to both sides, those beyond the row left out.
#[inline(always)]
fn sum_columns<const R: usize>(row: &Row) -> Row {
    // Room on both sides makes the loop as long as the row, a whole number of vectors.
    let mut padded = [0.0; SIDE + 2 * PATCH];
    padded[R..R + SIDE].copy_from_slice(row);
    let mut sums = *first(&padded);
    // Tap by tap: all taps of a column at once are not turned into vectors.
    for tap in 1..=2 * R {
        for column in 0..SIDE {
            sums[column] += padded[column + tap];
        }
    }
    sums
}

/// Sums over `R` rows to both sides.
#[inline(always)]
fn sum_rows<const R: usize>(rows: &[Row], local: usize) -> Row {
    let mut sums = rows[local - R];
    for other in &rows[local - R + 1..=local + R] {
        for column in 0..SIDE {
            sums[column] += other[column];
        }
    }
    sums
}
