//! Markov chains of any state: the one Metropolis–Hastings step that four methods share, where chains start, and how far
//! they jump. Only [`mutation`] knows of light.

pub mod bootstrap;
pub mod chain;
pub mod mutation;
pub mod statistics;

pub use crate::math::jump::{LogUniform, TwoTailed};
pub use bootstrap::Bootstrap;
pub use chain::{Chain, Kernels, Proposal, acceptance};
pub use statistics::{Failure, KernelStatistics, Statistics};
