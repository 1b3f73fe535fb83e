//! From radiance to the signals that kernels are applied to, and back (METHODS 10.1; Bako et al. 2017, section 4.1).
//!
//! The picture is split in two branches: the diffuse radiance with the albedo divided out, which leaves irradiance nearly
//! free of texture, and the rest. The *same noisy albedo* is divided out before and multiplied back after.

use crate::logarithm::ln_1p;

/// Added to the albedo, so that black surfaces do not divide by zero. (The paper's constant.)
pub const EPSILON: f32 = 0.00316;

/// Largest value of a filtered log-specular signal: exp(20) is 4.9e8, and only broken logits say more.
const LARGEST_LOG: f32 = 20.0;

/// What diffuse radiance is multiplied by to become a signal, of an albedo `a` and an exposure `e`: `e / (a + ε)`.
///
/// An albedo below 0 counts as 0. Multiplying the signal by [`remodulation`] gives the radiance back.
#[inline(always)]
pub(super) fn demodulation(albedo: f32, exposure: f32) -> f32 {
    exposure / (albedo.max(0.0) + EPSILON)
}

/// What a diffuse signal is multiplied by to become radiance: `(a + ε) / e`.
#[inline(always)]
pub(super) fn remodulation(albedo: f32, exposure: f32) -> f32 {
    (albedo.max(0.0) + EPSILON) / exposure
}

/// `ln(1 + max(c, 0))`.
#[inline(always)]
pub(super) fn logarithm(value: f32) -> f32 {
    ln_1p(value)
}

/// Specular radiance of a log-specular signal, the inverse of [`logarithm`].
#[inline(always)]
pub(super) fn exponential(signal: f32) -> f32 {
    signal.min(LARGEST_LOG).exp_m1()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_apart_is_put_together_again() {
        // METHODS 13.8: within 1e-6 relative, for black, for albedo 0 and for 1e8.
        for albedo in [0.0, 1e-6, 0.5, 1.0] {
            for radiance in [0.0, 1e-8, 0.3, 7.0, 1e8_f32] {
                for exposure in [1e-6, 1.0, 1e6] {
                    let signal = radiance * demodulation(albedo, exposure);
                    let again = signal * remodulation(albedo, exposure);
                    assert!((again - radiance).abs() <= 1e-6 * radiance, "{radiance} {again}");
                }
                let again = exponential(logarithm(radiance));
                // An f32 of size 18 has an ulp of 1.9e-6, which the exponential makes relative.
                let bound = if radiance > 1e3 { 2e-6 } else { 1e-6 };
                assert!((again - radiance).abs() <= bound * radiance, "{radiance} {again}");
            }
        }
        assert_eq!(logarithm(-3.0), 0.0);
        assert!(exponential(1e30).is_finite());
    }
}
