//! The secondary features against their definitions (METHODS 9.4), and the network's way to the filter.

use super::super::secondary::{COUNT, Secondary, names};
use super::*;
use crate::window::clipped;

/// A value of the picture mirrored at its borders, the border repeated.
fn mirrored(image: &Image, channel: usize, y: isize, x: isize) -> f64 {
    let (_, height, width) = image.dim();
    let inside = |mut index: isize, length: isize| {
        while !(0..length).contains(&index) {
            index = if index < 0 { -1 - index } else { 2 * length - 1 - index };
        }
        index as usize
    };
    f64::from(image[[channel, inside(y, height as isize), inside(x, width as isize)]])
}

/// Median absolute detail of the 16 cells of the 8×8 block at a pixel, in standard deviations.
fn naive_median(image: &Image, channel: usize, (y, x): (usize, usize)) -> f64 {
    let mut details = Vec::new();
    for dy in [-4, -2, 0, 2] {
        for dx in [-4, -2, 0, 2] {
            let value = |i, j| mirrored(image, channel, y as isize + dy + i, x as isize + dx + j);
            details.push((value(0, 1) + value(1, 0) - value(0, 0) - value(1, 1)).abs() / 2.0);
        }
    }
    details.sort_by(f64::total_cmp);
    (details[7] + details[8]) / 2.0 / 0.6745
}

/// The six sorts of one group at a pixel.
fn naive_group(raw: &Image, filtered: &features::Feature, (y, x): (usize, usize)) -> [f64; 7] {
    let (channels, height, width) = raw.dim();
    let near = |(y, x): (usize, usize), radius: usize| {
        clipped(y, radius, height).flat_map(move |y| clipped(x, radius, width).map(move |x| (y, x)))
    };
    let average = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let mut sums = [0.0; 7];
    for channel in 0..channels {
        let value = |(y, x): (usize, usize)| f64::from(filtered.mean[[channel, y, x]]);
        let cell = |(y, x): (usize, usize)| {
            let (top, left) = (y / 2 * 2, x / 2 * 2);
            let pixels = (top..(top + 2).min(height))
                .flat_map(|y| (left..(left + 2).min(width)).map(move |x| (y, x)));
            average(pixels.map(|pixel| naive_median(raw, channel, pixel)).collect())
        };
        let block: Vec<f64> = near((y, x), 3).map(value).collect();
        let block_mean = average(block.clone());
        let squares: f64 = block.iter().map(|value| (value - block_mean).powi(2)).sum();
        let around: Vec<f64> = near((y, x), 1).map(value).collect();
        let mean = average(around.clone());
        let repeated = |dy: isize, dx: isize| {
            let clamp = |index: usize, offset: isize, length: usize| {
                (index as isize + offset).clamp(0, length as isize - 1) as usize
            };
            value((clamp(y, dy, height), clamp(x, dx, width)))
        };
        let across: f64 = (-1..=1).map(|dy| repeated(dy, 1) - repeated(dy, -1)).sum();
        let down: f64 = (-1..=1).map(|dx| repeated(1, dx) - repeated(-1, dx)).sum();
        let sorts = [
            near((y, x), 1).map(cell).fold(0.0, f64::max),
            value((y, x)),
            f64::from(filtered.variance[[channel, y, x]]).sqrt(),
            block_mean,
            (squares / (block.len() as f64 - 1.0).max(1.0)).sqrt(),
            average(around.iter().map(|value| (value - mean).abs()).collect()),
            ((across / 9.0).powi(2) + (down / 9.0).powi(2)) / 2.0,
        ];
        sums.iter_mut().zip(sorts).for_each(|(sum, sort)| *sum += sort / channels as f64);
    }
    sums
}

#[test]
fn the_secondary_features_equal_their_definitions() {
    for (width, height) in [(16, 12), (41, 7), (1, 1), (2, 5), (5, 1)] {
        let mut noise = Noise(19);
        let shape = |kind: LayerKind| (kind.components().len(), height, width);
        let mut feature = |group: usize, centre: f32| features::Feature {
            group,
            mean: noise.image(shape(GROUPS[group]), centre, 1.0),
            variance: noise.image(shape(GROUPS[group]), 0.05, 0.09),
        };
        // Not all groups, and not the same numbers before and after the prefilter.
        let raw: Vec<_> = [0, 1, 2, 4].map(|group| feature(group, 0.5)).into();
        let filtered: Vec<_> = [0, 1, 2, 4].map(|group| feature(group, 0.3)).into();
        let samples = Image::from_shape_fn((1, height, width), |(_, y, x)| (1 + y + 3 * x) as f32);
        let secondary = Secondary::new(&raw, Some(&samples));
        for y in 0..height {
            let row = secondary.row(&filtered, y, width);
            for x in 0..width {
                let mut expected = [0.0; COUNT];
                for (raw, filtered) in raw.iter().zip(&filtered) {
                    let sorts = naive_group(&raw.mean, filtered, (y, x));
                    for (index, sort) in [0, 5, 10, 15, 20, 25, 31].into_iter().zip(sorts) {
                        expected[index + raw.group] = sort;
                    }
                }
                expected[30] = 1.0 / (1 + y + 3 * x) as f64;
                for (index, (name, expected)) in names().iter().zip(expected).enumerate() {
                    let found = f64::from(row[index * width + x]);
                    assert!(
                        (found - expected).abs() < 2e-6,
                        "{name} is {found} instead of {expected} at ({x}, {y}) of {width}x{height}"
                    );
                }
            }
        }
        let present = secondary.present(&filtered);
        let missing: Vec<usize> = (0..COUNT).filter(|&index| !present[index]).collect();
        assert_eq!(missing, [3, 8, 13, 18, 23, 28, 34]);
        assert!(!Secondary::new(&raw, None).present(&filtered)[30]);
    }
}

#[test]
fn the_names_are_in_the_order_of_the_table() {
    let names = names();
    assert_eq!(names.len(), COUNT);
    assert_eq!([&names[0], &names[9]], ["mad.position", "mean.visibility"]);
    assert_eq!([&names[30], &names[33]], ["sampling_rate", "gradient.albedo"]);
}

#[test]
fn learned_parameters_are_those_of_the_network_at_each_pixel() {
    let prepared = Prepared::new(&noisy_layers(45, 18, 21)).unwrap();
    let lambda = prepared.lambda(Network::embedded());
    assert_eq!(lambda.dim(), (6, 18, 45));
    let learned = Parameters::learned();
    let per_pixel = Parameters { lambda: Lambda::PerPixel(lambda), ..learned.clone() };
    let [one, other] = [learned, per_pixel].map(|p| prepared.filter(&p, &|_| ()).unwrap().image);
    assert_eq!(one, other);
}

#[test]
fn missing_groups_leave_the_network_at_its_training_mean() {
    // Of a beauty alone, without its sample counts, the network sees nothing: every pixel has the same parameters.
    let lambda = Prepared::new(&beauty_only(Noise(4).image((3, 9, 14), 0.5, 1.0), 0.1))
        .unwrap()
        .lambda(Network::embedded());
    for plane in lambda.outer_iter() {
        assert!(plane.iter().all(|value| *value == plane[[0, 0]]));
    }
}
