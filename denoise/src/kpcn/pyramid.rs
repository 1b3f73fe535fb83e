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

use std::ops::Range;

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

/// What the network gives for each level: channels, and the binary logarithm of how much smaller than the picture they
/// are. The finest level comes by space to depth, as the network works at half the resolution: channel `4 c + 2 dy + dx`
/// of the half-sized pixel `P` is logit `c` of pixel `2 P + (dx, dy)`.
pub const OUTPUTS: [(usize, usize); LEVELS] =
    [(4 * (DOWN + 1), 1), (DOWN + 1, 1), (DOWN + 1, 2), (FINE * FINE, 3)];

/// How tiles are cut. The network halves the picture and pools three times, hence the multiple of 16.
///
/// What a pixel depends on: the kernels reach 32 pixels, the last of them on level 3 (`⌊p/2⌋ − 1` three times, then two
/// of its pixels, each of 8), where they need the weights of the way down; those logits see another 92 pixels: two 3×3
/// convolutions at 1/2, 1/4, 1/8 and 1/16 and back, `2·(2+4+8+16+8+4+2) + 4 = 92` with what pooling adds. 124 in all.
pub(super) const GRID: Grid = Grid { multiple: 16, overlap: 128, most_pixels: 1 << 20 };

/// Filters the `C` channels of `signal`, `[height, C, width]`, by the network's [`OUTPUTS`] for a picture of the size
/// `padded`. Returns the shape of the signal, of which only the rows and columns `core` are computed.
pub fn apply<const C: usize>(
    logits: &[&[f32]],
    padded: [usize; 2],
    size: [usize; 2],
    core: &[Range<usize>; 2],
    signal: &[f32],
) -> Vec<f32> {
    let level = |level: usize| Logits {
        values: logits[level],
        height: padded[0] >> OUTPUTS[level].1,
        width: padded[1] >> OUTPUTS[level].1,
    };
    let columns = columns::<C>(signal, size);
    let mut images = vec![down(size, &columns, &level(0))];
    for l in 1..LEVELS - 1 {
        let fine = &images[l - 1];
        images.push(down([fine.height, fine.width], fine, &level(l)));
    }
    let mut result = filter(&images[LEVELS - 2], None, &level(LEVELS - 1));
    for l in (1..LEVELS - 1).rev() {
        let coarse = doubled(&result, [images[l].height, images[l].width]);
        result = filter(&images[l - 1], Some(&coarse), &level(l));
    }
    let coarse = bordered(&result, [images[0].height, images[0].width]);
    filter_finest(size, core, &columns, &coarse, &level(0))
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

/// Pixels of a level, two columns of which are one of the next.
trait Pairs<const C: usize>: Sync {
    /// Every second pixel of a channel in row `y`, from column `dx` on: the slice and its step.
    fn values(&self, channel: usize, y: usize, dx: usize) -> (&[f32], usize);

    /// The same of the logits of the way down, `y` and `x` of the coarser level.
    fn weights<'a>(logits: &Logits<'a>, y: usize, dy: usize, dx: usize) -> (&'a [f32], usize);
}

/// The even and the odd columns of the finest level apart, as its logits are.
impl<const C: usize> Pairs<C> for [Bordered<C>; 2] {
    fn values(&self, channel: usize, y: usize, dx: usize) -> (&[f32], usize) {
        (self[dx].row(channel, y), 1)
    }

    fn weights<'a>(logits: &Logits<'a>, y: usize, dy: usize, dx: usize) -> (&'a [f32], usize) {
        (logits.row(4 * DOWN + 2 * dy + dx, y), 1)
    }
}

impl<const C: usize> Pairs<C> for Bordered<C> {
    fn values(&self, channel: usize, y: usize, dx: usize) -> (&[f32], usize) {
        (self.row(channel, y).get(dx..).unwrap_or_default(), 2)
    }

    fn weights<'a>(logits: &Logits<'a>, y: usize, dy: usize, dx: usize) -> (&'a [f32], usize) {
        (&logits.row(DOWN, 2 * y + dy)[dx..], 2)
    }
}

/// The even and the odd columns of the signal, each with a border for its taps.
fn columns<const C: usize>(signal: &[f32], [height, width]: [usize; 2]) -> [Bordered<C>; 2] {
    std::array::from_fn(|dx| {
        let mut image =
            Bordered::new([height, (width + 1 - dx) / 2], COARSE / 2, width.div_ceil(2));
        let insides: [_; C] = std::array::from_fn(|channel| image.inside(channel));
        image.rows_mut().zip(signal.par_chunks(C * width)).for_each(|(row, source)| {
            for (inside, source) in insides.iter().zip(source.chunks(width)) {
                let source = source.iter().skip(dx).step_by(2);
                row[inside.clone()].iter_mut().zip(source).for_each(|(out, value)| *out = *value);
            }
        });
        image
    })
}

/// An image, `[height, C, width]`, with a border for the taps of the finest level.
fn bordered<const C: usize>(image: &[f32], size: [usize; 2]) -> Bordered<C> {
    let mut result = Bordered::new(size, COARSE / 2, size[1]);
    let insides: [_; C] = std::array::from_fn(|channel| result.inside(channel));
    result.rows_mut().zip(image.par_chunks(C * size[1])).for_each(|(row, source)| {
        for (inside, source) in insides.iter().zip(source.chunks(size[1])) {
            row[inside.clone()].copy_from_slice(source);
        }
    });
    result
}

/// An image, `[height, C, width]`, with every pixel twice in its row: the neighbours `⌊x/2⌋ + d` of all pixels `x` are
/// then one row, shifted by `2 d`.
fn doubled<const C: usize>(image: &[f32], size: [usize; 2]) -> Bordered<C> {
    let mut result = Bordered::new([size[0], 2 * size[1]], 2 * (COARSE / 2), 2 * size[1]);
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

/// The next coarser level of an image of that size: the mean of each 2×2 cell weighted by a softmax. Cells that stick out
/// of the picture use their pixels inside.
fn down<const C: usize, P: Pairs<C>>(
    [height, width]: [usize; 2],
    fine: &P,
    logits: &Logits<'_>,
) -> Bordered<C> {
    let size = [height.div_ceil(2), width.div_ceil(2)];
    let mut coarse = Bordered::new(size, FINE / 2, size[1]);
    let insides: [_; C] = std::array::from_fn(|channel| coarse.inside(channel));
    coarse.rows_mut().enumerate().for_each(|(row, out)| {
        let cell = [(0, 0), (0, 1), (1, 0), (1, 1)];
        // Beyond the picture the logits stay −∞.
        let mut weights = cell.map(|_| vec![f32::NEG_INFINITY; size[1]]);
        for (weights, (dy, dx)) in weights.iter_mut().zip(cell) {
            if 2 * row + dy < height {
                let (logits, step) = P::weights(logits, row, dy, dx);
                let inside = weights[..(width + 1 - dx) / 2].iter_mut();
                inside.zip(logits.iter().step_by(step)).for_each(|(out, logit)| *out = *logit);
            }
        }
        let [a, b, c, d] = &mut weights;
        for (((a, b), c), d) in a.iter_mut().zip(b).zip(c).zip(d) {
            let largest = a.max(*b).max(c.max(*d));
            let four = [*a, *b, *c, *d].map(|logit| exp_negative(largest - logit));
            let scale = four.iter().sum::<f32>().recip();
            [*a, *b, *c, *d] = four.map(|weight| weight * scale);
        }
        for (weights, (dy, dx)) in weights.iter().zip(cell) {
            if 2 * row + dy >= height {
                continue;
            }
            for (channel, inside) in insides.iter().enumerate() {
                let (values, step) = fine.values(channel, 2 * row + dy, dx);
                let values = weights.iter().zip(values.iter().step_by(step));
                let out = out[inside.clone()].iter_mut();
                out.zip(values).for_each(|(out, (weight, value))| *out += weight * value);
            }
        }
    });
    coarse
}

/// Filters the rows and columns `core` of the finest level, of that size, whose even and odd columns are apart; `[height, C,
/// width]`, the rest 0.
fn filter_finest<const C: usize>(
    [height, width]: [usize; 2],
    [rows, columns]: &[Range<usize>; 2],
    fine: &[Bordered<C>; 2],
    coarse: &Bordered<C>,
    logits: &Logits<'_>,
) -> Vec<f32> {
    let barriers = [fine[0].barrier(), fine[1].barrier()];
    let coarse_barrier = coarse.barrier();
    let mut result = vec![0.0; height * C * width];
    let out = result.par_chunks_mut(C * width).enumerate().skip(rows.start).take(rows.len());
    out.for_each_init(Vec::new, |half, (y, out)| {
        // The pixels of even columns, then those of odd ones.
        for phase in 0..2 {
            let pairs = (columns.start + 1 - phase) / 2..(columns.end + 1 - phase) / 2;
            if pairs.is_empty() {
                continue;
            }
            let start = pairs.start;
            let row_of =
                |logit: usize| &logits.row(4 * logit + 2 * (y % 2) + phase, y / 2)[start..];
            let mut taps = Vec::with_capacity(DOWN);
            for index in 0..FINE * FINE {
                // From 2 X + phase − 2 on, so that the columns seen are alternately even and odd.
                let (dy, column) = (index / FINE, index % FINE + phase);
                if let Some(row) = neighbour(y, dy, FINE / 2, height) {
                    taps.push(Tap {
                        logits: row_of(index),
                        barrier: &barriers[column % 2][start + column / 2..],
                        values: fine[column % 2].seen(row, start + column / 2),
                    });
                }
            }
            for index in 0..COARSE * COARSE {
                let (dy, dx) = (index / COARSE, index % COARSE);
                if let Some(row) = neighbour(y / 2, dy, COARSE / 2, coarse.height) {
                    taps.push(Tap {
                        logits: row_of(FINE * FINE + index),
                        barrier: &coarse_barrier[start + dx..],
                        values: coarse.seen(row, start + dx),
                    });
                }
            }
            half.resize(C * pairs.len(), 0.0);
            combine(&taps, pairs.len(), half);
            for (out, half) in out.chunks_mut(width).zip(half.chunks(pairs.len())) {
                let out = out.iter_mut().skip(2 * start + phase).step_by(2);
                out.zip(half).for_each(|(out, value)| *out = *value);
            }
        }
    });
    result
}

/// Filters a coarser level by its own taps and, where there is one, by those on the result of the next; `[height, C,
/// width]`.
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
