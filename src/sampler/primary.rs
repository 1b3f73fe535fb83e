//! Random numbers that are remembered and changed.

use super::{IndependentSampler, Sampler, unit_interval};
use crate::math::jump::LogUniform;
use glam::Vec2;

/// The point of primary sample space that a sample was made from: as many uniform numbers as were asked for, which
/// the next sample gets again, all changed a little or all new (Kelemen et al. 2002, "A Simple and Robust Mutation Strategy
/// for the Metropolis Light Transport Algorithm", section 3).
///
/// Both changes are symmetric: a new number does not depend on the old one, and a small step goes as often back as forth,
/// around the ends of `[0, 1)`. Numbers are changed when they are asked for: each remembers the time of its last change, and
/// makes up for the accepted mutations that it missed.
#[derive(Clone, Debug)]
pub struct PrimarySampler {
    /// Where changes come from.
    changes: IndependentSampler,
    /// Lengths of small steps.
    small_step: LogUniform,
    /// The numbers of each walk, so that a walk that grows longer does not shift those of the next.
    walks: Vec<Walk>,
    /// Which walk is under way.
    walk: usize,
    /// Accepted mutations, and the one under way.
    time: u64,
    /// Time of the last accepted mutation that made all numbers new.
    renewed: u64,
    /// Does the mutation under way make all numbers new?
    is_large: bool,
}

/// The numbers of one walk.
#[derive(Clone, Debug, Default)]
struct Walk {
    numbers: Vec<Number>,
    /// How many of them the sample under way has asked for.
    used: usize,
}

/// One dimension.
#[derive(Clone, Copy, Debug)]
struct Number {
    value: f64,
    /// Time of its last change.
    time: u64,
    /// Value and time before the mutation under way.
    before: (f64, u64),
}

impl PrimarySampler {
    /// Numbers as `first` gives them: the first sample is the one that `first` itself would make.
    pub fn new(first: IndependentSampler, small_step: LogUniform) -> Self {
        Self {
            changes: first,
            small_step,
            walks: vec![Walk::default()],
            walk: 0,
            time: 0,
            renewed: 0,
            is_large: true,
        }
    }

    /// From now on changes come from `changes`.
    pub fn change_by(&mut self, changes: IndependentSampler) {
        self.changes = changes;
    }

    /// Begins a mutation, in which all numbers are made new or all make a small step. It must end with
    /// [`PrimarySampler::accept`] or [`PrimarySampler::reject`].
    pub fn mutate(&mut self, is_large: bool) {
        self.time += 1;
        self.walks.iter_mut().for_each(|walk| walk.used = 0);
        self.walk = 0;
        self.is_large = is_large;
    }

    /// Keeps the changes.
    pub fn accept(&mut self) {
        if self.is_large {
            self.renewed = self.time;
        }
    }

    /// Takes the changes back.
    pub fn reject(&mut self) {
        let used = self.walks.iter_mut().flat_map(|walk| &mut walk.numbers[..walk.used]);
        for number in used {
            if number.time == self.time {
                (number.value, number.time) = number.before;
            }
        }
        self.time -= 1;
    }

    fn next_number(&mut self) -> f64 {
        let Self { changes, small_step, walks, walk, time, renewed, is_large } = self;
        let Walk { numbers, used } = &mut walks[*walk];
        if *used == numbers.len() {
            let value = f64::from(changes.next_1d());
            numbers.push(Number { value, time: *renewed, before: (value, *renewed) });
        }
        let number = &mut numbers[*used];
        *used += 1;
        // What it missed is done once and for all: it is no part of the mutation that may be taken back.
        if number.time < *renewed {
            number.value = f64::from(changes.next_1d());
            number.time = *renewed;
        }
        if number.time == *time {
            return number.value;
        }
        if !*is_large {
            while number.time + 1 < *time {
                number.value = step(number.value, small_step, changes);
                number.time += 1;
            }
        }
        number.before = (number.value, number.time);
        number.value = if *is_large {
            f64::from(changes.next_1d())
        } else {
            step(number.value, small_step, changes)
        };
        number.time = *time;
        number.value
    }
}

/// A value moved back or forth, around the ends of `[0, 1)`.
fn step(value: f64, length: &LogUniform, changes: &mut IndependentSampler) -> f64 {
    let u = 2.0 * changes.next_f64();
    let moved = if u < 1.0 { value + length.sample(u) } else { value - length.sample(u - 1.0) };
    let wrapped = moved - moved.floor();
    // A hair below 0 rounds up to 1.
    if wrapped < 1.0 { wrapped } else { 0.0 }
}

impl Sampler for PrimarySampler {
    #[inline]
    fn next_1d(&mut self) -> f32 {
        // The top bits, as in every sampler: rounding to the nearest f32 could give 1.
        unit_interval((self.next_number() * 4_294_967_296.0) as u32)
    }

    #[inline]
    fn next_2d(&mut self) -> Vec2 {
        let x = self.next_1d();
        Vec2::new(x, self.next_1d())
    }

    fn begin_walk(&mut self, walk: u16) {
        self.walk = usize::from(walk);
        if self.walk >= self.walks.len() {
            self.walks.resize_with(self.walk + 1, Walk::default);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: (f64, f64) = (1.0 / 1024.0, 1.0 / 64.0);

    fn sampler(seed: u64) -> PrimarySampler {
        let first = IndependentSampler::new(seed, 0, 0);
        PrimarySampler::new(first, LogUniform::new(SMALL.0, SMALL.1))
    }

    fn take<const N: usize>(sampler: &mut PrimarySampler) -> [f32; N] {
        std::array::from_fn(|_| sampler.next_1d())
    }

    /// Distance on the circle of circumference 1.
    fn distance(a: f32, b: f32) -> f64 {
        let difference = f64::from((a - b).abs());
        difference.min(1.0 - difference)
    }

    #[test]
    fn the_first_sample_is_that_of_the_generator() {
        let mut plain = IndependentSampler::new(7, 0, 0);
        let mut primary = sampler(7);
        for _ in 0..20 {
            assert_eq!(plain.next_2d(), primary.next_2d());
            assert_eq!(plain.next_1d(), primary.next_1d());
        }
    }

    #[test]
    fn a_rejected_mutation_leaves_no_trace_and_an_accepted_one_stays() {
        let mut primary = sampler(1);
        let before: [f32; 8] = take(&mut primary);
        // A mutation that asks for no number and is accepted leaves a step to be made up for; one that asks for more than
        // before must not leave the additional ones changed either.
        for is_large in [false, true, false, true] {
            primary.mutate(is_large);
            let proposed: [f32; 12] = take(&mut primary);
            assert!(proposed.iter().zip(before).all(|(a, b)| *a != b));
            primary.reject();
        }
        primary.mutate(false);
        let accepted: [f32; 8] = take(&mut primary);
        primary.accept();
        for (a, b) in accepted.iter().zip(before) {
            assert!(distance(*a, b) <= SMALL.1 && distance(*a, b) >= SMALL.0 * 0.999, "{a} {b}");
        }
        primary.mutate(false);
        let proposed: [f32; 8] = take(&mut primary);
        for (a, b) in proposed.iter().zip(accepted) {
            assert!(distance(*a, b) <= SMALL.1, "from the accepted value, {a} {b}");
        }
    }

    #[test]
    fn numbers_that_were_not_asked_for_make_up_for_what_they_missed() {
        // After k accepted small steps without being asked for, the value is k + 1 steps away: E[d²] of a step is
        // (s2² − s1²) / (2 ln(s2/s1)), and steps are independent. 20 000 replicas; the fourth moment of a sum of k + 1
        // symmetric steps is at most 3 (its variance)² plus that of its steps: relative error of the mean square below
        // √(6 / 20 000) = 1.7 %; 4.5 of them.
        let (s1, s2) = SMALL;
        let second = (s2 * s2 - s1 * s1) / (2.0 * (s2 / s1).ln());
        for missed in [0u32, 1, 5] {
            let mut squares = 0.0;
            let replicas = 20_000u32;
            for replica in 0..replicas {
                let mut primary = sampler(100 + u64::from(replica));
                let before = take::<3>(&mut primary)[2];
                for _ in 0..missed {
                    primary.mutate(false);
                    take::<1>(&mut primary);
                    primary.accept();
                }
                primary.mutate(false);
                squares += distance(take::<3>(&mut primary)[2], before).powi(2);
            }
            let ratio = squares / f64::from(replicas) / (f64::from(missed + 1) * second);
            assert!((ratio - 1.0).abs() < 4.5 * 0.0173, "{missed} missed: {ratio}");
        }
        // A large step that was missed makes the number new: its distance is uniform in [0, 1/2], E[d²] = 1/12.
        let mut squares = 0.0;
        for replica in 0..20_000 {
            let mut primary = sampler(50_000 + replica);
            let before = take::<3>(&mut primary)[2];
            primary.mutate(true);
            take::<1>(&mut primary);
            primary.accept();
            primary.mutate(false);
            squares += distance(take::<3>(&mut primary)[2], before).powi(2);
        }
        // Var(d²) = 1/80 − 1/144; the small step after it changes the distribution of the distance not at all.
        let error = ((1.0 / 80.0 - 1.0 / 144.0) / 20_000.0f64).sqrt();
        assert!((squares / 20_000.0 - 1.0 / 12.0).abs() < 4.5 * error);
    }

    #[test]
    fn a_walk_that_grows_does_not_shift_the_next() {
        let mut primary = sampler(3);
        let before: [f32; 4] = take(&mut primary);
        primary.begin_walk(1);
        let light: [f32; 4] = take(&mut primary);
        primary.mutate(false);
        let longer: [f32; 9] = take(&mut primary);
        primary.begin_walk(1);
        let moved: [f32; 4] = take(&mut primary);
        for (a, b) in longer.iter().zip(before).chain(moved.iter().zip(light)) {
            assert!(distance(*a, b) <= SMALL.1, "{a} {b}");
        }
        // All of it is taken back.
        primary.reject();
        primary.mutate(false);
        let again: [f32; 4] = take(&mut primary);
        primary.begin_walk(1);
        let light_again: [f32; 4] = take(&mut primary);
        for (a, b) in again.iter().zip(before).chain(light_again.iter().zip(light)) {
            assert!(distance(*a, b) <= SMALL.1 && *a != b, "{a} {b}");
        }
    }

    #[test]
    fn small_steps_keep_numbers_uniform_across_the_ends() {
        // 40 000 independent numbers after 30 small steps: χ² over 1024 cells, narrow enough to see what gathers at an end.
        // 1023 degrees of freedom: 4.75 standard deviations of √2046 for a level of 10⁻⁶.
        let mut counts = [0u32; 1024];
        for replica in 0..10_000 {
            let mut primary = sampler(100_000 + replica);
            take::<4>(&mut primary);
            for _ in 0..29 {
                primary.mutate(false);
                take::<4>(&mut primary);
                primary.accept();
            }
            primary.mutate(false);
            for value in take::<4>(&mut primary) {
                assert!((0.0..1.0).contains(&value));
                counts[(value * 1024.0) as usize] += 1;
            }
        }
        let expected = 40_000.0 / 1024.0;
        let chi_squared: f64 =
            counts.iter().map(|&count| (f64::from(count) - expected).powi(2) / expected).sum();
        assert!(chi_squared < 1023.0 + 4.75 * f64::sqrt(2046.0), "χ² {chi_squared}");
    }
}
