//! How far mutations jump: distances over several orders of magnitude, lengths near the present one.

use std::f64::consts::TAU;

/// A distance whose logarithm is uniform in an interval: as often between 1 and 2 as between 10 and 20 (Veach and Guibas
/// 1997, section 5.3.2). With a uniform angle around it, the density of a point of the plane falls with the square of the
/// distance and is the same from either end of the jump.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogUniform {
    low: f64,
    high: f64,
}

impl LogUniform {
    /// Distances in `(low, high]`, in any unit; angles in radians.
    ///
    /// # Panics
    /// Unless `0 < low < high`.
    pub fn new(low: f64, high: f64) -> Self {
        assert!(0.0 < low && low < high && high.is_finite(), "distances from {low} to {high}");
        Self { low, high }
    }

    /// The largest distance.
    pub fn high(&self) -> f64 {
        self.high
    }

    /// All distances times a positive factor; their ratio, and with it the density of the logarithm, stays.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self::new(self.low * factor, self.high * factor)
    }

    /// A distance by `u` in `[0, 1)`.
    pub fn sample(&self, u: f64) -> f64 {
        self.high * (-u * self.logarithm()).exp()
    }

    /// Could [`LogUniform::sample`] give this distance? The same question both ways decides whether a jump can be undone.
    pub fn contains(&self, distance: f64) -> bool {
        self.low < distance && distance <= self.high
    }

    /// Density of a distance, per unit of distance; 0 outside.
    pub fn pdf(&self, distance: f64) -> f64 {
        if self.contains(distance) { 1.0 / (distance * self.logarithm()) } else { 0.0 }
    }

    /// Density of the point at that distance in a uniform direction of the plane, per unit of area: `1 / (2π r² ln)`.
    pub fn pdf_plane(&self, distance: f64) -> f64 {
        self.pdf(distance) / (TAU * distance)
    }

    /// Density of the direction at that angle to a given one, turned uniformly around it, per steradian:
    /// `1 / (2π θ sin θ ln)`. The angle must be below π.
    pub fn pdf_sphere(&self, angle: f64) -> f64 {
        self.pdf(angle) / (TAU * angle.sin())
    }

    fn logarithm(&self) -> f64 {
        (self.high / self.low).ln()
    }
}

/// Whole numbers near a centre: `p(i) ∝ 2^−|i − centre|` for `i` in `low..=high` (METHODS 5.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TwoTailed {
    centre: i64,
    low: i64,
    high: i64,
}

impl TwoTailed {
    /// Around `centre`, which need not be in the interval.
    ///
    /// # Panics
    /// If the interval is empty.
    pub fn new(centre: u32, low: u32, high: u32) -> Self {
        assert!(low <= high, "numbers from {low} to {high}");
        Self { centre: centre.into(), low: low.into(), high: high.into() }
    }

    /// Probability of `value`; 0 outside of the interval.
    pub fn pmf(&self, value: u32) -> f64 {
        let value = i64::from(value);
        if (self.low..=self.high).contains(&value) {
            self.weight(value) / self.total()
        } else {
            0.0
        }
    }

    /// A number by `u` in `[0, 1)`.
    pub fn sample(&self, u: f64) -> u32 {
        let mut left = u * self.total();
        for value in self.low..self.high {
            left -= self.weight(value);
            if left < 0.0 {
                return value as u32;
            }
        }
        self.high as u32
    }

    /// Weight of a number of the interval. The nearest one has 1, so that intervals far from the centre do not vanish.
    fn weight(&self, value: i64) -> f64 {
        let nearest = self.centre.clamp(self.low, self.high);
        let excess = (value - self.centre).abs() - (nearest - self.centre).abs();
        (-(excess as f64)).exp2()
    }

    /// Sum of all weights: two geometric series, which share the number nearest to the centre.
    fn total(&self) -> f64 {
        let nearest = self.centre.clamp(self.low, self.high);
        let side = |numbers: i64| 1.0 - (-(numbers as f64)).exp2();
        1.0 + side(nearest - self.low) + side(self.high - nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::IndependentSampler;

    #[test]
    fn the_radius_of_the_worked_example_has_its_median_and_density() {
        // METHODS N.7.
        let radius = LogUniform::new(0.1, 10.0);
        assert!((radius.sample(0.5) - 1.0).abs() < 1e-12);
        assert!((radius.pdf(1.0) - 0.217_15).abs() < 1e-5);
        assert!((radius.pdf_plane(1.0) - 0.034_560).abs() < 1e-6);
        assert_eq!(
            (radius.sample(0.0), radius.contains(10.0), radius.contains(0.1)),
            (10.0, true, false)
        );
        assert_eq!((radius.pdf(0.1), radius.pdf(10.001)), (0.0, 0.0));
        let largest = 1.0 - f64::EPSILON / 2.0;
        assert!(radius.scaled(3.0).contains(radius.scaled(3.0).sample(largest)));
    }

    #[test]
    fn logarithms_of_distances_are_uniform() {
        // Kolmogorov's statistic: √n sup |F̂ − F| > 2.63 has probability 2 exp(−2 · 2.63²) = 2·10⁻⁶.
        let jump = LogUniform::new(1e-3, 0.7);
        let mut numbers = IndependentSampler::new(1, 2, 3);
        let n = 100_000;
        let mut places: Vec<f64> = (0..n)
            .map(|_| {
                let distance = jump.sample(numbers.next_f64());
                assert!(jump.contains(distance));
                // The cumulative probability, by the density's integral and not by the sampler's inverse.
                (distance / 1e-3).ln() / (0.7f64 / 1e-3).ln()
            })
            .collect();
        places.sort_by(f64::total_cmp);
        let n = f64::from(n);
        let gap = places
            .iter()
            .enumerate()
            .map(|(i, place)| ((i + 1) as f64 / n - place).max(place - i as f64 / n));
        let statistic = n.sqrt() * gap.fold(0.0, f64::max);
        assert!(statistic < 2.63, "Kolmogorov {statistic}");
    }

    #[test]
    fn densities_of_the_plane_and_of_the_sphere_integrate_to_one() {
        // Simpson's rule in the logarithm of the distance, where both integrands are smooth: dA = 2π r dr = 2π r² d ln r,
        // dω = 2π sin θ dθ = 2π θ sin θ d ln θ.
        let jump = LogUniform::new(1e-4, 1.5);
        let span = (1.5f64 / 1e-4).ln();
        let steps = 2000;
        let integral = |integrand: &dyn Fn(f64) -> f64| -> f64 {
            let at = |i: usize| {
                // Half-open at the low end: a hair inside.
                let distance = 1e-4 * (span * i as f64 / steps as f64).exp();
                integrand(distance.clamp(1e-4 * (1.0 + 1e-12), 1.5))
            };
            let weight = |i: usize| match i {
                0 => 1.0,
                i if i == steps => 1.0,
                i if i % 2 == 1 => 4.0,
                _ => 2.0,
            };
            (0..=steps).map(|i| weight(i) * at(i)).sum::<f64>() * span / steps as f64 / 3.0
        };
        let plane = integral(&|r| jump.pdf_plane(r) * TAU * r * r);
        let sphere = integral(&|angle| jump.pdf_sphere(angle) * TAU * angle * angle.sin());
        assert!((plane - 1.0).abs() < 1e-9 && (sphere - 1.0).abs() < 1e-9, "{plane} {sphere}");
    }

    #[test]
    fn the_lengths_of_the_worked_example_have_their_probabilities() {
        // METHODS N.5: weights 1/2, 1, 1/2, 1/4, 1/8 of 3 to 7 around 4.
        let lengths = TwoTailed::new(4, 3, 7);
        assert!((lengths.pmf(3) - 0.210_526).abs() < 1e-6);
        assert!((lengths.pmf(4) - 0.421_053).abs() < 1e-6);
        assert_eq!((lengths.pmf(2), lengths.pmf(8)), (0.0, 0.0));
    }

    #[test]
    fn two_tailed_probabilities_sum_to_one_and_are_met() {
        let mut numbers = IndependentSampler::new(4, 5, 6);
        for (centre, low, high) in
            [(4, 3, 7), (0, 0, 0), (2, 5, 9), (9, 1, 3), (50, 1, 102), (3000, 1, 2)]
        {
            let lengths = TwoTailed::new(centre, low, high);
            let sum: f64 = (low..=high).map(|value| lengths.pmf(value)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{lengths:?}: {sum}");
            let n = 20_000;
            let mut counts = vec![0.0; (high - low + 1) as usize];
            for _ in 0..n {
                counts[(lengths.sample(numbers.next_f64()) - low) as usize] += 1.0;
            }
            // χ² over the numbers that expect 5 at least, the others together. Wilson and Hilferty's cubic normal
            // approximation of the quantile of 1 − 10⁻⁶ (4.75 standard deviations).
            let (mut statistic, mut cells, mut rest) = (0.0, 0.0, (0.0, 0.0));
            for (value, count) in (low..=high).zip(counts) {
                let expected = lengths.pmf(value) * f64::from(n);
                if expected >= 5.0 {
                    statistic += (count - expected) * (count - expected) / expected;
                    cells += 1.0;
                } else {
                    rest = (rest.0 + count, rest.1 + expected);
                }
            }
            statistic += (rest.0 - rest.1) * (rest.0 - rest.1) / rest.1.max(5.0);
            let spread = 2.0 / (9.0 * cells);
            let bound = cells * (1.0 - spread + 4.75 * f64::sqrt(spread)).powi(3);
            assert!(statistic < bound, "{lengths:?}: χ² {statistic}, bound {bound}");
        }
        assert_eq!(TwoTailed::new(4, 3, 7).sample(1.0 - f64::EPSILON / 2.0), 7);
    }
}
