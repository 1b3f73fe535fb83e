//! Where random numbers come from.

use glam::Vec2;

/// A source of uniform numbers in `[0, 1)` for one sample of one pixel. Each call gives the next dimension.
pub trait Sampler {
    /// The next number.
    fn next_1d(&mut self) -> f32;

    /// The next two numbers, well distributed together.
    fn next_2d(&mut self) -> Vec2;
}
