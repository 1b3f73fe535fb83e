//! Where random numbers come from.
//!
//! Numbers belong to one sample of one pixel: a sampler is made from the seed, the pixel and the sample's index, and
//! needs nothing else, so that any thread can make any sample and one sample can be made again. Every number is a
//! multiple of 2⁻²⁴ in `[0, 1)`: 24 bits fill an `f32`'s mantissa exactly, so that 1 cannot occur by rounding.

pub(crate) mod hash;
pub mod independent;
pub mod primary;
pub mod sobol;

pub use independent::{IndependentSampler, Stream};
pub use primary::PrimarySampler;
pub use sobol::SobolSampler;

use glam::Vec2;

/// A source of uniform numbers in `[0, 1)` for one sample of one pixel. Each call gives the next dimension.
pub trait Sampler {
    /// The next number.
    fn next_1d(&mut self) -> f32;

    /// The next two numbers, well distributed together.
    fn next_2d(&mut self) -> Vec2;

    /// The next two numbers if the thing they choose exists, else zeros, for which no number is used up.
    fn next_2d_if(&mut self, is_needed: bool) -> Vec2 {
        if is_needed { self.next_2d() } else { Vec2::ZERO }
    }

    /// Goes on with the first dimension of another walk, which the numbers taken so far do not shift: the same one in every
    /// sample. Independent numbers need nothing of the kind.
    fn begin_walk(&mut self, _walk: u16) {}
}

impl<S: Sampler> Sampler for &mut S {
    #[inline]
    fn next_1d(&mut self) -> f32 {
        (**self).next_1d()
    }

    #[inline]
    fn next_2d(&mut self) -> Vec2 {
        (**self).next_2d()
    }

    fn begin_walk(&mut self, walk: u16) {
        (**self).begin_walk(walk);
    }
}

/// The top 24 bits of `bits` as a number in `[0, 1)`.
#[inline]
fn unit_interval(bits: u32) -> f32 {
    // Below 2²⁴ the signed conversion is exact, and it is one instruction where the unsigned one is several.
    (bits >> 8) as i32 as f32 * (1.0 / 16_777_216.0)
}
