//! Markov chains: targets that can be computed by hand, then pictures.

mod bootstrap;
mod pssmlt;
mod synthetic;
