//! Kernels of a pyramid of five levels: every pixel of the result is a convex combination of pixels of the input, near
//! and far.
//!
//! Level `l` has 2^−l of the resolution, sizes rounded up. With the signal `s_0 = s`:
//!
//! ```text
//! s_{l+1}(P) = Σ_{p in the 2×2 cell of P} softmax(z_down(p)) s_l(p)
//! o_4(p)     = Σ_{5×5} k s_4
//! o_l(p)     = Σ_{5×5 around p} k s_l + Σ_{3×3 around ⌊p/2⌋} k' o_{l+1}      one softmax over all 34 logits
//! ```
//!
//! The result is `o_0`. (A partition of unity among the levels, so that it cannot overshoot as the multi-scale
//! reconstruction of Vogels et al. 2018 can; EVIDENCE 6.)

use std::ops::Range;

use rayon::prelude::*;

use super::head::{Features, Head};
use super::softmax::{BLOCK, Bordered, Tap, combine};
use super::tile::Grid;
use crate::exp::exp_negative;

/// Levels of the pyramid.
pub(super) const LEVELS: usize = 5;

/// Taps on a pixel's own level: row-major, dy from −2 to 2, then dx.
const FINE: usize = 5;

/// Taps on the next coarser level, around `⌊p/2⌋`, row-major.
const COARSE: usize = 3;

/// The channel with the logit of a pixel's weight in the next coarser level.
pub(super) const DOWN: usize = FINE * FINE + COARSE * COARSE;

/// Logits of the finest level for each pixel of half the resolution, at which the network works: output `4 c + 2 dy + dx`
/// of the half-sized pixel `P` is logit `c` of pixel `2 P + (dx, dy)`. They are a 1×1 convolution (`head`) of what the
/// network gives.
pub const FINEST_OUTPUTS: usize = 4 * (DOWN + 1);

/// What the network gives for the coarser levels: channels, and the binary logarithm of how much smaller than the picture
/// they are.
pub const OUTPUTS: [(usize, usize); LEVELS - 1] =
    [(DOWN + 1, 1), (DOWN + 1, 2), (DOWN + 1, 3), (FINE * FINE, 4)];

/// How tiles are cut. The network halves the picture and pools three times, hence the multiple of 16.
///
/// What a pixel depends on: the kernels reach 64 pixels, the last of them on level 4 (`⌊p/2⌋ − 1` four times, then two
/// of its pixels, each of 16), where they need the weights of the way down; those logits see another 92 pixels: two 3×3
/// convolutions at 1/2, 1/4, 1/8 and 1/16 and back, `2·(2+4+8+16+8+4+2) + 4 = 92` with what pooling adds. 156 in all.
///
/// A pixel of a tile takes 550 bytes with 64 features (onnxruntime's, its input and output, the signals): 0.9 GB at most.
/// Tiles of one megapixel instead would take 20 % more time at 2048×2048, where more is read twice.
pub(super) const GRID: Grid = Grid { multiple: 16, overlap: 160, most_pixels: 3 << 19 };

/// Filters the `C` channels of `signal`, `[height, C, width]`, by what the network gives for a picture of the size
/// `padded`: features at half the resolution, `[inputs, padded / 2]`, the logits of the coarser levels as in [`OUTPUTS`], and
/// weight, `[140, inputs]`, and bias, `[140]`, of the convolution that makes logits of the features. Returns the shape of
/// the signal, of which only the rows and columns `core` are computed.
pub fn apply<const C: usize>(
    outputs: &[&[f32]],
    padded: [usize; 2],
    size: [usize; 2],
    core: &[Range<usize>; 2],
    signal: &[f32],
) -> Vec<f32> {
    let planes = |values, halvings: usize| Planes {
        values,
        height: padded[0] >> halvings,
        width: padded[1] >> halvings,
    };
    let level = |level: usize| planes(outputs[level], OUTPUTS[level - 1].1);
    let finest = Finest {
        half: planes(outputs[0], 1),
        head: Head::new(outputs[LEVELS], outputs[LEVELS + 1]),
    };
    let columns = columns::<C>(signal, size);
    let mut images = vec![down(size, &columns, &finest)];
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
    filter_finest(size, core, &columns, &coarse, &finest)
}

/// Logits of a level, or features.
#[derive(Clone, Copy)]
struct Planes<'a> {
    values: &'a [f32],
    height: usize,
    width: usize,
}

impl<'a> Planes<'a> {
    /// One channel from the beginning of a row on.
    fn row(&self, channel: usize, y: usize) -> &'a [f32] {
        &self.values[(channel * self.height + y) * self.width..]
    }
}

/// What the logits of the finest level are made of.
struct Finest<'a> {
    half: Planes<'a>,
    head: Head,
}

impl Finest<'_> {
    /// Features of the half-sized pixels of a row.
    fn features(&self, y: usize, columns: &Range<usize>, out: &mut Features) {
        let inputs = self.head.inputs;
        out.take(inputs, (0..inputs).map(|input| &self.half.row(input, y)[columns.clone()]));
    }
}

/// Where a level has the logits of the way down.
trait Down: Sync {
    /// Writes those of row `y` of the coarser level, of `width` pixels: of its four pixels below, `2 dy + dx`, `[4, stride]`.
    /// `features` is memory.
    fn weights(&self, y: usize, width: usize, features: &mut Features, out: &mut [f32]);
}

impl Down for Finest<'_> {
    fn weights(&self, y: usize, width: usize, features: &mut Features, out: &mut [f32]) {
        self.features(y, &(0..width), features);
        self.head.down(features, out);
    }
}

impl Down for Planes<'_> {
    fn weights(&self, y: usize, width: usize, _: &mut Features, out: &mut [f32]) {
        let stride = out.len() / 4;
        for (pixel, out) in out.chunks_mut(stride).enumerate() {
            let logits = self.row(DOWN, 2 * y + pixel / 2)[pixel % 2..].iter().step_by(2);
            out[..width].iter_mut().zip(logits).for_each(|(out, logit)| *out = *logit);
        }
    }
}

/// Pixels of a level, two columns of which are one of the next.
trait Pairs<const C: usize>: Sync {
    /// Every second pixel of a channel in row `y`, from column `dx` on: the slice and its step.
    fn values(&self, channel: usize, y: usize, dx: usize) -> (&[f32], usize);
}

/// The even and the odd columns of the finest level apart, as its logits are.
impl<const C: usize> Pairs<C> for [Bordered<C>; 2] {
    fn values(&self, channel: usize, y: usize, dx: usize) -> (&[f32], usize) {
        (self[dx].row(channel, y), 1)
    }
}

impl<const C: usize> Pairs<C> for Bordered<C> {
    fn values(&self, channel: usize, y: usize, dx: usize) -> (&[f32], usize) {
        (self.row(channel, y).get(dx..).unwrap_or_default(), 2)
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
fn down<const C: usize>(
    [height, width]: [usize; 2],
    fine: &impl Pairs<C>,
    logits: &impl Down,
) -> Bordered<C> {
    let size = [height.div_ceil(2), width.div_ceil(2)];
    let mut coarse = Bordered::new(size, FINE / 2, size[1]);
    let insides: [_; C] = std::array::from_fn(|channel| coarse.inside(channel));
    let stride = size[1].next_multiple_of(BLOCK);
    let memory = || (Features::default(), vec![0.0; 4 * stride]);
    coarse.rows_mut().enumerate().for_each_init(memory, |(features, weights), (row, out)| {
        logits.weights(row, size[1], features, weights);
        let cell = [(0, 0), (0, 1), (1, 0), (1, 1)];
        for (weights, (dy, dx)) in weights.chunks_mut(stride).zip(cell) {
            // Beyond the picture nothing weighs.
            let inside = if 2 * row + dy < height { (width + 1 - dx) / 2 } else { 0 };
            weights[inside..].fill(f32::NEG_INFINITY);
        }
        let mut rows = weights.chunks_mut(stride).map(|weights| &mut weights[..size[1]]);
        let [a, b, c, d] = std::array::from_fn(|_| rows.next().expect("four rows"));
        for (((a, b), c), d) in a.iter_mut().zip(b).zip(c).zip(d) {
            let largest = a.max(*b).max(c.max(*d));
            let four = [*a, *b, *c, *d].map(|logit| exp_negative(largest - logit));
            let scale = four.iter().sum::<f32>().recip();
            [*a, *b, *c, *d] = four.map(|weight| weight * scale);
        }
        for (weights, (dy, dx)) in weights.chunks(stride).zip(cell) {
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

/// Memory of a thread that filters rows of the finest level.
#[derive(Default)]
struct Rows {
    features: Features,
    logits: Vec<f32>,
    half: Vec<f32>,
}

/// Filters the rows and columns `core` of the finest level, of that size, whose even and odd columns are apart; `[height, C,
/// width]`, the rest 0.
fn filter_finest<const C: usize>(
    [height, width]: [usize; 2],
    [rows, columns]: &[Range<usize>; 2],
    fine: &[Bordered<C>; 2],
    coarse: &Bordered<C>,
    finest: &Finest<'_>,
) -> Vec<f32> {
    let barriers = [fine[0].barrier(), fine[1].barrier()];
    let coarse_barrier = coarse.barrier();
    let cells = columns.start / 2..columns.end.div_ceil(2);
    let mut result = vec![0.0; height * C * width];
    // Two rows at a time have the same features.
    let out = result.par_chunks_mut(2 * C * width).enumerate();
    let out = out.skip(rows.start / 2).take(rows.end.div_ceil(2) - rows.start / 2);
    out.for_each_init(Rows::default, |Rows { features, logits, half }, (row, out)| {
        finest.features(row, &cells, features);
        let stride = features.stride();
        let pair = (2 * row..).zip(out.chunks_mut(C * width)).filter(|(y, _)| rows.contains(y));
        for (y, out) in pair {
            // The pixels of even columns, then those of odd ones.
            for phase in 0..2 {
                let pairs = (columns.start + 1 - phase) / 2..(columns.end + 1 - phase) / 2;
                if pairs.is_empty() {
                    continue;
                }
                let start = pairs.start;
                let logits = finest.head.logits(features, 2 * (y % 2) + phase, logits);
                let row_of = |logit: usize| &logits[logit * stride..][start - cells.start..];
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
        }
    });
    result
}

/// Filters a coarser level by its own taps and, where there is one, by those on the result of the next; `[height, C,
/// width]`.
fn filter<const C: usize>(
    fine: &Bordered<C>,
    coarse: Option<&Bordered<C>>,
    logits: &Planes<'_>,
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
