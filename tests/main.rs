//! Laws of the whole system.
