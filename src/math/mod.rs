//! Numbers and measures; knows nothing of light, surfaces or scenes.

pub mod arc_tangent;
pub mod distribution;
pub mod float;
pub mod frame;
pub mod jump;
pub mod rgb;
pub mod rigid;
pub mod sine;
pub mod sum;
pub mod warp;

pub use frame::Frame;
pub use rgb::Rgb;
pub use sum::Sum;
