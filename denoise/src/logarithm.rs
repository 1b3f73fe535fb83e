//! The logarithms of the networks' input.

use crate::simd::{Kernel, vectorise};

/// `ln x` of a normal number `x > 0`, within 2e-7 of the larger of it and 1/3. What it gives for others means nothing.
///
/// Branch-free, so that it vectorises: `x = 2^k (1 + f)` with `1 + f` in `[√½, √2)`, and with `s = f / (2 + f)`
/// `ln(1 + f) = 2 artanh s = 2 (s + s³/3 + s⁵/5 + …)`, of which five terms leave `2 s¹¹/11 < 7e-10`. As `2 s = f − s f`, this
/// is `f − s (f − R)` with `R = 2 (s²/3 + s⁴/5 + …)`, whose first term is exact. `k ln 2` is added in two parts, the first
/// with few digits (Cody and Waite 1980).
#[inline(always)]
fn ln(x: f32) -> f32 {
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let bits = x.to_bits();
    // The exponent counts from √½ on.
    let k = bits.wrapping_sub(std::f32::consts::FRAC_1_SQRT_2.to_bits()) as i32 >> 23;
    let f = f32::from_bits(bits.wrapping_sub((k << 23) as u32)) - 1.0;
    let k = k as f32;
    let s = f / (2.0 + f);
    let z = s * s;
    let r = 2.0 * z * (1.0 / 3.0 + z * (0.2 + z * (1.0 / 7.0 + z * (1.0 / 9.0))));
    k * LN_2_HIGH + (f - s * (f - r) + k * LN_2_LOW)
}

/// `ln(1 + max(x, 0))`, within a relative error of 3e-7; of more than 1e38 that of 1e38.
#[inline(always)]
pub(crate) fn ln_1p(x: f32) -> f32 {
    let x = if x > 0.0 { x } else { 0.0 };
    let x = if x < 1e38 { x } else { 1e38 };
    let sum = 1.0 + x;
    // What the sum has lost, by the derivative of the logarithm.
    ln(sum) + (x - (sum - 1.0)) / sum
}

/// `ln x` of a normal number `x > 0`, NaN of all that is not above 0.
#[inline(always)]
pub(crate) fn ln_or_nan(x: f32) -> f32 {
    if x > 0.0 { ln(x) } else { f32::NAN }
}

/// Replaces all values by a function of them, one that is `#[inline(always)]`.
pub(crate) fn replace(values: &mut [f32], function: impl Fn(f32) -> f32) {
    vectorise(Replace { values, function });
}

struct Replace<'a, F> {
    values: &'a mut [f32],
    function: F,
}

impl<F: Fn(f32) -> f32> Kernel for Replace<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.values.iter_mut().for_each(|value| *value = (self.function)(*value));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every exponent, a thousand numbers each, and those next to the powers of two.
    fn numbers() -> impl Iterator<Item = f32> {
        let smallest = f32::MIN_POSITIVE.to_bits();
        let steps = (smallest..f32::INFINITY.to_bits()).step_by((1 << 23) / 1000);
        let powers = (1..255_u32).flat_map(|e| [(e << 23) - 1, e << 23, (e << 23) + 1]);
        steps.chain(powers.filter(move |bits| *bits >= smallest)).map(f32::from_bits)
    }

    #[test]
    fn the_logarithms_are_right() {
        let mut worst = [0.0_f64; 2];
        for x in numbers() {
            let exact = f64::from(x).ln();
            let error = (f64::from(ln(x)) - exact).abs() / exact.abs().max(1.0 / 3.0);
            worst[0] = worst[0].max(error);
            let exact = f64::from(x.min(1e38)).ln_1p();
            worst[1] = worst[1].max((f64::from(ln_1p(x)) / exact - 1.0).abs());
        }
        assert!(worst[0] < 2e-7 && worst[1] < 3e-7, "{worst:?}");
    }

    #[test]
    fn the_ends_are_right() {
        assert_eq!([0.0, -0.0, -3.0, f32::NAN, f32::NEG_INFINITY].map(ln_1p), [0.0; 5]);
        assert_eq!(ln_1p(1e-30), 1e-30);
        assert_eq!(ln_1p(f32::INFINITY), ln_1p(1e38));
        assert_eq!(ln_or_nan(1.0), 0.0);
        assert!([0.0, -1.0, f32::NAN].map(ln_or_nan).iter().all(|value| value.is_nan()));
    }

    #[test]
    fn every_processor_gives_the_same_bits() {
        let numbers: Vec<f32> = numbers().collect();
        let mut vectors = numbers.clone();
        replace(&mut vectors, ln_1p);
        let one_by_one: Vec<f32> = numbers.into_iter().map(ln_1p).collect();
        assert_eq!(vectors, one_by_one);
    }
}
