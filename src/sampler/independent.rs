//! Independent random numbers.

use super::{Sampler, hash, unit_interval};
use glam::Vec2;

/// What random numbers are for that belong to no sample of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// Candidates for the first states of Markov chains; one stream a draw.
    Bootstrap,
    /// The choice among the paths of a candidate; one stream a draw.
    Choice,
    /// The choice among candidates; one stream a half.
    Seeds,
    /// Mutations; one stream a chain.
    Chain,
}

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

    /// The numbers of stream `index` of a use that is no sample of a pixel. They meet those of another use, or of
    /// [`IndependentSampler::new`], no more than those of another seed do.
    pub fn stream(seed: u64, purpose: Stream, index: u64) -> Self {
        let seed = hash::mix(seed ^ hash::mix(hash::STEP.wrapping_mul(purpose as u64 + 2)));
        Self::new(seed, (index >> 32) as u32, index as u32)
    }

    /// A number of all 53 bits of an f64, for decisions of small probability.
    #[inline]
    pub fn next_f64(&mut self) -> f64 {
        let bits = u64::from(self.next()) << 32 | u64::from(self.next());
        (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_pcg32() {
        // First numbers of the reference implementation's demonstration (pcg32-demo, initstate 42, initseq 54).
        let mut generator = IndependentSampler { state: 0, increment: 54 << 1 | 1 };
        generator.next();
        generator.state = generator.state.wrapping_add(42);
        generator.next();
        let expected =
            [0xa15c_02b7, 0x7b47_f409, 0xba1d_3330, 0x83d2_f293, 0xbfa4_784b, 0xcbed_606e];
        assert_eq!(expected.map(|_| generator.next()), expected);
    }

    #[test]
    fn samples_start_apart() {
        // The first number of consecutive samples and of consecutive pixels, jointly: χ² over 16×16 cells.
        for step in [(0, 1), (1, 0)] {
            let mut counts = [0u32; 256];
            for i in 0..65_536u32 {
                let at = |k: u32| {
                    (IndependentSampler::new(9, step.0 * k, step.1 * k).next_1d() * 16.0) as usize
                };
                counts[at(i) * 16 + at(i + 1)] += 1;
            }
            let chi_squared: f64 =
                counts.iter().map(|&count| (f64::from(count) - 256.0).powi(2) / 256.0).sum();
            // 255 degrees of freedom: 370 is the quantile of 1 - 3e-6.
            assert!(chi_squared < 370.0, "χ² {chi_squared} along {step:?}");
        }
    }
}
