//! The 36 secondary features (METHODS 9.4; Kalantari, Bako and Sen 2015, section 3.1): what the network sees of a pixel's
//! surroundings.
//!
//! Each of the first 30 and the last five is the mean over the channels of one group. Windows are clipped at the borders
//! of the picture where nothing else is said.

use ndarray::s;

use super::detail::detail_deviation;
use super::features::{Feature, GROUPS};
use crate::layers::Image;
use crate::simd::{Kernel, vectorise};
use crate::window::clipped;

/// Number of secondary features.
pub(super) const COUNT: usize = 36;

/// First index of the features of each sort; a sort has one for each group, in the order of [`GROUPS`].
const DEVIATION_OF_DETAIL: usize = 0;
const MEAN: usize = 5;
const DEVIATION: usize = 10;
const BLOCK_MEAN: usize = 15;
const BLOCK_DEVIATION: usize = 20;
const MEAN_DEVIATION: usize = 25;
/// One over the number of samples; the only one that is of no group.
const SAMPLING_RATE: usize = 30;
const GRADIENT: usize = 31;

/// Radius of the block of [`BLOCK_MEAN`] and [`BLOCK_DEVIATION`].
const BLOCK_RADIUS: usize = 3;

/// Name of each secondary feature, as in the file of the weights.
pub(super) fn names() -> Vec<String> {
    let sorts = ["mad", "mean", "std", "block_mean", "block_std", "mean_deviation"];
    let of_groups = |sort: &'static str| GROUPS.map(|kind| format!("{sort}.{}", kind.name()));
    sorts
        .into_iter()
        .flat_map(of_groups)
        .chain(["sampling_rate".to_owned()])
        .chain(of_groups("gradient"))
        .collect()
}

/// What the secondary features need beside the prefiltered features.
#[derive(Debug)]
pub(super) struct Secondary {
    /// For each feature the median absolute deviation of its detail in the aligned 2×2 cells of the picture,
    /// `[channels, ⌈height / 2⌉, ⌈width / 2⌉]`.
    cells: Vec<Image>,
    /// Samples of each pixel, `[1, height, width]`.
    samples: Option<Image>,
}

impl Secondary {
    /// `features` are those before the prefilter, whose noise is what the first sort measures.
    pub(super) fn new(features: &[Feature], samples: Option<&Image>) -> Self {
        let cells = features.iter().map(|feature| detail_deviation(&feature.mean)).collect();
        Self { cells, samples: samples.cloned() }
    }

    /// Which secondary features the picture has: those of its groups, and the sampling rate where the samples are known.
    pub(super) fn present(&self, features: &[Feature]) -> [bool; COUNT] {
        std::array::from_fn(|index| match group(index) {
            Some(group) => features.iter().any(|feature| feature.group == group),
            None => self.samples.is_some(),
        })
    }

    /// The secondary features of row `y`, one row of the picture's width after the other; 0 where there are none.
    /// `features` are the prefiltered ones.
    pub(super) fn row(&self, features: &[Feature], y: usize, width: usize) -> Vec<f32> {
        let mut out = vec![0.0; COUNT * width];
        for (feature, cells) in features.iter().zip(&self.cells) {
            let (channels, ..) = feature.mean.dim();
            for channel in 0..channels {
                let average = Average { out: &mut out, width, group: feature.group, channels };
                vectorise(ChannelRow { feature, cells, channel, y, average });
            }
        }
        if let Some(samples) = &self.samples {
            let row = &mut out[SAMPLING_RATE * width..][..width];
            for (rate, &samples) in row.iter_mut().zip(samples.slice(s![0, y, ..])) {
                *rate = 1.0 / samples.max(1.0);
            }
        }
        out
    }
}

/// The group that a secondary feature is of.
fn group(index: usize) -> Option<usize> {
    match index {
        SAMPLING_RATE => None,
        GRADIENT.. => Some(index - GRADIENT),
        _ => Some(index % GROUPS.len()),
    }
}

/// The rows of one group's secondary features, to which each of its channels adds its part.
struct Average<'a> {
    out: &'a mut [f32],
    width: usize,
    group: usize,
    channels: usize,
}

impl Average<'_> {
    #[inline(always)]
    fn add(&mut self, sort: usize, values: impl Iterator<Item = f32>) {
        let part = 1.0 / self.channels as f32;
        let row = &mut self.out[(sort + self.group) * self.width..][..self.width];
        row.iter_mut().zip(values).for_each(|(sum, value)| *sum += part * value);
    }
}

/// One channel of a feature in row `y`.
struct ChannelRow<'a> {
    feature: &'a Feature,
    cells: &'a Image,
    channel: usize,
    y: usize,
    average: Average<'a>,
}

impl Kernel for ChannelRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        self.detail();
        self.pixel();
        self.block();
        self.neighbours();
    }
}

impl ChannelRow<'_> {
    /// A row of the prefiltered mean.
    #[inline(always)]
    fn mean(&self, y: usize) -> &[f32] {
        row(&self.feature.mean, self.channel, y)
    }

    /// The cells dilated: the largest that the 3×3 pixels lie in.
    #[inline(always)]
    fn detail(&mut self) {
        let (_, height, width) = self.feature.mean.dim();
        let above = self.y.saturating_sub(1) / 2;
        let below = (self.y + 1).min(height - 1) / 2;
        let rows = [above, below].map(|cell| row(self.cells, self.channel, cell));
        let largest: Vec<f32> = rows[0].iter().zip(rows[1]).map(|(a, b)| a.max(*b)).collect();
        let at =
            |x: usize| largest[x.saturating_sub(1) / 2].max(largest[(x + 1).min(width - 1) / 2]);
        self.average.add(DEVIATION_OF_DETAIL, (0..width).map(at));
    }

    #[inline(always)]
    fn pixel(&mut self) {
        let mean = row(&self.feature.mean, self.channel, self.y);
        let variance = row(&self.feature.variance, self.channel, self.y);
        self.average.add(MEAN, mean.iter().copied());
        self.average.add(DEVIATION, variance.iter().map(|variance| variance.sqrt()));
    }

    /// Mean and standard deviation (`n − 1`) in 7×7 pixels. In double precision: a difference of squares follows.
    #[inline(always)]
    fn block(&mut self) {
        let (_, height, width) = self.feature.mean.dim();
        let rows = clipped(self.y, BLOCK_RADIUS, height);
        let counts: Vec<f64> = (0..width)
            .map(|x| (rows.len() * clipped(x, BLOCK_RADIUS, width).len()) as f64)
            .collect();
        // Sums of the columns and of their squares, with room for the window to stick out.
        let [mut sums, mut squares] = [(); 2].map(|()| vec![0.0; width + 2 * BLOCK_RADIUS]);
        for y in rows {
            let sums = sums[BLOCK_RADIUS..].iter_mut().zip(&mut squares[BLOCK_RADIUS..]);
            for (&value, (sum, square)) in self.mean(y).iter().zip(sums) {
                let value = f64::from(value);
                *sum += value;
                *square += value * value;
            }
        }
        let [sums, squares] = [sums, squares].map(|columns| {
            let mut window = columns[..width].to_vec();
            for shift in 1..=2 * BLOCK_RADIUS {
                window.iter_mut().zip(&columns[shift..]).for_each(|(sum, value)| *sum += value);
            }
            window
        });
        let means = sums.iter().zip(&counts).map(|(sum, count)| (sum / count) as f32);
        let deviations = sums.iter().zip(&squares).zip(&counts).map(|((sum, square), count)| {
            let variance = (square - sum * (sum / count)) / (count - 1.0).max(1.0);
            variance.max(0.0).sqrt() as f32
        });
        self.average.add(BLOCK_MEAN, means);
        self.average.add(BLOCK_DEVIATION, deviations);
    }

    /// What 3×3 pixels tell: the mean absolute deviation from their mean, and half the squared gradient, a difference over
    /// three rows and columns of the picture with its border repeated.
    #[inline(always)]
    fn neighbours(&mut self) {
        let (_, height, width) = self.feature.mean.dim();
        let y = self.y;
        let padded = |y: usize| {
            let row = self.mean(y);
            let mut padded = Vec::with_capacity(width + 2);
            padded.push(row[0]);
            padded.extend_from_slice(row);
            padded.push(row[width - 1]);
            padded
        };
        let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(padded);
        // 1 in the columns of the picture, 0 in the two that repeat its border.
        let mut inside = vec![1.0; width + 2];
        (inside[0], inside[width + 1]) = (0.0, 0.0);
        let pixels = &rows[usize::from(y == 0)..if y + 1 < height { 3 } else { 2 }];

        let [mut means, mut deviations, mut counts] = [(); 3].map(|()| vec![0.0; width]);
        for (row, shift) in pixels.iter().flat_map(|row| (0..3).map(move |shift| (row, shift))) {
            for x in 0..width {
                means[x] += inside[x + shift] * row[x + shift];
                counts[x] += inside[x + shift];
            }
        }
        means.iter_mut().zip(&counts).for_each(|(mean, count)| *mean /= count);
        for (row, shift) in pixels.iter().flat_map(|row| (0..3).map(move |shift| (row, shift))) {
            for x in 0..width {
                deviations[x] += inside[x + shift] * (row[x + shift] - means[x]).abs();
            }
        }
        let deviations = deviations.iter().zip(&counts).map(|(sum, count)| sum / count);

        let [mut across, mut down] = [(); 2].map(|()| vec![0.0; width]);
        for (row, shift) in rows.iter().zip(0..3) {
            for x in 0..width {
                across[x] += row[x + 2] - row[x];
                down[x] += rows[2][x + shift] - rows[0][x + shift];
            }
        }
        let gradients = across.iter().zip(&down).map(|(across, down)| {
            let (across, down) = (across / 9.0, down / 9.0);
            0.5 * (across * across + down * down)
        });
        self.average.add(MEAN_DEVIATION, deviations);
        self.average.add(GRADIENT, gradients);
    }
}

/// A row of a channel of an image in the standard layout.
#[inline(always)]
fn row(image: &Image, channel: usize, y: usize) -> &[f32] {
    let (_, height, width) = image.dim();
    let pixels = image.as_slice().expect("the features are in the standard layout");
    &pixels[(channel * height + y) * width..][..width]
}
