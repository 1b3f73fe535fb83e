//! Never worse than not denoising: mixes a denoised image with the noisy one where the noise itself shows that filtering
//! harms. No reference is needed.
//!
//! A filter is linear in the colours once its weights are chosen: `x̂ = K x`. Let `x = μ + e` be the noisy mean and `a` a
//! sample of noise like `e`, independent of it given `x`: for instance `(A − B)/2` of two independent halves, or `±σ`
//! with random signs (the probe of Ramani, Blu and Unser 2008, "Monte-Carlo SURE"). Filter it by the same weights, `K a`.
//! With `d = x̂ − x`, the mixture `x + w d` of least expected squared error over a window has
//!
//! ```text
//! w = Σ E[e (e − K e)] / Σ E[d²] ≈ Σ a (a − K a) / Σ d²
//! ```
//!
//! because `E|x + w d − μ|² = E[e²] + 2 w E[e d] + w² E[d²]` and, given the weights, `E[e d] = E[e (Kμ − μ)] + E[e (K e − e)]`,
//! whose first term is 0 and whose second has the same mean for `a`. With halves this is exactly the estimate from their
//! cross products: for `r_A = A − x̂_A` and `r_B = B − x̂_B` the squared bias of `x̂` is `E[r_A r_B]`, its variance
//! `E[(x̂_A − x̂_B)²]/4`, and `d² = r_A r_B + (r_A − r_B)²/4`. What the formula leaves out is that the weights themselves follow the noise.
//!
//! Sums are over the channels and over a window, each term over `x̂² + ε`: the relative L2 that we are judged by
//! ([`metrics`](crate::metrics)).
//!
//! The estimate is itself noisy where samples are few, and a mistaken mixture brings noise back into a good picture. So
//! the part that is given back, `1 − w = H/Σd²` with `H = Σ (d² − a (a − K a))`, is multiplied by `max(0, 1 − (c s/H)²)`,
//! where `s² = Σ (4 d² a² + 2 a⁴)` is at least the variance of `H` (that of `d²` for a normal `d` whose variance is that of
//! the noise): nothing is given back that is not `c` standard deviations away from chance, and everything where harm is
//! plain. (The form of James and Stein's positive-part estimator.)

use rayon::prelude::*;

use crate::layers::Image;
use crate::metrics::RELATIVE_L2_EPSILON;
use crate::window::fold;

/// Radius of the window, passed twice: 29 pixels wide with the shape of a tent. Smaller and the mixture would show the
/// noise of its own estimate; larger and harm at a small thing would be outweighed by what surrounds it.
const RADIUS: usize = 7;

/// Standard deviations `c` by which harm must stand out.
const CERTAINTY: f64 = 2.0;

/// What is known of the harm in each pixel, not yet summed over windows.
#[derive(Clone, Debug)]
pub struct Evidence {
    width: usize,
    /// `d² − a (a − K a)`, `d²` and `4 d² a² + 2 a⁴`, each over its denominator.
    terms: [Vec<f64>; 3],
}

/// How much of the denoised image there is in the mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fractions {
    /// Mean over the pixels of the part `w` of the denoised image.
    pub mean: f64,
    /// Part of the pixels that are more noisy than denoised image, `w < 1/2`.
    pub mostly_noisy: f64,
}

/// What one pixel tells, summed over its channels: of its noisy and denoised colour, a sample of the noise, and the same
/// filtered by the weights that denoised the pixel.
#[inline]
pub fn terms(
    noisy: [f32; 3],
    denoised: [f32; 3],
    noise: [f32; 3],
    filtered_noise: [f32; 3],
) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for channel in 0..3 {
        let [x, y, a, filtered] =
            [noisy, denoised, noise, filtered_noise].map(|colour| f64::from(colour[channel]));
        let weight = 1.0 / (y * y + RELATIVE_L2_EPSILON);
        let change = (y - x) * (y - x);
        let noise = a * a;
        sums[0] += weight * (change - a * (a - filtered));
        sums[1] += weight * change;
        sums[2] += weight * weight * (4.0 * change * noise + 2.0 * noise * noise);
    }
    sums
}

impl Evidence {
    /// Of an image of that size, of which `terms` gives the [`terms`] of a pixel by its index, row after row.
    pub fn of(width: usize, height: usize, terms: impl Fn(usize) -> [f64; 3] + Sync) -> Self {
        let mut planes = [(); 3].map(|()| vec![0.0; width * height]);
        let [harm, change, chance] = &mut planes;
        let rows = harm.par_chunks_mut(width).zip(change.par_chunks_mut(width));
        let rows = rows.zip(chance.par_chunks_mut(width)).enumerate();
        rows.for_each(|(y, ((harm, change), chance))| {
            for x in 0..width {
                [harm[x], change[x], chance[x]] = terms(y * width + x);
            }
        });
        Self { width, terms: planes }
    }

    /// Of a noisy and a denoised image, a sample of the noise, and the same filtered by the weights that denoised the
    /// image; each `[3, height, width]`.
    pub fn of_images(
        noisy: &Image,
        denoised: &Image,
        noise: &Image,
        filtered_noise: &Image,
    ) -> Self {
        let (_, height, width) = noisy.dim();
        Self::of(width, height, |pixel| {
            let (y, x) = (pixel / width, pixel % width);
            let colour = |image: &Image| [0, 1, 2].map(|channel| image[[channel, y, x]]);
            terms(colour(noisy), colour(denoised), colour(noise), colour(filtered_noise))
        })
    }

    /// Mixes: `denoised` becomes `noisy + w (denoised − noisy)`. Both are `[3, height, width]`.
    pub fn blend(self, noisy: &Image, denoised: &mut Image) -> Fractions {
        let width = self.width;
        let [harm, change, chance] = self.terms.map(|terms| tent(&terms, width));
        let (_, height, _) = denoised.dim();
        let mut part = vec![1.0_f32; width * height];
        part.par_iter_mut().enumerate().for_each(|(pixel, part)| {
            *part = denoised_part(harm[pixel], change[pixel], chance[pixel]) as f32;
        });
        for (mut out, noisy) in denoised.outer_iter_mut().zip(noisy.outer_iter()) {
            for ((out, &noisy), &part) in out.iter_mut().zip(noisy).zip(&part) {
                // Exactly the one or the other at the ends.
                *out = noisy * (1.0 - part) + *out * part;
            }
        }
        let pixels = part.len() as f64;
        Fractions {
            mean: part.iter().map(|&part| f64::from(part)).sum::<f64>() / pixels,
            mostly_noisy: part.iter().filter(|&&part| part < 0.5).count() as f64 / pixels,
        }
    }
}

/// The part `w` of the denoised image, from the sums over a window.
fn denoised_part(harm: f64, change: f64, chance: f64) -> f64 {
    // No change is no harm; and where nothing is known, what the filter did stands.
    if !(harm > 0.0 && change > 0.0 && chance.is_finite()) {
        return 1.0;
    }
    let certainty = 1.0 - CERTAINTY * CERTAINTY * chance / (harm * harm);
    1.0 - (harm / change).min(1.0) * certainty.max(0.0)
}

/// Sums over the window.
fn tent(plane: &[f64], width: usize) -> Vec<f64> {
    let once = fold(plane, width, RADIUS, |a, b| a + b);
    fold(&once, width, RADIUS, |a, b| a + b)
}
