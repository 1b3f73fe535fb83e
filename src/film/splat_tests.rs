//! Splats that can be added up by hand.

use super::*;
use crate::integrator::Splat;
use crate::math::Rgb;
use glam::{DVec3, Vec2};

const SETTINGS: FilmSettings = FilmSettings { width: 8, height: 6, crop: [2, 1, 3, 2] };

fn splat(x: f32, y: f32, diffuse: f32, specular: f32) -> Splat {
    Splat { raster: Vec2::new(x, y), diffuse: Rgb::splat(diffuse), specular: Rgb::splat(specular) }
}

/// Layers of a film of one invisible sample per pixel with the radiance `diffuse` and `specular`.
fn sampled(diffuse: f32, specular: f32, samples: usize) -> Layers {
    let requirements = Requirements {
        has_specular: true,
        has_second_hit: false,
        has_emitters: false,
        has_masks: false,
        has_defocus: false,
        has_delta: false,
    };
    let mut film = Film::new(SETTINGS, &requirements);
    let (tiles, kept) = film.tiles_mut();
    let sample = PathSample {
        diffuse: Rgb::splat(diffuse),
        specular: Rgb::splat(specular),
        ..PathSample::default()
    };
    for tile in tiles {
        for (index, half) in (0..tile.len()).flat_map(|index| (0..samples).map(move |s| (index, s)))
        {
            tile.add(index, half % 2, &sample, kept);
        }
    }
    film.layers(DVec3::ZERO)
}

fn pixel(image: &Image, x: usize, y: usize) -> f32 {
    image[[1, y, x]]
}

#[test]
fn splats_fall_on_the_pixel_that_holds_them_and_nowhere_outside_of_the_crop() {
    let mut film = SplatFilm::new(SETTINGS);
    let inside = [(2.0, 1.0, 1.0), (2.999, 1.999, 2.0), (4.5, 2.5, 16.0), (4.999, 2.0, 32.0)];
    let outside = [
        (1.999, 1.5),
        (5.0, 1.5),
        (3.0, 0.999),
        (3.0, 3.0),
        (-0.0, -1.0),
        (1e30, 1.0),
        (-1e30, 1.0),
        (4.3e9, 1.5),
    ];
    for (x, y, value) in inside {
        film.add(0, &splat(x, y, value, 0.0));
    }
    for (x, y) in outside {
        film.add(0, &splat(x, y, 1e6, 0.0));
    }
    let mut layers = sampled(9.0, 9.0, 2);
    film.put_into(&mut layers, &Scale { half: [1.0; 2], weight: [1.0, 0.0] }, Radiance::Replaced);
    let beauty = &layers.layers[&LayerKind::Beauty].mean;
    let expected = [[3.0, 0.0, 0.0], [0.0, 0.0, 48.0]];
    for (y, row) in expected.into_iter().enumerate() {
        for (x, value) in row.into_iter().enumerate() {
            assert_eq!(pixel(beauty, x, y), value, "pixel {x}, {y}");
        }
    }
    assert_eq!(film.invalid_splats(), 0);
}

#[test]
fn what_is_not_finite_is_dropped_whole_and_counted() {
    let mut film = SplatFilm::of_independent(SETTINGS);
    for broken in [
        splat(3.5, 1.5, f32::NAN, 1.0),
        splat(3.5, 1.5, 1.0, f32::INFINITY),
        splat(3.5, 1.5, 3e38, 3e38),
        splat(f32::NAN, 1.5, 1.0, 1.0),
        splat(3.5, f32::INFINITY, 1.0, 1.0),
        splat(3.5, 1.5, 1e30, 0.0).weighted(1e30),
        splat(3.5, 1.5, 0.0, 0.0).weighted(f64::INFINITY),
    ] {
        film.add(1, &broken);
    }
    film.add(1, &splat(3.5, 1.5, 2.0, 3.0));
    assert_eq!(film.invalid_splats(), 7);
    let mut layers = sampled(0.0, 0.0, 2);
    film.put_into(&mut layers, &Scale { half: [1.0; 2], weight: [0.5; 2] }, Radiance::Replaced);
    let [a, b] = layers.layers[&LayerKind::Beauty].halves.as_ref().unwrap();
    assert_eq!([pixel(a, 1, 0), pixel(b, 1, 0)], [0.0, 5.0]);
    assert_eq!(layers.invalid.unwrap()[[0, 0, 1]], 5.0);
}

#[test]
fn halves_have_their_own_scales_and_the_mean_is_theirs() {
    let mut film = SplatFilm::new(SETTINGS);
    film.add(0, &splat(3.5, 1.5, 1.0, 2.0));
    film.add(1, &splat(3.5, 1.5, 4.0, 8.0));
    let mut layers = sampled(9.0, 9.0, 2);
    film.put_into(
        &mut layers,
        &Scale { half: [3.0, 0.5], weight: [0.25, 0.75] },
        Radiance::Replaced,
    );
    let values = |kind| {
        let layer: &Layer = &layers.layers[&kind];
        let [a, b] = layer.halves.as_ref().unwrap();
        assert!(layer.variance.is_none());
        [pixel(&layer.mean, 1, 0), pixel(a, 1, 0), pixel(b, 1, 0)]
    };
    assert_eq!(values(LayerKind::Diffuse), [0.25 * 3.0 + 0.75 * 2.0, 3.0, 2.0]);
    assert_eq!(values(LayerKind::Specular), [0.25 * 6.0 + 0.75 * 4.0, 6.0, 4.0]);
    assert_eq!(values(LayerKind::Beauty), [6.75, 9.0, 6.0]);
}

#[test]
fn added_splats_come_to_the_samples_with_their_variance() {
    // Three samples per pixel, two of them in half A: splats of 6 and 3 add 3 to the mean, 3 to A and 3 to B.
    let mut film = SplatFilm::of_independent(SETTINGS);
    film.add(0, &splat(2.5, 2.5, 0.0, 6.0));
    film.add(1, &splat(2.5, 2.5, 3.0, 0.0));
    let mut layers = sampled(1.0, 0.5, 3);
    let scale = Scale::of_samples(3);
    film.put_into(&mut layers, &scale, Radiance::Added);
    let beauty = &layers.layers[&LayerKind::Beauty];
    let [a, b] = beauty.halves.as_ref().unwrap();
    assert_eq!([pixel(&beauty.mean, 0, 1), pixel(a, 0, 1), pixel(b, 0, 1)], [4.5; 3]);
    assert_eq!(pixel(&beauty.mean, 1, 1), 1.5);
    let variance = pixel(beauty.variance.as_ref().unwrap(), 0, 1);
    assert!((variance - (36.0 + 9.0) / 9.0).abs() < 1e-6, "{variance}");
    // One sample: no half B, whose picture is then the mean.
    let mut layers = sampled(1.0, 0.5, 1);
    let mut film = SplatFilm::new(SETTINGS);
    film.add(0, &splat(2.5, 2.5, 0.0, 6.0));
    film.put_into(&mut layers, &Scale::of_samples(1), Radiance::Added);
    let [a, b] = layers.layers[&LayerKind::Beauty].halves.as_ref().unwrap();
    assert_eq!([pixel(a, 0, 1), pixel(b, 0, 1)], [7.5; 2]);
}

#[test]
fn beauty_is_diffuse_and_specular_to_the_last_bit() {
    let mut film = SplatFilm::new(SETTINGS);
    for index in 0..1000 {
        let value = (index as f32 * 0.731).sin().abs();
        film.add(index % 2, &splat(2.0 + 3.0 * value, 1.0 + value, value * 0.3, value * value));
    }
    let scale = Scale { half: [0.013, 0.017], weight: [0.5; 2] };
    for radiance in [Radiance::Replaced, Radiance::Added] {
        let mut layers = sampled(0.1, 0.7, 2);
        film.put_into(&mut layers, &scale, radiance);
        let of = |kind| &layers.layers[&kind];
        let (diffuse, specular) = (of(LayerKind::Diffuse), of(LayerKind::Specular));
        let beauty = of(LayerKind::Beauty);
        assert_eq!(beauty.mean, &diffuse.mean + &specular.mean);
        for half in [0, 1] {
            let halves = [beauty, diffuse, specular].map(|l| &l.halves.as_ref().unwrap()[half]);
            assert_eq!(halves[0], &(halves[1] + halves[2]));
        }
    }
}

#[test]
fn merged_films_are_one_film() {
    let splats: Vec<Splat> = (0..64)
        .map(|index| splat(2.0 + 0.04 * index as f32, 1.7, index as f32, f32::from(index > 60)))
        .chain([splat(2.5, 1.5, f32::NAN, 0.0), splat(f32::NAN, 0.0, 0.0, 0.0)])
        .collect();
    let mut whole = SplatFilm::of_independent(SETTINGS);
    whole.add_all(1, &splats);
    let mut merged = SplatFilm::of_independent(SETTINGS);
    for part in splats.chunks(7) {
        let mut film = SplatFilm::of_independent(SETTINGS);
        film.add_all(1, part);
        merged.merge(&film);
    }
    let layers = |film: &SplatFilm| {
        let mut layers = sampled(0.0, 0.0, 2);
        film.put_into(&mut layers, &Scale::of_samples(2), Radiance::Added);
        layers.layers[&LayerKind::Beauty].clone()
    };
    assert_eq!(whole.invalid_splats(), merged.invalid_splats());
    // Whole numbers add up without rounding.
    assert_eq!(layers(&whole).halves, layers(&merged).halves);
    assert_eq!(layers(&whole).variance, layers(&merged).variance);
}

#[test]
fn pixels_far_above_the_proposals_around_them_become_their_median() {
    let film = |values: [[f32; 3]; 2]| {
        let mut film = SplatFilm::new(SETTINGS);
        for (y, row) in values.into_iter().enumerate() {
            for (x, value) in row.into_iter().enumerate() {
                film.add(0, &splat(2.5 + x as f32, 1.5 + y as f32, value, 0.25 * value));
            }
        }
        film
    };
    // Of all six around the middle the median is 3.5; of the four around the left column 4, around the right one 3.5.
    let proposals = film([[1.0, 2.0, 3.0], [6.0, 7.0, 4.0]]);
    let deposits = film([[8.0, 7.5, 7.0], [9.0, 0.0, 100.0]]);
    let limited = deposits.limited_by(&proposals, 2.0);
    let mut layers = sampled(0.0, 0.0, 2);
    let scale = Scale { half: [1.0; 2], weight: [0.5; 2] };
    limited.put_into(&mut layers, &scale, Radiance::Replaced);
    for (kind, factor) in [(LayerKind::Diffuse, 1.0), (LayerKind::Specular, 0.25)] {
        let [a, b] = layers.layers[&kind].halves.as_ref().unwrap();
        // 8 and 7 are not above twice their medians, 7.5 is above 7, 9 and 100 are above theirs.
        let expected = [[8.0, 3.5, 7.0], [4.0, 0.0, 3.5]];
        for (y, row) in expected.into_iter().enumerate() {
            for (x, value) in row.into_iter().enumerate() {
                assert_eq!(pixel(a, x, y), factor * value, "{kind:?}, pixel {x}, {y}");
                assert_eq!(pixel(b, x, y), 0.0, "the other half has its own medians");
            }
        }
    }
    assert!((deposits.total() - 131.5 * 3.0 * 1.25).abs() < 1e-9);
    assert!((limited.total() - 26.0 * 3.0 * 1.25).abs() < 1e-9);
}
