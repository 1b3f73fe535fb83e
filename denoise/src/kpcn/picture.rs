//! From tiles of signal to the picture: what the kernels are applied to, and what is made of the result.

use rayon::prelude::*;

use super::buffers::{Buffers, Modulation, Planes};
use super::network::{Branch, Kind};
use super::noise::Noise;
use super::tile::Tile;
use super::transform::{exponential, logarithm};
use crate::blend::{Fractions, Pixel, denoised_parts, mix};
use crate::layers::Image;

/// Channels of a signal: three of light, and three of a sample of its noise where the noise is known.
pub(super) const WITH_NOISE: usize = 6;

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

/// Light and noise of one branch in a pixel, of all channels.
type Light = [[f32; 3]; 2];

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
            for (x, pixel) in (start..start + width).enumerate() {
                let numbers = part.signal(pixel);
                for (channel, number) in numbers.as_flattened()[..channels].iter().enumerate() {
                    row[channel * width + x] = *number;
                }
            }
        });
        signal
    }

    /// Adds the core of a filtered tile.
    pub(super) fn add(&mut self, tile: &Tile, filtered: &Filtered) {
        let (channels, width) = (self.channels(), self.buffers.width);
        let (branch, kind) = (filtered.branch, filtered.kind);
        let Some(part) = Part::new(self.buffers, self.noise.as_ref(), branch, kind) else { return };
        let own_width = tile.columns.len();
        let rows = self.values.par_chunks_mut(channels * width).enumerate();
        rows.skip(tile.core_rows.start).take(tile.core_rows.len()).for_each(|(y, row)| {
            let start = (y - tile.rows.start) * channels * own_width;
            let source = &filtered.signal[start..start + channels * own_width];
            for x in tile.core_columns.clone() {
                let mut light = Light::default();
                for (channel, number) in light.as_flattened_mut()[..channels].iter_mut().enumerate()
                {
                    *number = source[channel * own_width + x - tile.columns.start];
                }
                let light = part.radiance(light, y * width + x);
                for (channel, number) in light.as_flattened()[..channels].iter().enumerate() {
                    row[channel * width + x] += number;
                }
            }
        });
    }

    /// Adds the noisy light of a branch that is not filtered.
    pub(super) fn add_noisy(&mut self, branch: Branch) {
        let (channels, width) = (self.channels(), self.buffers.width);
        let kind = Kind::KernelPyramid;
        let Some(part) = Part::new(self.buffers, self.noise.as_ref(), branch, kind) else { return };
        self.values.par_chunks_mut(channels * width).enumerate().for_each(|(y, row)| {
            for x in 0..width {
                let light = part.light(y * width + x);
                for (channel, number) in light.as_flattened()[..channels].iter().enumerate() {
                    row[channel * width + x] += number;
                }
            }
        });
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
        let (width, height) = (self.buffers.width, self.buffers.height);
        let parts: Vec<_> = Branch::ALL
            .into_iter()
            .filter_map(|b| Part::new(self.buffers, Some(known), b, Kind::KernelPyramid))
            .collect();
        let parts = denoised_parts(width, height, |pixel| {
            let row = &self.values[pixel / width * WITH_NOISE * width..][..WITH_NOISE * width];
            let number = |channel: usize| row[channel * width + pixel % width];
            let [mut light, mut noise] = Light::default();
            let signs = known.signs(pixel);
            for part in &parts {
                let [more_light, more_noise] = part.light_of(pixel, signs);
                for channel in 0..3 {
                    light[channel] += more_light[channel];
                    noise[channel] += more_noise[channel];
                }
            }
            Pixel {
                noisy: light,
                denoised: [0, 1, 2].map(number),
                noise,
                filtered_noise: [3, 4, 5].map(number),
            }
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

    /// Radiance and noise of a pixel.
    #[inline]
    fn light(&self, pixel: usize) -> Light {
        self.light_of(pixel, self.noise.map_or([0.0; 2], |noise| noise.signs(pixel)))
    }

    /// The same where the signs of the noise are known.
    #[inline]
    fn light_of(&self, pixel: usize, signs: [f32; 2]) -> Light {
        let sign = signs[self.branch as usize];
        [
            std::array::from_fn(|channel| self.light.mean(channel)[pixel]),
            std::array::from_fn(|channel| sign * self.light.variance(channel)[pixel].sqrt()),
        ]
    }

    /// What the kernels are applied to: signal and noise of a pixel. The noise of a logarithm is by the delta method.
    #[inline]
    fn signal(&self, pixel: usize) -> Light {
        let [mut light, mut noise] = self.light(pixel);
        for channel in 0..3 {
            match self.domain {
                Domain::Linear(modulation) => {
                    let factor = modulation.to_signal(channel, pixel);
                    light[channel] *= factor;
                    noise[channel] *= factor;
                }
                Domain::Logarithmic => {
                    noise[channel] /= 1.0 + light[channel].max(0.0);
                    light[channel] = logarithm(light[channel]);
                }
            }
        }
        [light, noise]
    }

    /// Radiance and noise of a signal; the inverse of [`Self::signal`].
    #[inline]
    fn radiance(&self, [mut light, mut noise]: Light, pixel: usize) -> Light {
        for channel in 0..3 {
            match self.domain {
                Domain::Linear(modulation) => {
                    let factor = modulation.to_radiance(channel, pixel);
                    light[channel] *= factor;
                    noise[channel] *= factor;
                }
                Domain::Logarithmic => {
                    light[channel] = exponential(light[channel]);
                    noise[channel] *= 1.0 + light[channel];
                }
            }
        }
        [light, noise]
    }
}
