//! Owen-scrambled Sobol' points, padded to any number of dimensions.
//!
//! The first two Sobol' dimensions are a (0, 2)-sequence: any aligned 2ᵏ of its points put exactly one point into each
//! elementary interval of area 2⁻ᵏ. Further dimensions of the sequence are worse in pairs, need tables, and end
//! somewhere; so this sampler uses the same two dimensions again for every pair of numbers, each time in another
//! order and scrambled anew ("padding": Kollig and Keller 2002, "Efficient Multidimensional Sampling", section 2.2).
//! Both the order and the values are permuted by nested uniform (Owen) scrambling, done by a hash of the bit-reversed
//! value (Burley 2020, "Practical Hash-based Owen Scrambling", sections 3 and 5).
//!
//! A pixel has two halves, A and B: sample `i` is element `i >> 1` of half `i & 1`, and the halves are scrambled
//! independently, so that the difference of their means measures the error of their mean.

use super::{Sampler, hash, unit_interval};
use glam::Vec2;

/// Pairs computed together, in one 256-bit vector where the machine has those: two bounces of a path tracer, which takes
/// three or four pairs a bounce. Each multiplication waits for the one before, so that eight cost little more than four.
const LANES: usize = 8;

/// Hashes of 64 bits that seed a batch: three scrambles of 32 bits a lane.
const SEEDS: usize = 3 * LANES / 2;

/// Owen-scrambled Sobol' points; see the [module](self). Up to 2³² samples a pixel and 2³² numbers a sample.
#[derive(Clone, Debug)]
pub struct SobolSampler {
    /// Identifies seed, pixel and half.
    key: u64,
    /// The sample's index in its half, bits reversed.
    reversed_index: u32,
    /// How many batches have been computed.
    batch: u32,
    /// How many pairs of the batch have been given out.
    used: usize,
    pairs: [[f32; LANES]; 2],
    /// Second number of a pair whose first one was taken alone.
    spare: Option<f32>,
}

impl SobolSampler {
    /// The numbers of sample `sample` of the pixel with linear index `pixel`.
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Self {
        Self {
            key: hash::key(seed, pixel, sample & 1),
            reversed_index: (sample >> 1).reverse_bits(),
            batch: 0,
            used: LANES,
            pairs: [[0.0; LANES]; 2],
            spare: None,
        }
    }

    #[inline]
    fn next_pair(&mut self) -> [f32; 2] {
        if self.used == LANES {
            self.refill();
        }
        let lane = self.used;
        self.used += 1;
        [self.pairs[0][lane], self.pairs[1][lane]]
    }

    /// Computes the next `LANES` pairs. Written lane by lane so that the compiler makes vector instructions of it.
    #[inline(never)]
    fn refill(&mut self) {
        let mut seeds = [0u64; SEEDS];
        let first = self.key.wrapping_add(
            u64::from(self.batch).wrapping_mul(hash::STEP.wrapping_mul(SEEDS as u64)),
        );
        for (i, seed) in seeds.iter_mut().enumerate() {
            *seed = hash::mix(first.wrapping_add(hash::STEP.wrapping_mul(i as u64)));
        }
        let words = |scramble: usize| -> [u32; LANES] {
            let first = scramble * LANES / 2;
            std::array::from_fn(|lane| (seeds[first + lane / 2] >> (32 * (lane % 2))) as u32)
        };

        // Each pair visits the sequence in its own order. The nested scramble keeps aligned blocks of 2ᵏ together.
        let index = reverse(permute([self.reversed_index; LANES], words(0)));

        // The first dimension is the bit-reversed index; the scramble wants its argument reversed again.
        let x = reverse(permute(index, words(1)));
        let y = reverse(permute(second_dimension_reversed(index), words(2)));
        self.pairs = [x.map(unit_interval), y.map(unit_interval)];
        self.batch = self.batch.wrapping_add(1);
        self.used = 0;
    }
}

impl Sampler for SobolSampler {
    /// A number of a pair whose other number is the next one taken alone.
    #[inline]
    fn next_1d(&mut self) -> f32 {
        match self.spare.take() {
            Some(second) => second,
            None => {
                let [first, second] = self.next_pair();
                self.spare = Some(second);
                first
            }
        }
    }

    #[inline]
    fn next_2d(&mut self) -> Vec2 {
        self.next_pair().into()
    }

    fn begin_walk(&mut self, walk: u16) {
        self.batch = u32::from(walk) << 16;
        self.used = LANES;
        self.spare = None;
    }
}

/// Second Sobol' dimension at `index`, with the most significant digit in bit 0.
///
/// Its generator matrix is Pascal's triangle modulo 2, where `C(i, j)` is odd if and only if the bits of `j` are among
/// those of `i` (Lucas). Digit `j` is thus the sum of the index's bits over all positions that contain `j`, which five
/// butterfly steps give without a table.
#[inline]
fn second_dimension_reversed(mut index: [u32; LANES]) -> [u32; LANES] {
    const STEPS: [(u32, u32); 5] =
        [(1, 0x5555_5555), (2, 0x3333_3333), (4, 0x0f0f_0f0f), (8, 0x00ff_00ff), (16, 0x0000_ffff)];
    for (distance, lacks) in STEPS {
        for bits in &mut index {
            *bits ^= (*bits >> distance) & lacks;
        }
    }
    index
}

/// A nested uniform permutation of bit-reversed values: bit `k` is flipped by a hash of `seed` and the bits below it.
/// The form is that of Laine and Karras 2011 ("Stratified Sampling for Stochastic Transparency", section 3.1), the
/// constants and the multiplication by the seed are Vegdahl's (2021, "Building a Better LK Hash"), who found them by
/// measuring how evenly each bit depends on those below.
#[inline]
fn permute(mut values: [u32; LANES], seeds: [u32; LANES]) -> [u32; LANES] {
    for (value, seed) in values.iter_mut().zip(seeds) {
        let mut bits = *value;
        bits ^= bits.wrapping_mul(0x3d20_adea);
        bits = bits.wrapping_add(seed);
        bits = bits.wrapping_mul((seed >> 16) | 1);
        bits ^= bits.wrapping_mul(0x0552_6c56);
        bits ^= bits.wrapping_mul(0x53a2_2864);
        *value = bits;
    }
    values
}

#[inline]
fn reverse(values: [u32; LANES]) -> [u32; LANES] {
    values.map(u32::reverse_bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::IndependentSampler;

    /// The first `count` points of half A of pair `pair`.
    fn points(seed: u64, pixel: u32, pair: usize, count: u32) -> Vec<Vec2> {
        let point = |i: u32| {
            let mut sampler = SobolSampler::new(seed, pixel, 2 * i);
            (0..pair).for_each(|_| _ = sampler.next_2d());
            sampler.next_2d()
        };
        (0..count).map(point).collect()
    }

    /// Correlation coefficient of the first coordinates.
    fn correlation(a: &[Vec2], b: &[Vec2]) -> f64 {
        let product = |a: &Vec2, b: &Vec2| (f64::from(a.x) - 0.5) * (f64::from(b.x) - 0.5);
        a.iter().zip(b).map(|(a, b)| product(a, b)).sum::<f64>() / a.len() as f64 * 12.0
    }

    /// Variance over 256 pixels of the mean of `f` over `count` samples of half A.
    fn variance<S: Sampler>(
        count: u32,
        new: impl Fn(u64, u32, u32) -> S,
        f: impl Fn(Vec2) -> f64,
    ) -> f64 {
        const PIXELS: u32 = 256;
        let mean = |pixel| {
            (0..count).map(|i| f(new(5, pixel, 2 * i).next_2d())).sum::<f64>() / f64::from(count)
        };
        let means: Vec<f64> = (0..PIXELS).map(mean).collect();
        let center = means.iter().sum::<f64>() / f64::from(PIXELS);
        means.iter().map(|mean| (mean - center).powi(2)).sum::<f64>() / f64::from(PIXELS - 1)
    }

    #[test]
    fn another_walk_begins_at_the_same_dimension_whatever_came_before() {
        let third = |taken: usize| {
            let mut sampler = SobolSampler::new(1, 2, 3);
            (0..taken).for_each(|_| _ = sampler.next_1d());
            sampler.begin_walk(1);
            (0..3).for_each(|_| _ = sampler.next_2d());
            sampler.next_1d()
        };
        assert_eq!(third(5), third(80));
        assert_ne!(third(0), SobolSampler::new(1, 2, 3).next_1d());
    }

    #[test]
    fn the_second_dimension_is_that_of_joe_and_kuo() {
        // Points 0 to 7 of dimension 2 in any table of direction numbers (its polynomial is x + 1, all m_i are 1,
        // 3, 5, 15, ...): 0, 1/2, 3/4, 1/4, 5/8, 1/8, 3/8, 7/8 in the natural (not the Gray code) order.
        let expected = [0.0, 0.5, 0.75, 0.25, 0.625, 0.125, 0.375, 0.875];
        for (index, value) in expected.into_iter().enumerate() {
            let bits = second_dimension_reversed([index as u32; LANES]);
            assert_eq!(reverse(bits).map(unit_interval), [value; LANES], "point {index}");
        }
    }

    #[test]
    fn every_aligned_power_of_two_of_points_is_a_net() {
        for (pixel, pair) in [(0, 0), (0, 3), (1, 4), (999_999, 13)] {
            let all = points(7, pixel, pair, 1024);
            for k in 0..=10u32 {
                for block in all.chunks_exact(1 << k) {
                    for columns in 0..=k {
                        let mut seen = vec![false; 1 << k];
                        for point in block {
                            let x = (point.x * (1u32 << columns) as f32) as usize;
                            let y = (point.y * (1u32 << (k - columns)) as f32) as usize;
                            let interval = (x << (k - columns)) + y;
                            assert!(
                                !seen[interval],
                                "pair {pair}: two points in an interval of 2^-{k}"
                            );
                            seen[interval] = true;
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_last_samples_are_stratified_too() {
        let first = (1u32 << 31) - 256;
        let numbers = |i: u32| SobolSampler::new(3, 4, 2 * (first + i) + 1).next_2d();
        let mut strata: Vec<u32> = (0..256).map(|i| (numbers(i).x * 256.0) as u32).collect();
        strata.sort_unstable();
        assert!(strata.iter().copied().eq(0..256));
    }

    #[test]
    fn single_values_are_uniform() {
        // One value of each of 65 536 pixels, where nothing is stratified: χ² over 64 cells.
        for skip in [0, 1, 7, 8, 30] {
            let mut counts = [0u32; 64];
            for pixel in 0..65_536 {
                let mut sampler = SobolSampler::new(11, pixel, 0);
                (0..skip).for_each(|_| _ = sampler.next_1d());
                counts[(sampler.next_1d() * 64.0) as usize] += 1;
            }
            let chi_squared: f64 =
                counts.iter().map(|&count| (f64::from(count) - 1024.0).powi(2) / 1024.0).sum();
            // 63 degrees of freedom: 125 is the quantile of 1 - 5e-6.
            assert!(chi_squared < 125.0, "χ² {chi_squared} after {skip} numbers");
        }
    }

    #[test]
    fn pairs_of_single_values_fill_the_square_evenly() {
        // The joint distribution of two values, over pixels: the two of a pair, of neighbouring pairs, of neighbouring
        // batches, and of the halves. χ² over 16×16 cells, 255 degrees of freedom: 370 is the quantile of 1 - 3e-6.
        let numbers = |pixel, sample, index: usize| {
            let mut sampler = SobolSampler::new(13, pixel, sample);
            (0..index).for_each(|_| _ = sampler.next_1d());
            sampler.next_1d()
        };
        for (first, second) in
            [((0, 0), (0, 1)), ((0, 0), (0, 2)), ((0, 1), (0, 9)), ((0, 0), (1, 0))]
        {
            let mut counts = [0u32; 256];
            for pixel in 0..65_536 {
                let x = (numbers(pixel, first.0, first.1) * 16.0) as usize;
                counts[x * 16 + (numbers(pixel, second.0, second.1) * 16.0) as usize] += 1;
            }
            let chi_squared: f64 =
                counts.iter().map(|&count| (f64::from(count) - 256.0).powi(2) / 256.0).sum();
            assert!(chi_squared < 370.0, "χ² {chi_squared} of {first:?} and {second:?}");
        }
    }

    #[test]
    fn groups_pixels_seeds_and_halves_are_uncorrelated() {
        // Of n stratified points against others in independent order the correlation is N(0, 1/n); of 64 such, all
        // within 4.8 standard deviations with probability 1 - 1e-4.
        const COUNT: u32 = 1024;
        let bound = 4.8 / f64::from(COUNT).sqrt();
        let reference = points(1, 1, 0, COUNT);
        for k in 0..16 {
            let half_b = |i: u32| SobolSampler::new(1, 1 + k, 2 * i + 1).next_2d();
            for (what, other) in [
                ("group", points(1, 1, 1 + k as usize, COUNT)),
                ("pixel", points(1, 2 + k, 0, COUNT)),
                ("seed", points(2 + u64::from(k), 1, 0, COUNT)),
                ("half", (0..COUNT).map(half_b).collect()),
            ] {
                let correlation = correlation(&reference, &other);
                assert!(
                    correlation.abs() < bound,
                    "{what} {k}: correlation {correlation}, bound {bound}"
                );
            }
        }
    }

    #[test]
    fn the_halves_have_independent_errors() {
        // Were they parts of one sequence, their errors would be opposite. The correlation of the errors of 1024 pixels
        // is N(0, 1/1024).
        let f = |u: Vec2| f64::from((3.0 * u.x + u.y * u.y).sin());
        let error = |pixel, half: u32| {
            let mean = (0..16u32)
                .map(|i| f(SobolSampler::new(17, pixel, 2 * i + half).next_2d()))
                .sum::<f64>()
                / 16.0;
            // ∫∫ sin(3x + y²), by the antiderivative in x and Simpson's rule with 4000 intervals in y.
            mean - 0.614_593_8
        };
        let errors: Vec<[f64; 2]> =
            (0..1024).map(|pixel| [error(pixel, 0), error(pixel, 1)]).collect();
        let moment = |i: usize, j: usize| errors.iter().map(|e| e[i] * e[j]).sum::<f64>();
        let correlation = moment(0, 1) / (moment(0, 0) * moment(1, 1)).sqrt();
        assert!(correlation.abs() < 4.0 / 32.0, "correlation of the halves' errors {correlation}");
    }

    #[test]
    fn the_error_of_a_smooth_integrand_falls_faster_than_that_of_independent_numbers() {
        let smooth = |u: Vec2| f64::from((3.0 * u.x + u.y * u.y).sin());
        let variances = [16, 64, 256].map(|count| variance(count, SobolSampler::new, smooth));
        // Independent numbers gain 4 by four times the samples; a scrambled net gains 64 on smooth integrands,
        // asymptotically (Owen 1997). 256 pixels give a variance to within 9 %, so 30 is far from both.
        assert!(variances[0] / variances[1] > 30.0, "{variances:?}");
        assert!(variances[1] / variances[2] > 30.0, "{variances:?}");
        let independent = variance(256, IndependentSampler::new, smooth);
        assert!(independent / variances[2] > 1000.0, "{independent} against {variances:?}");
    }

    #[test]
    fn equal_keys_give_equal_numbers_and_mixed_calls_lose_none() {
        let mut a = SobolSampler::new(1, 2, 3);
        let mut b = a.clone();
        for _ in 0..100 {
            // a: 1, 2, 1 numbers; b: the pair taken alone, then the pair. The same four numbers either way.
            let alone = a.next_1d();
            let pair = a.next_2d();
            let partner = a.next_1d();
            assert_eq!(Vec2::new(alone, partner), b.next_2d());
            assert_eq!(pair, b.next_2d());
            for value in [alone, pair.x, pair.y, partner] {
                assert!((0.0..1.0).contains(&value));
            }
        }
    }
}
