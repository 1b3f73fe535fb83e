//! Russian roulette: ending a walk at random without changing its mean.

/// The estimate `F' = (F − q c) / (1 − q)` with probability `1 − q`, else `c`: it has the mean of `F` for every `c`
/// (Ghosh 2024, "Global Illumination I", slide 9). `evaluate` computes `F`, and runs only when the walk goes on.
///
/// `q` must be in `[0, 1)` and `u` uniform in `[0, 1)`.
pub fn russian_roulette(q: f64, c: f64, u: f64, evaluate: impl FnOnce() -> f64) -> f64 {
    debug_assert!((0.0..1.0).contains(&q), "termination probability {q}");
    if u < q { c } else { (evaluate() - q * c) / (1.0 - q) }
}

/// The same with `c = 0` for a walk whose throughput is still to be multiplied: the factor `1 / (1 − q)`, or `None` when
/// the walk ends.
///
/// The walk goes on with probability `1 − q = clamp(importance, 0.05, 0.95)`; `importance` is the largest component of
/// the throughput with the compression of radiance by refraction taken out, so that a walk inside glass is not killed
/// for being there. The lower limit bounds the weight that a survivor can gain to 20; the upper one ends walks between
/// two perfect mirrors.
pub fn survive(importance: f32, u: f32) -> Option<f32> {
    #[expect(
        clippy::manual_clamp,
        reason = "`clamp` would keep a NaN; `max` turns it into the lower limit, and the sample is dropped where it is added up"
    )]
    let probability = importance.max(0.05).min(0.95);
    (u < probability).then(|| 1.0 / probability)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::{IndependentSampler, Sampler};

    /// Mean and variance of many draws.
    fn moments(draws: usize, mut draw: impl FnMut() -> f64) -> (f64, f64) {
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..draws {
            let value = draw();
            sum += value;
            squares += value * value;
        }
        let mean = sum / draws as f64;
        (mean, squares / draws as f64 - mean * mean)
    }

    #[test]
    fn a_two_valued_estimate_has_the_moments_of_the_worked_example() {
        // METHODS N.2: F is 0 or 2, q = 0.5, c = 1: mean 1, variance 2.
        let mut numbers = IndependentSampler::new(1, 0, 0);
        let (mean, variance) = moments(400_000, || {
            let u = f64::from(numbers.next_1d());
            let f = if numbers.next_1d() < 0.5 { 0.0 } else { 2.0 };
            russian_roulette(0.5, 1.0, u, || f)
        });
        // Standard errors: mean sqrt(2/n) = 0.0022; variance sqrt((m4 - 4)/n) with m4 = 8, 0.0032. Bounds are 4.5 of them.
        assert!((mean - 1.0).abs() < 0.010, "mean {mean}");
        assert!((variance - 2.0).abs() < 0.0143, "variance {variance}");
    }

    #[test]
    fn any_c_keeps_the_mean_and_changes_the_variance_as_derived() {
        // F ~ U[0, 2]: mean 1, variance 1/3. F' has E[F'²] = q c² + E[(F - q c)²] / (1 - q).
        let q = 0.4;
        for (stream, c) in [0.0, 0.5, 2.0].into_iter().enumerate() {
            let second = q * c * c + (1.0 / 3.0 + (1.0 - q * c) * (1.0 - q * c)) / (1.0 - q);
            let expected = second - 1.0;
            let mut numbers = IndependentSampler::new(2, stream as u32, 0);
            let n = 400_000;
            let (mean, variance) = moments(n, || {
                let u = f64::from(numbers.next_1d());
                let f = 2.0 * f64::from(numbers.next_1d());
                russian_roulette(q, c, u, || f)
            });
            let error = (expected / n as f64).sqrt();
            assert!((mean - 1.0).abs() < 4.5 * error, "c {c}: mean {mean}");
            // |F' - 1| ≤ 8/3 here, so the fourth central moment is at most (8/3)² of the variance.
            let variance_error = (expected * (64.0 / 9.0) / n as f64).sqrt();
            assert!(
                (variance - expected).abs() < 4.5 * variance_error,
                "c {c}: {variance}, expected {expected}"
            );
        }
    }

    #[test]
    fn survival_is_never_certain_nor_impossible() {
        assert_eq!(survive(0.0, 0.049), Some(20.0));
        assert_eq!(survive(0.0, 0.051), None);
        assert_eq!(survive(1e30, 0.951), None);
        assert_eq!(survive(0.5, 0.25), Some(2.0));
        assert_eq!(survive(f32::NAN, 0.5), None);
    }
}
