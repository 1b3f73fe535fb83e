//! Choices and judgements that can be told by numbers.

use super::*;

#[test]
fn a_panic_is_noted_with_what_it_said() {
    for (work, expected) in [
        ((|| panic!("plain words")) as fn() -> Result<Tried, Error>, "plain words"),
        (|| panic!("{} digits", std::hint::black_box(2)), "2 digits"),
        (|| std::panic::panic_any(7), "without a message"),
    ] {
        match or_panic_noted(work) {
            Ok(Tried::Refused(Refusal::Broken(reason))) => {
                assert!(reason.contains(expected), "{reason}");
            }
            _ => panic!("{expected} went unnoticed"),
        }
    }
}

#[test]
fn films_hold_the_window_and_differ_in_format() {
    let mut dice = Dice::new(4);
    let films: Vec<[u32; 2]> = (0..300).map(|_| film(128, &mut dice)).collect();
    for [width, height] in &films {
        assert!(width.min(height) >= &128 && width.max(height) <= &283, "{width}x{height}");
    }
    let upright = films.iter().filter(|[width, height]| height > width).count();
    // 60 ± 4 standard deviations of √(300 · 0.16), and one film or the other is square.
    assert!((30..=90).contains(&upright), "{upright}");
    let widest = films.iter().map(|[w, h]| f64::from(*w) / f64::from(*h)).fold(0.0, f64::max);
    assert!((1.6..1.79).contains(&widest), "{widest}");
}

#[test]
fn windows_reach_every_edge_of_the_film_and_stay_on_it() {
    let mut dice = Dice::new(4);
    let windows: Vec<_> = (0..500).map(|_| window([20, 16], 12, &mut dice)).collect();
    assert!(windows.iter().all(|&[x, y, w, h]| (w, h) == (12, 12) && x <= 8 && y <= 4));
    for (x, y) in [(0, 0), (8, 4), (0, 4), (8, 0)] {
        assert!(windows.iter().any(|window| window[..2] == [x, y]), "{x},{y}");
    }
    assert_eq!(window([20, 6], 12, &mut dice)[1..], [0, 12, 6]);
}

#[test]
fn a_film_smaller_than_the_window_grows_in_its_format() {
    assert_eq!(large_enough([256, 192], 128), None);
    assert_eq!(large_enough([256, 192], 256), Some((342, 256)));
    assert_eq!(large_enough([100, 200], 128), Some((128, 256)));
}

#[test]
fn sample_counts_are_log_uniform() {
    let settings = Settings::default();
    let mut dice = Dice::new(1);
    let counts: Vec<u32> = (0..4000).map(|_| sample_count(&settings, &mut dice)).collect();
    assert!(counts.iter().all(|count| (1..=256).contains(count)));
    // Rounded, a count is at most 15 with probability ln 15.5 / ln 256 = 0.4943; 1 alone with ln 1.5 / ln 256 = 0.0731.
    // 4 standard deviations of √(p (1 − p) / 4000).
    for (most, expected, bound) in [(15, 0.4943, 0.0317), (1, 0.0731, 0.0165)] {
        let part = counts.iter().filter(|&&count| count <= most).count() as f64 / 4000.0;
        assert!((part - expected).abs() < bound, "{most}: {part}");
    }
    let fixed = Settings { min_spp: 7, max_spp: 7, ..settings };
    assert_eq!(sample_count(&fixed, &mut dice), 7);
}

#[test]
fn the_noise_of_a_dark_picture_is_that_of_the_same_picture_at_middle_grey() {
    let beauty = |light: f32| Layer {
        mean: Image::from_elem((3, 8, 8), light),
        variance: Some(Image::from_elem((3, 8, 8), 0.01 * light * light)),
        halves: None,
    };
    let [dark, grey, bright] = [0.001, 0.18, 20.0].map(|light| Noise::of(&beauty(light)));
    // 0.01 x² / (x² + 0.01) at x = 0.18.
    let expected = 0.01 * 0.0324 / 0.0424;
    assert!((grey.plain / expected - 1.0).abs() < 1e-5, "{}", grey.plain);
    assert!((dark.exposed / expected - 1.0).abs() < 1e-5, "{}", dark.exposed);
    assert!(dark.plain < 1e-5, "as it is, the constant hides the noise: {}", dark.plain);
    assert_eq!(bright.plain, bright.exposed);
}

/// Layers of 32×32 pixels.
fn layers(light: impl Fn(usize) -> f32, albedo: impl Fn(usize) -> f32, depth: f32) -> Layers {
    let mut layers = Layers { width: 32, height: 32, ..Layers::default() };
    let mut insert = |kind: LayerKind, value: &dyn Fn(usize) -> f32| {
        let channels = kind.components().len();
        let mean = Image::from_shape_fn((channels, 32, 32), |(_, _, x)| value(x));
        layers.layers.insert(kind, Layer { mean, variance: None, halves: None });
    };
    insert(LayerKind::Beauty, &light);
    insert(LayerKind::Albedo, &albedo);
    insert(LayerKind::Normal, &|_| 0.6);
    insert(LayerKind::Depth, &|_| depth);
    layers
}

#[test]
fn views_that_show_nothing_are_told_from_dark_or_plain_ones() {
    let faulty = |light: f32| fault(&layers(|_| light, |_| 0.5, 1.0));
    assert_eq!(faulty(0.0), Some("nearly black"));
    assert_eq!(faulty(1e-6), Some("constant"), "dark as it is, it is not black");
    assert_eq!(fault(&layers(|x| x as f32, |_| 0.5, 0.0)), Some("nothing but background in view"));
    // A shadow on a plain wall, a painted wall in even light, one pixel in eight lit.
    assert_eq!(fault(&layers(|x| if x < 16 { 1e-4 } else { 2e-4 }, |_| 0.5, 1.0)), None);
    assert_eq!(fault(&layers(|_| 1.0, |x| if x < 16 { 0.2 } else { 0.3 }, 1.0)), None);
    assert_eq!(fault(&layers(|x| if x < 4 { 1e-3 } else { 0.0 }, |_| 0.5, 1.0)), None);
}
