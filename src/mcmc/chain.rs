//! The step of Metropolis et al. 1953, for proposals that are not symmetric (Hastings 1970) and kernels that are chosen by
//! the state.
//!
//! The target density `f` needs no normalisation. From the state `x` one of several kernels is chosen, kernel `m` with
//! probability `s_m(x)`; it proposes `y` with density `T(x → y)`. The chain moves to `y` with probability
//!
//! ```text
//! a = min(1, C(x → y) s_m(y) / (C(y → x) s_m(x))),   C(x → y) = f(y) / T(x → y),
//! ```
//!
//! so that each kernel by itself carries as much weight from `x` to `y` as back, and `f` stays what it is (Veach and Guibas
//! 1997, "Metropolis Light Transport", section 5). A proposal that fails keeps the chain where it is.

use super::statistics::{Failure, Statistics};
use crate::sampler::IndependentSampler;

/// A changed state, and the two densities that decide whether the chain goes there.
#[derive(Clone, Debug)]
pub struct Proposal<S> {
    /// The state `y`.
    pub state: S,
    /// `ln C(x → y) = ln (f(y) / T(x → y))`. Factors that both directions share may be left out of both.
    pub forward: f64,
    /// `ln C(y → x) = ln (f(x) / T(y → x))`; infinite where `y` never leads back to `x`.
    pub backward: f64,
}

impl<S> Proposal<S> {
    /// From the target densities `[f(x), f(y)]` and the densities `[T(x → y), T(y → x)]` of the kernel.
    pub fn of_densities(state: S, target: [f64; 2], kernel: [f64; 2]) -> Self {
        Self {
            state,
            forward: target[1].ln() - kernel[0].ln(),
            backward: target[0].ln() - kernel[1].ln(),
        }
    }

    /// By a kernel with `T(x → y) = T(y → x)`, from the target densities `[f(x), f(y)]`.
    pub fn symmetric(state: S, target: [f64; 2]) -> Self {
        Self::of_densities(state, target, [1.0; 2])
    }
}

/// Probability of moving to a proposal of the kernel that was chosen with probability `selection[0]`, and would be chosen
/// with probability `selection[1]` in the proposed state.
///
/// # Errors
/// Why it is 0, where it is: nothing but a finite, positive ratio moves a chain.
pub fn acceptance<S>(proposal: &Proposal<S>, selection: [f64; 2]) -> Result<f64, Failure> {
    let Proposal { forward, backward, .. } = *proposal;
    let logarithm = forward - backward + selection[1].ln() - selection[0].ln();
    if forward == f64::NEG_INFINITY {
        Err(Failure::Dark)
    } else if (backward == f64::INFINITY || selection[1] == 0.0) && forward.is_finite() {
        Err(Failure::NoReturn)
    } else if !(forward.is_finite() && backward.is_finite() && logarithm.is_finite()) {
        Err(Failure::NotFinite)
    } else {
        Ok(logarithm.exp().min(1.0))
    }
}

/// The ways in which a chain's state can be changed.
pub trait Kernels {
    /// What the chain is in.
    type State;

    /// How they are called; one name a kernel.
    fn names(&self) -> &'static [&'static str];

    /// How readily a kernel is chosen in that state: the probability `s_m` is this over the sum for all kernels. 0 where it
    /// has nothing to change.
    fn selection(&self, kernel: usize, state: &Self::State) -> f64;

    /// Proposes another state.
    ///
    /// # Errors
    /// Why there is none.
    fn propose(
        &mut self,
        kernel: usize,
        state: &Self::State,
        numbers: &mut IndependentSampler,
    ) -> Result<Proposal<Self::State>, Failure>;

    /// Tells what became of the last proposal, also of one that failed: for kernels that remember more than the state.
    fn settle(&mut self, is_accepted: bool) {
        _ = is_accepted;
    }
}

/// A Markov chain that records the expected value of each step: the state it may leave with the probability of staying, the
/// proposed one with that of going there (Veach and Guibas 1997, section 5.5). Both sum to 1, so that nothing is lost.
#[derive(Clone, Debug)]
pub struct Chain<S> {
    state: S,
    /// Weight of the state that has not been recorded yet: it is recorded at once when the chain leaves.
    weight: f64,
    /// Steps since the chain moved.
    stay: u64,
    statistics: Statistics,
}

impl<S> Chain<S> {
    /// A chain in its first state, whose target density must be positive, with `kernels` ways of changing it. The first
    /// state itself is not recorded.
    pub fn new(state: S, kernels: usize) -> Self {
        Self { state, weight: 0.0, stay: 0, statistics: Statistics::new(kernels) }
    }

    /// Where it is.
    pub fn state(&self) -> &S {
        &self.state
    }

    /// How it went so far.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// One mutation. `record` gets states with their weights; all weights of a step sum to 1, but that of the current state
    /// may come with a later step, or with [`Chain::flush`].
    pub fn step<K: Kernels<State = S>>(
        &mut self,
        kernels: &mut K,
        numbers: &mut IndependentSampler,
        record: &mut impl FnMut(&S, f64),
    ) {
        let count = kernels.names().len();
        let total = |state: &S| (0..count).map(|m| kernels.selection(m, state)).sum::<f64>();
        let total_here = total(&self.state);
        // Nothing can be changed: the step leaves the chain where it is.
        let Some((kernel, chosen)) = choose(kernels, &self.state, total_here, numbers.next_f64())
        else {
            self.statistics.idle += 1;
            self.stay();
            return;
        };

        let outcome = kernels.propose(kernel, &self.state, numbers).and_then(|proposal| {
            let total: f64 = (0..count).map(|m| kernels.selection(m, &proposal.state)).sum();
            let back = kernels.selection(kernel, &proposal.state);
            let back = if back > 0.0 { back / total } else { 0.0 };
            let probability = acceptance(&proposal, [chosen / total_here, back])?;
            Ok((proposal.state, probability))
        });
        let statistics = &mut self.statistics.kernels[kernel];
        statistics.proposed += 1;
        match outcome {
            Err(failure) => {
                statistics.failures[failure as usize] += 1;
                kernels.settle(false);
                self.stay();
            }
            Ok((state, probability)) => {
                debug_assert!((0.0..=1.0).contains(&probability), "acceptance {probability}");
                statistics.expected += probability;
                self.weight += 1.0 - probability;
                if numbers.next_f64() < probability {
                    statistics.accepted += 1;
                    kernels.settle(true);
                    self.flush(record);
                    self.state = state;
                    self.weight = probability;
                    self.stay = 0;
                } else {
                    kernels.settle(false);
                    if probability > 0.0 {
                        record(&state, probability);
                    }
                    self.count_stay();
                }
            }
        }
    }

    /// Records what is still due to the current state.
    pub fn flush(&mut self, record: &mut impl FnMut(&S, f64)) {
        if self.weight > 0.0 {
            record(&self.state, self.weight);
            self.weight = 0.0;
        }
    }

    /// A step whose whole weight is the current state's.
    fn stay(&mut self) {
        self.weight += 1.0;
        self.count_stay();
    }

    fn count_stay(&mut self) {
        self.stay += 1;
        self.statistics.longest_stay = self.statistics.longest_stay.max(self.stay);
    }
}

/// The kernel that `u` in `[0, 1)` chooses, with how readily it is chosen; `None` where none can be.
fn choose<K: Kernels>(kernels: &K, state: &K::State, total: f64, u: f64) -> Option<(usize, f64)> {
    let mut left = u * total;
    let mut last = None;
    for kernel in 0..kernels.names().len() {
        let selection = kernels.selection(kernel, state);
        debug_assert!(selection >= 0.0, "selection {selection}");
        if selection > 0.0 {
            if left < selection {
                return Some((kernel, selection));
            }
            // Rounding may leave a little after the last one that can be chosen.
            left -= selection;
            last = Some((kernel, selection));
        }
    }
    last
}
