//! Sums of samples that can be added up by hand.

use super::*;
use crate::math::Rgb;
use crate::sampler::{IndependentSampler, Sampler};
use glam::{DVec3, Vec3};

fn requirements() -> Requirements {
    Requirements {
        has_specular: true,
        has_second_hit: true,
        has_emitters: true,
        has_masks: false,
        has_defocus: false,
        has_delta: false,
    }
}

/// A film of one pixel with these samples, halves in turns.
fn film_of(samples: impl IntoIterator<Item = PathSample>) -> Film {
    let settings = FilmSettings { width: 1, height: 1, crop: [0, 0, 1, 1] };
    let mut film = Film::new(settings, &requirements());
    let (tiles, kept) = film.tiles_mut();
    for (index, sample) in samples.into_iter().enumerate() {
        tiles[0].add(0, index % 2, &sample, kept);
    }
    film
}

fn of_depth(depth: f32) -> PathSample {
    PathSample { depth, ..PathSample::default() }
}

/// Mean, variance and halves of the depth of the only pixel.
fn depth(film: &Film) -> [f32; 4] {
    let layer = &film.layers(DVec3::ZERO).layers[&LayerKind::Depth];
    let at = [0, 0, 0];
    let ([a, b], variance) = (layer.halves.as_ref().unwrap(), layer.variance.as_ref().unwrap());
    [layer.mean[at], variance[at], a[at], b[at]]
}

#[test]
fn mean_variance_and_halves_are_those_of_the_samples() {
    // 1, 2, 6: mean 3; Σ (x − 3)² = 14, over 3 · 2; even samples 1 and 6, odd one 2.
    assert_eq!(depth(&film_of([1.0, 2.0, 6.0].map(of_depth))), [3.0, 14.0 / 6.0, 3.5, 2.0]);
}

#[test]
fn one_sample_has_no_variance_and_equal_halves_and_none_is_black() {
    assert_eq!(depth(&film_of([of_depth(5.0)])), [5.0, 0.0, 5.0, 5.0]);
    assert_eq!(depth(&film_of([])), [0.0; 4]);
}

#[test]
fn sums_go_on_beyond_the_digits_of_single_precision() {
    // 4 million samples of 1000 and 1001: an f32 sum would stop growing at 1.7e10, and lose the difference of squares.
    let count = 4_000_000;
    let [mean, variance, a, b] =
        depth(&film_of((0..count).map(|index| of_depth(1000.0 + (index % 2) as f32))));
    assert_eq!([mean, a, b], [1000.5, 1000.0, 1001.0]);
    let expected = 0.25 / f64::from(count - 1);
    assert!((f64::from(variance) / expected - 1.0).abs() < 1e-5, "{variance} {expected}");
    // One sample of 1e8 in one half leaves the other half, and samples of 1e-8, as they are.
    let [.., b] = depth(&film_of([1e8, 1e-8].map(of_depth)));
    assert_eq!(b, 1e-8);
}

/// Samples with numbers of 10⁻⁸ to 10⁸ in every layer.
fn mixed(count: u32, seed: u32) -> Vec<(usize, PathSample)> {
    let mut numbers = IndependentSampler::new(5, seed, 0);
    let mut samples = Vec::new();
    for index in 0..count {
        let mut next = || 10f32.powf(16.0 * numbers.next_1d() - 8.0);
        let sample = PathSample {
            diffuse: Rgb::new(next(), next(), next()),
            specular: Rgb::new(next(), next(), next()),
            position: Vec3::new(next(), -next(), next()),
            depth: next(),
            ..PathSample::default()
        };
        samples.push(((index % 2) as usize, sample));
    }
    samples
}

#[test]
fn in_which_order_and_on_how_many_films_samples_come_does_not_show() {
    let settings = FilmSettings { width: 1, height: 1, crop: [0, 0, 1, 1] };
    let filled = |samples: &[(usize, PathSample)]| {
        let mut film = Film::new(settings, &requirements());
        let (tiles, kept) = film.tiles_mut();
        samples.iter().for_each(|(half, sample)| tiles[0].add(0, *half, sample, kept));
        film
    };
    let mut samples = mixed(5000, 0);
    let expected = filled(&samples).layers(DVec3::ONE);
    let mut numbers = IndependentSampler::new(6, 0, 0);
    for parts in [1, 2, 3, 50] {
        for last in (1..samples.len()).rev() {
            samples.swap(last, (numbers.next_f64() * (last + 1) as f64) as usize);
        }
        let mut film = filled(&[]);
        samples.chunks(samples.len() / parts).for_each(|part| film.merge(&filled(part)));
        let found = film.layers(DVec3::ONE);
        for (kind, layer) in &expected.layers {
            let other = &found.layers[kind];
            assert_eq!(layer.mean, other.mean, "{kind:?} in {parts} parts");
            assert_eq!(layer.variance, other.variance, "{kind:?} in {parts} parts");
            assert_eq!(layer.halves, other.halves, "{kind:?} in {parts} parts");
        }
        assert_eq!(expected.samples, found.samples);
    }
}

#[test]
fn a_sample_with_anything_not_finite_is_dropped_whole() {
    let broken = [
        PathSample { diffuse: Rgb::new(0.0, f32::NAN, 0.0), ..of_depth(9.0) },
        PathSample { specular: Rgb::splat(f32::INFINITY), ..of_depth(9.0) },
        // Finite by themselves, but not their sum.
        PathSample { diffuse: Rgb::splat(3e38), specular: Rgb::splat(3e38), ..of_depth(9.0) },
        PathSample { normal: Vec3::new(0.0, 0.0, f32::NAN), ..of_depth(9.0) },
        PathSample { albedo: Rgb::splat(f32::NAN), ..of_depth(9.0) },
        of_depth(f32::NEG_INFINITY),
    ];
    let film = film_of(broken.into_iter().chain([of_depth(2.0), of_depth(2.0)]));
    assert_eq!(film.invalid_samples(), 6);
    assert_eq!(depth(&film), [2.0, 0.0, 2.0, 2.0]);
    let layers = film.layers(DVec3::ZERO);
    assert_eq!(layers.samples.unwrap()[[0, 0, 0]], 2.0);
    assert_eq!(layers.invalid.unwrap()[[0, 0, 0]], 6.0);
}

#[test]
fn positions_get_back_what_the_scene_was_moved_by() {
    let sample = PathSample { position: Vec3::new(1.0, 2.0, 3.0), ..PathSample::default() };
    let layers = film_of([sample; 2]).layers(DVec3::new(100.0, 0.0, -3.0));
    let position = &layers.layers[&LayerKind::Position];
    assert_eq!(position.mean.iter().copied().collect::<Vec<_>>(), [101.0, 2.0, 0.0]);
    assert!(position.variance.as_ref().unwrap().iter().all(|&variance| variance == 0.0));
    assert_eq!(position.halves.as_ref().unwrap()[1], position.mean);
}

#[test]
fn tiles_cover_every_pixel_of_the_crop_once() {
    for crop in [[0, 0, 1, 1], [5, 7, 16, 16], [3, 0, 17, 33], [0, 9, 40, 1]] {
        let mut found = vec![0; (crop[2] * crop[3]) as usize];
        for tile in tiles(crop, 1) {
            assert_eq!(tile.len(), tile.pixels().count());
            for ([x, y], [film_x, film_y]) in tile.pixels().zip(tile.film_pixels()) {
                assert_eq!([film_x, film_y], [x + crop[0], y + crop[1]]);
                found[(y * crop[2] + x) as usize] += 1;
            }
        }
        assert!(found.iter().all(|&count| count == 1), "{crop:?}");
    }
}

#[test]
fn a_film_takes_the_bytes_that_it_says() {
    let settings = FilmSettings { width: 50, height: 50, crop: [0, 0, 20, 30] };
    let film = Film::new(settings, &requirements());
    let taken: usize = film
        .tiles
        .iter()
        .map(|tile| size_of_val(&tile.sums[..]) + size_of_val(&tile.counts[..]))
        .sum();
    assert_eq!(taken as u64, Film::bytes(settings, &requirements()));
}
