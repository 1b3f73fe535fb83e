//! Independent random numbers.

use super::{Sampler, hash, unit_interval};
use glam::Vec2;

/// Independent uniform numbers: PCG32, the XSH-RR generator of O'Neill 2014 ("PCG: A Family of Simple Fast
/// Space-Efficient Statistically Good Algorithms for Random Number Generation", section 6.3). Each sample of each
/// pixel starts at its own place of its own stream.
#[derive(Clone, Debug)]
pub struct IndependentSampler {
    state: u64,
    /// Odd; which of the 2⁶³ streams.
    increment: u64,
}

impl IndependentSampler {
    /// The numbers of sample `sample` of the pixel with linear index `pixel`.
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Self {
        let key = hash::key(seed, pixel, sample);
        Self { state: hash::mix(key.wrapping_add(hash::STEP)), increment: key | 1 }
    }

    #[inline]
    fn next(&mut self) -> u32 {
        let state = self.state;
        self.state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(self.increment);
        let xor_shifted = (((state >> 18) ^ state) >> 27) as u32;
        xor_shifted.rotate_right((state >> 59) as u32)
    }
}

impl Sampler for IndependentSampler {
    #[inline]
    fn next_1d(&mut self) -> f32 {
        unit_interval(self.next())
    }

    #[inline]
    fn next_2d(&mut self) -> Vec2 {
        let x = self.next_1d();
        Vec2::new(x, self.next_1d())
    }
}
