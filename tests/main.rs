//! Laws of the whole system.

mod support;
