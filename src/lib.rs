//! World space: from a scene file to a noisy picture with its feature buffers.
//!
//! Follow one sample through the modules, in order: [`cli`] reads what was typed; [`scene`] loads a file into a
//! [`scene::Scene`], which owns its [`geometry`], [`texture`]s, materials and [`emitter`]s; [`render`] gives tiles of
//! pixels to threads; a [`sampler`] gives each camera sample its random numbers; the camera turns them into a ray; the
//! [`integrator`] follows it from hit to hit, asking each [`bsdf`] where to go and each emitter what it sends; [`film`]
//! adds up what was found. Its layers then go to image space, the crate `quietlight_denoise`.
//!
//! Each module uses only what stands to its left:
//! `math ← sampler, geometry, texture ← bsdf, emitter ← scene ← transport ← integrator ← film, render ← dataset, tradeoff ← cli`; Markov chains in
//! general ([`mcmc`]) stand right of `sampler`, folders of long work ([`folder`]) left of `dataset`. A `bsdf` never sees a scene or a sampler, a `scene` never sees an integrator
//! or a film, and only `cli` prints.
//!
//! Deliberately absent: participating media, spectra, hair, motion. A scene that needs them is refused.

pub mod bsdf;
pub mod cli;
pub mod dataset;
pub mod emitter;
pub mod film;
pub mod folder;
pub mod geometry;
pub mod integrator;
pub mod math;
pub mod mcmc;
pub mod render;
pub mod sampler;
pub mod scene;
pub mod texture;
pub mod tradeoff;
pub mod transport;
