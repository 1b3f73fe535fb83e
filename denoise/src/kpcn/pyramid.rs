//! Kernels of a pyramid of four levels: every pixel of the result is a convex combination of pixels of the input, near
//! and far.
//!
//! Level `l` has 2^−l of the resolution, sizes rounded up. With the signal `s_0 = s`:
//!
//! ```text
//! s_{l+1}(P) = Σ_{p in the 2×2 cell of P} softmax(z_down(p)) s_l(p)
//! o_3(p)     = Σ_{5×5} k s_3
//! o_l(p)     = Σ_{5×5 around p} k s_l + Σ_{3×3 around ⌊p/2⌋} k' o_{l+1}      one softmax over all 34 logits
//! ```
//!
//! The result is `o_0`. (A partition of unity among the levels, so that it cannot overshoot as the multi-scale
//! reconstruction of Vogels et al. 2018 can; EVIDENCE 6.)

use rayon::prelude::*;

use super::softmax::{Bordered, Tap, combine};
use super::tile::Grid;
use crate::exp::exp_negative;

/// Levels of the pyramid.
pub(super) const LEVELS: usize = 4;

/// Taps on a pixel's own level: row-major, dy from −2 to 2, then dx.
const FINE: usize = 5;

/// Taps on the next coarser level, around `⌊p/2⌋`, row-major.
const COARSE: usize = 3;

/// The channel with the logit of a pixel's weight in the next coarser level.
const DOWN: usize = FINE * FINE + COARSE * COARSE;

/// Logits of a pixel on each level.
pub(super) const LEVEL_CHANNELS: [usize; LEVELS] = [DOWN + 1, DOWN + 1, DOWN + 1, FINE * FINE];

/// How tiles are cut. The network halves the picture and pools three times, hence the multiple of 16.
///
/// What a pixel depends on: the kernels reach 32 pixels, the last of them on level 3 (`⌊p/2⌋ − 1` three times, then two
/// of its pixels, each of 8), where they need the weights of the way down; those logits see another 92 pixels: two 3×3
/// convolutions at 1/2, 1/4, 1/8 and 1/16 and back, `2·(2+4+8+16+8+4+2) + 4 = 92` with what pooling adds. 124 in all.
pub(super) const GRID: Grid = Grid { multiple: 16, overlap: 128, most_pixels: 900_000 };

/// Filters the `C` channels of `signal`, `[height, C, width]`, by the logits of the four levels, and returns the same
/// shape. Level `l` of the logits is `[LEVEL_CHANNELS[l], padded height / 2^l, padded width / 2^l]`.
pub(super) fn apply<const C: usize>(
    logits: &[&[f32]],
    padded: [usize; 2],
    size: [usize; 2],
    signal: &[f32],
) -> Vec<f32> {
    let level = |level: usize| Logits {
        values: logits[level],
        height: padded[0] >> level,
        width: padded[1] >> level,
    };
    let mut images = vec![bordered::<C>(signal, size)];
    for l in 0..LEVELS - 1 {
        images.push(down(&images[l], &level(l)));
    }
    let mut result = filter(&images[LEVELS - 1], None, &level(LEVELS - 1));
    for l in (0..LEVELS - 1).rev() {
        let coarse = doubled::<C>(&result, [images[l + 1].height, images[l + 1].width]);
        result = filter(&images[l], Some(&coarse), &level(l));
    }
    result
}

/// The logits of a level.
#[derive(Clone, Copy)]
struct Logits<'a> {
    values: &'a [f32],
    height: usize,
    width: usize,
}

impl<'a> Logits<'a> {
    /// One channel from the beginning of a row on.
    fn row(&self, channel: usize, y: usize) -> &'a [f32] {
        &self.values[(channel * self.height + y) * self.width..]
    }
}

/// The signal with a border for the taps on its own level.
fn bordered<const C: usize>(signal: &[f32], size: [usize; 2]) -> Bordered<C> {
    let mut image = Bordered::new(size, FINE / 2);
    let insides: [_; C] = std::array::from_fn(|channel| image.inside(channel));
    image.rows_mut().zip(signal.par_chunks(C * size[1])).for_each(|(row, source)| {
        for (inside, source) in insides.iter().zip(source.chunks(size[1])) {
            row[inside.clone()].copy_from_slice(source);
        }
    });
    image
}

/// An image, `[height, C, width]`, with every pixel twice in its row: the neighbours `⌊x/2⌋ + d` of all pixels `x` are
/// then one row, shifted by `2 d`.
fn doubled<const C: usize>(image: &[f32], size: [usize; 2]) -> Bordered<C> {
    let mut result = Bordered::new([size[0], 2 * size[1]], 2 * (COARSE / 2));
    let insides: [_; C] = std::array::from_fn(|channel| result.inside(channel));
    result.rows_mut().zip(image.par_chunks(C * size[1])).for_each(|(row, source)| {
        for (inside, source) in insides.iter().zip(source.chunks(size[1])) {
            for (pair, value) in row[inside.clone()].chunks_mut(2).zip(source) {
                pair.fill(*value);
            }
        }
    });
    result
}

/// The next coarser level: the mean of each 2×2 cell weighted by a softmax. Cells that stick out of the picture use
/// their pixels inside.
fn down<const C: usize>(fine: &Bordered<C>, logits: &Logits<'_>) -> Bordered<C> {
    let size = [fine.height.div_ceil(2), fine.width.div_ceil(2)];
    let mut coarse = Bordered::new(size, FINE / 2);
    let insides: [_; C] = std::array::from_fn(|channel| coarse.inside(channel));
    coarse.rows_mut().enumerate().for_each(|(row, out)| {
        let rows = 2 * row..(2 * row + 2).min(fine.height);
        let mut weights = vec![0.0; 2 * size[1] * 2];
        // Beyond the picture the logits stay −∞.
        let mut cells = vec![f32::NEG_INFINITY; 2 * size[1] * 2];
        for (cells, y) in cells.chunks_mut(2 * size[1]).zip(rows.clone()) {
            cells[..fine.width].copy_from_slice(&logits.row(DOWN, y)[..fine.width]);
        }
        let (above, below) = cells.split_at(2 * size[1]);
        let (weights_above, weights_below) = weights.split_at_mut(2 * size[1]);
        let pairs = above.chunks_exact(2).zip(below.chunks_exact(2));
        let weight_pairs = weights_above.chunks_exact_mut(2).zip(weights_below.chunks_exact_mut(2));
        for ((above, below), (weights_above, weights_below)) in pairs.zip(weight_pairs) {
            let largest = above[0].max(above[1]).max(below[0].max(below[1]));
            let four = [above[0], above[1], below[0], below[1]].map(|z| exp_negative(largest - z));
            let scale = four.iter().sum::<f32>().recip();
            weights_above.copy_from_slice(&[four[0] * scale, four[1] * scale]);
            weights_below.copy_from_slice(&[four[2] * scale, four[3] * scale]);
        }
        for (y, weights) in rows.zip(weights.chunks(2 * size[1])) {
            for (channel, inside) in insides.iter().enumerate() {
                let values = fine.row(channel, y).chunks(2).zip(weights.chunks(2));
                for (out, (values, weights)) in out[inside.clone()].iter_mut().zip(values) {
                    for (value, weight) in values.iter().zip(weights) {
                        *out += weight * value;
                    }
                }
            }
        }
    });
    coarse
}

/// Filters a level by its own taps and, where there is one, by those on the coarser result; `[height, C, width]`.
fn filter<const C: usize>(
    fine: &Bordered<C>,
    coarse: Option<&Bordered<C>>,
    logits: &Logits<'_>,
) -> Vec<f32> {
    let fine_barrier = fine.barrier();
    let coarse_barrier = coarse.map(Bordered::barrier).unwrap_or_default();
    let mut result = vec![0.0; fine.height * C * fine.width];
    result.par_chunks_mut(C * fine.width).enumerate().for_each(|(y, out)| {
        let mut taps = Vec::with_capacity(DOWN);
        for index in 0..FINE * FINE {
            let (dy, dx) = (index / FINE, index % FINE);
            if let Some(row) = neighbour(y, dy, FINE / 2, fine.height) {
                taps.push(Tap {
                    logits: logits.row(index, y),
                    barrier: &fine_barrier[dx..],
                    values: fine.seen(row, dx),
                });
            }
        }
        for (coarse, index) in coarse.iter().flat_map(|c| (0..COARSE * COARSE).map(move |i| (c, i)))
        {
            let (dy, dx) = (index / COARSE, index % COARSE);
            if let Some(row) = neighbour(y / 2, dy, COARSE / 2, coarse.height) {
                taps.push(Tap {
                    logits: logits.row(FINE * FINE + index, y),
                    barrier: &coarse_barrier[2 * dx..],
                    values: coarse.seen(row, 2 * dx),
                });
            }
        }
        combine(&taps, fine.width, out);
    });
    result
}

/// The row `offset − radius` away from `y`, if the image has it.
pub(super) fn neighbour(y: usize, offset: usize, radius: usize, height: usize) -> Option<usize> {
    (y + offset).checked_sub(radius).filter(|&row| row < height)
}
