//! How chains fared, and why they stayed where they were.

use serde::{Deserialize, Serialize};

/// Why a proposal came to nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// It left the film, or the domain.
    Outside,
    /// A vertex is of another kind than the mutation needs: diffuse instead of a mirror, no surface at all, ...
    Label,
    /// Something stands between two vertices.
    Blocked,
    /// The target density is 0 there.
    Dark,
    /// From there the same kernel could not come back.
    NoReturn,
    /// Its choices left nothing to change.
    Impossible,
    /// A density was not a number.
    NotFinite,
}

impl Failure {
    /// All of them, in the order of declaration.
    pub const ALL: [Self; 7] = [
        Self::Outside,
        Self::Label,
        Self::Blocked,
        Self::Dark,
        Self::NoReturn,
        Self::Impossible,
        Self::NotFinite,
    ];

    /// Name for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Outside => "outside",
            Self::Label => "other kind of vertex",
            Self::Blocked => "blocked",
            Self::Dark => "dark",
            Self::NoReturn => "no way back",
            Self::Impossible => "nothing to change",
            Self::NotFinite => "not finite",
        }
    }
}

/// Counts of one kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KernelStatistics {
    /// How often it was chosen.
    pub proposed: u64,
    /// How often the chain went where it proposed.
    pub accepted: u64,
    /// Sum of the probabilities of going there.
    pub expected: f64,
    /// How often there was no proposal that could be accepted, by [`Failure`].
    pub failures: [u64; Failure::ALL.len()],
}

/// Counts of a chain, or of several together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// One entry a kernel.
    pub kernels: Vec<KernelStatistics>,
    /// Steps for which no kernel could be chosen.
    pub idle: u64,
    /// Most steps in a row without a move.
    pub longest_stay: u64,
}

impl KernelStatistics {
    /// Part of the proposals that were accepted, in expectation; 0 without any.
    pub fn acceptance(&self) -> f64 {
        self.expected / self.proposed.max(1) as f64
    }
}

impl Statistics {
    /// Nothing counted yet, of so many kernels.
    pub fn new(kernels: usize) -> Self {
        Self { kernels: vec![KernelStatistics::default(); kernels], ..Self::default() }
    }

    /// Adds the counts of another chain with the same kernels.
    pub fn merge(&mut self, other: &Self) {
        self.kernels.resize(self.kernels.len().max(other.kernels.len()), Default::default());
        for (kernel, more) in self.kernels.iter_mut().zip(&other.kernels) {
            kernel.proposed += more.proposed;
            kernel.accepted += more.accepted;
            kernel.expected += more.expected;
            for (count, more) in kernel.failures.iter_mut().zip(more.failures) {
                *count += more;
            }
        }
        self.idle += other.idle;
        self.longest_stay = self.longest_stay.max(other.longest_stay);
    }

    /// One line for people about each kernel, by the names that they have, such as
    /// `lens: 40.0 % of 1000 accepted; blocked 12.0 %, outside 3.0 %`.
    pub fn lines(&self, names: &[&str]) -> Vec<String> {
        let line = |(kernel, name): (&KernelStatistics, &&str)| {
            let part = |count: f64| 100.0 * count / kernel.proposed.max(1) as f64;
            let mut failures: Vec<(u64, Failure)> =
                kernel.failures.into_iter().zip(Failure::ALL).filter(|(n, _)| *n > 0).collect();
            failures.sort_by_key(|&(count, _)| std::cmp::Reverse(count));
            let failures: Vec<String> = failures
                .iter()
                .map(|&(count, why)| format!("{} {:.1} %", why.name(), part(count as f64)))
                .collect();
            let separator = if failures.is_empty() { "" } else { "; " };
            format!(
                "{name}: {:.1} % of {} accepted{separator}{}",
                part(kernel.expected),
                kernel.proposed,
                failures.join(", ")
            )
        };
        self.kernels.iter().zip(names).map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_are_counted_in_the_order_of_their_list() {
        for (index, failure) in Failure::ALL.into_iter().enumerate() {
            assert_eq!(failure as usize, index);
        }
    }

    #[test]
    fn a_line_tells_acceptance_and_the_commonest_failure_first() {
        let mut kernel =
            KernelStatistics { proposed: 8, accepted: 3, expected: 2.0, ..Default::default() };
        kernel.failures[Failure::Outside as usize] = 1;
        kernel.failures[Failure::Blocked as usize] = 2;
        let mut statistics = Statistics { kernels: vec![kernel], idle: 1, longest_stay: 5 };
        let expected = "lens: 25.0 % of 8 accepted; blocked 25.0 %, outside 12.5 %";
        assert_eq!(statistics.lines(&["lens"]), [expected]);
        assert_eq!(statistics.kernels[0].acceptance(), 0.25);
        statistics.merge(&Statistics { longest_stay: 9, ..statistics.clone() });
        assert_eq!((statistics.kernels[0].proposed, statistics.idle), (16, 2));
        assert_eq!(statistics.longest_stay, 9);
        assert_eq!(Statistics::new(1).lines(&["lens"]), ["lens: 0.0 % of 0 accepted"]);
    }
}
