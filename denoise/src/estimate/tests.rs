use super::*;
use crate::window::box_mean;

const SIZE: usize = 96;
/// What holds for a filter of fixed weights.
const LINEAR: Factors =
    Factors { variance: 0.5, change: 0.0, bias: 1.0, spread: 0.1, correlated: [0.0, 0.0] };

/// Repeatable noise of variance 1, the sum of twelve uniform numbers less 6.
pub(super) fn noise(seed: u64) -> Image {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    Image::from_shape_simple_fn((3, SIZE, SIZE), || {
        let mut sum = -6.0;
        for _ in 0..12 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum += (state >> 40) as f32 / 16_777_216.0;
        }
        sum
    })
}

/// Waves, which a wide filter flattens.
fn truth() -> Image {
    Image::from_shape_fn((3, SIZE, SIZE), |(channel, y, x)| {
        1.0 + 0.2 * (0.4 * x as f32 + channel as f32).sin() * (0.3 * y as f32).cos()
    })
}

/// A render of that truth, its noise of this standard deviation in each half, and what a box filter makes of it.
fn render(deviation: f32, radius: usize, seed: u64) -> (Layers, Image, [Image; 2]) {
    let halves = [seed, seed + 1].map(|seed| truth() + noise(seed) * deviation);
    let mean = (&halves[0] + &halves[1]) * 0.5;
    let denoised = box_mean(&mean, radius);
    let of_halves = [0, 1].map(|index| box_mean(&halves[index], radius));
    let mut layers = Layers { width: SIZE, height: SIZE, ..Layers::default() };
    let layer = Layer { mean, variance: None, halves: Some(halves) };
    layers.layers.insert(LayerKind::Beauty, layer);
    (layers, denoised, of_halves)
}

fn estimated(deviation: f32, radius: usize, seed: u64) -> (ErrorEstimate, f64) {
    let (layers, denoised, [a, b]) = render(deviation, radius, seed);
    let found = ErrorEstimate::from_halves(&denoised, [&a, &b], &layers, LINEAR);
    let true_error = crate::metrics::relative_l2(&denoised, &truth()).unwrap();
    (found.unwrap().unwrap(), true_error)
}

#[test]
fn the_error_of_a_linear_filter_is_found_whether_it_is_noise_or_blur() {
    // Noise rules at radius 1, blur at radius 4. The bias is seen through 27 648 products of noise, each of which has the
    // standard deviation 0.01: 6e-5; three of these, and a tenth for r² in the denominator, which is not quite that of
    // the model where a filter flattens waves.
    for (radius, seed) in [(1, 1), (2, 5), (4, 9)] {
        let (found, expected) = estimated(0.1, radius, seed);
        let difference = (found.relative_l2 - expected).abs();
        assert!(
            difference < 3.0 * 6e-5 + 0.1 * expected,
            "radius {radius}: {} for {expected}",
            found.relative_l2
        );
        assert!(found.interval[0] < expected && expected < found.interval[1], "{found:?}");
    }
}

#[test]
fn the_map_has_the_mean_of_the_estimate_and_is_large_where_the_error_is() {
    let (mut layers, mut denoised, mut halves) = render(0.1, 1, 3);
    // A quarter of the picture is filtered to nothing: an error of 100 %.
    for image in [&mut denoised].into_iter().chain(&mut halves) {
        image.slice_mut(ndarray::s![.., ..SIZE / 2, ..SIZE / 2]).fill(0.0);
    }
    let found = ErrorEstimate::from_halves(&denoised, [&halves[0], &halves[1]], &layers, LINEAR);
    let found = found.unwrap().unwrap();
    let mean = f64::from(found.map.sum()) / found.map.len() as f64;
    assert!((mean / found.relative_l2 - 1.0).abs() < 1e-4, "{mean} {}", found.relative_l2);
    let [inside, outside] = [found.map[[0, 20, 20]], found.map[[0, 75, 75]]];
    assert!(inside > 20.0 * outside, "{inside} {outside}");
    layers.error = Some(found.map);
    layers.check_shapes().unwrap();
}

#[test]
fn a_firefly_of_one_half_is_no_error_of_a_filter_that_took_it_out() {
    let (mut layers, denoised, [a, b]) = render(0.1, 1, 3);
    let before = ErrorEstimate::from_halves(&denoised, [&a, &b], &layers, LINEAR);
    let beauty = layers.layers.get_mut(&LayerKind::Beauty).unwrap();
    beauty.halves.as_mut().unwrap()[0][[1, 40, 40]] = 1e3;
    let after = ErrorEstimate::from_halves(&denoised, [&a, &b], &layers, LINEAR);
    let [before, after] = [before, after].map(|found| found.unwrap().unwrap().relative_l2);
    // Its product with the error of the other half, 0.1, is 100 at one of 27 648 values: 3.6e-3 for an error of 6.5e-4,
    // and its square 0.01 of the squared picture. The product is not believed; what stays is the usual bias of a
    // variance of 1.1e-3.
    assert!(after < 4.0 * before, "{before} {after}");
}

#[test]
fn noise_that_neighbours_share_makes_the_estimate_larger_and_its_interval_wider() {
    // Means of 9 × 9 pixels: neighbours four apart have 5 of 9 columns in common.
    let halves = [1, 2].map(|seed| truth() + box_mean(&noise(seed), 4));
    let mean = (&halves[0] + &halves[1]) * 0.5;
    let mut layers = Layers { width: SIZE, height: SIZE, ..Layers::default() };
    let beauty = Layer { mean: mean.clone(), variance: None, halves: Some(halves.clone()) };
    layers.layers.insert(LayerKind::Beauty, beauty);
    let of = |correlated| {
        let factors = Factors { correlated, ..LINEAR };
        let [a, b] = &halves;
        ErrorEstimate::from_halves(&mean, [a, b], &layers, factors).unwrap().unwrap()
    };
    let [plain, more] = [of([0.0, 0.0]), of([2.0, 3.0])];
    let growth = (more.relative_l2 / plain.relative_l2).ln();
    assert!((growth / (2.0 * 5.0 / 9.0) - 1.0).abs() < 0.25, "{growth}");
    let width = |found: &ErrorEstimate| (found.interval[1] / found.interval[0]).ln() / 2.0;
    let spread = (width(&more) / NINETY_PERCENT).powi(2) - (width(&plain) / NINETY_PERCENT).powi(2);
    assert!((spread.sqrt() / (1.5 * growth) - 1.0).abs() < 1e-6, "{spread} {growth}");
    let mean = f64::from(more.map.sum()) / more.map.len() as f64;
    assert!((mean / more.relative_l2 - 1.0).abs() < 1e-4);
}

#[test]
fn bias_that_noise_hides_is_taken_for_the_usual() {
    // Precisions 1/4 and 1/9: (2/4 + 3/9)/(1/4 + 1/9) and 1/√(1/4 + 1/9).
    let (mean, error) = posterior_bias(2.0, 4.0, 2.0);
    assert!((mean - (0.5 + 3.0 / 9.0) / (0.25 + 1.0 / 9.0)).abs() < 1e-12);
    assert!((error - (0.25_f64 + 1.0 / 9.0).sqrt().recip()).abs() < 1e-12);
    // Products that say more than the usual are believed: 1 − 1/100 of 10, and 1/100 of 0.15.
    assert!((posterior_bias(10.0, 1.0, 0.1).0 - (9.9 + 0.0015)).abs() < 1e-12);
    assert!((posterior_bias(5.0, 1e12, 2.0).0 - 3.0).abs() < 1e-5);
    assert_eq!(posterior_bias(-5.0, 1e-9, 2.0).0, 0.0);
}

#[test]
fn nothing_is_said_where_nothing_is_known() {
    let (mut layers, denoised, [a, b]) = render(0.1, 1, 3);
    let wrong = Image::zeros((3, 1, 1));
    assert!(ErrorEstimate::from_halves(&wrong, [&a, &b], &layers, LINEAR).is_err());
    let of = |layers: &Layers, picture: &Image| {
        ErrorEstimate::from_halves(picture, [&a, &b], layers, LINEAR).unwrap().is_none()
    };
    let mut broken = denoised.clone();
    broken[[0, 3, 3]] = f32::NAN;
    assert!(!of(&layers, &denoised) && of(&layers, &broken));
    let beauty = layers.layers.get_mut(&LayerKind::Beauty).unwrap();
    let same = beauty.mean.clone();
    beauty.halves = Some([same.clone(), same]);
    assert!(of(&layers, &denoised));
    layers.layers.clear();
    assert!(of(&layers, &denoised));
}

#[test]
fn a_half_is_a_picture_of_half_the_samples() {
    let (mut layers, ..) = render(0.1, 1, 3);
    layers.samples = Some(Image::from_elem((1, SIZE, SIZE), 8.0));
    let beauty = layers.layers.get_mut(&LayerKind::Beauty).unwrap();
    beauty.variance = Some(Image::from_elem((3, SIZE, SIZE), 0.005));
    let halves = beauty.halves.clone().unwrap();
    let other = beauty.clone();
    layers.layers.insert(LayerKind::Albedo, other);
    for (index, expected) in halves.iter().enumerate() {
        let one = half(&layers, index, |kind| kind == LayerKind::Beauty);
        assert_eq!(one.layers.len(), 1);
        let beauty = &one.layers[&LayerKind::Beauty];
        assert_eq!(&beauty.mean, expected);
        assert_eq!(beauty.variance.as_ref().unwrap()[[0, 0, 0]], 0.01);
        assert!(beauty.halves.is_none());
        assert_eq!(one.samples.unwrap()[[0, 0, 0]], 4.0);
    }
}
