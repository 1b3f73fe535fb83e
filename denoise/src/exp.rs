//! The exponential function of the filters.

/// `e^(−distance)` for `distance ≥ 0`, infinity included, within a relative error of 3e-7; 0 beyond 87.68, where
/// `2^-126.5` is too small for a normal number; exactly 1 at 0.
///
/// Branch-free, so that it vectorises: `e^x = 2^k e^r`, `k` the nearest integer to `x / ln 2` and `r` in
/// `±ln 2 / 2`, where seven terms of the series leave `r⁷/7! < 1.3e-7`. Subtracting `k ln 2` in two parts, the first with
/// few digits, keeps `r` exact (Cody and Waite 1980).
#[inline(always)]
pub(crate) fn exp_negative(distance: f32) -> f32 {
    // Adding 1.5 · 2²³ rounds to an integer, which then stands in the last bits.
    const ROUND: f32 = 12_582_912.0;
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    // Any number from 87.68 on has an exponent below all that exist.
    let x = -if distance < 90.0 { distance } else { 90.0 };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
    // In pairs and not by Horner's rule, which would wait for each term (Estrin 1960).
    let square = r * r;
    let high = (1.0 / 24.0 + r * (1.0 / 120.0)) + square * (1.0 / 720.0);
    let series = (1.0 + r) + square * ((0.5 + r * (1.0 / 6.0)) + square * high);
    let exponent =
        (shifted.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32).wrapping_add(127);
    // An exponent of 0 is the number 0.
    let exponent = if exponent > 0 { exponent } else { 0 };
    series * f32::from_bits((exponent as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_right_to_three_parts_in_ten_million() {
        let mut worst = (0.0_f64, 0.0);
        for step in 0..=3_000_000_u32 {
            let distance = step as f32 * (87.67 / 3e6);
            let exact = (-f64::from(distance)).exp();
            let error = (f64::from(exp_negative(distance)) / exact - 1.0).abs();
            if error > worst.0 {
                worst = (error, distance);
            }
        }
        assert!(worst.0 < 3e-7, "relative error {} at {}", worst.0, worst.1);
    }

    #[test]
    fn the_exponential_has_the_right_ends() {
        assert_eq!(exp_negative(0.0), 1.0);
        assert_eq!(exp_negative(1e-30), 1.0);
        assert_eq!([87.7, 1e10, 1e38, f32::INFINITY].map(exp_negative), [0.0; 4]);
        assert!(exp_negative(87.67) > 0.0);
    }
}
