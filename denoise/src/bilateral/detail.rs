//! The noise of a feature before the prefilter, from its finest detail (METHODS 9.4, features 0 to 4).

use ndarray::ArrayView2;
use rayon::prelude::*;

use crate::layers::Image;
use crate::simd::{Kernel, vectorise};

/// Cells of the block of 8×8 pixels around a pixel.
const CELLS: usize = 16;

/// How far the block reaches to the left of (and above) its pixel, and to the right: pixels −4 to 3, and one more for the
/// details of odd columns.
const BEFORE: usize = 4;
const AFTER: usize = 4;

/// Median of the absolute values of a normal distribution, in standard deviations.
const NORMAL_MEDIAN: f32 = 0.6745;

/// Pixels that are sorted side by side.
const LANES: usize = 32;

/// A number for each of some pixels of a row.
type Lanes = [f32; LANES];

/// Standard deviation of the detail in each aligned 2×2 cell of a picture, `[channels, ⌈height / 2⌉, ⌈width / 2⌉]`.
///
/// A pixel's is the median absolute detail `|b + c − a − d| / 2` of the 16 cells `a b / c d` in the 8×8 pixels around it
/// (rows and columns −4 to 3, the picture mirrored at its borders), over 0.6745; a cell's is the mean of its pixels'.
pub(super) fn detail_deviation(image: &Image) -> Image {
    let (channels, height, width) = image.dim();
    let (cell_rows, cell_columns) = (height.div_ceil(2), width.div_ceil(2));
    let mut cells = vec![0.0; channels * cell_rows * cell_columns];
    cells.par_chunks_mut(cell_columns).enumerate().for_each(|(index, cells)| {
        let plane = image.index_axis(ndarray::Axis(0), index / cell_rows);
        vectorise(CellRow { plane, row: index % cell_rows, cells });
    });
    Image::from_shape_vec((channels, cell_rows, cell_columns), cells)
        .expect("a number for each cell")
}

/// One row of cells of a channel.
struct CellRow<'a> {
    plane: ArrayView2<'a, f32>,
    row: usize,
    cells: &'a mut [f32],
}

impl Kernel for CellRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { plane, row, cells } = self;
        let (height, width) = plane.dim();
        let padded = width.next_multiple_of(LANES) + BEFORE + AFTER;
        // The mirrored rows that the blocks of both rows of pixels reach, from 2 row − 4 on.
        let rows: [Vec<f32>; 2 * BEFORE + 1] = std::array::from_fn(|offset| {
            let y = mirrored((2 * row + offset) as isize - BEFORE as isize, height);
            let columns = 0..padded as isize;
            columns.map(|x| plane[[y, mirrored(x - BEFORE as isize, width)]]).collect()
        });
        let details: [Vec<f32>; 2 * BEFORE] = std::array::from_fn(|offset| {
            let (upper, lower) = (&rows[offset], &rows[offset + 1]);
            let mut details = vec![0.0; padded];
            for x in 0..padded - 1 {
                details[x] = 0.5 * ((upper[x + 1] + lower[x]) - (upper[x] + lower[x + 1])).abs();
            }
            details
        });
        cells.fill(0.0);
        let pixels = 2.min(height - 2 * row);
        for pixel in 0..pixels {
            for x in (0..width).step_by(LANES) {
                let mut sorted: [Lanes; CELLS] = std::array::from_fn(|cell| {
                    let row = &details[pixel + 2 * (cell / 4)];
                    *row[x + 2 * (cell % 4)..].first_chunk().expect("the rows are padded")
                });
                sort(&mut sorted);
                for column in x..(x + LANES).min(width) {
                    let median = 0.5 * sorted[7][column - x] + 0.5 * sorted[8][column - x];
                    let in_cell = pixels * 2.min(width - column / 2 * 2);
                    cells[column / 2] += median / (NORMAL_MEDIAN * in_cell as f32);
                }
            }
        }
    }
}

/// Index of a picture that is mirrored at its borders, the border itself repeated: … 1 0 0 1 …
#[inline(always)]
fn mirrored(index: isize, length: usize) -> usize {
    let length = length as isize;
    let period = index.rem_euclid(2 * length);
    if period < length { period as usize } else { (2 * length - 1 - period) as usize }
}

/// Sorts 16 numbers for each pixel by the odd-even merge sort (Batcher 1968): its comparisons do not depend on the numbers,
/// so that all pixels are sorted side by side.
#[inline(always)]
fn sort(rows: &mut [Lanes; CELLS]) {
    let mut sorted = 1;
    while sorted < CELLS {
        let mut distance = sorted;
        while distance > 0 {
            let mut start = distance % sorted;
            while start + distance < CELLS {
                for lower in start..(start + distance).min(CELLS - distance) {
                    if lower / (2 * sorted) == (lower + distance) / (2 * sorted) {
                        exchange(rows, lower, lower + distance);
                    }
                }
                start += 2 * distance;
            }
            distance /= 2;
        }
        sorted *= 2;
    }
}

/// Puts the smaller number of each pixel into the first row.
#[inline(always)]
#[expect(
    clippy::needless_range_loop,
    reason = "one index for both rows is the form that vectorises"
)]
fn exchange(rows: &mut [Lanes; CELLS], first: usize, second: usize) {
    for lane in 0..LANES {
        let (a, b) = (rows[first][lane], rows[second][lane]);
        rows[first][lane] = if a < b { a } else { b };
        rows[second][lane] = if a < b { b } else { a };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_network_sorts_every_pattern_of_zeros_and_ones() {
        // A sorting network that sorts all 2¹⁶ of them sorts everything (Knuth, volume 3, 5.3.4, theorem Z).
        for start in (0..1 << CELLS).step_by(LANES) {
            let mut rows: [Lanes; CELLS] = std::array::from_fn(|row| {
                std::array::from_fn(|lane| f32::from(((start + lane) >> row & 1) as u8))
            });
            sort(&mut rows);
            for lane in 0..LANES {
                assert!(rows.is_sorted_by(|a, b| a[lane] <= b[lane]), "{}", start + lane);
            }
        }
    }

    #[test]
    fn a_mirror_repeats_the_border() {
        let indices: Vec<usize> = (-5..8).map(|index| mirrored(index, 3)).collect();
        assert_eq!(indices, [1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]);
        assert_eq!(mirrored(-4, 1), 0);
    }

    #[test]
    fn white_noise_has_its_standard_deviation() {
        // The detail of four independent numbers of variance σ² is |N(0, 4 σ²)| / 2, of standard deviation σ.
        let mut state = 5_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / 16_777_216.0
        };
        let image = Image::from_shape_simple_fn((1, 128, 128), || {
            // Twelve uniform numbers: variance 1.
            0.25 * ((0..12).map(|_| uniform()).sum::<f32>() - 6.0)
        });
        let cells = detail_deviation(&image);
        let mean = cells.iter().sum::<f32>() / cells.len() as f32;
        // The median of 16 has a relative bias below 3 % and a deviation of about 0.3; 4096 cells, every fourth 8×8 block
        // new: 0.3 / √256, three of them.
        assert!((mean / 0.25 - 1.0).abs() < 0.03 + 0.056, "{mean}");
    }
}
