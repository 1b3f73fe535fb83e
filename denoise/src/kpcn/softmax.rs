//! Convex combinations: `o = Σ_k w_k v_k` with `w = softmax(z)`, the one operation of every predicted kernel.
//!
//! A row of pixels at a time, some side by side; for each, the largest logit first, so that no exponential overflows
//! (METHODS 10.3). A tap outside the picture has a barrier of −∞, hence no weight.

use crate::exp::exp_negative;
use crate::simd::{Kernel, vectorise};

/// Pixels computed side by side: a vector of AVX-512. The loops over them have a fixed length and vectorise.
pub(super) const BLOCK: usize = 16;

/// A number for each pixel of a block.
pub(super) type Row = [f32; BLOCK];

/// One tap of all pixels of a row: its logits and the values that it sees in `C` channels. All slices begin at the first
/// pixel; barrier and values reach [`BLOCK`] − 1 beyond the last.
#[derive(Clone, Copy)]
pub(super) struct Tap<'a, const C: usize> {
    /// Logits, of which the first `width` are the row's.
    pub(super) logits: &'a [f32],
    /// 0 where the tap lies in the picture, −∞ where it does not.
    pub(super) barrier: &'a [f32],
    /// What it sees, channel by channel; finite everywhere.
    pub(super) values: [&'a [f32]; C],
}

/// Combines a row of `width` pixels into `out`, `[C, width]`. At least one tap of each pixel is within the picture.
pub(super) fn combine<const C: usize>(taps: &[Tap<'_, C>], width: usize, out: &mut [f32]) {
    vectorise(Combine { taps, width, out });
}

/// [`combine`] as a processor without wide vectors computes it.
#[cfg(test)]
pub(super) fn combine_portably<const C: usize>(taps: &[Tap<'_, C>], width: usize, out: &mut [f32]) {
    Combine { taps, width, out }.run();
}

struct Combine<'a, const C: usize> {
    taps: &'a [Tap<'a, C>],
    width: usize,
    out: &'a mut [f32],
}

impl<const C: usize> Kernel for Combine<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { taps, width, out } = self;
        let mut logits = vec![[0.0; BLOCK]; taps.len()];
        for x in (0..width).step_by(BLOCK) {
            // Logits of the taps lie far apart: they are fetched once.
            let mut largest = [f32::NEG_INFINITY; BLOCK];
            for (tap, logits) in taps.iter().zip(&mut logits) {
                *logits = tap.logits(x);
                largest = each(
                    largest,
                    *logits,
                    |largest, logit| {
                        if logit > largest { logit } else { largest }
                    },
                );
            }
            let mut sum = [0.0; BLOCK];
            let mut values = [[0.0; BLOCK]; C];
            for (tap, logits) in taps.iter().zip(&logits) {
                let weights =
                    each(largest, *logits, |largest, logit| exp_negative(largest - logit));
                sum = each(sum, weights, |sum, weight| sum + weight);
                for (total, seen) in values.iter_mut().zip(tap.values) {
                    let products = each(weights, *block(seen, x), |weight, value| weight * value);
                    *total = each(*total, products, |total, product| total + product);
                }
            }
            let pixels = x..(x + BLOCK).min(width);
            for (channel, totals) in values.iter().enumerate() {
                let out = &mut out[channel * width..][pixels.clone()];
                for ((out, total), sum) in out.iter_mut().zip(totals).zip(&sum) {
                    *out = total / sum;
                }
            }
        }
    }
}

impl<const C: usize> Tap<'_, C> {
    /// Logits of a block, those outside the picture −∞.
    #[inline(always)]
    fn logits(&self, x: usize) -> Row {
        let rest = &self.logits[x..];
        let logits = rest.first_chunk().copied().unwrap_or_else(|| {
            let mut row = [0.0; BLOCK];
            row[..rest.len()].copy_from_slice(rest);
            row
        });
        each(logits, *block(self.barrier, x), |logit, barrier| logit + barrier)
    }
}

/// Combines the numbers of two blocks, one by one.
#[inline(always)]
pub(super) fn each(a: Row, b: Row, combine: impl Fn(f32, f32) -> f32) -> Row {
    let mut result = a;
    for (result, b) in result.iter_mut().zip(b) {
        *result = combine(*result, b);
    }
    result
}

/// The block of a row from column `x`.
#[inline(always)]
fn block(row: &[f32], x: usize) -> &Row {
    row[x..].first_chunk().expect("rows reach a block beyond their last pixel")
}

/// Images of `C` channels with room around each row for taps that leave the picture: `[height, C, stride]`.
pub(super) struct Bordered<const C: usize> {
    values: Vec<f32>,
    stride: usize,
    /// Rows.
    pub(super) height: usize,
    /// Pixels of a row, without the border.
    pub(super) width: usize,
    border: usize,
}

impl<const C: usize> Bordered<C> {
    /// Space for an image with `border` pixels to the left and to the right, all 0. Taps may see it from rows of up to
    /// `widest` pixels.
    pub(super) fn new([height, width]: [usize; 2], border: usize, widest: usize) -> Self {
        let stride = widest.max(width) + BLOCK - 1 + 2 * border;
        Self { values: vec![0.0; height * C * stride], stride, height, width, border }
    }

    /// Rows of all channels, for writing: `C` times `stride` numbers each, of which [`Self::inside`] are the picture.
    pub(super) fn rows_mut(
        &mut self,
    ) -> impl rayon::iter::IndexedParallelIterator<Item = &mut [f32]> {
        use rayon::slice::ParallelSliceMut;
        self.values.par_chunks_mut(C * self.stride)
    }

    /// The pixels of a channel in a row of [`Self::rows_mut`].
    pub(super) fn inside(&self, channel: usize) -> std::ops::Range<usize> {
        let start = channel * self.stride + self.border;
        start..start + self.width
    }

    /// The picture's part of a row.
    pub(super) fn row(&self, channel: usize, y: usize) -> &[f32] {
        &self.values[(y * C + channel) * self.stride + self.border..][..self.width]
    }

    /// What a tap sees that lies `offset − border` pixels to the right: row `y` from there.
    pub(super) fn seen(&self, y: usize, offset: usize) -> [&[f32]; C] {
        std::array::from_fn(|channel| {
            let start = (y * C + channel) * self.stride;
            &self.values[start + offset..start + self.stride]
        })
    }

    /// The barrier of a row: 0 in the picture, −∞ in the border.
    pub(super) fn barrier(&self) -> Vec<f32> {
        let mut barrier = vec![f32::NEG_INFINITY; self.stride];
        barrier[self.border..][..self.width].fill(0.0);
        barrier
    }
}
