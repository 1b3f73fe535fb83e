//! Path space: what bidirectional path tracing and the Markov chain methods share.
//!
//! A path `x_0 … x_k` starts on an emitter and ends on the lens. Its events are *smooth* or a delta lobe; only smooth ones can
//! be connected. With the effective value `f̄ = f_s |n_s·ω_l| / |n_g·ω_l|` (`ω_l` to the light's side, `n_g` the geometric
//! normal) both walks use geometric cosines, and no factor depends on who walks (Veach 1997, section 5.3; METHODS 1.7).
//! Masks let rays pass without a vertex; connections carry their transmittance.

pub mod connect;
mod joined;
pub mod mis;
pub mod path;
pub mod roulette;
pub mod shading;
pub mod vertex;
pub mod visibility;
pub mod walk;

pub use connect::Contribution;
pub use path::{Event, Path};
pub use shading::Shading;
pub use vertex::{LightVertex, Side, Surface, Vertex};
pub use walk::{Subpath, Walker};
