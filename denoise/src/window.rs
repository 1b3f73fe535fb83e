//! Windows of neighbours around each pixel, clipped at the borders.

use std::ops::Range;

use rayon::prelude::*;

use crate::layers::Image;

/// Indices within `radius` of `centre` that lie in `0..length`.
pub(crate) fn clipped(centre: usize, radius: usize, length: usize) -> Range<usize> {
    centre.saturating_sub(radius)..(centre + radius + 1).min(length)
}

/// Combines the values of the square window of `radius` around each pixel of a plane, by rows and then by columns.
///
/// `combine` is a sum, a maximum or a minimum. The sums are of `2 radius + 1` values at a time, without running
/// differences: a firefly must not take the digits of its neighbours.
pub(crate) fn fold<T, F>(plane: &[T], width: usize, radius: usize, combine: F) -> Vec<T>
where
    T: Copy + Send + Sync,
    F: Fn(T, T) -> T + Send + Sync,
{
    let height = plane.len() / width;
    let merge = |row: &mut [T], with: &[T]| {
        row.iter_mut().zip(with).for_each(|(a, &b)| *a = combine(*a, b));
    };

    let mut rows = plane.to_vec();
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(row, source)| {
        for shift in 1..=radius.min(width - 1) {
            merge(&mut row[..width - shift], &source[shift..]);
            merge(&mut row[shift..], &source[..width - shift]);
        }
    });
    let mut result = rows.clone();
    result.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for other in clipped(y, radius, height).filter(|&other| other != y) {
            merge(row, &rows[other * width..(other + 1) * width]);
        }
    });
    result
}

/// Mean over the window of `radius` around each pixel, per channel.
pub(crate) fn box_mean(image: &Image, radius: usize) -> Image {
    let (channels, height, width) = image.dim();
    let mut means = Vec::with_capacity(image.len());
    for channel in 0..channels {
        let sums = fold(&plane(image, channel), width, radius, |a, b| a + b);
        means.extend(sums.iter().enumerate().map(|(index, sum)| {
            let count = clipped(index % width, radius, width).len()
                * clipped(index / width, radius, height).len();
            sum / count as f32
        }));
    }
    Image::from_shape_vec((channels, height, width), means).expect("one mean for each pixel")
}

/// The values of one channel, row after row.
pub(crate) fn plane(image: &Image, channel: usize) -> Vec<f32> {
    image.index_axis(ndarray::Axis(0), channel).iter().copied().collect()
}

/// The values of the 3×3 window around a pixel, as many as lie in the image.
pub(crate) fn neighbourhood(
    image: &Image,
    channel: usize,
    y: usize,
    x: usize,
) -> impl Iterator<Item = f32> {
    let (_, height, width) = image.dim();
    clipped(y, 1, height)
        .flat_map(move |y| clipped(x, 1, width).map(move |x| image[[channel, y, x]]))
}

/// Median of at most nine finite numbers, the mean of the two middle ones where their number is even.
pub(crate) fn median(values: impl Iterator<Item = f32>) -> Option<f32> {
    let mut sorted = [0.0; 9];
    let mut count = 0;
    for (slot, value) in sorted.iter_mut().zip(values) {
        *slot = value;
        count += 1;
    }
    let sorted = &mut sorted[..count];
    sorted.sort_unstable_by(f32::total_cmp);
    match count {
        0 => None,
        _ if count % 2 == 1 => Some(sorted[count / 2]),
        _ => Some(0.5 * sorted[count / 2 - 1] + 0.5 * sorted[count / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fold_equals_the_double_loop() {
        let (height, width) = (6, 9);
        let plane: Vec<f64> =
            (0..height * width).map(|index| f64::from((index * 37 % 53) as u32)).collect();
        for radius in [0, 1, 4, 20] {
            let sums = fold(&plane, width, radius, |a, b| a + b);
            let largest = fold(&plane, width, radius, f64::max);
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let window = || {
                    clipped(y, radius, height)
                        .flat_map(|y| clipped(x, radius, width).map(move |x| (y, x)))
                        .map(|(y, x)| plane[y * width + x])
                };
                assert_eq!(sums[y * width + x], window().sum::<f64>());
                assert_eq!(largest[y * width + x], window().fold(0.0, f64::max));
            }
        }
    }

    #[test]
    fn the_median_of_an_even_number_is_between() {
        assert_eq!(median([3.0, 1.0, 2.0].into_iter()), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 3.0].into_iter()), Some(2.5));
        assert_eq!(median(std::iter::empty()), None);
    }
}
