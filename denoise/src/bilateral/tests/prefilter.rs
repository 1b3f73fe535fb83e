//! The prefilter against its equations (METHODS 9.3).

use super::super::features::Feature;
use super::super::prefilter::prefilter;
use super::*;
use crate::window::clipped;

/// Equations of METHODS 9.3 as loops in double precision.
fn naive_prefilter(feature: &Feature) -> [Image; 2] {
    let (channels, height, width) = feature.mean.dim();
    let partner = |(y, x): (usize, usize), (dy, dx): (isize, isize)| {
        let (y, x) = (y.checked_add_signed(dy)?, x.checked_add_signed(dx)?);
        (y < height && x < width).then_some((y, x))
    };
    let near = |(y, x): (usize, usize), radius: usize| {
        clipped(y, radius, height).flat_map(move |y| clipped(x, radius, width).map(move |x| (y, x)))
    };
    let value = |image: &Image, q: usize, (y, x): (usize, usize)| f64::from(image[[q, y, x]]);
    let squared = |i, offset| {
        let j = partner(i, offset)?;
        let term = |q| {
            let difference = value(&feature.mean, q, j) - value(&feature.mean, q, i);
            difference * difference
                / (1e-10 + value(&feature.variance, q, j) + value(&feature.variance, q, i))
        };
        Some((0..channels).map(term).sum::<f64>() / channels as f64)
    };
    let average = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let mut results = [(); 2].map(|()| Image::zeros(feature.mean.dim()));
    for i in near((0, 0), height.max(width)) {
        let mut weights = 0.0;
        let mut sums = vec![[0.0; 2]; channels];
        for offset in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dy, dx))) {
            let Some(j) = partner(i, offset) else { continue };
            let weight = |i| {
                let patch = near(i, 3).filter_map(|p| squared(p, offset)).collect();
                (-average(patch)).exp()
            };
            let smooth =
                average(near(i, 2).filter(|&p| partner(p, offset).is_some()).map(weight).collect());
            weights += smooth;
            for (q, sums) in sums.iter_mut().enumerate() {
                sums[0] += smooth * value(&feature.mean, q, j);
                sums[1] += smooth * value(&feature.variance, q, j);
            }
        }
        for (q, sums) in sums.iter().enumerate() {
            for (result, sum) in results.iter_mut().zip(sums) {
                result[[q, i.0, i.1]] = (sum / weights) as f32;
            }
        }
    }
    results
}

#[test]
fn the_prefilter_equals_the_loops() {
    for shape in [(3, 9, 13), (1, 12, 4), (3, 1, 1), (1, 2, 7)] {
        let mut noise = Noise(17);
        let mean = noise.image(shape, 0.5, 1.0);
        let feature = Feature { group: 0, mean, variance: noise.image(shape, 0.04, 0.07) };
        let found = prefilter(&feature);
        let [mean, variance] = naive_prefilter(&feature);
        assert_close(&found.mean, &mean, 2e-6);
        assert_close(&found.variance, &variance, 2e-6);
    }
}

#[test]
fn the_prefilter_takes_noise_and_leaves_edges() {
    let mut noise = Noise(23);
    let shape = (1, 40, 80);
    // Two flat halves, noise of variance 1/300 on both.
    let mean = Image::from_shape_fn(shape, |(_, _, x)| if x < 40 { 0.2 } else { 0.8 })
        + noise.image(shape, 0.0, 0.2);
    let clean = Image::from_shape_fn(shape, |(_, _, x)| if x < 40 { 0.2 } else { 0.8 });
    let feature =
        Feature { group: 0, mean: mean.clone(), variance: Image::from_elem(shape, 1.0 / 300.0) };
    let error = |image: &Image| (image - &clean).mapv(|value| value * value).sum();
    assert!(error(&prefilter(&feature).mean) < 0.1 * error(&mean));
}
