//! Laws of the whole system.

mod rays;
mod support;
