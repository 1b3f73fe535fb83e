//! A sample of the noise of a picture, drawn from its variances: `±σ` with a random sign in each pixel.
//!
//! The halves of a render are one such sample too, `(A − B)/2`. The variances are known better (they are from all samples,
//! and corrected by the halves where they were added up) and are in every file, so that a picture is denoised to the
//! same bits whether its halves were written or not.

use super::buffers::Buffers;
use super::network::Branch;
use crate::layers::LayerKind;

/// Draws the noise of the two branches in each pixel.
pub(super) struct Noise<'a> {
    buffers: &'a Buffers<'a>,
}

impl<'a> Noise<'a> {
    pub(super) fn new(buffers: &'a Buffers<'a>) -> Self {
        Self { buffers }
    }

    /// Signs of the noise of the diffuse and of the specular branch in a pixel, the same for all channels, by the index
    /// of the pixel and nothing else. They agree as often as the correlation of the two says,
    /// `ρ = Σ (σ²_beauty − σ²_d − σ²_s) / (2 Σ σ_d σ_s)`, so that their sum has the variance of the beauty layer.
    pub(super) fn signs(&self, pixel: usize) -> [f32; 2] {
        let random = mix(pixel as u64);
        let sign = |is_negative: bool| if is_negative { -1.0 } else { 1.0 };
        let diffuse = sign(random & 1 == 1);
        let uniform = (random >> 11) as f32 / (1_u64 << 53) as f32;
        let agree = uniform < 0.5 * (1.0 + self.correlation(pixel));
        [diffuse, if agree { diffuse } else { -diffuse }]
    }

    /// Of the diffuse and the specular light of a pixel; 0 where it is not known.
    fn correlation(&self, pixel: usize) -> f32 {
        let planes = |kind| self.buffers.planes(kind);
        let (Some(beauty), Some(specular), Some(diffuse)) = (
            planes(LayerKind::Beauty),
            self.buffers.light(Branch::Specular),
            self.buffers.light(Branch::Diffuse),
        ) else {
            return 0.0;
        };
        let (mut both, mut product) = (0.0, 0.0);
        for channel in 0..3 {
            let variance = [beauty, diffuse, specular].map(|light| light.variance(channel)[pixel]);
            both += variance[0] - variance[1] - variance[2];
            product += (variance[1].sqrt()) * variance[2].sqrt();
        }
        if product > 0.0 { (both / (2.0 * product)).clamp(-1.0, 1.0) } else { 0.0 }
    }
}

/// Scrambles the bits of a number (the finaliser of SplitMix64; Steele, Lea and Flood 2014).
fn mix(number: u64) -> u64 {
    let mut z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
