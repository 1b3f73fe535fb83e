//! Training data: generated scenes.

pub mod generator;
