//! Where things stand: discs on a floor that do not overlap.

use super::random::Random;
use glam::DVec2;

/// A rectangle of floor and the discs taken on it; coordinates are x and z.
#[derive(Clone, Debug)]
pub(super) struct FloorPlan {
    low: DVec2,
    high: DVec2,
    taken: Vec<(DVec2, f64)>,
}

impl FloorPlan {
    /// A free floor between two corners.
    pub(super) fn new(low: DVec2, high: DVec2) -> Self {
        Self { low, high, taken: Vec::new() }
    }

    /// A free place for a disc of this radius, taken from now on; `None` where none was found.
    pub(super) fn find(&mut self, random: &mut Random, radius: f64) -> Option<DVec2> {
        let (low, high) = (self.low + radius, self.high - radius);
        if low.cmpgt(high).any() {
            return None;
        }
        for _ in 0..24 {
            let at = DVec2::new(random.uniform(low.x, high.x), random.uniform(low.y, high.y));
            if self.is_free(at, radius) {
                self.take(at, radius);
                return Some(at);
            }
        }
        None
    }

    /// Is nothing within this distance?
    pub(super) fn is_free(&self, at: DVec2, radius: f64) -> bool {
        self.taken.iter().all(|(other, size)| at.distance(*other) >= radius + size)
    }

    /// Takes a disc.
    pub(super) fn take(&mut self, at: DVec2, radius: f64) {
        self.taken.push((at, radius));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_keep_apart_and_inside() {
        let mut random = Random::new(2, 0);
        let mut plan = FloorPlan::new(DVec2::ZERO, DVec2::new(4.0, 3.0));
        let mut found: Vec<(DVec2, f64)> = Vec::new();
        for _ in 0..60 {
            let radius = random.uniform(0.1, 0.6);
            if let Some(at) = plan.find(&mut random, radius) {
                assert!(at.cmpge(DVec2::splat(radius)).all());
                assert!(at.x <= 4.0 - radius && at.y <= 3.0 - radius);
                assert!(found.iter().all(|(other, size)| at.distance(*other) >= radius + size));
                found.push((at, radius));
            }
        }
        assert!(found.len() > 5 && found.len() < 60, "{} discs", found.len());
        assert_eq!(plan.find(&mut random, 1.6), None, "larger than the floor");
    }
}
