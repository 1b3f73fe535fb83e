//! Multiple importance sampling (Veach and Guibas 1995, "Optimally Combining Sampling Techniques").

/// Weight of a sample drawn with density `pdf` where another technique would have drawn it with density `other`: the
/// power heuristic with exponent 2 (eq. 16), one sample of each. Both densities are in the same measure.
///
/// Computed from the ratio of the two, so that densities up to the largest float neither overflow nor vanish; 0 where
/// the sample's own density is 0 or the other's is infinite.
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    // Which of them is larger nobody can predict: without a branch.
    let is_larger = pdf > other;
    let (small, large) = if is_larger { (other, pdf) } else { (pdf, other) };
    let ratio = small / large;
    let square = ratio * ratio;
    let weight = (if is_larger { 1.0 } else { square }) / (1.0 + square);
    if is_larger | ((pdf > 0.0) & other.is_finite()) { weight } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::power_heuristic;

    #[test]
    fn densities_of_one_to_four_weigh_one_to_sixteen() {
        // METHODS N.3.
        assert!((power_heuristic(0.2, 0.8) - 1.0 / 17.0).abs() < 1e-7);
        assert!((power_heuristic(0.8, 0.2) - 16.0 / 17.0).abs() < 1e-7);
    }

    #[test]
    fn weights_of_both_techniques_sum_to_one_at_the_extremes() {
        for (p, q) in [(1e-38, 1e38), (3e38, 3e38), (1e-45, 1e-45), (1.0, 0.0), (0.5, 2.0)] {
            let sum = power_heuristic(p, q) + power_heuristic(q, p);
            assert!((sum - 1.0).abs() < 1e-6, "p {p}, q {q}: {sum}");
        }
        assert_eq!(power_heuristic(0.0, 0.0), 0.0);
    }
}
