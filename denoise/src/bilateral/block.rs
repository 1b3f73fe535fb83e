//! The filter at a block of pixels.
//!
//! Neighbouring pixels in a row are computed side by side. A few offsets of a row of the window at a time, so that what
//! belongs to the centres is read once for all of them, the spatial distance is taken, the distances of the groups are added
//! and, where that is not too far for all, the colours compared and weighed. The innermost loops run over the pixels of the
//! block, whose number is fixed: this is the form that the compiler turns into vectors.

use super::filter::{BLOCK, LARGEST_RADIUS, Multipliers, Row, Settings, TAPS, TOGETHER};
use super::stack::{FIRST_FEATURE, Stack, first as first_of};
use crate::exp::exp_negative;
use crate::window::clipped;

/// Added to the colour variances, so that equal pixels of no variance are equal.
const COLOUR_EPSILON: f32 = 1e-10;

/// Smallest feature variance: differences of features of size one are not told apart below 0.01.
const FEATURE_FLOOR: f32 = 1e-4;

/// Offsets that are farther than this without their colour weigh nothing: all 3024 together would weigh less than
/// 3024 e⁻²⁴ ≈ 1.2e-7 of the centre, no more than the rounding of the sum. Skipping them saved a fifth
/// of the time on renders of the Cornell box and of Veach's plates (λ = 0.1).
const FARTHEST: f32 = 24.0;

/// Offsets that are weighed together: the vectors of more do not fit into the registers.
const PAIR: usize = 2;

/// Numbers that begin where a line of the cache does: a vector across two lines is read and written twice.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Aligned<T>(T);

/// Some pixels of row `y`, from column `x`.
pub(super) struct Block<'a> {
    stack: &'a Stack,
    radius: usize,
    y: usize,
    x: usize,
    colour_lambda: f32,
    spatial_lambda: Aligned<Row>,
    /// √(λ / max(1e-4, σ²)) for each channel of each group.
    scales: Aligned<[Row; MOST_CHANNELS]>,
    /// Channels of the groups there are, and their means.
    channels: usize,
    centre: Aligned<[Row; MOST_CHANNELS]>,
    /// Colour variance and its ε.
    variance: Aligned<[Row; 3]>,
    /// 0 for each offset to the sides that lies in the picture, infinity outside.
    border: Aligned<[Row; TAPS + TOGETHER]>,
}

/// Channels of all groups together.
const MOST_CHANNELS: usize = 13;

impl<'a> Block<'a> {
    #[inline(always)]
    pub(super) fn new(stack: &'a Stack, settings: &Settings<'_>, y: usize, x: usize) -> Self {
        let lambda = |index: usize| -> Row {
            match settings.lambda {
                Multipliers::Constant(values) => [values[index]; BLOCK],
                Multipliers::PerPixel(image) => {
                    std::array::from_fn(|pixel| image[[index, y, (x + pixel).min(stack.width - 1)]])
                }
            }
        };
        let channels = stack.groups.iter().map(|group| group.channels).sum();
        let inside = LARGEST_RADIUS..stack.width + LARGEST_RADIUS;
        let mut block = Self {
            stack,
            radius: settings.radius,
            y,
            x,
            colour_lambda: settings.colour,
            // Never 0: 0 · ∞ must not arise.
            spatial_lambda: Aligned(lambda(0).map(|value| value.max(f32::MIN_POSITIVE))),
            scales: Aligned([[0.0; BLOCK]; MOST_CHANNELS]),
            channels,
            centre: Aligned(std::array::from_fn(|channel| {
                if channel < channels {
                    *stack.pixels(y, FIRST_FEATURE + channel, x)
                } else {
                    [0.0; BLOCK]
                }
            })),
            variance: Aligned([[0.0; BLOCK]; 3]),
            border: Aligned(std::array::from_fn(|tap| {
                std::array::from_fn(|pixel| {
                    if inside.contains(&(x + pixel + tap)) { 0.0 } else { f32::INFINITY }
                })
            })),
        };
        for (channel, variance) in block.variance.0.iter_mut().enumerate() {
            *variance = stack.pixels(y, 3 + channel, x).map(|value| value + COLOUR_EPSILON);
        }
        let mut scales = block.scales.0.iter_mut();
        for group in &stack.groups {
            let lambda = lambda(group.lambda);
            for (channel, scale) in (0..group.channels).zip(&mut scales) {
                let variance = stack.pixels(y, group.variance_plane + channel, x);
                *scale = std::array::from_fn(|pixel| {
                    (lambda[pixel] / variance[pixel].max(FEATURE_FLOOR)).sqrt()
                });
            }
        }
        block
    }

    #[inline(always)]
    pub(super) fn filter(&self) -> [Row; 3] {
        let smallest = self.spatial_lambda.0.iter().copied().fold(f32::INFINITY, f32::min);
        let mut total = Sums::default();
        for neighbour_y in clipped(self.y, self.radius, self.stack.height) {
            let dy = neighbour_y.abs_diff(self.y);
            if let Some(reach) = reach(smallest, dy, self.radius) {
                // Sums of rows, then of the window: 55 + 55 roundings and not 3025.
                total.add(&self.weigh_row(neighbour_y, reach));
            }
        }
        total.colours.map(|colour| std::array::from_fn(|pixel| colour[pixel] / total.weight[pixel]))
    }

    /// Weights and weighted colours of a row of the window.
    #[inline(always)]
    fn weigh_row(&self, neighbour_y: usize, reach: usize) -> Sums {
        let colours: [&[f32]; 6] =
            std::array::from_fn(|plane| self.neighbours(reach, neighbour_y, plane));
        let features: [&[f32]; MOST_CHANNELS] = std::array::from_fn(|channel| {
            if channel < self.channels {
                self.neighbours(reach, neighbour_y, FIRST_FEATURE + channel)
            } else {
                &[]
            }
        });
        let centre = Colours {
            mean: std::array::from_fn(|channel| self.stack.pixels(self.y, channel, self.x)),
            variance: self.variance.0.each_ref(),
        };
        let mut sums = Sums::default();
        for first in (0..2 * reach + 1).step_by(TOGETHER) {
            let mut distances = self.spatial(first, reach, neighbour_y.abs_diff(self.y));
            let mut channel = 0;
            for group in &self.stack.groups {
                if group.channels == 3 {
                    self.add_group::<3>(&mut distances, &features, first, channel);
                } else {
                    self.add_group::<1>(&mut distances, &features, first, channel);
                }
                channel += group.channels;
            }
            for (pair, distances) in distances.0.as_chunks::<PAIR>().0.iter().enumerate() {
                if count_near(distances) == 0 {
                    continue;
                }
                let window = |plane: usize| {
                    first_of::<{ BLOCK + PAIR - 1 }>(&colours[plane][first + PAIR * pair..])
                };
                let neighbours = Colours {
                    mean: std::array::from_fn(window),
                    variance: std::array::from_fn(|plane| window(3 + plane)),
                };
                add_weights(&mut sums, distances, &neighbours, &centre, self.colour_lambda);
            }
        }
        sums
    }

    #[inline(always)]
    fn add_group<const CHANNELS: usize>(
        &self,
        distances: &mut Aligned<[Row; TOGETHER]>,
        features: &[&[f32]; MOST_CHANNELS],
        first: usize,
        channel: usize,
    ) {
        let neighbours = std::array::from_fn(|own| {
            first_of::<{ BLOCK + TOGETHER - 1 }>(&features[channel + own][first..])
        });
        let centre: [&Row; CHANNELS] = std::array::from_fn(|own| &self.centre.0[channel + own]);
        let scales: [&Row; CHANNELS] = std::array::from_fn(|own| &self.scales.0[channel + own]);
        add_squares(&mut distances.0, neighbours, centre, scales);
    }

    /// The spatial term of the offsets from column `first` of the window on.
    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        reason = "one index for all arrays is the form that vectorises"
    )]
    fn spatial(&self, first: usize, reach: usize, dy: usize) -> Aligned<[Row; TOGETHER]> {
        let border = &self.border.0[LARGEST_RADIUS - reach + first..];
        let border: &[Row; TOGETHER] = border.first_chunk().expect("the border is padded");
        let squared: [f32; TOGETHER] = std::array::from_fn(|tap| {
            let dx = (first + tap).abs_diff(reach);
            // Offsets beyond the window are those that fill up to a multiple.
            if dx > reach { f32::INFINITY } else { (dx * dx + dy * dy) as f32 }
        });
        let mut distances = Aligned([[0.0; BLOCK]; TOGETHER]);
        for pixel in 0..BLOCK {
            for tap in 0..TOGETHER {
                distances.0[tap][pixel] =
                    self.spatial_lambda.0[pixel] * squared[tap] + border[tap][pixel];
            }
        }
        distances
    }

    /// The pixels of a row that the offsets reach.
    #[inline(always)]
    fn neighbours(&self, reach: usize, y: usize, plane: usize) -> &[f32] {
        &self.stack.row(y, plane)[LARGEST_RADIUS + self.x - reach..]
    }
}

/// Weights and weighted colours.
struct Sums {
    weight: Row,
    colours: [Row; 3],
}

impl Default for Sums {
    #[inline(always)]
    fn default() -> Self {
        Self { weight: [0.0; BLOCK], colours: [[0.0; BLOCK]; 3] }
    }
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        let add = |sum: &mut Row, other: &Row| {
            sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
        };
        add(&mut self.weight, &other.weight);
        self.colours.iter_mut().zip(&other.colours).for_each(|(sum, other)| add(sum, other));
    }
}

/// Colours and variances of a block, or of the `N` pixels that some offsets of a block reach.
struct Colours<'a, const N: usize> {
    mean: [&'a [f32; N]; 3],
    variance: [&'a [f32; N]; 3],
}

/// The squared differences of a group at a few offsets.
#[inline(always)]
fn add_squares<const CHANNELS: usize>(
    distances: &mut [Row; TOGETHER],
    neighbours: [&[f32; BLOCK + TOGETHER - 1]; CHANNELS],
    centre: [&Row; CHANNELS],
    scale: [&Row; CHANNELS],
) {
    for pixel in 0..BLOCK {
        for tap in 0..TOGETHER {
            let mut sum = distances[tap][pixel];
            for channel in 0..CHANNELS {
                let difference = (neighbours[channel][pixel + tap] - centre[channel][pixel])
                    * scale[channel][pixel];
                sum += difference * difference;
            }
            distances[tap][pixel] = sum;
        }
    }
}

/// How many pixels at two offsets are not too far to weigh. A count, because that vectorises where a search does not.
#[inline(always)]
fn count_near(distances: &[Row; PAIR]) -> u32 {
    let mut near = 0;
    for distance in distances.as_flattened() {
        near += u32::from(*distance <= FARTHEST);
    }
    near
}

/// The weights at two offsets, whose `distances` lack the colour.
#[inline(always)]
#[expect(
    clippy::needless_range_loop,
    reason = "one index for all arrays is the form that vectorises"
)]
fn add_weights(
    sums: &mut Sums,
    distances: &[Row; PAIR],
    neighbours: &Colours<'_, { BLOCK + PAIR - 1 }>,
    centre: &Colours<'_, BLOCK>,
    lambda: f32,
) {
    for pixel in 0..BLOCK {
        for tap in 0..PAIR {
            let mut distance = distances[tap][pixel];
            for channel in 0..3 {
                let difference =
                    neighbours.mean[channel][pixel + tap] - centre.mean[channel][pixel];
                let variance =
                    neighbours.variance[channel][pixel + tap] + centre.variance[channel][pixel];
                // λ first: 0 · ∞ must not arise.
                distance += difference * (lambda * difference) / variance;
            }
            let weight = exp_negative(distance);
            sums.weight[pixel] += weight;
            for channel in 0..3 {
                sums.colours[channel][pixel] += weight * neighbours.mean[channel][pixel + tap];
            }
        }
    }
}

/// How far to the sides the offsets `dy` rows away reach before [`FARTHEST`]; `None` where not even the nearest does.
#[inline(always)]
fn reach(lambda_0: f32, dy: usize, radius: usize) -> Option<usize> {
    let near = |dx: &usize| lambda_0 * (dx * dx + dy * dy) as f32 <= FARTHEST;
    (0..=radius).rev().find(near)
}
