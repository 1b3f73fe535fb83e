//! The input channels of the networks: the one table on this side. `denoise/training/quietlight_training/channels.py` is
//! its twin, and fixtures prove them equal.
//!
//! Gradients are backward differences `f[x] − f[x−1]`, 0 in the first column or row of the picture; they look beyond a
//! tile. Rows and columns beyond the picture repeat it reflected.

use rayon::prelude::*;

use super::buffers::{Buffers, Modulation, Planes};
use super::network::Branch;
use super::tile::{Tile, reflect};
use super::transform::logarithm;
use crate::layers::LayerKind;
use crate::logarithm::{ln_1p, ln_or_nan, replace};

/// Of the kernel pyramid; `l = ln(1 + max(s, 0))` of the branch's signal `s`.
pub const PYRAMID: [&str; 22] = [
    "log.R",
    "log.G",
    "log.B",
    "log.dx.R",
    "log.dx.G",
    "log.dx.B",
    "log.dy.R",
    "log.dy.G",
    "log.dy.B",
    "log.deviation",
    "log.deviation.log",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "normal.deviation",
    "albedo.R",
    "albedo.G",
    "albedo.B",
    "albedo.deviation",
    "depth.log.dx",
    "depth.log.dy",
    "depth.deviation",
];

/// Of the kernel-predicting network of Bako et al. 2017 (METHODS 10.2).
pub const KERNEL: [&str; 27] = [
    "signal.R",
    "signal.G",
    "signal.B",
    "signal.dx.R",
    "signal.dx.G",
    "signal.dx.B",
    "signal.dy.R",
    "signal.dy.G",
    "signal.dy.B",
    "signal.variance",
    "normal.dx.X",
    "normal.dx.Y",
    "normal.dx.Z",
    "normal.dy.X",
    "normal.dy.Y",
    "normal.dy.Z",
    "normal.variance",
    "albedo.dx.R",
    "albedo.dx.G",
    "albedo.dx.B",
    "albedo.dy.R",
    "albedo.dy.G",
    "albedo.dy.B",
    "albedo.variance",
    "depth.dx",
    "depth.dy",
    "depth.variance",
];

/// A deviation of `ln(1 + s)` of 10 already says that nothing is known.
const LARGEST_LOG_DEVIATION: f32 = 10.0;

/// Normals and albedos lie within a range of 1; so do relative depths that mean something.
const LARGEST_FEATURE_DEVIATION: f32 = 1.0;

/// A step of `ln(depth)` of 2 is a factor of 7: an edge, however far behind the background lies.
const LARGEST_DEPTH_STEP: f32 = 2.0;

/// Variances of the paper's channels are fed as they are; this keeps a firefly from overflowing the first layer.
const LARGEST_VARIANCE: f32 = 1e4;

/// The channels [`PYRAMID`] of a tile, by space to depth: `[88, padded height / 2, padded width / 2]`,
/// channel `4 c + 2 dy + dx` of the half-sized pixel `P` is channel `c` of pixel `2 P + (dx, dy)`.
pub(super) fn pyramid(buffers: &Buffers<'_>, branch: Branch, tile: &Tile) -> Vec<f32> {
    let Some(light) = buffers.light(branch) else { return Vec::new() };
    let modulation = buffers.modulation(branch, buffers.exposure);
    let mut log = Margin::new(buffers.width, tile, |channel: usize, pixel| {
        light.mean(channel)[pixel] * modulation.to_signal(channel, pixel)
    });
    log.replace(logarithm);
    let normal = buffers.planes(LayerKind::Normal);
    let albedo = buffers.planes(LayerKind::Albedo);
    let depth = buffers.planes(LayerKind::Depth);
    // NaN where the depth is not known.
    let log_depth = depth.map(|depth| {
        let depth = depth.mean(0);
        let mut log_depth = Margin::<1>::new(buffers.width, tile, |_, pixel| depth[pixel]);
        log_depth.replace(ln_or_nan);
        log_depth
    });
    fill(tile, 2, |y, channels: [&mut [f32]; 22]| {
        let [l0, l1, l2, x0, x1, x2, y0, y1, y2, noise, log_noise, rest @ ..] = channels;
        let [n0, n1, n2, normal_noise, a0, a1, a2, albedo_noise, zx, zy, depth_noise] = rest;
        log.gradients(y, [l0, l1, l2], [x0, x1, x2], [y0, y1, y2]);
        let start = (tile.rows.start + y) * buffers.width + tile.columns.start;
        let row = start..start + tile.columns.len();

        log_deviation(light, modulation, row.clone(), noise);
        log_noise.copy_from_slice(noise);
        replace(log_noise, log_of_deviation);
        for (planes, [x, y, z], noise) in
            [(normal, [n0, n1, n2], normal_noise), (albedo, [a0, a1, a2], albedo_noise)]
        {
            let Some(planes) = planes else { continue };
            for (channel, out) in [x, y, z].into_iter().enumerate() {
                out[..row.len()].copy_from_slice(&planes.mean(channel)[row.clone()]);
            }
            mean_variance(planes, row.clone(), noise);
            noise.iter_mut().for_each(|v| *v = v.sqrt().min(LARGEST_FEATURE_DEVIATION));
        }
        if let (Some(depth), Some(log_depth)) = (depth, &log_depth) {
            log_depth.steps(y, zx, zy);
            let numbers = depth.mean(0)[row.clone()].iter().zip(&depth.variance(0)[row]);
            for (out, (&depth, &variance)) in depth_noise.iter_mut().zip(numbers) {
                let relative = if depth > 0.0 { variance.sqrt() / depth } else { 0.0 };
                *out = relative.min(LARGEST_FEATURE_DEVIATION);
            }
        }
    })
}

/// The channels [`KERNEL`] of a tile, `[27, padded height, padded width]`.
pub(super) fn kernel(buffers: &Buffers<'_>, branch: Branch, tile: &Tile) -> Vec<f32> {
    let Some(light) = buffers.light(branch) else { return Vec::new() };
    let modulation = buffers.modulation(branch, 1.0);
    let width = buffers.width;
    let signal = Margin::new(width, tile, |channel: usize, pixel| {
        let value = light.mean(channel)[pixel];
        match branch {
            Branch::Diffuse => value * modulation.to_signal(channel, pixel),
            Branch::Specular => logarithm(value),
        }
    });
    let margin = |kind| {
        let planes = buffers.planes(kind)?;
        Some((planes, Margin::<3>::new(width, tile, |channel, pixel| planes.mean(channel)[pixel])))
    };
    let normal = margin(LayerKind::Normal);
    let albedo = margin(LayerKind::Albedo);
    let depth = buffers.planes(LayerKind::Depth).map(|planes| {
        let farthest = planes.mean(0).iter().copied().fold(0.0, f32::max);
        let scale = if farthest > 0.0 { farthest } else { 1.0 };
        (planes, scale, Margin::<1>::new(width, tile, |_, pixel| planes.mean(0)[pixel] / scale))
    });
    fill(tile, 1, |y, channels: [&mut [f32]; 27]| {
        let [s0, s1, s2, x0, x1, x2, y0, y1, y2, noise, rest @ ..] = channels;
        let [n0, n1, n2, n3, n4, n5, normal_noise, rest @ ..] = rest;
        let [a0, a1, a2, a3, a4, a5, albedo_noise, z0, z1, depth_noise] = rest;
        signal.gradients(y, [s0, s1, s2], [x0, x1, x2], [y0, y1, y2]);
        let start = (tile.rows.start + y) * width + tile.columns.start;
        let row = start..start + tile.columns.len();

        let at_most = |row: &mut [f32]| row.iter_mut().for_each(|v| *v = v.min(LARGEST_VARIANCE));
        for (noise, pixel) in noise.iter_mut().zip(row.clone()) {
            let variance = |channel: usize| {
                let variance = light.variance(channel)[pixel];
                let scale = match branch {
                    Branch::Diffuse => modulation.to_signal(channel, pixel),
                    // The derivative of ln(1 + c) at the linear value.
                    Branch::Specular => (1.0 + light.mean(channel)[pixel].max(0.0)).recip(),
                };
                (variance.sqrt() * scale).powi(2)
            };
            *noise = (variance(0) + variance(1) + variance(2)) / 3.0;
        }
        at_most(noise);
        for (feature, dx, dy, noise) in [
            (&normal, [n0, n1, n2], [n3, n4, n5], normal_noise),
            (&albedo, [a0, a1, a2], [a3, a4, a5], albedo_noise),
        ] {
            let Some((planes, margin)) = feature else { continue };
            margin.differences(y, dx, dy);
            mean_variance(*planes, row.clone(), noise);
            at_most(noise);
        }
        if let Some((planes, scale, margin)) = &depth {
            margin.differences(y, [z0], [z1]);
            for (out, variance) in depth_noise.iter_mut().zip(&planes.variance(0)[row]) {
                *out = variance / (scale * scale);
            }
            at_most(depth_noise);
        }
    })
}

/// `(ln(σ² + 1e-8) + 9) / 9`: −1 to 1 over what there is.
#[inline(always)]
fn log_of_deviation(deviation: f32) -> f32 {
    // The logarithm of 1e-8.
    const LEAST: f32 = -18.420_681;
    (ln_1p(deviation * deviation * 1e8) + LEAST + 9.0) / 9.0
}

/// Standard deviation of `ln(1 + max(s, 0))` by the delta method, `√mean(σ²/(1 + max(s, 0))²)`, at most
/// [`LARGEST_LOG_DEVIATION`].
fn log_deviation(
    light: Planes<'_>,
    modulation: Modulation<'_>,
    row: std::ops::Range<usize>,
    out: &mut [f32],
) {
    for (out, pixel) in out.iter_mut().zip(row) {
        let mut sum = 0.0;
        for channel in 0..3 {
            let factor = modulation.to_signal(channel, pixel);
            let signal = (light.mean(channel)[pixel] * factor).max(0.0);
            let deviation = light.variance(channel)[pixel].sqrt() * factor / (1.0 + signal);
            sum += deviation * deviation;
        }
        *out = (sum / 3.0).sqrt().min(LARGEST_LOG_DEVIATION);
    }
}

/// Mean of the variances of the three channels.
fn mean_variance(planes: Planes<'_>, row: std::ops::Range<usize>, out: &mut [f32]) {
    for (out, pixel) in out.iter_mut().zip(row) {
        let sum = (0..3).map(|channel| planes.variance(channel)[pixel]).sum::<f32>();
        *out = sum / 3.0;
    }
}

/// Calls `write` for each row of a tile with that row of each of `N` channels, and reflects the tile into its padding.
///
/// With `block` 2, space to depth: channel `4 c + 2 dy + dx` of the half-sized pixel `P` is channel `c` of pixel
/// `2 P + (dx, dy)`. With `block` 1 the channels stay as they are.
fn fill<const N: usize>(
    tile: &Tile,
    block: usize,
    write: impl Fn(usize, [&mut [f32]; N]) + Sync,
) -> Vec<f32> {
    let [padded_height, padded_width] = tile.padded;
    let [height, width] = tile.size();
    let [rows, columns] = [padded_height / block, padded_width / block];
    let mut out = vec![0.0; N * padded_height * padded_width];
    // One row of each plane of the result.
    let mut planes: Vec<Vec<&mut [f32]>> = (0..rows).map(|_| Vec::new()).collect();
    for plane in out.chunks_mut(rows * columns) {
        for (row, values) in planes.iter_mut().zip(plane.chunks_mut(columns)) {
            row.push(values);
        }
    }
    planes.into_par_iter().enumerate().for_each_init(
        || vec![0.0; N * padded_width],
        |scratch, (row, mut planes)| {
            for dy in 0..block {
                scratch.fill(0.0);
                let mut channels = scratch.chunks_mut(padded_width).map(|row| &mut row[..width]);
                write(
                    reflect(row * block + dy, height),
                    std::array::from_fn(|_| channels.next().expect("one row for each channel")),
                );
                for (channel, values) in scratch.chunks_mut(padded_width).enumerate() {
                    for x in width..padded_width {
                        values[x] = values[reflect(x, width)];
                    }
                    for dx in 0..block {
                        let plane = &mut planes[(channel * block + dy) * block + dx];
                        let values = values[dx..].iter().step_by(block);
                        plane.iter_mut().zip(values).for_each(|(out, value)| *out = *value);
                    }
                }
            }
        },
    );
    out
}

/// Values of `N` channels over a tile and over the row and the column before it, where the picture has them.
struct Margin<const N: usize> {
    values: Vec<f32>,
    /// Whether there is a row above and a column to the left.
    has: [bool; 2],
    stride: usize,
    width: usize,
}

impl<const N: usize> Margin<N> {
    /// `value` gives the value of a channel in a pixel of the picture of that width.
    fn new(width: usize, tile: &Tile, value: impl Fn(usize, usize) -> f32 + Sync) -> Self {
        let has = [tile.rows.start > 0, tile.columns.start > 0];
        let [above, left] = has.map(usize::from);
        let (first_row, first_column) = (tile.rows.start - above, tile.columns.start - left);
        let [height, own_width] = tile.size();
        let stride = own_width + left;
        let mut values = vec![0.0; (height + above) * N * stride];
        values.par_chunks_mut(N * stride).enumerate().for_each(|(y, rows)| {
            let start = (first_row + y) * width + first_column;
            for (channel, row) in rows.chunks_mut(stride).enumerate() {
                for (out, pixel) in row.iter_mut().zip(start..) {
                    *out = value(channel, pixel);
                }
            }
        });
        Self { values, has, stride, width: own_width }
    }

    /// Replaces all values by a function of them.
    fn replace(&mut self, function: impl Fn(f32) -> f32 + Sync) {
        self.values.par_chunks_mut(N * self.stride).for_each(|rows| replace(rows, &function));
    }

    /// One channel in row `y` of the tile, with the column before it where there is one.
    fn row(&self, y: usize, channel: usize) -> &[f32] {
        let row = y + usize::from(self.has[0]);
        &self.values[(row * N + channel) * self.stride..][..self.stride]
    }

    /// The row above; the same row where there is none, which makes differences 0.
    fn row_above(&self, y: usize, channel: usize) -> &[f32] {
        if y > 0 || self.has[0] {
            let row = y + usize::from(self.has[0]) - 1;
            &self.values[(row * N + channel) * self.stride..][..self.stride]
        } else {
            self.row(y, channel)
        }
    }

    /// The values of a row of the tile and their backward differences.
    fn gradients(
        &self,
        y: usize,
        values: [&mut [f32]; N],
        dx: [&mut [f32]; N],
        dy: [&mut [f32]; N],
    ) {
        let left = self.stride - self.width;
        for (channel, values) in values.into_iter().enumerate() {
            values[..self.width].copy_from_slice(&self.row(y, channel)[left..]);
        }
        self.differences(y, dx, dy);
    }

    /// The backward differences of a row of the tile.
    fn differences(&self, y: usize, dx: [&mut [f32]; N], dy: [&mut [f32]; N]) {
        let left = self.stride - self.width;
        for (channel, (dx, dy)) in dx.into_iter().zip(dy).enumerate() {
            let (row, above) = (self.row(y, channel), self.row_above(y, channel));
            // Without a column before it the first difference stays 0.
            for (out, pair) in dx[1 - left..].iter_mut().zip(row.windows(2)) {
                *out = pair[1] - pair[0];
            }
            for (out, (here, above)) in dy.iter_mut().zip(row[left..].iter().zip(&above[left..])) {
                *out = here - above;
            }
        }
    }
}

impl Margin<1> {
    /// Backward differences of logarithms of depth, within ±[`LARGEST_DEPTH_STEP`]; 0 where one is not known.
    fn steps(&self, y: usize, dx: &mut [f32], dy: &mut [f32]) {
        self.differences(y, [&mut *dx], [&mut *dy]);
        for step in dx.iter_mut().chain(dy) {
            *step = if step.is_nan() {
                0.0
            } else {
                step.clamp(-LARGEST_DEPTH_STEP, LARGEST_DEPTH_STEP)
            };
        }
    }
}
