//! One kernel of `size`×`size` taps a pixel, as in Bako et al. 2017: `ĉ(p) = Σ_q softmax(z_p)_q c(q)`, the same weights
//! for all channels.

use rayon::prelude::*;

use super::pyramid::neighbour;
use super::softmax::{Bordered, Tap, combine};
use super::tile::Grid;

/// How tiles are cut. The paper's nine layers of 5×5 see 18 pixels, its 21×21 kernels another 10: 28 in all. A pixel has
/// 441 logits, hence the small tiles.
pub(super) const GRID: Grid = Grid { multiple: 1, overlap: 28, most_pixels: 256 * 256 };

/// Filters the `C` channels of `signal`, `[height, C, width]`, by `logits`, `[size², height, width]`, row-major in the
/// taps; returns the shape of the signal.
pub fn apply<const C: usize>(
    logits: &[f32],
    [height, width]: [usize; 2],
    size: usize,
    signal: &[f32],
) -> Vec<f32> {
    let radius = size / 2;
    let mut image = Bordered::<C>::new([height, width], radius, width);
    let insides: [_; C] = std::array::from_fn(|channel| image.inside(channel));
    image.rows_mut().zip(signal.par_chunks(C * width)).for_each(|(row, source)| {
        for (inside, source) in insides.iter().zip(source.chunks(width)) {
            row[inside.clone()].copy_from_slice(source);
        }
    });
    let barrier = image.barrier();
    let mut result = vec![0.0; height * C * width];
    result.par_chunks_mut(C * width).enumerate().for_each(|(y, out)| {
        let mut taps = Vec::with_capacity(size * size);
        for index in 0..size * size {
            let (dy, dx) = (index / size, index % size);
            if let Some(row) = neighbour(y, dy, radius, height) {
                taps.push(Tap {
                    logits: &logits[(index * height + y) * width..],
                    barrier: &barrier[dx..],
                    values: image.seen(row, dx),
                });
            }
        }
        combine(&taps, width, out);
    });
    result
}
