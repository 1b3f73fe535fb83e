//! The cross-bilateral filter itself (METHODS 9.6).
//!
//! For pixel i and its neighbours j in a window clipped at the borders,
//!
//! ```text
//! d = λ₀ ‖p_j − p_i‖² + λ_c Σ (c_j − c_i)² / (1e-10 + σ²_j + σ²_i) + Σ_k λ_k Σ (f_j − f_i)² / max(1e-4, σ²_f,i)
//! ĉ_i = Σ e^−d c_j / Σ e^−d
//! ```
//!
//! (Kalantari, Bako and Sen 2015, equations 10 to 12; of the feature variances only the centre's counts).

use rayon::prelude::*;

use super::block::Block;
use super::image_of_rows;
use super::stack::Stack;
use crate::layers::Image;
use crate::simd::{Kernel, vectorise};

/// Largest radius of the window.
pub(super) const LARGEST_RADIUS: usize = 27;

/// Offsets that are computed together.
pub(super) const TOGETHER: usize = 4;

/// Offsets in a row of the window, with some that weigh nothing to make them a multiple of [`TOGETHER`].
pub(super) const TAPS: usize = (2 * LARGEST_RADIUS + 1).next_multiple_of(TOGETHER);

/// Pixels in a block. More waste work where the width of the picture is no multiple of it, less leave the vectors empty.
pub(super) const BLOCK: usize = 32;

/// A number for each pixel of a block.
pub(super) type Row = [f32; BLOCK];

/// The numbers that the filter computes with.
pub(super) struct Settings<'a> {
    pub(super) lambda: Multipliers<'a>,
    pub(super) colour: f32,
    pub(super) radius: usize,
}

/// λ₀ to λ₅.
#[derive(Clone, Copy)]
pub(super) enum Multipliers<'a> {
    Constant([f32; 6]),
    /// `[6, height, width]`.
    PerPixel(&'a Image),
}

impl Stack {
    /// Filters the colour, `[3, height, width]`; `done` is called after each row.
    pub(super) fn filter(&self, settings: &Settings<'_>, done: &(dyn Fn() + Sync)) -> Image {
        let mut rows = vec![0.0; self.height * 3 * self.width];
        rows.par_chunks_mut(3 * self.width).enumerate().for_each(|(y, out)| {
            vectorise(RowKernel { stack: self, settings, y, out });
            done();
        });
        image_of_rows(rows, (3, self.height, self.width))
    }

    /// [`Stack::filter`] as a processor without wide vectors computes it.
    #[cfg(test)]
    pub(super) fn filter_portably(&self, settings: &Settings<'_>) -> Image {
        let mut rows = vec![0.0; self.height * 3 * self.width];
        rows.chunks_mut(3 * self.width).enumerate().for_each(|(y, out)| {
            RowKernel { stack: self, settings, y, out }.run();
        });
        image_of_rows(rows, (3, self.height, self.width))
    }
}

/// One row of the picture.
struct RowKernel<'a> {
    stack: &'a Stack,
    settings: &'a Settings<'a>,
    y: usize,
    out: &'a mut [f32],
}

impl Kernel for RowKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { stack, settings, y, out } = self;
        for x in (0..stack.width).step_by(BLOCK) {
            let colours = Block::new(stack, settings, y, x).filter();
            for (channel, colour) in colours.iter().enumerate() {
                let pixels = x..(x + BLOCK).min(stack.width);
                let bounds = |side: usize| &stack.bounds[3 * side + channel][y * stack.width..];
                let (low, high) = (&bounds(0)[pixels.clone()], &bounds(1)[pixels.clone()]);
                let out = &mut out[channel * stack.width..][pixels];
                for (((out, colour), &low), &high) in out.iter_mut().zip(colour).zip(low).zip(high)
                {
                    *out = colour.clamp(low, high);
                }
            }
        }
    }
}
