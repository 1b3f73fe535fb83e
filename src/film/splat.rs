//! Sums of splats per pixel, in two independent halves.

use super::sum_to_beauty;
use crate::integrator::Splat;
use crate::math::Sum;
use crate::scene::FilmSettings;
use ndarray::{Array3, Zip};
use quietlight_denoise::{Image, Layer, LayerKind, Layers};
use serde::{Deserialize, Serialize};

/// Splats that fell on one pixel, in whatever order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Pixel {
    /// Sums over each half: diffuse and specular red, green, blue.
    half: [[Sum; 6]; 2],
    /// Non-finite splats, dropped.
    invalid: u32,
}

/// Sums of the squares of one pixel's splats: of beauty, diffuse and specular.
type Squares = [[Sum; 3]; 3];

/// Where splats add up. A splat counts in the pixel that holds it (a box filter); those outside of the crop window are
/// not kept. There are no atomics: workers collect splats and the film takes them in a fixed order, so that the bits do
/// not depend on who was faster.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SplatFilm {
    settings: FilmSettings,
    /// The pixels of the crop window, row by row.
    pixels: Vec<Pixel>,
    /// As many, or none where splats are not independent.
    squares: Vec<Squares>,
    /// Splats whose place is not a number, dropped.
    nowhere: u64,
}

/// What makes pixel values out of the sums of a [`SplatFilm`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The sum of each half times its factor is a picture.
    pub half: [f64; 2],
    /// The mean picture is that of the halves with these weights, which sum to 1. A half of weight 0 has no samples: its
    /// picture is the mean.
    pub weight: [f64; 2],
}

/// What splats do to the radiance of the layers that they are put into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Radiance {
    /// Splats are all light there is.
    Replaced,
    /// Splats come to what is there.
    Added,
}

impl Scale {
    /// Splats of `samples` samples per pixel, those of even index in the first half.
    pub fn of_samples(samples: u32) -> Self {
        let counts = [samples.div_ceil(2), samples / 2].map(f64::from);
        let each = |count: f64| if count > 0.0 { 1.0 / count } else { 0.0 };
        Self { half: counts.map(each), weight: counts.map(|count| count * each(samples.into())) }
    }
}

impl SplatFilm {
    /// Bytes that a film of this size takes: of splats that are independent, or of others.
    pub fn bytes(settings: FilmSettings, is_independent: bool) -> u64 {
        let squares = if is_independent { size_of::<Squares>() } else { 0 };
        settings.crop_pixels().saturating_mul((size_of::<Pixel>() + squares) as u64)
    }

    /// A film without splats.
    pub fn new(settings: FilmSettings) -> Self {
        let [_, _, columns, rows] = settings.crop.map(|number| number as usize);
        Self {
            settings,
            pixels: vec![Pixel::default(); columns * rows],
            squares: Vec::new(),
            nowhere: 0,
        }
    }

    /// A film for independent splats, which keeps their squares: these give a variance for each pixel. Those of a Markov
    /// chain say nothing of its variance.
    pub fn of_independent(settings: FilmSettings) -> Self {
        let film = Self::new(settings);
        Self { squares: vec![Squares::default(); film.pixels.len()], ..film }
    }

    /// Adds a splat to half 0 or 1. One that is not finite, in itself or in the sum of its parts, is counted as invalid and
    /// dropped.
    pub fn add(&mut self, half: usize, splat: &Splat) {
        let Some(index) = self.pixel_at(splat) else { return };
        let pixel = &mut self.pixels[index];
        let (diffuse, specular) = (splat.diffuse, splat.specular);
        if !(diffuse + specular).is_finite() {
            pixel.invalid += 1;
            return;
        }
        let values = [diffuse.r, diffuse.g, diffuse.b, specular.r, specular.g, specular.b];
        for (sum, value) in pixel.half[half].iter_mut().zip(values) {
            *sum += f64::from(value);
        }
        if let Some(squares) = self.squares.get_mut(index) {
            for (sums, color) in squares.iter_mut().zip([diffuse + specular, diffuse, specular]) {
                for (sum, value) in sums.iter_mut().zip(color.to_array()) {
                    *sum += f64::from(value) * f64::from(value);
                }
            }
        }
    }

    /// Adds splats in their order.
    pub fn add_all(&mut self, half: usize, splats: &[Splat]) {
        splats.iter().for_each(|splat| self.add(half, splat));
    }

    /// Adds sums of radiance, diffuse and specular, of the crop window's pixels row by row; and, to a film of splats whose
    /// squares are kept, something that the variances of beauty, diffuse and specular are in proportion to.
    pub(crate) fn add_sums(
        &mut self,
        half: usize,
        sums: impl Iterator<Item = ([[Sum; 3]; 2], [f64; 3])>,
    ) {
        for (index, (pixel, (more, spread))) in self.pixels.iter_mut().zip(sums).enumerate() {
            let all = pixel.half[half].iter_mut().zip(more.as_flattened());
            all.for_each(|(sum, more)| *sum += *more);
            for (squares, spread) in self.squares.get_mut(index).into_iter().flatten().zip(spread) {
                squares.iter_mut().for_each(|sum| *sum += spread);
            }
        }
    }

    /// Adds all that is on another film of the same size. In which order films are merged does not show.
    ///
    /// # Panics
    /// If the other film has another size, or one keeps squares and the other does not.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.settings.crop, other.settings.crop, "films of one size");
        assert_eq!(self.squares.len(), other.squares.len(), "films of one kind");
        for (pixel, more) in self.pixels.iter_mut().zip(&other.pixels) {
            let sums = pixel.half.as_flattened_mut().iter_mut();
            sums.zip(more.half.as_flattened()).for_each(|(sum, more)| *sum += *more);
            pixel.invalid += more.invalid;
        }
        let sums = self.squares.as_flattened_mut().as_flattened_mut().iter_mut();
        sums.zip(other.squares.as_flattened().as_flattened()).for_each(|(sum, more)| *sum += *more);
        self.nowhere += other.nowhere;
    }

    /// The film whose numbers are those of `self`, but where they exceed `limit` times the median of the 3×3 pixels around them
    /// on another film: there they are that median. It is darker, in no way that could be predicted.
    ///
    /// # Panics
    /// If the other film has another size.
    pub fn limited_by(&self, other: &Self, limit: f64) -> Self {
        assert_eq!(self.settings.crop, other.settings.crop, "films of one size");
        let [_, _, columns, rows] = self.settings.crop.map(|number| number as usize);
        let mut limited = self.clone();
        let mut around = Vec::with_capacity(9);
        for (index, pixel) in limited.pixels.iter_mut().enumerate() {
            let (x, y) = (index % columns, index / columns);
            for (half, sums) in pixel.half.iter_mut().enumerate() {
                for (place, sum) in sums.iter_mut().enumerate() {
                    around.clear();
                    for row in y.saturating_sub(1)..(y + 2).min(rows) {
                        for column in x.saturating_sub(1)..(x + 2).min(columns) {
                            let sum = other.pixels[row * columns + column].half[half][place];
                            around.push(sum.value());
                        }
                    }
                    around.sort_by(f64::total_cmp);
                    let middle = around.len() / 2;
                    let median = 0.5 * (around[middle] + around[(around.len() - 1) / 2]);
                    if sum.value() > limit * median {
                        *sum = median.into();
                    }
                }
            }
        }
        limited
    }

    /// Sum of all colours of all splats kept.
    pub fn total(&self) -> f64 {
        let sums =
            |pixel: &Pixel| pixel.half.as_flattened().iter().map(|sum| sum.value()).sum::<f64>();
        self.pixels.iter().map(sums).sum()
    }

    /// Non-finite splats dropped so far.
    pub fn invalid_splats(&self) -> u64 {
        self.nowhere + self.pixels.iter().map(|pixel| u64::from(pixel.invalid)).sum::<u64>()
    }

    /// Puts the splats into the radiance layers of `layers`, which must be of this film's size: mean, halves and, where
    /// splats are independent, variance. The variance of others is left to be found from the halves. Beauty is the sum of
    /// diffuse and specular, exactly. Invalid splats are added to the invalid samples.
    ///
    /// The variance of a pixel's mean is `Σ x²`, scaled: of the very many samples that could have hit the pixel few did,
    /// so that the square of the mean of one is nothing against the mean of its square.
    pub fn put_into(&self, layers: &mut Layers, scale: &Scale, radiance: Radiance) {
        for (place, kind) in
            [LayerKind::Beauty, LayerKind::Diffuse, LayerKind::Specular].into_iter().enumerate()
        {
            let Some(layer) = layers.layers.get_mut(&kind) else { continue };
            let splats = self.layer(place, scale);
            match radiance {
                Radiance::Replaced => *layer = splats,
                Radiance::Added => add(layer, &splats),
            }
        }
        sum_to_beauty(layers);
        if let Some(invalid) = &mut layers.invalid {
            let counts = self.pixels.iter().map(|pixel| pixel.invalid as f32);
            invalid.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        }
    }

    /// The layer of beauty (0), diffuse (1) or specular (2).
    fn layer(&self, place: usize, scale: &Scale) -> Layer {
        let halves = [0, 1].map(|half| {
            self.image(|index, channel| {
                let sums = self.pixels[index].half[half].map(Sum::value);
                scale.half[half]
                    * match place {
                        0 => sums[channel] + sums[channel + 3],
                        1 => sums[channel],
                        _ => sums[channel + 3],
                    }
            })
        });
        let mean = Zip::from(&halves[0]).and(&halves[1]).map_collect(|a, b| {
            let whole: f64 = scale.weight[0] * a + scale.weight[1] * b;
            whole as f32
        });
        // What one splat adds to the mean; the same in both halves where they have samples.
        let each = (scale.half[0] * scale.weight[0]).max(scale.half[1] * scale.weight[1]);
        let variance = (!self.squares.is_empty()).then(|| {
            self.image(|index, channel| each * each * self.squares[index][place][channel].value())
                .mapv(|value| value as f32)
        });
        let [a, b] = halves;
        let half = |image: Array3<f64>, weight: f64| {
            if weight > 0.0 { image.mapv(|value| value as f32) } else { mean.clone() }
        };
        let halves = Some([half(a, scale.weight[0]), half(b, scale.weight[1])]);
        Layer { mean, variance, halves }
    }

    /// An image of three channels out of one number for each pixel's index and channel.
    fn image(&self, number: impl Fn(usize, usize) -> f64) -> Array3<f64> {
        let [_, _, columns, rows] = self.settings.crop.map(|number| number as usize);
        Array3::from_shape_fn((3, rows, columns), |(channel, y, x)| {
            number(y * columns + x, channel)
        })
    }

    /// Index of the pixel of the crop window that holds the splat; `None` outside of it. A splat at no place at all is
    /// counted.
    fn pixel_at(&mut self, splat: &Splat) -> Option<usize> {
        let raster = splat.raster;
        if !raster.is_finite() {
            self.nowhere += 1;
            return None;
        }
        self.settings.crop_pixel(raster)
    }
}

/// Adds one layer to another of independent errors.
fn add(layer: &mut Layer, more: &Layer) {
    let sum = |a: &Image, b: &Image| a + b;
    layer.mean += &more.mean;
    layer.variance = layer.variance.as_ref().zip(more.variance.as_ref()).map(|(a, b)| sum(a, b));
    layer.halves = layer
        .halves
        .as_ref()
        .zip(more.halves.as_ref())
        .map(|([a, b], [more_a, more_b])| [sum(a, more_a), sum(b, more_b)]);
}
