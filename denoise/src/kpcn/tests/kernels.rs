//! What any logits must do: combine convexly, at the borders too.

use super::Random;
use crate::kpcn::pyramid::{self, FINEST_OUTPUTS, OUTPUTS};
use crate::kpcn::{kernel, softmax};

/// Sizes with odd and tiny levels, and one wider than two blocks.
const SIZES: [[usize; 2]; 7] = [[1, 1], [1, 9], [7, 1], [2, 2], [13, 11], [16, 16], [19, 77]];

/// Random logits of the five levels, in `±range`.
fn pyramid_logits(random: &mut Random, [height, width]: [usize; 2], range: f32) -> Vec<Vec<f32>> {
    [(FINEST_OUTPUTS, 1)]
        .into_iter()
        .chain(OUTPUTS)
        .map(|(channels, halvings)| {
            let count = channels * (height >> halvings) * (width >> halvings);
            random.uniforms(count, -range..range)
        })
        .collect()
}

/// Filters by the logits of the five levels.
pub(super) fn apply_logits<const C: usize>(
    levels: &[Vec<f32>],
    padded: [usize; 2],
    size: [usize; 2],
    signal: &[f32],
) -> Vec<f32> {
    // A convolution that gives what it is given.
    let mut identity = vec![0.0; FINEST_OUTPUTS * FINEST_OUTPUTS];
    identity.iter_mut().step_by(FINEST_OUTPUTS + 1).for_each(|weight| *weight = 1.0);
    let bias = vec![0.0; FINEST_OUTPUTS];
    let outputs: Vec<&[f32]> = levels.iter().chain([&identity, &bias]).map(Vec::as_slice).collect();
    pyramid::apply::<C>(&outputs, padded, size, &all(size), signal)
}

/// All rows and columns.
fn all([height, width]: [usize; 2]) -> [std::ops::Range<usize>; 2] {
    [0..height, 0..width]
}

/// Filters by a pyramid of random logits and by kernels of 5×5 and 21×21.
fn filtered(random: &mut Random, size: [usize; 2], range: f32, signal: &[f32]) -> [Vec<f32>; 3] {
    let padded = size.map(|side| side.next_multiple_of(16));
    let levels = pyramid_logits(random, padded, range);
    let [small, large] = [5, 21].map(|side| {
        let logits = random.uniforms(side * side * size[0] * size[1], -range..range);
        kernel::apply::<1>(&logits, size, side, signal)
    });
    [apply_logits::<1>(&levels, padded, size, signal), small, large]
}

#[test]
fn a_constant_image_stays_constant() {
    let mut random = Random(1);
    for size in SIZES {
        for range in [0.0, 3.0, 1e4] {
            let signal = vec![0.7; size[0] * size[1]];
            for result in filtered(&mut random, size, range, &signal) {
                // Weights that add up to 1 within 1e-6, three times one after the other.
                assert!(result.iter().all(|v| (v - 0.7).abs() < 3e-6), "{size:?}: {result:?}");
            }
        }
    }
}

#[test]
fn the_result_lies_among_its_inputs() {
    let mut random = Random(2);
    for size in SIZES {
        let signal = random.uniforms(size[0] * size[1], -2.0..5.0);
        let low = signal.iter().copied().fold(f32::INFINITY, f32::min);
        let high = signal.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        for result in filtered(&mut random, size, 8.0, &signal) {
            assert!(result.iter().all(|v| (low - 1e-5..=high + 1e-5).contains(v)), "{size:?}");
        }
    }
}

#[test]
fn one_hot_logits_are_the_identity() {
    let mut random = Random(3);
    for size in SIZES {
        let padded = size.map(|side| side.next_multiple_of(16));
        let signal = random.uniforms(size[0] * size[1], 0.0..4.0);
        let mut levels = pyramid_logits(&mut random, padded, 3.0);
        // The centre of the 5×5 taps on the finest level: four channels of half the size.
        levels[0][12 * padded[0] * padded[1]..][..padded[0] * padded[1]].fill(200.0);
        assert_eq!(apply_logits::<1>(&levels, padded, size, &signal), signal);

        let mut logits = random.uniforms(25 * size[0] * size[1], -3.0..3.0);
        logits[12 * size[0] * size[1]..][..size[0] * size[1]].fill(200.0);
        assert_eq!(kernel::apply::<1>(&logits, size, 5, &signal), signal);
    }
}

#[test]
fn equal_logits_are_the_mean_of_the_window() {
    let size = [6, 40];
    let signal = Random(4).uniforms(size[0] * size[1], 0.0..1.0);
    let result = kernel::apply::<1>(&vec![7.5; 9 * size[0] * size[1]], size, 3, &signal);
    for (y, x) in [(0, 0), (0, 39), (3, 17), (5, 33)] {
        let rows = crate::window::clipped(y, 1, size[0]);
        let window: Vec<f32> = rows
            .flat_map(|y| crate::window::clipped(x, 1, size[1]).map(move |x| (y, x)))
            .map(|(y, x)| signal[y * size[1] + x])
            .collect();
        let mean = window.iter().sum::<f32>() / window.len() as f32;
        assert!((result[y * size[1] + x] - mean).abs() < 1e-6, "({x}, {y})");
    }
}

#[test]
fn a_tap_outside_weighs_nothing_however_large_its_logit() {
    // The tap at the top left is all that counts, except where there is none.
    let size = [4, 35];
    let pixels = size[0] * size[1];
    let signal = Random(5).uniforms(pixels, 1.0..2.0);
    let mut logits = vec![0.0; 9 * pixels];
    logits[..pixels].fill(1e4);
    let result = kernel::apply::<1>(&logits, size, 3, &signal);
    for (y, x) in (1..4).flat_map(|y| (1..35).map(move |x| (y, x))) {
        assert_eq!(result[y * 35 + x], signal[(y - 1) * 35 + x - 1]);
    }
    assert!((result[0] - (signal[0] + signal[1] + signal[35] + signal[36]) / 4.0).abs() < 1e-6);
}

#[test]
fn only_the_coarsest_level_can_be_asked_for() {
    // Coarse centre taps take all on four levels; then each 16×16 cell is its mean under equal weights on the way down.
    let size = [32, 48];
    let padded = size;
    let signal = Random(6).uniforms(size[0] * size[1], 0.0..1.0);
    let mut levels = pyramid_logits(&mut Random(0), padded, 1e-30);
    // The finest level has four channels for each logit.
    for (logits, (centre, channels, halvings)) in
        levels.iter_mut().zip([(29, 4, 1), (29, 1, 1), (29, 1, 2), (29, 1, 3), (12, 1, 4)])
    {
        let count = channels * (padded[0] >> halvings) * (padded[1] >> halvings);
        logits[centre * count..][..count].fill(300.0);
    }
    let result = apply_logits::<1>(&levels, padded, size, &signal);
    for (y, x) in (0..32).flat_map(|y| (0..48).map(move |x| (y, x))) {
        let (row, column) = (y / 16 * 16, x / 16 * 16);
        let cell = (row..row + 16).flat_map(|y| (column..column + 16).map(move |x| (y, x)));
        let mean = cell.map(|(y, x)| signal[y * 48 + x]).sum::<f32>() / 256.0;
        assert!((result[y * 48 + x] - mean).abs() < 1e-5, "({x}, {y})");
    }
}

#[test]
fn every_processor_gives_the_same_bits() {
    let mut random = Random(7);
    let width = 77_usize;
    let stride = width + softmax::BLOCK - 1;
    let logits = random.uniforms(9 * width, -5.0..5.0);
    let values = random.uniforms(9 * stride, 0.0..3.0);
    let barrier = vec![0.0; stride];
    let taps: Vec<softmax::Tap<'_, 1>> = (0..9)
        .map(|tap| softmax::Tap {
            logits: &logits[tap * width..],
            barrier: &barrier,
            values: [&values[tap * stride..][..stride]],
        })
        .collect();
    let [mut vectors, mut plain] = [vec![0.0; width], vec![0.0; width]];
    softmax::combine(&taps, width, &mut vectors);
    softmax::combine_portably(&taps, width, &mut plain);
    assert_eq!(vectors, plain);
}
