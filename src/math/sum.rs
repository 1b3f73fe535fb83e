//! Sums that do not tell in which order they were added up.

use serde::{Deserialize, Serialize};
use std::ops::AddAssign;

/// A sum of numbers of single precision and their squares in twice the digits of an `f64`, by the error-free addition of Knuth
/// (1969, "The Art of Computer Programming", volume 2, section 4.2.2, theorem B): what each addition rounds off is added up
/// by itself.
///
/// The sum is *exact*, and therefore the same in any order and in any parts that are merged, while the numbers and the
/// absolute values of all partial sums lie within some 106 binary digits: with `m` the lowest digit of any of `n` numbers
/// (for an `f32` of size `x`, `2⁻²³ x`; for its square `2⁻⁴⁶ x²`) and `S` the sum of their absolute values, all that is rounded
/// off is a multiple of `m` below `n 2⁻⁵³ S`, and an `f64` holds that exactly while `n S < 2¹⁰⁶ m`. A thousand samples may
/// thus reach from 10⁻⁸ to 10⁸, a million from 10⁻⁴. Beyond that what the order changes is some `n 2⁻¹⁰⁶` of `S`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sum {
    /// The sum, rounded at each addition.
    rounded: f64,
    /// What rounding took away.
    rest: f64,
}

impl Sum {
    /// The sum, rounded once.
    #[inline]
    pub fn value(self) -> f64 {
        self.rounded + self.rest
    }
}

impl From<f64> for Sum {
    fn from(value: f64) -> Self {
        Self { rounded: value, rest: 0.0 }
    }
}

impl AddAssign<f64> for Sum {
    #[inline]
    fn add_assign(&mut self, value: f64) {
        let sum = self.rounded + value;
        let of_value = sum - self.rounded;
        self.rest += (self.rounded - (sum - of_value)) + (value - of_value);
        self.rounded = sum;
    }
}

impl AddAssign for Sum {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self += other.rounded;
        self.rest += other.rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::{IndependentSampler, Sampler};

    /// Numbers of both signs from 10⁻⁸ to 10⁸, evenly in their logarithm, and their squares where they are to be.
    fn numbers(count: usize, is_squared: bool) -> Vec<f64> {
        let mut random = IndependentSampler::new(11, 0, 0);
        let mut draw = || {
            let size = 10f32.powf(16.0 * random.next_1d() - 8.0);
            if random.next_1d() < 0.5 { -size } else { size }
        };
        let power = if is_squared { 2 } else { 1 };
        (0..count).map(|_| f64::from(draw()).powi(power)).collect()
    }

    fn shuffle(numbers: &mut [f64], seed: u32) {
        let mut random = IndependentSampler::new(12, seed, 0);
        for last in (1..numbers.len()).rev() {
            numbers.swap(last, (random.next_f64() * (last + 1) as f64) as usize);
        }
    }

    fn sum(numbers: &[f64]) -> Sum {
        let mut sum = Sum::default();
        numbers.iter().for_each(|&number| sum += number);
        sum
    }

    #[test]
    fn the_order_and_the_parts_of_a_sum_do_not_show() {
        for is_squared in [false, true] {
            let mut numbers = numbers(100_000, is_squared);
            let expected = sum(&numbers).value();
            let plain = |numbers: &[f64]| numbers.iter().sum::<f64>();
            let (mut plain_differs, first) = (false, plain(&numbers));
            for seed in 0..20 {
                shuffle(&mut numbers, seed);
                assert_eq!(sum(&numbers).value().to_bits(), expected.to_bits());
                plain_differs |= plain(&numbers) != first;
                for parts in [2, 7, 1000] {
                    let mut merged = Sum::default();
                    numbers.chunks(numbers.len() / parts).for_each(|part| merged += sum(part));
                    assert_eq!(merged.value().to_bits(), expected.to_bits(), "{parts} parts");
                }
            }
            assert!(plain_differs, "a plain sum would have done");
        }
    }

    #[test]
    fn nothing_is_lost_next_to_much_larger_numbers() {
        let mut sum = Sum::default();
        for value in [1e-8f32, 1e8, 3e-8, -1e8, 1e30, -1e30] {
            sum += f64::from(value);
        }
        assert_eq!(sum.value(), f64::from(1e-8f32) + f64::from(3e-8f32));
    }
}
