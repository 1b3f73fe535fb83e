//! Markov chains: targets that can be computed by hand, then pictures.

mod bootstrap;
mod flow;
mod mutations;
mod pssmlt;
mod synthetic;
