//! What replicates tell: means with confidence intervals, and errors split into bias and variance.

use ndarray::Zip;
use quietlight_denoise::Image;
use quietlight_denoise::metrics::RELATIVE_L2_EPSILON;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A mean over replicates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Ends of its 95 % confidence interval; `None` of one replicate, which tells nothing of the others.
    pub interval: Option<[f64; 2]>,
}

impl Estimate {
    /// Mean of `values` with Student's interval: `x̄ ± t₀.₉₇₅,ₙ₋₁ s / √n`. NaN of no values.
    pub fn of(values: &[f64]) -> Self {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let interval = (values.len() > 1).then(|| {
            let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
            let deviation = (squares / (count - 1.0) / count).sqrt();
            let half = quantile(count - 1.0) * deviation;
            [mean - half, mean + half]
        });
        Self { mean, interval }
    }

    /// Do the intervals have no point in common? False where one is not known.
    pub fn is_apart_from(&self, other: &Self) -> bool {
        match (self.interval, other.interval) {
            (Some([low, high]), Some([other_low, other_high])) => {
                high < other_low || other_high < low
            }
            _ => false,
        }
    }
}

/// The 97.5 % quantile of Student's distribution of so many degrees of freedom; at least 1.
fn quantile(freedom: f64) -> f64 {
    let student = StudentsT::new(0.0, 1.0, freedom.max(1.0));
    student.map_or(f64::NAN, |student| student.inverse_cdf(0.975))
}

/// A reference as two independent halves: its own noise then has no part in an error.
#[derive(Clone, Debug)]
pub struct Reference {
    halves: [Image; 2],
    /// The mean of the halves.
    pub mean: Image,
    /// Relative L2 of the noise of the mean: `mean (r₁ − r₂)² / 4 / (r̄² + 0.01)`.
    pub noise: f64,
}

/// What replicates of a picture are off by, in relative L2. The errors' mean is `bias² + variance`.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    /// Error of each replicate.
    pub errors: Vec<f64>,
    /// Squared bias, the error of the mean of infinitely many replicates; the estimate may be negative. `None` of one.
    pub bias2: Option<f64>,
    /// Variance of a replicate. `None` of one.
    pub variance: Option<f64>,
}

impl Reference {
    /// A reference of two halves of one shape.
    pub fn new(halves: [Image; 2]) -> Self {
        let mean = Zip::from(&halves[0]).and(&halves[1]).map_collect(|&a, &b| 0.5 * (a + b));
        let terms =
            Zip::from(&halves[0]).and(&halves[1]).and(&mean).fold(0.0, |sum, &a, &b, &r| {
                let difference = f64::from(a) - f64::from(b);
                sum + 0.25 * difference * difference / scale(r)
            });
        let noise = terms / mean.len() as f64;
        Self { halves, mean, noise }
    }

    /// Unbiased squared error of a picture, relative as in the relative L2: the mean over pixels and channels of
    /// `(x − r₁)(x − r₂) / (r̄² + 0.01)`. What the halves of the reference are off by are independent of each other and of the
    /// picture, so that their product vanishes on average; the result can be a little below zero. The denominator is not free
    /// of their noise, which matters only where that is not small against the picture's error.
    pub fn error(&self, picture: &Image) -> f64 {
        self.mean_of(picture, |x, [r1, r2]| (x - r1) * (x - r2))
    }

    /// Splits the error of replicates `x₁ … xₙ` of one picture. The variance `v` is that among them, relative as the error
    /// is; the error of their mean picture is on average `bias² + v / n`, which gives the bias.
    pub fn split(&self, replicates: &[Image]) -> Split {
        let errors: Vec<f64> = replicates.iter().map(|picture| self.error(picture)).collect();
        let count = replicates.len() as f64;
        if replicates.len() < 2 {
            return Split { errors, bias2: None, variance: None };
        }
        let mut mean = ndarray::Array3::<f64>::zeros(self.mean.dim());
        for picture in replicates {
            Zip::from(&mut mean).and(picture).for_each(|mean, &x| *mean += f64::from(x) / count);
        }
        let mut variance = 0.0;
        for picture in replicates {
            variance +=
                Zip::from(&mean).and(picture).and(&self.mean).fold(0.0, |sum, &m, &x, &r| {
                    let off = f64::from(x) - m;
                    sum + off * off / scale(r)
                });
        }
        variance /= (count - 1.0) * self.mean.len() as f64;
        // In double precision: the mean of single ones would be rounded by more than a good denoiser is off by.
        let of_mean = self.mean_of(&mean, |m, [r1, r2]| (m - r1) * (m - r2));
        Split { errors, bias2: Some(of_mean - variance / count), variance: Some(variance) }
    }

    fn mean_of<T: Copy + Into<f64>>(
        &self,
        picture: &ndarray::Array3<T>,
        term: impl Fn(f64, [f64; 2]) -> f64,
    ) -> f64 {
        let [first, second] = &self.halves;
        let sum = Zip::from(picture)
            .and(first)
            .and(second)
            .and(&self.mean)
            .fold(0.0, |sum, &x, &r1, &r2, &r| {
                sum + term(x.into(), [r1.into(), r2.into()]) / scale(r)
            });
        sum / picture.len() as f64
    }
}

/// The denominator of the relative error.
fn scale(reference: f32) -> f64 {
    let reference = f64::from(reference);
    reference * reference + RELATIVE_L2_EPSILON
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_students() {
        // 1, 2, 3: mean 2, s 1; t of two degrees of freedom is 4.302 652 7 (any table).
        let estimate = Estimate::of(&[1.0, 2.0, 3.0]);
        let half = 4.302_652_7 / 3f64.sqrt();
        let [low, high] = estimate.interval.unwrap();
        assert_eq!(estimate.mean, 2.0);
        assert!((low - (2.0 - half)).abs() < 1e-6 && (high - (2.0 + half)).abs() < 1e-6);
        assert_eq!(Estimate::of(&[5.0]), Estimate { mean: 5.0, interval: None });
    }

    #[test]
    fn intervals_that_touch_are_not_apart() {
        let of = |low, high| Estimate { mean: 0.5 * (low + high), interval: Some([low, high]) };
        assert!(of(1.0, 2.0).is_apart_from(&of(2.1, 3.0)));
        assert!(of(2.1, 3.0).is_apart_from(&of(1.0, 2.0)));
        assert!(!of(1.0, 2.0).is_apart_from(&of(2.0, 3.0)));
        assert!(!of(1.0, 4.0).is_apart_from(&of(2.0, 3.0)));
        assert!(!Estimate::of(&[1.0]).is_apart_from(&of(2.0, 3.0)));
    }

    #[test]
    fn a_picture_that_is_off_by_a_tenth_has_that_error() {
        // (0.1)² / (0.3² + 0.01) = 0.1.
        let picture = |value| Image::from_elem((3, 4, 5), value);
        let reference = Reference::new([picture(0.3), picture(0.3)]);
        assert_eq!(reference.noise, 0.0);
        assert!((reference.error(&picture(0.4)) - 0.1).abs() < 1e-6);
        let split = reference.split(&[picture(0.4), picture(0.4)]);
        assert!((split.bias2.unwrap() - 0.1).abs() < 1e-6, "{split:?}");
        assert!(split.variance.unwrap() < 1e-12, "{split:?}");
        // 0.2 and 0.4: each is off by 0.1, their mean not at all; variance 0.02 over 0.1.
        let split = reference.split(&[picture(0.2), picture(0.4)]);
        assert!((split.variance.unwrap() - 0.2).abs() < 1e-6, "{split:?}");
        assert!((split.bias2.unwrap() + 0.1).abs() < 1e-6, "{split:?}");
    }
}
