//! Spike removal: pixels far out of what their neighbours say.

use ndarray::Axis;
use rayon::prelude::*;

use crate::layers::Image;
use crate::window::{clipped, fold, median, neighbourhood, plane};

/// Replaces all channels of a pixel by their 3×3 medians where one channel is more than `threshold` standard deviations
/// from the mean of the window of `radius` around it, the pixel itself left out. Returns the number of pixels.
///
/// Where fewer than two neighbours exist nothing is known of their deviation, and nothing is a spike.
pub(crate) fn remove_spikes(image: &mut Image, radius: usize, threshold: f32) -> usize {
    let (channels, height, width) = image.dim();
    let mut spike = vec![false; height * width];
    for channel in 0..channels {
        // In double precision: the square of a variance may be 1e60.
        let values: Vec<f64> = plane(image, channel).into_iter().map(f64::from).collect();
        let squares: Vec<f64> = values.iter().map(|value| value * value).collect();
        let [sums, square_sums] =
            [&values, &squares].map(|plane| fold(plane, width, radius, |a, b| a + b));
        spike.par_iter_mut().enumerate().for_each(|(index, spike)| {
            let (y, x) = (index / width, index % width);
            let neighbours = clipped(y, radius, height).len() * clipped(x, radius, width).len() - 1;
            if neighbours < 2 {
                return;
            }
            let count = neighbours as f64;
            let mean = (sums[index] - values[index]) / count;
            let variance =
                ((square_sums[index] - squares[index]) - count * mean * mean) / (count - 1.0);
            let deviation = (values[index] - mean).abs();
            // The last term is the rounding of an image of 32 bits, which is no spike in a flat neighbourhood.
            *spike |=
                deviation > f64::from(threshold) * variance.max(0.0).sqrt() + 1e-6 * mean.abs();
        });
    }

    let spikes: Vec<usize> = (0..spike.len()).filter(|&index| spike[index]).collect();
    let medians: Vec<f32> = spikes
        .iter()
        .flat_map(|index| (0..channels).map(move |channel| (index / width, index % width, channel)))
        .map(|(y, x, channel)| {
            median(neighbourhood(image, channel, y, x)).expect("a pixel is its own neighbour")
        })
        .collect();
    for (&index, medians) in spikes.iter().zip(medians.chunks_exact(channels)) {
        for (mut plane, &median) in image.axis_iter_mut(Axis(0)).zip(medians) {
            plane[[index / width, index % width]] = median;
        }
    }
    spikes.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lone_spike_becomes_the_median_in_all_channels() {
        let mut image = Image::from_shape_fn((3, 9, 9), |(c, y, x)| {
            c as f32 + 0.1 * ((x * 7 + y * 3) % 5) as f32
        });
        let mut expected = image.clone();
        image[[1, 4, 4]] = 50.0;
        for channel in 0..3 {
            expected[[channel, 4, 4]] = median(neighbourhood(&image, channel, 4, 4)).unwrap();
        }
        assert_eq!(remove_spikes(&mut image, 27, 10.0), 1);
        assert_eq!(image, expected);
    }

    #[test]
    fn the_centre_is_left_out_of_its_own_statistics() {
        // With it, nine values can never be more than 8/3 standard deviations from their mean.
        let mut image = Image::from_shape_fn((1, 3, 3), |(_, y, x)| ((x + y) % 2) as f32);
        image[[0, 1, 1]] = 100.0;
        assert_eq!(remove_spikes(&mut image, 1, 50.0), 1);
    }

    #[test]
    fn flat_and_tiny_images_have_no_spikes() {
        for shape in [(3, 1, 1), (3, 1, 2), (3, 2, 1), (3, 12, 9)] {
            let mut image = Image::from_elem(shape, 0.1);
            assert_eq!(remove_spikes(&mut image, 1, 2.0), 0);
        }
        let mut two = Image::from_shape_vec((1, 1, 2), vec![0.0, 1.0]).unwrap();
        assert_eq!(remove_spikes(&mut two, 1, 2.0), 0);
    }

    #[test]
    fn a_spike_of_the_largest_variance_is_seen() {
        let mut image = Image::from_elem((1, 60, 60), 1e-6);
        image[[0, 30, 30]] = 1e30;
        assert_eq!(remove_spikes(&mut image, 27, 10.0), 1);
        assert_eq!(image[[0, 30, 30]], 1e-6);
    }
}
