//! Laws of the whole system.

mod rays;
mod scene;
mod support;
