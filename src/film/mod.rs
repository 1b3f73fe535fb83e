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
use crate::scene::{FilmSettings, Requirements};
use ndarray::Array3;
use quietlight_denoise::{Image, Layer, LayerKind, Layers};

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

/// Sums of one number over the samples of a pixel. In f64, so that 10⁸ next to 10⁻⁸ survives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sums {
    /// Sum over each half.
    half: [f64; 2],
    /// Sum of squares over both.
    squares: f64,
}

/// Samples of one pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Finite samples in each half.
    half: [u32; 2],
    /// Non-finite samples, dropped.
    invalid: u32,
}

/// Where the samples of a picture add up.
#[derive(Debug)]
pub struct Film {
    settings: FilmSettings,
    /// Which numbers of [`values`] are kept, and the layers they belong to.
    kept: Vec<usize>,
    layers: Vec<(LayerKind, usize)>,
    tiles: Vec<Tile>,
}

impl Film {
    /// A film without samples, with the layers that the scene requires.
    pub fn new(settings: FilmSettings, requirements: &Requirements) -> Self {
        Self::of(settings, |kind| requirements.needs(kind))
    }

    /// A film for methods that take their features from elsewhere: of the layers that the scene requires, those of light.
    pub fn of_radiance(settings: FilmSettings, requirements: &Requirements) -> Self {
        let is_radiance =
            |kind| matches!(kind, LayerKind::Beauty | LayerKind::Diffuse | LayerKind::Specular);
        Self::of(settings, |kind| is_radiance(kind) && requirements.needs(kind))
    }

    fn of(settings: FilmSettings, is_kept: impl Fn(LayerKind) -> bool) -> Self {
        let (mut kept, mut layers, mut first) = (Vec::new(), Vec::new(), 0);
        for (kind, channels) in CHANNELS {
            if is_kept(kind) {
                kept.extend(first..first + channels);
                layers.push((kind, channels));
            }
            first += channels;
        }
        debug_assert_eq!(first, VALUES);
        let tiles = tiles(settings.crop, kept.len());
        Self { settings, kept, layers, tiles }
    }

    /// How many numbers a film with these layers keeps of each pixel.
    pub fn numbers(requirements: &Requirements) -> usize {
        let kept = CHANNELS.iter().filter(|(kind, _)| requirements.needs(*kind));
        kept.map(|&(_, channels)| channels).sum()
    }

    /// Bytes that a film of this size and these layers takes.
    pub fn bytes(settings: FilmSettings, requirements: &Requirements) -> u64 {
        let of_pixel = Self::numbers(requirements) * size_of::<Sums>() + size_of::<Counts>();
        settings.crop_pixels() * of_pixel as u64
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
        for &(kind, channels) in &self.layers {
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
                    let [sum_a, sum_b] = sum.half;
                    let centre = (sum_a + sum_b) / n;
                    mean[at] = (centre + shift[channel]) as f32;
                    if n > 1.0 {
                        variance[at] =
                            ((sum.squares / n - centre * centre).max(0.0) / (n - 1.0)) as f32;
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
fn sum_to_beauty(layers: &mut Layers) {
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
