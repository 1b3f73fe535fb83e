//! Laws of the whole system.

mod emission;
mod rays;
mod support;
