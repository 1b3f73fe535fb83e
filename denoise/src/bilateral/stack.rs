//! What is filtered, in the layout of the filter's kernel.

use ndarray::s;
use rayon::prelude::*;

use super::features::Feature;
use super::filter::{BLOCK, LARGEST_RADIUS, Row, TAPS};
use crate::layers::Image;
use crate::window::{fold, plane};

/// Plane of the first channel of the features' means.
pub(super) const FIRST_FEATURE: usize = 6;

/// Colour, its variance and the features: the rows of all planes lie one after the other, padded on both sides so that
/// the window of a block can be read without asking where the border is.
#[derive(Debug)]
pub(super) struct Stack {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Colour 0 to 2, its variance 3 to 5, then the means of the features, then their variances.
    planes: usize,
    stride: usize,
    pub(super) groups: Vec<Group>,
    values: Vec<f32>,
    /// Smallest and largest colour in the window of each pixel: a mean of them lies between, whatever is rounded.
    pub(super) bounds: [Vec<f32>; 6],
}

#[derive(Debug)]
pub(super) struct Group {
    /// Which λ it has, 1 to 5.
    pub(super) lambda: usize,
    pub(super) channels: usize,
    pub(super) variance_plane: usize,
}

impl Stack {
    pub(super) fn new(colour: &Image, variance: &Image, features: &[Feature]) -> Self {
        let (_, height, width) = colour.dim();
        let mut sources: Vec<(&Image, usize)> = [colour, variance]
            .into_iter()
            .flat_map(|image| (0..3).map(move |channel| (image, channel)))
            .collect();
        let mut groups = Vec::new();
        let channels: usize = features.iter().map(|feature| feature.mean.dim().0).sum();
        for feature in features {
            let variance_plane = sources.len() + channels;
            let own = feature.mean.dim().0;
            groups.push(Group { lambda: feature.group + 1, channels: own, variance_plane });
            sources.extend((0..own).map(|channel| (&feature.mean, channel)));
        }
        for feature in features {
            sources.extend((0..feature.mean.dim().0).map(|channel| (&feature.variance, channel)));
        }

        let stride = width.next_multiple_of(BLOCK) + TAPS;
        let planes = sources.len();
        let mut values = vec![0.0; height * planes * stride];
        values.par_chunks_mut(planes * stride).enumerate().for_each(|(y, rows)| {
            for (row, (image, channel)) in rows.chunks_mut(stride).zip(&sources) {
                let row = &mut row[LARGEST_RADIUS..LARGEST_RADIUS + width];
                let pixels = image.slice(s![*channel, y, ..]);
                row.iter_mut().zip(pixels).for_each(|(value, &pixel)| *value = pixel);
            }
        });
        let bounds = std::array::from_fn(|index| {
            let plane = plane(colour, index % 3);
            if index < 3 {
                fold(&plane, width, LARGEST_RADIUS, f32::min)
            } else {
                fold(&plane, width, LARGEST_RADIUS, f32::max)
            }
        });
        Self { width, height, planes, stride, groups, values, bounds }
    }

    /// A row of a plane; its pixel 0 is at [`LARGEST_RADIUS`].
    #[inline(always)]
    pub(super) fn row(&self, y: usize, plane: usize) -> &[f32] {
        let start = (y * self.planes + plane) * self.stride;
        &self.values[start..start + self.stride]
    }

    /// The block of pixels of a row from column `x`.
    #[inline(always)]
    pub(super) fn pixels(&self, y: usize, plane: usize, x: usize) -> &Row {
        first(&self.row(y, plane)[LARGEST_RADIUS + x..])
    }
}

#[inline(always)]
pub(super) fn first<const N: usize>(values: &[f32]) -> &[f32; N] {
    values.first_chunk().expect("the rows are padded")
}
