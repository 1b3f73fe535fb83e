//! Laws of the whole system, in one binary: one link, and one place for what they share.

mod analytic;
mod bidirectional;
mod budgets;
mod buffers;
mod cli;
mod consistency;
mod dataset;
mod delta;
mod determinism;
mod emission;
mod equal_energy;
mod extremes;
mod inspect;
mod kept_inputs;
mod markov;
mod rays;
mod redistribution;
mod sampling;
mod scene;
mod strategies;
mod support;
mod survival;
mod tradeoff;
mod visibility;
