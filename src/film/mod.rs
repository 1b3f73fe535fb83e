//! Sums per pixel, in two independent halves, and the layers that come out of them: of samples, each of which belongs to a
//! pixel ([`Film`]), and of splats, which fall where they like ([`SplatFilm`]).

mod splat;
#[cfg(test)]
mod splat_tests;
#[cfg(test)]
mod tests;
mod tile;

pub use splat::{Radiance, Scale, SplatFilm};
pub use tile::{Tile, tiles};

use crate::integrator::PathSample;
use crate::math::Sum;
use crate::scene::{FilmSettings, Requirements};
use ndarray::Array3;
use quietlight_denoise::{Image, Layer, LayerKind, Layers};
use serde::{Deserialize, Serialize};

/// How many numbers a sample has in each layer, in the order in which [`values`] lists them.
const CHANNELS: [(LayerKind, usize); 9] = [
    (LayerKind::Beauty, 3),
    (LayerKind::Diffuse, 3),
    (LayerKind::Specular, 3),
    (LayerKind::Albedo, 3),
    (LayerKind::Normal, 3),
    (LayerKind::Position, 3),
    (LayerKind::Depth, 1),
    (LayerKind::Texture2, 3),
    (LayerKind::Visibility, 1),
];

/// Numbers of all layers together.
const VALUES: usize = 23;

/// A sample as one row of numbers.
fn values(sample: &PathSample) -> [f32; VALUES] {
    let (d, s, a, t) = (sample.diffuse, sample.specular, sample.albedo, sample.texture2);
    let (n, p) = (sample.normal, sample.position);
    [
        d.r + s.r,
        d.g + s.g,
        d.b + s.b,
        d.r,
        d.g,
        d.b,
        s.r,
        s.g,
        s.b,
        a.r,
        a.g,
        a.b,
        n.x,
        n.y,
        n.z,
        p.x,
        p.y,
        p.z,
        sample.depth,
        t.r,
        t.g,
        t.b,
        sample.visibility,
    ]
}

/// Sums of one number over the samples of a pixel, in whatever order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sums {
    /// Sum over each half.
    half: [Sum; 2],
    /// Sum of squares over both.
    squares: Sum,
}

/// Samples of one pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Counts {
    /// Finite samples in each half.
    half: [u32; 2],
    /// Non-finite samples, dropped.
    invalid: u32,
}

/// Where the samples of a picture add up.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Film {
    settings: FilmSettings,
    /// Which numbers of [`values`] are kept: all or none of a layer.
    kept: Vec<usize>,
    tiles: Vec<Tile>,
}

impl Film {
    /// A film without samples, with the layers that the scene requires.
    pub fn new(settings: FilmSettings, requirements: &Requirements) -> Self {
        Self::of(settings, |kind| requirements.needs(kind))
    }

    /// A film for methods that take their features from elsewhere: of the layers that the scene requires, those of light.
    pub fn of_radiance(settings: FilmSettings, requirements: &Requirements) -> Self {
        Self::of(settings, |kind| kind.is_radiance() && requirements.needs(kind))
    }

    fn of(settings: FilmSettings, is_kept: impl Fn(LayerKind) -> bool) -> Self {
        let (mut kept, mut first) = (Vec::new(), 0);
        for (kind, channels) in CHANNELS {
            if is_kept(kind) {
                kept.extend(first..first + channels);
            }
            first += channels;
        }
        debug_assert_eq!(first, VALUES);
        let tiles = tiles(settings.crop, kept.len());
        Self { settings, kept, tiles }
    }

    /// Bytes that a film of this size and these layers takes.
    pub fn bytes(settings: FilmSettings, requirements: &Requirements) -> u64 {
        Self::bytes_of(settings, |kind| requirements.needs(kind))
    }

    /// Bytes that a film of [`Film::of_radiance`] takes.
    pub fn radiance_bytes(settings: FilmSettings, requirements: &Requirements) -> u64 {
        Self::bytes_of(settings, |kind| kind.is_radiance() && requirements.needs(kind))
    }

    /// Bytes that the layers take that [`Film::layers`] makes: mean, variance and two halves of each, and two counts.
    pub fn layer_bytes(settings: FilmSettings, requirements: &Requirements) -> u64 {
        let each = 4 * Self::count(|kind| requirements.needs(kind)) + 2;
        settings.crop_pixels().saturating_mul((each * size_of::<f32>()) as u64)
    }

    /// Numbers of a sample in the layers that are kept.
    fn count(is_kept: impl Fn(LayerKind) -> bool) -> usize {
        CHANNELS.iter().filter(|(kind, _)| is_kept(*kind)).map(|&(_, channels)| channels).sum()
    }

    fn bytes_of(settings: FilmSettings, is_kept: impl Fn(LayerKind) -> bool) -> u64 {
        let kept = Self::count(is_kept);
        let each = kept * size_of::<Sums>() + size_of::<Counts>();
        settings.crop_pixels().saturating_mul(each as u64)
    }

    /// Layers that are kept, with the number of their channels.
    fn kept_layers(&self) -> impl Iterator<Item = (LayerKind, usize)> {
        let with_first = CHANNELS.iter().scan(0, |first, &(kind, channels)| {
            *first += channels;
            Some((kind, channels, *first - channels))
        });
        let is_kept = |first: usize| self.kept.binary_search(&first).is_ok();
        with_first.filter(move |&(.., first)| is_kept(first)).map(|(kind, n, _)| (kind, n))
    }

    /// Adds all samples of another film of the same size and layers. In which order films are merged does not show.
    ///
    /// # Panics
    /// If the other film has another size or other layers.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.settings.crop, other.settings.crop, "films of one size");
        assert_eq!(self.kept, other.kept, "films of the same layers");
        for (tile, more) in self.tiles.iter_mut().zip(&other.tiles) {
            tile.merge(more);
        }
    }

    /// The tiles and the list of kept numbers, for workers that each fill one tile.
    pub(crate) fn tiles_mut(&mut self) -> (&mut [Tile], &[usize]) {
        (&mut self.tiles, &self.kept)
    }

    /// Non-finite samples dropped so far.
    pub fn invalid_samples(&self) -> u64 {
        self.tiles.iter().flat_map(|tile| &tile.counts).map(|count| u64::from(count.invalid)).sum()
    }

    /// Means, variances of the mean and halves of all layers. `offset` is added to positions: it is what the scene
    /// subtracted when it was loaded.
    ///
    /// The variance is that of independent samples, `Σ(x − x̄)² / (n (n − 1))`; stratified samples have less, which
    /// `quietlight_denoise::variance` corrects by the halves. Beauty is the sum of diffuse and specular, exactly. A pixel
    /// with one sample has no variance and its halves are equal; a pixel without any is black.
    pub fn layers(&self, offset: glam::DVec3) -> Layers {
        let [_, _, width, height] = self.settings.crop.map(|number| number as usize);
        let mut layers = Layers { width, height, ..Layers::default() };
        let mut first = 0;
        for (kind, channels) in self.kept_layers() {
            let shift: [f64; 3] =
                if kind == LayerKind::Position { offset.to_array() } else { [0.0; 3] };
            layers.layers.insert(kind, self.layer(first, channels, shift));
            first += channels;
        }
        sum_to_beauty(&mut layers);
        layers.samples = Some(self.image_of(|count| (count.half[0] + count.half[1]) as f32));
        layers.invalid = Some(self.image_of(|count| count.invalid as f32));
        layers
    }

    /// One layer from the sums that start at `first`.
    fn layer(&self, first: usize, channels: usize, shift: [f64; 3]) -> Layer {
        let [_, _, width, height] = self.settings.crop.map(|number| number as usize);
        let blank = || Array3::<f32>::zeros((channels, height, width));
        let (mut mean, mut variance, mut a, mut b) = (blank(), blank(), blank(), blank());
        for tile in &self.tiles {
            for (index, [x, y]) in tile.pixels().enumerate() {
                let counts = tile.counts[index];
                let sums = &tile.sums[index * self.kept.len()..][first..first + channels];
                let [na, nb] = counts.half.map(f64::from);
                let n = na + nb;
                if n == 0.0 {
                    continue;
                }
                for (channel, sum) in sums.iter().enumerate() {
                    let at = [channel, y as usize, x as usize];
                    let [sum_a, sum_b] = sum.half.map(Sum::value);
                    let mut whole = sum.half[0];
                    whole += sum.half[1];
                    let centre = whole.value() / n;
                    mean[at] = (centre + shift[channel]) as f32;
                    if n > 1.0 {
                        variance[at] = ((sum.squares.value() / n - centre * centre).max(0.0)
                            / (n - 1.0)) as f32;
                    }
                    let half = |sum: f64, n: f64| if n > 0.0 { sum / n } else { centre };
                    a[at] = (half(sum_a, na) + shift[channel]) as f32;
                    b[at] = (half(sum_b, nb) + shift[channel]) as f32;
                }
            }
        }
        Layer { mean, variance: Some(variance), halves: Some([a, b]) }
    }

    /// One number of each pixel's counts, as an image.
    fn image_of(&self, number: impl Fn(&Counts) -> f32) -> Image {
        let [_, _, width, height] = self.settings.crop.map(|number| number as usize);
        let mut image = Array3::zeros((1, height, width));
        for tile in &self.tiles {
            for (index, [x, y]) in tile.pixels().enumerate() {
                image[[0, y as usize, x as usize]] = number(&tile.counts[index]);
            }
        }
        image
    }
}

/// Makes the beauty the sum of diffuse and specular to the last bit, in the mean and in both halves.
pub(crate) fn sum_to_beauty(layers: &mut Layers) {
    let (Some(diffuse), Some(specular)) =
        (layers.layers.get(&LayerKind::Diffuse), layers.layers.get(&LayerKind::Specular))
    else {
        return;
    };
    let mean = &diffuse.mean + &specular.mean;
    let halves = match (&diffuse.halves, &specular.halves) {
        (Some([da, db]), Some([sa, sb])) => Some([da + sa, db + sb]),
        _ => None,
    };
    if let Some(beauty) = layers.layers.get_mut(&LayerKind::Beauty) {
        beauty.mean = mean;
        beauty.halves = halves;
    }
}
