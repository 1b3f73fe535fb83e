//! Laws of the whole system.

mod sampling;
mod support;
