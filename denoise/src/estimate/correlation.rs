//! What the noise of a pixel tells of that of pixels nearby.

use rayon::prelude::*;

use super::smooth;

/// Pixels between those whose noise is compared: more than pixel filters reach, and the small steps that all chains make.
const DISTANCE: usize = 4;

/// Radius of the window by whose noise each is measured, so that no firefly speaks for all.
const RADIUS: usize = 5;

/// Correlation of the noise with that of pixels [`DISTANCE`] away, along rows and columns, for the difference of two halves
/// `[channels, height, width]`: from 0, as where pixels are sampled independently, to 1; less than 0 counts as 0.
pub(super) fn correlation([a, b]: [&[f32]; 2], width: usize, plane: usize) -> f64 {
    let (mut products, mut squares) = (Mean::default(), Mean::default());
    for (a, b) in a.chunks_exact(plane).zip(b.chunks_exact(plane)) {
        let noise: Vec<f64> = a.iter().zip(b).map(|(&a, &b)| f64::from(a) - f64::from(b)).collect();
        let variance = smooth(&noise, width, RADIUS, |noise| noise * noise);
        let noise: Vec<f64> = (noise.par_iter().zip(&variance))
            .map(|(noise, variance)| noise / variance.sqrt())
            .map(|noise| if noise.is_finite() { noise } else { 0.0 })
            .collect();
        squares.add(noise.iter().map(|noise| noise * noise));
        for row in noise.chunks_exact(width) {
            products.add(row.iter().zip(row.iter().skip(DISTANCE)).map(|(a, b)| a * b));
        }
        products.add(noise.iter().zip(noise.iter().skip(DISTANCE * width)).map(|(a, b)| a * b));
    }
    let correlation = products.value() / squares.value();
    if correlation > 0.0 { correlation.min(1.0) } else { 0.0 }
}

/// Of numbers that come one after the other.
#[derive(Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, numbers: impl Iterator<Item = f64>) {
        for number in numbers {
            self.sum += number;
            self.count += 1.0;
        }
    }

    fn value(&self) -> f64 {
        self.sum / self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::tests::noise;
    use crate::window::box_mean;

    fn of(a: &crate::layers::Image, b: &crate::layers::Image) -> f64 {
        let (_, height, width) = a.dim();
        let [a, b] = [a, b].map(|image| image.as_slice().unwrap());
        correlation([a, b], width, height * width)
    }

    #[test]
    fn independent_noise_has_none_and_that_of_a_filter_the_overlap_of_its_windows() {
        // 2 × 27 648 products of variance 1: a standard deviation of 0.0043.
        assert!(of(&noise(1), &noise(2)) < 3.0 * 0.0043);
        // Means of 9 × 9 pixels whose windows are 4 apart share 5 of 9 columns. Some 340 windows do not overlap: ± 0.06
        // with the windows of the size's, which take part of the noise for its size.
        let [a, b] = [noise(1), noise(2)].map(|noise| box_mean(&noise, 4));
        let found = of(&a, &b);
        assert!((found - 5.0 / 9.0).abs() < 0.15, "{found}");
        // Of 3 × 3 pixels none.
        let [a, b] = [noise(3), noise(4)].map(|noise| box_mean(&noise, 1));
        assert!(of(&a, &b) < 0.03);
    }

    #[test]
    fn a_firefly_and_darkness_say_nothing() {
        let (mut a, b) = (noise(1), noise(2));
        let before = of(&a, &b);
        a[[0, 40, 40]] = 1e6;
        a[[0, 40, 44]] = 1e6;
        assert!((of(&a, &b) - before).abs() < 0.01);
        assert_eq!(of(&b, &b), 0.0);
        let small = noise(1).slice(ndarray::s![.., ..1, ..1]).to_owned();
        assert_eq!(of(&small, &(&small + 1.0)), 0.0);
    }
}
