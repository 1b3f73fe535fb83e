//! Path space: what the integrators share.

pub mod shading;
pub mod visibility;

pub use shading::Shading;
