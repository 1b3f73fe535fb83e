//! Laws of the whole system, in one binary: one link, and one place for what they share.

mod analytic;
mod buffers;
mod cli;
mod dataset;
mod determinism;
mod emission;
mod equal_energy;
mod extremes;
mod rays;
mod sampling;
mod scene;
mod support;
mod visibility;
