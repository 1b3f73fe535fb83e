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
//!
//! Eight neighbouring pixels are computed side by side. Row by row of the window, the distances of all offsets in the
//! row are collected group by group, so that the values of the centres stay in registers, and then weighed.

use rayon::prelude::*;

use super::features::Feature;
use super::{Lambda, Parameters};
use crate::lanes::{LANES, Lanes, exp_negative};
use crate::layers::Image;
use crate::simd::{Kernel, vectorise};
use crate::window::{fold, plane};

/// Added to the colour variances, so that equal pixels of no variance are equal.
const COLOUR_EPSILON: f32 = 1e-10;

/// Smallest feature variance: differences of features of size one are not told apart below 0.01.
const FEATURE_FLOOR: f32 = 1e-4;

/// Offsets whose spatial distance alone exceeds this are left out: all 3024 together weigh less than 3024 e⁻²⁴ ≈ 1.2e-7
/// of the centre, less than the rounding of the sum.
const FARTHEST: f32 = 24.0;

/// Largest radius of the window; the array of distances of one row has room for it.
pub(super) const LARGEST_RADIUS: usize = 27;
const TAPS: usize = 2 * LARGEST_RADIUS + 1;

/// What is filtered, in the layout of the kernel.
///
/// The rows of all planes lie one after the other, padded on both sides so that a window and a group of eight pixels
/// can be read without asking where the border is.
#[derive(Debug)]
pub(super) struct Stack {
    width: usize,
    height: usize,
    /// Colour 0 to 2, its variance 3 to 5, then the means of the features, then their variances.
    planes: usize,
    stride: usize,
    groups: Vec<Group>,
    values: Vec<f32>,
    /// Smallest and largest colour in the window of each pixel: a mean of them lies between, whatever is rounded.
    bounds: [Vec<f32>; 6],
}

#[derive(Debug)]
struct Group {
    /// Which λ it has, 1 to 5.
    lambda: usize,
    channels: usize,
    mean_plane: usize,
    variance_plane: usize,
}

impl Stack {
    pub(super) fn new(colour: &Image, variance: &Image, features: &[Feature]) -> Self {
        let (_, height, width) = colour.dim();
        let mut sources: Vec<(&Image, usize)> =
            [colour, variance].into_iter().flat_map(|image| (0..3).map(move |channel| (image, channel))).collect();
        let mut groups = Vec::new();
        let channels: usize = features.iter().map(|feature| feature.mean.dim().0).sum();
        for feature in features {
            let mean_plane = sources.len();
            let own = feature.mean.dim().0;
            groups.push(Group {
                lambda: feature.group + 1,
                channels: own,
                mean_plane,
                variance_plane: mean_plane + channels,
            });
            sources.extend((0..own).map(|channel| (&feature.mean, channel)));
        }
        for feature in features {
            sources.extend((0..feature.mean.dim().0).map(|channel| (&feature.variance, channel)));
        }

        let stride = 2 * LARGEST_RADIUS + width.next_multiple_of(LANES);
        let planes = sources.len();
        let mut values = vec![0.0; height * planes * stride];
        values.par_chunks_mut(planes * stride).enumerate().for_each(|(y, rows)| {
            for (row, (image, channel)) in rows.chunks_mut(stride).zip(&sources) {
                let row = &mut row[LARGEST_RADIUS..LARGEST_RADIUS + width];
                row.iter_mut().enumerate().for_each(|(x, value)| *value = image[[*channel, y, x]]);
            }
        });
        let bounds = std::array::from_fn(|index| {
            let plane = plane(colour, index % 3);
            if index < 3 { fold(&plane, width, LARGEST_RADIUS, f32::min) } else { fold(&plane, width, LARGEST_RADIUS, f32::max) }
        });
        Self { width, height, planes, stride, groups, values, bounds }
    }

    /// Filters the colour, `[3, height, width]`; `done` is called after each row.
    pub(super) fn filter(&self, parameters: &Parameters, done: &(dyn Fn() + Sync)) -> Image {
        let mut rows = vec![0.0; self.height * 3 * self.width];
        rows.par_chunks_mut(3 * self.width).enumerate().for_each(|(y, out)| {
            vectorise(RowKernel { stack: self, parameters, y, out });
            done();
        });
        let mut image = Image::from_shape_vec((self.height, 3, self.width), rows).expect("three rows for each row");
        image.swap_axes(0, 1);
        image.as_standard_layout().into_owned()
    }

    /// A row of a plane; its pixel 0 is at [`LARGEST_RADIUS`].
    #[inline(always)]
    fn row(&self, y: usize, plane: usize) -> &[f32] {
        let start = (y * self.planes + plane) * self.stride;
        &self.values[start..start + self.stride]
    }
}

/// One row of the picture.
struct RowKernel<'a> {
    stack: &'a Stack,
    parameters: &'a Parameters,
    y: usize,
    out: &'a mut [f32],
}

impl Kernel for RowKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { stack, parameters, y, out } = self;
        for x in (0..stack.width).step_by(LANES) {
            let colours = Block { stack, parameters, y, x }.filter();
            for (channel, colour) in colours.into_iter().enumerate() {
                let inside = LANES.min(stack.width - x);
                for lane in 0..inside {
                    let pixel = y * stack.width + x + lane;
                    let (low, high) = (stack.bounds[channel][pixel], stack.bounds[channel + 3][pixel]);
                    out[channel * stack.width + x + lane] = colour.0[lane].clamp(low, high);
                }
            }
        }
    }
}

/// Eight pixels of a row, from column `x`.
struct Block<'a> {
    stack: &'a Stack,
    parameters: &'a Parameters,
    y: usize,
    x: usize,
}

impl Block<'_> {
    #[inline(always)]
    fn filter(&self) -> [Lanes; 3] {
        let lambda_0 = self.lambda(0);
        let smallest = lambda_0.0.iter().copied().fold(f32::INFINITY, f32::min);
        let mut weight = Lanes::splat(0.0);
        let mut colours = [Lanes::splat(0.0); 3];
        let mut distances = [Lanes::splat(0.0); TAPS];

        let radius = self.parameters.window_radius;
        let rows = crate::window::clipped(self.y, radius, self.stack.height);
        for neighbour_y in rows {
            let dy = neighbour_y.abs_diff(self.y);
            let Some(reach) = reach(smallest, dy, radius) else { continue };
            let distances = &mut distances[..2 * reach + 1];
            self.spatial(distances, lambda_0, dy);
            for group in &self.stack.groups {
                if group.channels == 3 {
                    self.add_group::<3>(distances, group, neighbour_y);
                } else {
                    self.add_group::<1>(distances, group, neighbour_y);
                }
            }
            let (row_weight, row_colours) = self.weigh(distances, neighbour_y);
            // Sums of rows, then of the window: 55 + 55 roundings and not 3025.
            weight = weight + row_weight;
            for (colour, row) in colours.iter_mut().zip(row_colours) {
                *colour = *colour + row;
            }
        }
        colours.map(|colour| colour / weight)
    }

    /// One of λ₀ to λ₅ for the eight pixels.
    #[inline(always)]
    fn lambda(&self, index: usize) -> Lanes {
        match &self.parameters.lambda {
            Lambda::Constant(values) => Lanes::splat(values[index]),
            Lambda::PerPixel(image) => {
                let last = self.stack.width - 1;
                Lanes(std::array::from_fn(|lane| image[[index, self.y, (self.x + lane).min(last)]]))
            }
        }
    }

    /// Starts the distances with the spatial term; offsets outside of the picture are infinitely far.
    #[inline(always)]
    fn spatial(&self, distances: &mut [Lanes], lambda_0: Lanes, dy: usize) {
        let reach = distances.len() / 2;
        let width = self.stack.width;
        let inside = self.x >= reach && self.x + LANES + reach <= width;
        for (tap, distance) in distances.iter_mut().enumerate() {
            let dx = tap.abs_diff(reach);
            *distance = lambda_0 * Lanes::splat((dx * dx + dy * dy) as f32);
            if !inside {
                for (lane, distance) in distance.0.iter_mut().enumerate() {
                    let x = self.x + lane + tap;
                    if x < reach || x >= width + reach {
                        *distance = f32::INFINITY;
                    }
                }
            }
        }
    }

    /// Adds the distances of one feature group to the pixels of a row.
    #[inline(always)]
    fn add_group<const CHANNELS: usize>(&self, distances: &mut [Lanes], group: &Group, neighbour_y: usize) {
        let lambda = self.lambda(group.lambda);
        let centre: [Lanes; CHANNELS] = std::array::from_fn(|channel| self.centre(group.mean_plane + channel));
        let scale: [Lanes; CHANNELS] = std::array::from_fn(|channel| {
            let variance = self.centre(group.variance_plane + channel).map(|value| value.max(FEATURE_FLOOR));
            (lambda / variance).map(f32::sqrt)
        });
        let rows: [&[f32]; CHANNELS] =
            std::array::from_fn(|channel| self.neighbours(distances.len(), neighbour_y, group.mean_plane + channel));
        for (tap, distance) in distances.iter_mut().enumerate() {
            for channel in 0..CHANNELS {
                let difference = (Lanes::load(&rows[channel][tap..]) - centre[channel]) * scale[channel];
                *distance = *distance + difference * difference;
            }
        }
    }

    /// Adds the colour distance, and sums the weights and the weighted colours of a row.
    #[inline(always)]
    fn weigh(&self, distances: &[Lanes], neighbour_y: usize) -> (Lanes, [Lanes; 3]) {
        let lambda = Lanes::splat(self.parameters.colour);
        let centre: [Lanes; 3] = std::array::from_fn(|channel| self.centre(channel));
        let variance: [Lanes; 3] =
            std::array::from_fn(|channel| self.centre(3 + channel) + Lanes::splat(COLOUR_EPSILON));
        let rows: [&[f32]; 6] = std::array::from_fn(|plane| self.neighbours(distances.len(), neighbour_y, plane));
        let mut weights = Lanes::splat(0.0);
        let mut colours = [Lanes::splat(0.0); 3];
        for (tap, &distance) in distances.iter().enumerate() {
            let mut distance = distance;
            let neighbour: [Lanes; 3] = std::array::from_fn(|channel| Lanes::load(&rows[channel][tap..]));
            for channel in 0..3 {
                let difference = neighbour[channel] - centre[channel];
                let variance = Lanes::load(&rows[3 + channel][tap..]) + variance[channel];
                // λ first: 0 · ∞ must not arise.
                distance = distance + difference * (lambda * difference) / variance;
            }
            let weight = distance.map(exp_negative);
            weights = weights + weight;
            for channel in 0..3 {
                colours[channel] = colours[channel] + weight * neighbour[channel];
            }
        }
        (weights, colours)
    }

    /// The eight pixels themselves.
    #[inline(always)]
    fn centre(&self, plane: usize) -> Lanes {
        Lanes::load(&self.stack.row(self.y, plane)[LARGEST_RADIUS + self.x..])
    }

    /// The pixels of a row that `taps` offsets of eight pixels reach.
    #[inline(always)]
    fn neighbours(&self, taps: usize, y: usize, plane: usize) -> &[f32] {
        let start = LARGEST_RADIUS + self.x - taps / 2;
        &self.stack.row(y, plane)[start..start + taps + LANES - 1]
    }
}

/// How far to the sides the offsets `dy` rows away reach before [`FARTHEST`]; `None` where not even the nearest does.
#[inline(always)]
fn reach(lambda_0: f32, dy: usize, radius: usize) -> Option<usize> {
    let near = |dx: &usize| lambda_0 * (dx * dx + dy * dy) as f32 <= FARTHEST;
    (0..=radius).rev().find(near)
}
