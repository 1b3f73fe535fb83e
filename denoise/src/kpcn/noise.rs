//! A sample of the noise of a picture, drawn from its variances: `±σ` with a random sign in each pixel.
//!
//! The halves of a render are one such sample too, `(A − B)/2`. The variances are known better (they are from all samples,
//! and corrected by the halves where they were added up) and are in every file, so that a picture is denoised to the
//! same bits whether its halves were written or not.

use std::ops::Range;

use rayon::prelude::*;

use super::buffers::{Buffers, Planes};
use super::network::Branch;
use crate::layers::LayerKind;

/// The noise of the two branches in each pixel: its signs.
pub(super) struct Noise {
    /// Whether that of the diffuse and of the specular branch is negative. They are asked for several times.
    is_negative: Vec<[bool; 2]>,
}

impl Noise {
    /// Draws the signs of the noise, the same for all channels, by the index that a pixel has before any turning and nothing
    /// else. The branches' agree as often as the correlation of the two says,
    /// `ρ = Σ (σ²_beauty − σ²_d − σ²_s) / (2 Σ σ_d σ_s)`, so that their sum has the variance of the beauty layer.
    pub(super) fn new(buffers: &Buffers<'_>) -> Self {
        let light = |branch| buffers.light(branch);
        let both = light(Branch::Diffuse).zip(light(Branch::Specular));
        let split =
            buffers.planes(LayerKind::Beauty).zip(both).map(|(beauty, (d, s))| [beauty, d, s]);
        let pixels = (0..buffers.width * buffers.height).into_par_iter();
        let draw = |pixel: usize| {
            let random = mix(buffers.source(pixel) as u64);
            let diffuse = random & 1 == 1;
            let uniform = (random >> 40) as f32 / (1_u32 << 24) as f32;
            let correlation = split.map_or(0.0, |split| correlation(split, pixel));
            let agree = uniform < 0.5 * (1.0 + correlation);
            [diffuse, diffuse == agree]
        };
        Self { is_negative: pixels.map(draw).collect() }
    }

    /// Signs of the noise of a branch in some pixels.
    #[inline(always)]
    pub(super) fn signs(&self, branch: Branch, pixels: Range<usize>) -> impl Iterator<Item = f32> {
        let of_branch = move |is_negative: &[bool; 2]| is_negative[branch as usize];
        self.is_negative[pixels].iter().map(move |pair| if of_branch(pair) { -1.0 } else { 1.0 })
    }
}

/// Of the diffuse and the specular light of a pixel, from the variances of both together and of each.
fn correlation(split: [Planes<'_>; 3], pixel: usize) -> f32 {
    let (mut both, mut product) = (0.0, 0.0);
    for channel in 0..3 {
        let [beauty, diffuse, specular] = split.map(|light| light.variance(channel)[pixel]);
        both += beauty - diffuse - specular;
        product += diffuse.sqrt() * specular.sqrt();
    }
    if product > 0.0 { (both / (2.0 * product)).clamp(-1.0, 1.0) } else { 0.0 }
}

/// Scrambles the bits of a number (the finaliser of `SplitMix64`; Steele, Lea and Flood 2014).
fn mix(number: u64) -> u64 {
    let mut z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::{Image, Layer, Layers};

    #[test]
    fn the_signs_have_the_correlation_of_the_branches() {
        // 10⁴ pixels with σ_d = 2, σ_s = 1 and ρ = 0.6, 0 and −0.6: a mean of signs of ±1 is good to 1 %; 4 standard
        // deviations.
        for correlation in [0.6_f32, 0.0, -0.6] {
            let beauty = 4.0 + 1.0 + 2.0 * correlation * 2.0;
            let mut layers = Layers { width: 100, height: 100, ..Default::default() };
            for (kind, variance) in
                [(LayerKind::Beauty, beauty), (LayerKind::Diffuse, 4.0), (LayerKind::Specular, 1.0)]
            {
                let image = |value| Image::from_elem((3, 100, 100), value);
                let variance = Some(image(variance));
                let mean = image(if kind == LayerKind::Beauty { 2.0 } else { 1.0 });
                layers.layers.insert(kind, Layer { mean, variance, halves: None });
            }
            let buffers = Buffers::new(&layers).unwrap();
            let noise = Noise::new(&buffers);
            let [diffuse, specular] = Branch::ALL.map(|branch| noise.signs(branch, 0..10_000));
            let signs: Vec<[f32; 2]> = diffuse.zip(specular).map(Into::into).collect();
            let mean = |value: &dyn Fn(&[f32; 2]) -> f32| {
                signs.iter().map(value).sum::<f32>() / signs.len() as f32
            };
            assert!(mean(&|signs| signs[0]).abs() < 0.04 && mean(&|signs| signs[1]).abs() < 0.04);
            let found = mean(&|signs| signs[0] * signs[1]);
            assert!((found - correlation).abs() < 0.04, "{found} instead of {correlation}");
        }
    }
}
