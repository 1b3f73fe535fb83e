//! From tiles of signal to the picture: what the kernels are applied to, and what is made of the result.

use std::ops::Range;

use rayon::prelude::*;

use super::buffers::{Buffers, Modulation, Planes};
use super::network::{Branch, Kind};
use super::noise::Noise;
use super::tile::Tile;
use super::transform::{exponential, logarithm};
use crate::blend::{self, Fractions, denoised_parts, mix};
use crate::layers::Image;

/// Channels of a signal: three of light, and three of a sample of its noise where the noise is known.
pub(super) const WITH_NOISE: usize = blend::CHANNELS;

/// Channels of a signal without its noise.
pub(super) const WITHOUT_NOISE: usize = 3;

/// The picture that is being denoised.
pub(super) struct Picture<'a> {
    pub(super) buffers: &'a Buffers<'a>,
    noise: Option<Noise>,
    /// What has been denoised: light and, where it is known, filtered noise; `[height, channels, width]`.
    values: Vec<f32>,
}

/// A filtered signal of a tile, `[height, channels, width]`, and of what it is.
pub(super) struct Filtered {
    pub(super) branch: Branch,
    pub(super) kind: Kind,
    pub(super) signal: Vec<f32>,
}

impl<'a> Picture<'a> {
    /// Black, until light is added.
    pub(super) fn new(buffers: &'a Buffers<'a>) -> Self {
        let noise = buffers.knows_noise().then(|| Noise::new(buffers));
        let mut picture = Self { buffers, noise, values: Vec::new() };
        picture.values = vec![0.0; buffers.height * picture.channels() * buffers.width];
        picture
    }

    /// Whether signals have [`WITH_NOISE`] channels.
    pub(super) fn has_noise(&self) -> bool {
        self.noise.is_some()
    }

    fn channels(&self) -> usize {
        if self.has_noise() { WITH_NOISE } else { WITHOUT_NOISE }
    }

    /// What the kernels of a branch are applied to over a tile, `[height, channels, width]`: the signal, then its noise.
    pub(super) fn signal(&self, branch: Branch, kind: Kind, tile: &Tile) -> Vec<f32> {
        let channels = self.channels();
        let [height, width] = tile.size();
        let Some(part) = Part::new(self.buffers, self.noise.as_ref(), branch, kind) else {
            return Vec::new();
        };
        let mut signal = vec![0.0; height * channels * width];
        signal.par_chunks_mut(channels * width).zip(tile.rows.clone()).for_each(|(row, y)| {
            let start = y * self.buffers.width + tile.columns.start;
            part.add_light(start..start + width, row);
            part.to_signal(start..start + width, row);
        });
        signal
    }

    /// Adds the core of a filtered tile.
    pub(super) fn add(&mut self, tile: &Tile, filtered: &Filtered) {
        let (channels, width) = (self.channels(), self.buffers.width);
        let (branch, kind) = (filtered.branch, filtered.kind);
        let Some(part) = Part::new(self.buffers, self.noise.as_ref(), branch, kind) else { return };
        let own_width = tile.columns.len();
        let core = tile.core_columns.clone();
        let rows = self.values.par_chunks_mut(channels * width).enumerate();
        let rows = rows.skip(tile.core_rows.start).take(tile.core_rows.len());
        rows.for_each_init(Vec::new, |light, (y, row)| {
            let start = (y - tile.rows.start) * channels * own_width;
            let source = &filtered.signal[start..start + channels * own_width];
            light.clear();
            for channel in source.chunks(own_width) {
                light.extend_from_slice(&channel[core.start - tile.columns.start..][..core.len()]);
            }
            part.to_radiance(y * width + core.start..y * width + core.end, light);
            for (out, light) in row.chunks_mut(width).zip(light.chunks(core.len())) {
                let out = out[core.clone()].iter_mut();
                out.zip(light).for_each(|(out, light)| *out += light);
            }
        });
    }

    /// Adds the noisy light of a branch that is not filtered.
    pub(super) fn add_noisy(&mut self, branch: Branch) {
        let (channels, width) = (self.channels(), self.buffers.width);
        let kind = Kind::KernelPyramid;
        let Some(part) = Part::new(self.buffers, self.noise.as_ref(), branch, kind) else { return };
        let rows = self.values.par_chunks_mut(channels * width).enumerate();
        rows.for_each(|(y, row)| part.add_light(y * width..(y + 1) * width, row));
    }

    /// Makes this, so far the mean of `count` pictures, the mean of them and of the same picture denoised in another
    /// orientation.
    pub(super) fn average(&mut self, count: usize, turned: &Picture<'_>) {
        let (channels, width, turned_width) =
            (self.channels(), self.buffers.width, turned.buffers.width);
        let part = (count as f32 + 1.0).recip();
        self.values.par_chunks_mut(channels * width).enumerate().for_each(|(y, row)| {
            for x in 0..width {
                let [turned_y, turned_x] = turned.buffers.place([y, x]);
                let other = &turned.values[turned_y * channels * turned_width + turned_x..];
                let other = other.iter().step_by(turned_width);
                // As many as there are channels.
                for (mean, other) in row[x..].iter_mut().step_by(width).zip(other) {
                    *mean += (other - *mean) * part;
                }
            }
        });
    }

    /// The picture when all is added, before any mixing; `[3, height, width]`.
    pub(super) fn denoised(&self) -> Image {
        let (width, height, channels) = (self.buffers.width, self.buffers.height, self.channels());
        let mut image = Vec::with_capacity(3 * height * width);
        for channel in 0..3 {
            for row in self.values.chunks(channels * width) {
                image.extend_from_slice(&row[channel * width..][..width]);
            }
        }
        Image::from_shape_vec((3, height, width), image).expect("three planes of all rows")
    }

    /// The picture when all is added, mixed with the noisy one where filtering harms.
    pub(super) fn finish(self) -> (Image, Option<Fractions>) {
        let mut image = self.denoised();
        let Some(known) = &self.noise else { return (image, None) };
        let width = self.buffers.width;
        let lights: Vec<_> = Branch::ALL
            .into_iter()
            .filter_map(|b| Part::new(self.buffers, Some(known), b, Kind::KernelPyramid))
            .collect();
        let parts = denoised_parts(&self.values, width, |y, row| {
            lights.iter().for_each(|light| light.add_light(y * width..(y + 1) * width, row));
        });
        let fractions = mix(&self.buffers.beauty, &mut image, &parts);
        (image, Some(fractions))
    }
}

/// The light of a branch and the domain in which its kernels work.
struct Part<'a> {
    light: Planes<'a>,
    noise: Option<&'a Noise>,
    branch: Branch,
    domain: Domain<'a>,
}

/// Where kernels are applied.
#[derive(Clone, Copy)]
enum Domain<'a> {
    /// To a multiple of the radiance.
    Linear(Modulation<'a>),
    /// To `ln(1 + max(c, 0))`.
    Logarithmic,
}

impl<'a> Part<'a> {
    /// `None` where the picture has no such branch.
    fn new(
        buffers: &'a Buffers<'a>,
        noise: Option<&'a Noise>,
        branch: Branch,
        kind: Kind,
    ) -> Option<Self> {
        let domain = match (kind, branch) {
            (Kind::KernelPyramid, _) => {
                Domain::Linear(buffers.modulation(branch, buffers.exposure))
            }
            (Kind::Kernel { .. }, Branch::Diffuse) => {
                Domain::Linear(buffers.modulation(branch, 1.0))
            }
            (Kind::Kernel { .. }, Branch::Specular) => Domain::Logarithmic,
        };
        Some(Self { light: buffers.light(branch)?, noise, branch, domain })
    }

    /// Adds the light of a row of pixels and, where it is known, its noise to `[channels, width]`.
    fn add_light(&self, pixels: Range<usize>, out: &mut [f32]) {
        let width = pixels.len();
        let (light, noise) = out.split_at_mut(3 * width);
        for (channel, out) in light.chunks_mut(width).enumerate() {
            let mean = &self.light.mean(channel)[pixels.clone()];
            out.iter_mut().zip(mean).for_each(|(out, mean)| *out += mean);
        }
        let Some(known) = self.noise else { return };
        for (channel, out) in noise.chunks_mut(width).enumerate() {
            let variance = &self.light.variance(channel)[pixels.clone()];
            for ((out, variance), sign) in
                out.iter_mut().zip(variance).zip(known.signs(self.branch, pixels.clone()))
            {
                *out += sign * variance.sqrt();
            }
        }
    }

    /// Turns radiance and noise of a row of pixels, `[channels, width]`, into what the kernels are applied to. The noise of a
    /// logarithm is by the delta method.
    fn to_signal(&self, pixels: Range<usize>, row: &mut [f32]) {
        match self.domain {
            Domain::Linear(modulation) => {
                scale(row, pixels, |channel, pixel| modulation.to_signal(channel, pixel));
            }
            Domain::Logarithmic => {
                let (light, noise) = row.split_at_mut(3 * pixels.len());
                for (noise, light) in noise.iter_mut().zip(light.iter()) {
                    *noise /= 1.0 + light.max(0.0);
                }
                light.iter_mut().for_each(|light| *light = logarithm(*light));
            }
        }
    }

    /// The inverse of [`Self::to_signal`].
    fn to_radiance(&self, pixels: Range<usize>, row: &mut [f32]) {
        match self.domain {
            Domain::Linear(modulation) => {
                scale(row, pixels, |channel, pixel| modulation.to_radiance(channel, pixel));
            }
            Domain::Logarithmic => {
                let (light, noise) = row.split_at_mut(3 * pixels.len());
                light.iter_mut().for_each(|light| *light = exponential(*light));
                for (noise, light) in noise.iter_mut().zip(light.iter()) {
                    *noise *= 1.0 + light;
                }
            }
        }
    }
}

/// Multiplies light and noise of a row of pixels, `[channels, width]`, by a factor of each channel and pixel.
fn scale(row: &mut [f32], pixels: Range<usize>, factor: impl Fn(usize, usize) -> f32) {
    for (channel, values) in row.chunks_mut(pixels.len()).enumerate() {
        for (value, pixel) in values.iter_mut().zip(pixels.clone()) {
            *value *= factor(channel % 3, pixel);
        }
    }
}
