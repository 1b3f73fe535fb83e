//! Hashing of keys (seed, pixel, sample, ...) into independent-looking bits.

/// 2⁶⁴ divided by the golden ratio: the step of `SplitMix64`'s counter.
pub(super) const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The output function of `SplitMix64` (Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number Generators",
/// with the constants of Stafford's variant 13): a bijection of 64 bits in which every input bit flips every output
/// bit with a probability near one half.
#[inline]
pub(super) fn mix(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// A key from a seed and two numbers of 32 bits. For one seed, different numbers never give the same key.
#[inline]
pub(crate) fn key(seed: u64, first: u32, second: u32) -> u64 {
    mix(mix(seed.wrapping_add(STEP)) ^ (u64::from(first) << 32 | u64::from(second)))
}
