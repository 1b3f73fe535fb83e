//! Pictures of a scene for the page: what some combinations give in the same time, and where they are off.

use super::Error;
use super::scores::{Combination, Point, SceneScores};
use super::settings::Filter;
use super::statistics::Reference;
use super::unit::{ReferenceHalf, Unit};
use super::words::decimal;
use crate::dataset::exposure::gain;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ndarray::Array2;
use quietlight_denoise::metrics::relative_l2_map;
use quietlight_denoise::picture::read_picture;
use quietlight_denoise::{Image, png};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;

/// Pixels on each side of one that its error is averaged with: the error of one pixel of noise says little.
const SMOOTHING: isize = 2;

/// Decades of error that the colours of a map span.
const DECADES: i32 = 4;

/// Pictures are shown as they are unless they are this many stops from middle grey.
const DIM: f64 = 2.0;

/// The pictures of a scene.
#[derive(Debug, Serialize)]
pub(super) struct Pictures {
    /// Stops that all pictures are brightened by.
    pub(super) exposure: i32,
    /// Errors that the first and the last colour of the maps stand for.
    pub(super) range: [f64; 2],
    /// Times that they are smaller than what was rendered.
    pub(super) reduced: usize,
    /// The reference, as the value of a `src`.
    pub(super) reference: String,
    /// The others.
    pub(super) shown: Vec<Shown>,
}

/// One picture.
#[derive(Debug, Serialize)]
pub(super) struct Shown {
    /// Index of its point.
    pub(super) point: usize,
    /// As the value of a `src`.
    pub(super) picture: String,
    /// Its error, the same.
    pub(super) map: String,
}

impl Pictures {
    /// Pictures of about the same time for every integrator: as rendered and by its best denoiser, by all denoisers for the
    /// best integrator and that of `auto`. They take about `limit` bytes, reduced in size where they would take more.
    pub(super) fn of(folder: &Path, scene: &SceneScores, limit: usize) -> Result<Self, Error> {
        let halves = [0, 1].map(|half| {
            let unit = Unit::Reference { scene: 0, half };
            ReferenceHalf::picture(&unit.folder(folder, &scene.name))
        });
        let [first, second] = halves;
        let reference = Reference::new([first?, second?]);
        let stops = gain(&reference.mean).log2();
        let exposure = if stops.abs() >= DIM { stops.round() as i32 } else { 0 };
        let chosen = choose(scene);
        let mut images = Vec::new();
        for &index in &chosen {
            let picture = read_picture(&folder.join(&scene.points[index].picture))?;
            let map = smooth(&relative_l2_map(&picture, &reference.mean)?);
            images.push((picture, map));
        }
        let range = range(images.iter().map(|(_, map)| map));
        for reduced in 1.. {
            let source = |picture: &Image| -> Result<String, Error> {
                Ok(source(&png::to_bytes(&reduce(picture, reduced), exposure as f32)?))
            };
            let mut shown = Vec::new();
            for (&point, (picture, map)) in chosen.iter().zip(&images) {
                let map = reduce(&map.clone().insert_axis(ndarray::Axis(0)), reduced);
                let colours = map.index_axis(ndarray::Axis(0), 0).mapv(|error| part(error, range));
                let map = self::source(&png::map_to_bytes(&colours)?);
                shown.push(Shown { point, picture: source(picture)?, map });
            }
            let pictures =
                Self { exposure, range, reduced, reference: source(&reference.mean)?, shown };
            if pictures.bytes() <= limit || scene.size.iter().all(|&side| side <= reduced as u32) {
                return Ok(pictures);
            }
        }
        Err(Error::Nothing("pictures that are small enough".into()))
    }

    fn bytes(&self) -> usize {
        let shown = self.shown.iter().map(|shown| shown.picture.len() + shown.map.len());
        self.reference.len() + shown.sum::<usize>()
    }
}

fn source(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(png))
}

/// Indices of the points to show, by integrator and denoiser.
fn choose(scene: &SceneScores) -> Vec<usize> {
    let Some(last) = scene.verdict.choices.last() else { return Vec::new() };
    let combinations: BTreeSet<Combination> =
        scene.points.iter().map(|point| point.combination).collect();
    // The last measurement within the time, else the first.
    let place = |combination: Combination| {
        let of = || {
            let all = scene.points.iter().enumerate();
            all.filter(move |(_, point)| point.combination == combination)
        };
        let seconds = |&(_, point): &(usize, &Point)| point.seconds.mean;
        let by_time = |a: &(usize, &Point), b: &(usize, &Point)| seconds(a).total_cmp(&seconds(b));
        of().filter(|one| seconds(one) <= last.seconds)
            .max_by(by_time)
            .or_else(|| of().min_by(by_time))
    };
    let best_of = |combination: Combination| {
        combinations
            .iter()
            .filter(|one| one.integrator == combination.integrator)
            .filter_map(|&one| place(one))
            .min_by(|(_, a), (_, b)| a.error.mean.total_cmp(&b.error.mean))
            .is_some_and(|(_, point)| point.combination == combination)
    };
    let leading = [last.best.integrator, scene.auto.integrator];
    let is_shown = |&combination: &Combination| {
        leading.contains(&combination.integrator)
            || combination.denoiser == Filter::None
            || best_of(combination)
    };
    combinations
        .iter()
        .copied()
        .filter(is_shown)
        .filter_map(|combination| Some(place(combination)?.0))
        .collect()
}

/// The mean over the neighbours, those outside left out.
fn smooth(map: &Array2<f32>) -> Array2<f32> {
    let (height, width) = map.dim();
    Array2::from_shape_fn((height, width), |(y, x)| {
        let around = |at: usize, end: usize| {
            let at = at as isize;
            (at - SMOOTHING).max(0) as usize..((at + SMOOTHING + 1) as usize).min(end)
        };
        let (rows, columns) = (around(y, height), around(x, width));
        let count = rows.len() * columns.len();
        let sum: f64 = rows
            .flat_map(|row| columns.clone().map(move |column| f64::from(map[[row, column]])))
            .sum();
        (sum / count as f64) as f32
    })
}

/// The range of colours: up to the decade above all but a hundredth of the errors.
fn range<'a>(maps: impl Iterator<Item = &'a Array2<f32>>) -> [f64; 2] {
    let mut errors: Vec<f32> = maps.flatten().copied().filter(|&error| error > 0.0).collect();
    errors.sort_by(f32::total_cmp);
    let high = errors.get(errors.len() * 99 / 100).map_or(1.0, |&error| f64::from(error));
    let power = high.log10().ceil() as i32;
    [decimal(1, power - DECADES), decimal(1, power)]
}

/// Where in the range of colours an error is, 0 to 1, by its logarithm.
fn part(error: f32, [low, high]: [f64; 2]) -> f32 {
    let part = (f64::from(error).max(low) / low).ln() / (high / low).ln();
    part.min(1.0) as f32
}

/// The picture with each side divided by `by`, the last row and column of blocks smaller where it does not divide.
fn reduce(picture: &Image, by: usize) -> Image {
    if by == 1 {
        return picture.clone();
    }
    let (channels, height, width) = picture.dim();
    let shape = (channels, height.div_ceil(by), width.div_ceil(by));
    Image::from_shape_fn(shape, |(channel, y, x)| {
        let rows = y * by..((y + 1) * by).min(height);
        let columns = x * by..((x + 1) * by).min(width);
        let count = (rows.len() * columns.len()) as f32;
        let pixels = rows.flat_map(|row| columns.clone().map(move |column| (row, column)));
        pixels.map(|(row, column)| picture[[channel, row, column]]).sum::<f32>() / count
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_go_by_the_decade() {
        let maps = [Array2::from_elem((10, 10), 0.02f32)];
        let range = range(maps.iter());
        assert!((range[0] / 1e-5 - 1.0).abs() < 1e-9 && (range[1] / 0.1 - 1.0).abs() < 1e-9);
        for (error, place) in [(0.0, 0.0), (1e-5, 0.0), (1e-3, 0.5), (0.1, 1.0), (5.0, 1.0)] {
            assert!((part(error, range) - place).abs() < 1e-6, "{error}");
        }
        assert_eq!(self::range([].iter()), [1e-4, 1.0]);
    }

    #[test]
    fn smoothing_and_reducing_keep_a_constant_and_average_the_rest() {
        let flat = Array2::from_elem((7, 3), 0.25f32);
        assert_eq!(smooth(&flat), flat);
        let mut spike = Array2::zeros((9, 9));
        spike[[4, 4]] = 25.0f32;
        let smoothed = smooth(&spike);
        assert_eq!((smoothed[[4, 4]], smoothed[[2, 6]], smoothed[[1, 4]]), (1.0, 1.0, 0.0));
        let ramp = Image::from_shape_fn((1, 2, 5), |(_, _, x)| x as f32);
        assert_eq!(reduce(&ramp, 2).iter().copied().collect::<Vec<_>>(), [0.5, 2.5, 4.0]);
    }
}
