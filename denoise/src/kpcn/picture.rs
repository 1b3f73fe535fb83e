//! From tiles of signal to the picture: what the kernels are applied to, and what is made of the result.

use ndarray::s;
use rayon::prelude::*;

use super::buffers::{Buffers, Modulation, Planes};
use super::network::{Branch, Kind};
use super::noise::Noise;
use super::tile::Tile;
use super::transform::{exponential, logarithm};
use crate::blend::{Evidence, Fractions, terms};
use crate::layers::Image;

/// Channels of a signal: three of light, and three of a sample of its noise where the noise is known.
pub(super) const WITH_NOISE: usize = 6;

/// Channels of a signal without its noise.
pub(super) const WITHOUT_NOISE: usize = 3;

/// The picture that is being denoised.
pub(super) struct Picture<'a> {
    pub(super) buffers: &'a Buffers<'a>,
    noise: Option<Noise<'a>>,
    image: Image,
    evidence: Option<Evidence>,
}

/// A filtered signal of a tile and the branch it is of: `[height, channels, width]`.
pub(super) struct Filtered {
    pub(super) branch: Branch,
    pub(super) kind: Kind,
    pub(super) signal: Vec<f32>,
}

/// Light and noise of one branch in a pixel, of all channels.
type Light = [[f32; 3]; 2];

impl<'a> Picture<'a> {
    /// Black, until tiles are [put](Self::put) into it.
    pub(super) fn new(buffers: &'a Buffers<'a>) -> Self {
        let (width, height) = (buffers.width, buffers.height);
        let noise = buffers.knows_noise().then(|| Noise::new(buffers));
        let evidence = noise.is_some().then(|| Evidence::new(width, height));
        Self { buffers, noise, image: Image::zeros((3, height, width)), evidence }
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
        let Some(part) = Part::new(self, branch, kind) else { return Vec::new() };
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

    /// Puts the core of a tile into the picture. A branch that was not filtered adds its noisy light.
    pub(super) fn put(&mut self, tile: &Tile, filtered: &[Filtered]) {
        let parts: Vec<_> = Branch::ALL
            .into_iter()
            .filter_map(|branch| {
                let filtered = filtered.iter().find(|filtered| filtered.branch == branch);
                let kind = filtered.map_or(Kind::KernelPyramid, |filtered| filtered.kind);
                Some((Part::new(self, branch, kind)?, filtered))
            })
            .collect();
        let channels = self.channels();
        let width = tile.columns.len();
        let rows: Vec<Vec<([f32; 3], [f64; 3])>> = tile
            .core_rows
            .clone()
            .into_par_iter()
            .map(|y| {
                let pixels = tile.core_columns.clone().map(|x| {
                    let pixel = y * self.buffers.width + x;
                    let [mut noisy, mut denoised]: [Light; 2] = Default::default();
                    for (part, filtered) in &parts {
                        let light = part.light(pixel);
                        let mut result = light;
                        if let Some(filtered) = filtered {
                            let row = (y - tile.rows.start) * channels * width;
                            let at = row + x - tile.columns.start;
                            let number = |channel| filtered.signal[at + channel * width];
                            result[0] = [0, 1, 2].map(number);
                            if channels == WITH_NOISE {
                                result[1] = [3, 4, 5].map(number);
                            }
                            result = part.radiance(result, pixel);
                        }
                        add(&mut noisy, light);
                        add(&mut denoised, result);
                    }
                    let [light, noise] = noisy;
                    (denoised[0], terms(light, denoised[0], noise, denoised[1]))
                });
                pixels.collect()
            })
            .collect();
        for (y, row) in tile.core_rows.clone().zip(rows) {
            for (x, (colour, terms)) in tile.core_columns.clone().zip(row) {
                self.image.slice_mut(s![.., y, x]).assign(&ndarray::aview1(&colour));
                if let Some(evidence) = &mut self.evidence {
                    evidence.tell(y * self.buffers.width + x, terms);
                }
            }
        }
    }

    /// The picture as it was put together.
    #[cfg(test)]
    pub(super) fn unmixed(&self) -> &Image {
        &self.image
    }

    /// The picture when all tiles are in it, mixed with the noisy one where filtering harms.
    pub(super) fn finish(mut self) -> (Image, Option<Fractions>) {
        let fractions =
            self.evidence.map(|evidence| evidence.blend(&self.buffers.beauty, &mut self.image));
        (self.image, fractions)
    }
}

fn add(sum: &mut Light, light: Light) {
    for (sum, value) in sum.as_flattened_mut().iter_mut().zip(light.as_flattened()) {
        *sum += value;
    }
}

/// The light of a branch and the domain in which its kernels work.
struct Part<'a> {
    light: Planes<'a>,
    noise: Option<&'a Noise<'a>>,
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
    fn new(picture: &'a Picture<'a>, branch: Branch, kind: Kind) -> Option<Self> {
        let buffers = picture.buffers;
        let domain = match (kind, branch) {
            (Kind::KernelPyramid, _) => {
                Domain::Linear(buffers.modulation(branch, buffers.exposure))
            }
            (Kind::Kernel { .. }, Branch::Diffuse) => {
                Domain::Linear(buffers.modulation(branch, 1.0))
            }
            (Kind::Kernel { .. }, Branch::Specular) => Domain::Logarithmic,
        };
        Some(Self { light: buffers.light(branch)?, noise: picture.noise.as_ref(), branch, domain })
    }

    /// Radiance and noise of a pixel.
    #[inline]
    fn light(&self, pixel: usize) -> Light {
        let sign = self.noise.map_or(0.0, |noise| noise.signs(pixel)[self.branch as usize]);
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
