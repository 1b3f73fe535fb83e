//! Error against seconds: the Pareto front, and what lies between two measurements.
//!
//! Between measurements a curve is straight in the logarithms of both; beyond them nothing is said.

use serde::{Deserialize, Serialize};

/// A measurement: seconds, and the error that is left after them. Both positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Wall time, in seconds.
    pub seconds: f64,
    /// Relative L2.
    pub error: f64,
}

/// When an error is reached.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reach {
    /// After so many seconds, between two measurements.
    After(f64),
    /// The first measurement, of so many seconds, has reached it.
    Within(f64),
    /// No measurement has; the last took so many seconds.
    Not(f64),
}

/// What is known of the error at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// Between two measurements, or at one.
    Measured(f64),
    /// Measurements end before; the last left this error.
    Ended(f64),
}

impl Level {
    /// The error that is left, at most, at that time.
    pub fn error(self) -> f64 {
        match self {
            Self::Measured(error) | Self::Ended(error) => error,
        }
    }
}

/// Measurements of one integrator and denoiser at rising sample counts.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    places: Vec<Place>,
}

impl Curve {
    /// A curve through `places`, in any order. Errors below `floor`, which is not measured, count as `floor`.
    pub fn new(mut places: Vec<Place>, floor: f64) -> Self {
        places.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        for place in &mut places {
            place.error = place.error.max(floor);
        }
        Self { places }
    }

    /// When the error first is `target`.
    pub fn reach(&self, target: f64) -> Option<Reach> {
        let last = self.places.last()?;
        let Some(index) = self.places.iter().position(|place| place.error <= target) else {
            return Some(Reach::Not(last.seconds));
        };
        let after = self.places[index];
        let Some(before) = index.checked_sub(1).map(|index| self.places[index]) else {
            return Some(Reach::Within(after.seconds));
        };
        let part = part(before.error, after.error, target);
        Some(Reach::After(between(before.seconds, after.seconds, part)))
    }

    /// The error after so many seconds; `None` before the first measurement.
    pub fn at(&self, seconds: f64) -> Option<Level> {
        let index = self.places.iter().rposition(|place| place.seconds <= seconds)?;
        let before = self.places[index];
        let Some(after) = self.places.get(index + 1) else {
            let is_there = before.seconds == seconds;
            let level = if is_there { Level::Measured } else { Level::Ended };
            return Some(level(before.error));
        };
        let part = part(before.seconds, after.seconds, seconds);
        Some(Level::Measured(between(before.error, after.error, part)))
    }

    /// Seconds of the first and of the last measurement.
    pub fn range(&self) -> Option<[f64; 2]> {
        Some([self.places.first()?.seconds, self.places.last()?.seconds])
    }
}

/// How far `value` is on the way from `from` to `to`, in logarithms.
fn part(from: f64, to: f64, value: f64) -> f64 {
    let way = (to / from).ln();
    if way == 0.0 { 0.0 } else { ((value / from).ln() / way).clamp(0.0, 1.0) }
}

fn between(from: f64, to: f64, part: f64) -> f64 {
    from * (to / from).powf(part)
}

/// Indices of the places that no other one beats in both seconds and error, from the fastest to the most accurate. Of equal
/// places the first is kept; places that are not finite are left out.
pub fn pareto_front(places: &[Place]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..places.len())
        .filter(|&index| places[index].seconds.is_finite() && places[index].error.is_finite())
        .collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (places[a], places[b]);
        a.seconds.total_cmp(&b.seconds).then(a.error.total_cmp(&b.error))
    });
    let mut front: Vec<usize> = Vec::new();
    for index in order {
        if front.last().is_none_or(|&best| places[index].error < places[best].error) {
            front.push(index);
        }
    }
    front
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(seconds: f64, error: f64) -> Place {
        Place { seconds, error }
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let places = [
            place(2.0, 0.5),
            place(1.0, 1.0),
            // Slower than the first, and as good: beaten.
            place(3.0, 0.5),
            place(4.0, 0.1),
            // Worse and slower.
            place(5.0, 0.2),
            // As fast as the second, and worse.
            place(1.0, 2.0),
            place(6.0, f64::NAN),
            // As fast as the last, better than all before, and worse than it.
            place(9.0, 0.095),
            place(9.0, 0.09),
        ];
        assert_eq!(pareto_front(&places), [1, 0, 3, 8]);
        assert_eq!(pareto_front(&[]), [0; 0]);
        assert_eq!(pareto_front(&[place(1.0, 1.0); 3]), [0]);
    }

    #[test]
    fn between_measurements_the_logarithms_are_straight() {
        // Error 1/t: at 1, 4 and 16 seconds.
        let curve = Curve::new(vec![place(4.0, 0.25), place(1.0, 1.0), place(16.0, 0.0625)], 0.0);
        for seconds in [1.0, 1.5, 2.0, 4.0, 9.0, 16.0] {
            let Some(Level::Measured(error)) = curve.at(seconds) else { panic!("{seconds}") };
            assert!((error * seconds - 1.0).abs() < 1e-12, "{seconds}: {error}");
            if seconds > 1.0 {
                let Some(Reach::After(found)) = curve.reach(1.0 / seconds) else { panic!() };
                assert!((found - seconds).abs() < 1e-12 * seconds, "{seconds}: {found}");
            }
        }
        assert_eq!(curve.range(), Some([1.0, 16.0]));
    }

    #[test]
    fn nothing_is_said_beyond_the_measurements() {
        let curve = Curve::new(vec![place(1.0, 1.0), place(4.0, 0.25)], 0.0);
        assert_eq!(curve.at(0.9), None);
        assert_eq!(curve.at(5.0), Some(Level::Ended(0.25)));
        assert_eq!(curve.reach(0.2), Some(Reach::Not(4.0)));
        assert_eq!(curve.reach(2.0), Some(Reach::Within(1.0)));
        assert_eq!(Curve::new(vec![], 0.0).reach(1.0), None);
        assert_eq!(Curve::new(vec![], 0.0).at(1.0), None);
    }

    #[test]
    fn a_curve_that_rises_again_has_reached_what_it_reached_first() {
        let places = vec![place(1.0, 1.0), place(2.0, 0.1), place(4.0, 0.4), place(8.0, 0.05)];
        let curve = Curve::new(places, 0.0);
        let Some(Reach::After(seconds)) = curve.reach(0.2) else { panic!() };
        // ln 5 / ln 10 of the way from 1 to 2.
        assert!((seconds - 2f64.powf(5f64.log10())).abs() < 1e-12);
        // What is below the floor is not told apart from it, and negative estimates have a logarithm.
        let noisy = Curve::new(vec![place(1.0, 1.0), place(2.0, -0.1)], 0.01);
        assert_eq!(noisy.at(2.0), Some(Level::Measured(0.01)));
    }
}
