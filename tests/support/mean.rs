//! Means of random batches and their comparison.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Mean and variance of numbers given one after the other (Welford 1962).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Mean {
    count: u64,
    mean: f64,
    squares: f64,
}

impl Mean {
    /// Adds a number.
    pub(crate) fn add(&mut self, value: f64) {
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.squares += before * (value - self.mean);
    }

    /// How many numbers were added.
    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    /// Their mean.
    pub(crate) fn mean(&self) -> f64 {
        self.mean
    }

    /// The unbiased variance of one number; 0 for fewer than two numbers.
    pub(crate) fn variance(&self) -> f64 {
        if self.count < 2 { 0.0 } else { self.squares / (self.count - 1) as f64 }
    }

    /// Variance of the mean.
    pub(crate) fn variance_of_mean(&self) -> f64 {
        self.variance() / self.count.max(1) as f64
    }

    /// The same of the numbers times a factor.
    pub(crate) fn times(&self, factor: f64) -> Self {
        Self { mean: self.mean * factor, squares: self.squares * factor * factor, ..*self }
    }

    /// Two-sided p-value of the hypothesis that the expectation is `value` (Student's t).
    pub(crate) fn p_against(&self, value: f64) -> f64 {
        p_of(self.mean - value, self.variance_of_mean(), (self.count.max(2) - 1) as f64)
    }

    /// Two-sided p-value of the hypothesis that two expectations are the same (Welch's t).
    pub(crate) fn p_same_as(&self, other: &Self) -> f64 {
        let (a, b) = (self.variance_of_mean(), other.variance_of_mean());
        let degrees = (a + b) * (a + b)
            / (a * a / (self.count.max(2) - 1) as f64 + b * b / (other.count.max(2) - 1) as f64);
        p_of(self.mean - other.mean, a + b, if degrees.is_finite() { degrees } else { 1.0 })
    }
}

impl Extend<f64> for Mean {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, values: I) {
        values.into_iter().for_each(|value| self.add(value));
    }
}

impl FromIterator<f64> for Mean {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut mean = Self::default();
        mean.extend(values);
        mean
    }
}

/// Two-sided p-value of a difference with the given variance.
fn p_of(difference: f64, variance: f64, degrees: f64) -> f64 {
    if variance == 0.0 {
        // Constants: only equality up to rounding is no difference.
        return if difference.abs() < 1e-12 { 1.0 } else { 0.0 };
    }
    let t = StudentsT::new(0.0, 1.0, degrees).expect("degrees are positive");
    2.0 * t.sf((difference / variance.sqrt()).abs())
}

/// Two-sided p-value of a standard normal number.
pub(crate) fn p_of_z(z: f64) -> f64 {
    2.0 * Normal::standard().sf(z.abs())
}

#[test]
fn means_know_their_error() {
    let mut random = super::random::Random::new(2);
    let batch: Mean = (0..10_000).map(|_| random.next_f64()).collect();
    let other: Mean = (0..10_000).map(|_| random.next_f64()).collect();
    let exact: Mean = [4.0, 7.0, 13.0].into_iter().collect();
    assert!((exact.mean() - 8.0).abs() < 1e-12 && (exact.variance() - 21.0).abs() < 1e-12);
    assert_eq!(batch.count(), 10_000);
    assert!((batch.variance() - 1.0 / 12.0).abs() < 0.003);
    assert!(batch.p_against(0.5) > 1e-3 && batch.p_against(0.515) < 1e-4);
    let shifted: Mean = (0..10_000).map(|_| random.next_f64() + 0.03).collect();
    let (same, different) = (batch.p_same_as(&other), batch.p_same_as(&shifted));
    assert!(same > 1e-3 && different < 1e-4, "{same} {different}");
    let p = p_of_z(1.959_964);
    assert!((p - 0.05).abs() < 1e-6, "{p}");
}
