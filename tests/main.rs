//! Laws of the whole system.

mod emission;
mod rays;
mod sampling;
mod scene;
mod support;
