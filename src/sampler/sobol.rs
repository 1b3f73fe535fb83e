//! Owen-scrambled Sobol' points, padded to any number of dimensions.
//!
//! The first two Sobol' dimensions are a (0, 2)-sequence: any aligned 2ᵏ of its points put exactly one point into each
//! elementary interval of area 2⁻ᵏ. Further dimensions of the sequence are worse in pairs, need tables, and end
//! somewhere; so this sampler uses the same two dimensions again for every pair of numbers, each time in another
//! order and scrambled anew ("padding": Kollig and Keller 2002, "Efficient Multidimensional Sampling", section 2.2).
//! Both the order and the values are permuted by nested uniform (Owen) scrambling, done by a hash of the bit-reversed
//! value (Burley 2020, "Practical Hash-based Owen Scrambling", sections 3 and 5).
//!
//! A pixel has two halves, A and B: sample `i` is element `i >> 1` of half `i & 1`, and the halves are scrambled
//! independently, so that the difference of their means measures the error of their mean.

use super::{Sampler, hash, unit_interval};
use glam::Vec2;

/// Pairs computed together. Four fill the 128-bit vectors that every x86-64 and AArch64 has; a bounce of a path tracer
/// takes five to seven numbers, so that few of the eight are computed in vain.
const LANES: usize = 4;

/// Owen-scrambled Sobol' points; see the [module](self). Up to 2³² samples a pixel and 2³² numbers a sample.
#[derive(Clone, Debug)]
pub struct SobolSampler {
    /// Identifies seed, pixel and half.
    key: u64,
    /// The sample's index in its half, bits reversed.
    reversed_index: u32,
    /// How many batches have been computed.
    batch: u32,
    /// How many pairs of the batch have been given out.
    used: usize,
    pairs: [[f32; LANES]; 2],
    /// Second number of a pair whose first one was taken alone.
    spare: Option<f32>,
}

impl SobolSampler {
    /// The numbers of sample `sample` of the pixel with linear index `pixel`.
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Self {
        Self {
            key: hash::key(seed, pixel, sample & 1),
            reversed_index: (sample >> 1).reverse_bits(),
            batch: 0,
            used: LANES,
            pairs: [[0.0; LANES]; 2],
            spare: None,
        }
    }

    #[inline]
    fn next_pair(&mut self) -> [f32; 2] {
        if self.used == LANES {
            self.pairs = self.compute_batch();
            self.batch = self.batch.wrapping_add(1);
            self.used = 0;
        }
        let lane = self.used;
        self.used += 1;
        [self.pairs[0][lane], self.pairs[1][lane]]
    }

    /// The next `LANES` pairs. Written lane by lane so that the compiler makes vector instructions of it.
    #[inline(never)]
    fn compute_batch(&self) -> [[f32; LANES]; 2] {
        let mut seeds = [0u64; 6];
        let first =
            self.key.wrapping_add(u64::from(self.batch).wrapping_mul(hash::STEP.wrapping_mul(6)));
        for (i, seed) in seeds.iter_mut().enumerate() {
            *seed = hash::mix(first.wrapping_add(hash::STEP.wrapping_mul(i as u64)));
        }
        let quad = |i: usize| -> [u32; LANES] {
            [
                seeds[i] as u32,
                (seeds[i] >> 32) as u32,
                seeds[i + 1] as u32,
                (seeds[i + 1] >> 32) as u32,
            ]
        };

        // Each pair visits the sequence in its own order. The nested scramble keeps aligned blocks of 2ᵏ together.
        let index = reverse(permute([self.reversed_index; LANES], quad(0)));

        // The first dimension is the bit-reversed index; the scramble wants its argument reversed again.
        let x = reverse(permute(index, quad(2)));
        let y = reverse(permute(second_dimension_reversed(index), quad(4)));
        [x.map(unit_interval), y.map(unit_interval)]
    }
}

impl Sampler for SobolSampler {
    /// A number of a pair whose other number is the next one taken alone.
    #[inline]
    fn next_1d(&mut self) -> f32 {
        match self.spare.take() {
            Some(second) => second,
            None => {
                let [first, second] = self.next_pair();
                self.spare = Some(second);
                first
            }
        }
    }

    #[inline]
    fn next_2d(&mut self) -> Vec2 {
        self.next_pair().into()
    }
}

/// Second Sobol' dimension at `index`, with the most significant digit in bit 0.
///
/// Its generator matrix is Pascal's triangle modulo 2, where `C(i, j)` is odd if and only if the bits of `j` are among
/// those of `i` (Lucas). Digit `j` is thus the sum of the index's bits over all positions that contain `j`, which five
/// butterfly steps give without a table.
#[inline]
fn second_dimension_reversed(mut index: [u32; LANES]) -> [u32; LANES] {
    const STEPS: [(u32, u32); 5] =
        [(1, 0x5555_5555), (2, 0x3333_3333), (4, 0x0f0f_0f0f), (8, 0x00ff_00ff), (16, 0x0000_ffff)];
    for (distance, lacks) in STEPS {
        for bits in &mut index {
            *bits ^= (*bits >> distance) & lacks;
        }
    }
    index
}

/// A nested uniform permutation of bit-reversed values: bit `k` is flipped by a hash of `seed` and the bits below it.
/// The form is that of Laine and Karras 2011 ("Stratified Sampling for Stochastic Transparency", section 3.1), the
/// constants and the multiplication by the seed are Vegdahl's (2021, "Building a Better LK Hash"), who found them by
/// measuring how evenly each bit depends on those below.
#[inline]
fn permute(mut values: [u32; LANES], seeds: [u32; LANES]) -> [u32; LANES] {
    for (value, seed) in values.iter_mut().zip(seeds) {
        let mut bits = *value;
        bits ^= bits.wrapping_mul(0x3d20_adea);
        bits = bits.wrapping_add(seed);
        bits = bits.wrapping_mul((seed >> 16) | 1);
        bits ^= bits.wrapping_mul(0x0552_6c56);
        bits ^= bits.wrapping_mul(0x53a2_2864);
        *value = bits;
    }
    values
}

#[inline]
fn reverse(values: [u32; LANES]) -> [u32; LANES] {
    values.map(u32::reverse_bits)
}
