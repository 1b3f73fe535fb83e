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
//! Sums are over the channels and over a window, each term over `y² + ε`, the relative L2 that we are judged by
//! ([`metrics`](crate::metrics)), with the mixture `y` itself for the reference: first `x̂`, then what comes of it, in a few
//! rounds where anything is given back.
//!
//! The estimate is itself noisy where samples are few, and a mistaken mixture brings noise back into a good picture. So
//! the part that is given back, `1 − w = H/Σd²` with `H = Σ (d² − a (a − K a))`, is multiplied by `max(0, 1 − (c s/H)²)`,
//! where `s² = Σ (4 d² a² + 2 a⁴)` is at least the variance of `H` (that of `d²` for a normal `d` whose variance is that of
//! the noise): nothing is given back that is not `c` standard deviations away from chance, and everything where harm is
//! plain. (The form of James and Stein's positive-part estimator.)

use rayon::prelude::*;

use crate::layers::Image;
use crate::metrics::RELATIVE_L2_EPSILON;
use crate::simd::{Kernel, vectorise};
use crate::window::fold;

/// Radius of the window, passed twice: 17 pixels wide with the shape of a tent. Smaller and the mixture would show the
/// noise of its own estimate; larger and harm at a small thing would be outweighed by what surrounds it. On three of our
/// scenes, 1 to 4096 samples, 4 was better than 7 and 10 from 256 samples on, and as good with fewer.
const RADIUS: usize = 4;

/// Pixels across one pass of the window.
const SIDE: f64 = (2 * RADIUS + 1) as f64;

/// Rounds in which the mixture stands for the reference: the third changes little.
const ROUNDS: usize = 3;

/// Where everything is denoised by more than this, the mixture is the denoised image for the reference's purpose.
const NEARLY_ALL: f32 = 0.95;

/// Standard deviations `c` by which harm must stand out. Less and chance brings noise back; more and a filter that harms
/// under much noise is left alone. On those scenes 1 was better than 1.5 from 256 samples on and cost up to 2 % at 4; with 0.7
/// that was 6 %.
const CERTAINTY: f64 = 1.0;

/// How much of the denoised image there is in the mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fractions {
    /// Mean over the pixels of the part `w` of the denoised image.
    pub mean: f64,
    /// Part of the pixels that are more noisy than denoised image, `w < 1/2`.
    pub mostly_noisy: f64,
}

/// Channels of a row of pixels in [`denoised_parts`]: three of colour, then three of a sample of its noise.
pub const CHANNELS: usize = 6;

/// In each pixel of a row, `d² − a (a − K a)`, `d²` and `4 d² a² + 2 a⁴`, each over its denominator, summed over the channels.
struct Terms<'a> {
    /// The colour `x` and its noise `a`, `[CHANNELS, width]`.
    noisy: &'a [f32],
    /// Both filtered by the same weights, `x̂` and `K a`.
    filtered: &'a [f32],
    /// The part of the denoised colour in what stands for the reference, `[width]`.
    parts: &'a [f32],
    /// The three sums. Doubles would be twice the memory to pass through; what overflows a single is not known.
    out: [&'a mut [f32]; 3],
}

impl<'a> Kernel for Terms<'a> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.parts.len();
        let planes = |row: &'a [f32]| -> [&'a [f32]; CHANNELS] {
            std::array::from_fn(|channel| &row[channel * width..][..width])
        };
        let (noisy, filtered) = (planes(self.noisy), planes(self.filtered));
        let [harms, changes, chances] = self.out.map(|plane| &mut plane[..width]);
        for x in 0..width {
            let [mut sum, mut change_sum, mut chance] = [0.0; 3];
            for channel in 0..3 {
                let at = |plane: &[f32]| f64::from(plane[x]);
                let (before, after) = (at(noisy[channel]), at(filtered[channel]));
                let (noise, filtered) = (at(noisy[3 + channel]), at(filtered[3 + channel]));
                let difference = after - before;
                let reference = before + at(self.parts) * difference;
                let weight = 1.0 / (reference * reference + RELATIVE_L2_EPSILON);
                let (change, noise_squared) = (difference * difference, noise * noise);
                sum += weight * harm(difference, noise, filtered);
                change_sum += weight * change;
                chance += weight
                    * weight
                    * (4.0 * change * noise_squared + 2.0 * noise_squared * noise_squared);
            }
            [harms[x], changes[x], chances[x]] = [sum, change_sum, chance].map(|sum| sum as f32);
        }
    }
}

/// `d² − a (a − K a)`, of a change `d` and of a sample of the noise before and after the filter. Its mean is the squared
/// error of the denoised value less its covariance with the error of the noisy one, `E[ê²] − E[e ê]`.
#[inline(always)]
fn harm(change: f64, noise: f64, filtered_noise: f64) -> f64 {
    change * change - noise * (noise - filtered_noise)
}

/// The part `w` of the denoised image in each pixel, in `[0, 1]`, row after row. `filtered` is the denoised image and the
/// noise filtered by the same weights, `[height, CHANNELS, width]`; `noisy` is given a row and adds the noisy image and the
/// sample of its noise there to zeros, `[CHANNELS, width]`.
pub fn denoised_parts(
    filtered: &[f32],
    width: usize,
    noisy: impl Fn(usize, &mut [f32]) + Sync,
) -> Vec<f32> {
    let pixels = filtered.len() / CHANNELS;
    let mut parts = vec![1.0_f32; pixels];
    let mut sums = [(); 3].map(|()| vec![0_f32; pixels]);
    for _ in 0..ROUNDS {
        let [harm, change, chance] = &mut sums;
        let rows = harm.par_chunks_mut(width).zip(change.par_chunks_mut(width));
        let rows = rows.zip(chance.par_chunks_mut(width)).zip(parts.par_chunks(width));
        let rows = rows.zip(filtered.par_chunks(CHANNELS * width)).enumerate();
        rows.for_each_init(
            || vec![0.0; CHANNELS * width],
            |memory, (y, ((((harm, change), chance), parts), filtered))| {
                memory.fill(0.0);
                noisy(y, memory);
                vectorise(Terms { noisy: memory, filtered, parts, out: [harm, change, chance] });
            },
        );
        let [harm, change, chance] = sums.each_ref().map(|plane| tent(plane, width));
        parts.par_iter_mut().enumerate().for_each(|(pixel, part)| {
            let sums = [&harm, &change, &chance].map(|plane| f64::from(plane[pixel]));
            *part = denoised_part(sums) as f32;
        });
        if parts.par_iter().all(|&part| part > NEARLY_ALL) {
            break;
        }
    }
    parts
}

/// Mixes: `denoised` becomes `noisy + w (denoised − noisy)`. Both are `[3, height, width]`, `parts` has a `w` for each pixel.
pub fn mix(noisy: &Image, denoised: &mut Image, parts: &[f32]) -> Fractions {
    for (mut out, noisy) in denoised.outer_iter_mut().zip(noisy.outer_iter()) {
        for ((out, &noisy), &part) in out.iter_mut().zip(noisy).zip(parts) {
            // Exactly the one or the other at the ends.
            *out = noisy * (1.0 - part) + *out * part;
        }
    }
    let count = parts.len() as f64;
    Fractions {
        mean: parts.iter().map(|&part| f64::from(part)).sum::<f64>() / count,
        mostly_noisy: parts.iter().filter(|&&part| part < 0.5).count() as f64 / count,
    }
}

/// The part `w` of the denoised image, from the sums over a window.
fn denoised_part([harm, change, chance]: [f64; 3]) -> f64 {
    // A weight of the window is at most `SIDE²`, so that this is at least the sum over the squared weights.
    let chance = chance * SIDE * SIDE;
    // No change is no harm; and where nothing is known, what the filter did stands.
    if !(harm > 0.0 && change > 0.0 && chance.is_finite()) {
        return 1.0;
    }
    let certainty = 1.0 - CERTAINTY * CERTAINTY * chance / (harm * harm);
    1.0 - (harm / change).min(1.0) * certainty.max(0.0)
}

/// Sums over the window.
fn tent(plane: &[f32], width: usize) -> Vec<f32> {
    let once = fold(plane, width, RADIUS, |a, b| a + b);
    fold(&once, width, RADIUS, |a, b| a + b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::relative_l2;
    use crate::window::box_mean;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 48;

    /// Repeatable numbers of mean 0 and variance 1: the sum of twelve uniform ones, less 6.
    struct Normal(u64);

    impl Normal {
        fn next(&mut self) -> f32 {
            let mut sum = -6.0;
            for _ in 0..12 {
                self.0 = self
                    .0
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                sum += (self.0 >> 40) as f32 / 16_777_216.0;
            }
            sum
        }

        fn image(&mut self, deviation: &Image) -> Image {
            deviation.mapv(|deviation| deviation * self.next())
        }
    }

    /// Smooth to the left, checks to the right: a box filter helps here and harms there.
    fn truth() -> Image {
        Image::from_shape_fn((3, HEIGHT, WIDTH), |(channel, y, x)| {
            let checks = if (x + y) % 2 == 0 { 0.2 } else { 1.0 };
            if x < WIDTH / 2 { 0.5 + 0.1 * channel as f32 } else { checks }
        })
    }

    /// The filter of these tests, linear with fixed weights.
    fn filter(image: &Image) -> Image {
        box_mean(image, 2)
    }

    /// A noisy image and its two halves.
    fn halves(normal: &mut Normal, deviation: &Image) -> (Image, [Image; 2]) {
        let truth = truth();
        let root = 2.0_f32.sqrt();
        let halves = [(); 2].map(|()| &truth + &(normal.image(deviation) * root));
        ((&halves[0] + &halves[1]) * 0.5, halves)
    }

    #[test]
    fn the_harm_is_estimated_without_bias() {
        // Against the truth, in 400 realisations: Σ over all pixels of d² − a (a − K a) and of E[ê²] − E[e ê], where
        // e = x − μ and ê = x̂ − μ. Their difference has mean 0; its own scatter says within what: 4 standard errors.
        let deviation = truth().mapv(|value| 0.3 * value);
        let truth = truth();
        for by_halves in [true, false] {
            let mut normal = Normal(1);
            let mut differences = Vec::new();
            let mut size = 0.0;
            for _ in 0..400 {
                let (noisy, [a, b]) = halves(&mut normal, &deviation);
                let denoised = filter(&noisy);
                let noise = if by_halves {
                    (&a - &b) * 0.5
                } else {
                    // Random signs, as where only the variance is known.
                    deviation.mapv(|d| if normal.next() < 0.0 { -d } else { d })
                };
                let filtered = filter(&noise);
                let found: f64 = ndarray::Zip::from(&noisy)
                    .and(&denoised)
                    .and(&noise)
                    .and(&filtered)
                    .fold(0.0, |sum, &x, &y, &a, &b| {
                        sum + harm((y - x).into(), a.into(), b.into())
                    });
                let true_harm: f64 = ndarray::Zip::from(&noisy)
                    .and(&denoised)
                    .and(&truth)
                    .fold(0.0, |sum, &x, &y, &t| {
                        sum + f64::from((y - t) * (y - t) - (x - t) * (y - t))
                    });
                differences.push(found - true_harm);
                size += true_harm / 400.0;
            }
            let count = differences.len() as f64;
            let mean = differences.iter().sum::<f64>() / count;
            let variance =
                differences.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / (count - 1.0);
            let error = (variance / count).sqrt();
            assert!(mean.abs() < 4.0 * error, "{mean} ± {error} of {size}");
            assert!(error < 0.02 * size, "{error} of {size}: nothing would be seen");
        }
    }

    #[test]
    fn halves_give_the_estimate_of_their_cross_products() {
        // d² − a (a − K a) = r_A r_B + (x̂_A − x̂_B)²/4 − (A − B)(x̂_A − x̂_B)/4 in each pixel, for any numbers.
        let mut normal = Normal(2);
        let (noisy, [a, b]) = halves(&mut normal, &Image::from_elem((3, HEIGHT, WIDTH), 0.4));
        let [denoised, filtered_a, filtered_b] = [&noisy, &a, &b].map(filter);
        let (noise, filtered) = ((&a - &b) * 0.5, (&filtered_a - &filtered_b) * 0.5);
        for (index, &x) in noisy.indexed_iter() {
            let change = denoised[index] - x;
            let direct = harm(change.into(), noise[index].into(), filtered[index].into()) as f32;
            let (of_a, of_b) = (filtered_a[index], filtered_b[index]);
            let bias = (a[index] - of_a) * (b[index] - of_b);
            let cross = bias + (of_a - of_b) * (of_a - of_b) / 4.0
                - (a[index] - b[index]) * (of_a - of_b) / 4.0;
            assert!((direct - cross).abs() < 2e-6, "{direct} {cross}");
        }
    }

    /// Mixes a denoised image with the noisy one.
    fn blend(noisy: &Image, denoised: &mut Image, noise: &Image, filtered: &Image) -> Fractions {
        let (_, height, width) = noisy.dim();
        let add = |images: [&Image; 2], y: usize, row: &mut [f32]| {
            let planes = images.into_iter().flat_map(|image| image.outer_iter());
            for (out, plane) in row.chunks_mut(width).zip(planes) {
                out.iter_mut().zip(plane.row(y)).for_each(|(out, value)| *out += value);
            }
        };
        let mut both = vec![0.0; height * CHANNELS * width];
        let rows = both.chunks_mut(CHANNELS * width).enumerate();
        rows.for_each(|(y, row)| add([denoised, filtered], y, row));
        let parts = denoised_parts(&both, width, |y, row| add([noisy, noise], y, row));
        mix(noisy, denoised, &parts)
    }

    /// Relative L2 of noisy, denoised and mixed image at a noise of `deviation`, of one realisation.
    fn errors(deviation: f32, seed: u64, truth: &Image) -> [f64; 3] {
        let deviations = truth.mapv(|value| deviation * value);
        let mut normal = Normal(seed);
        let noisy = truth + &normal.image(&deviations);
        let noise = deviations.mapv(|d| if normal.next() < 0.0 { -d } else { d });
        let denoised = filter(&noisy);
        let mut mixed = denoised.clone();
        blend(&noisy, &mut mixed, &noise, &filter(&noise));
        [&noisy, &denoised, &mixed].map(|image| relative_l2(image, truth).unwrap())
    }

    #[test]
    fn the_mixture_is_never_worse_than_the_noise_or_the_filter() {
        // From 1 sample to 65 536: the filter harms ever more, the mixture stays at or below both. (Where both are alike the
        // mixture is clearly better; where the filter is right everywhere it costs less than 2 %.)
        let truth = truth();
        for exponent in 0..=8 {
            let [noisy, denoised, mixed] = errors(0.5_f32.powi(exponent), exponent as u64, &truth);
            assert!(
                mixed <= noisy && mixed <= 1.02 * denoised,
                "{exponent}: {noisy} {denoised} {mixed}"
            );
        }
        // The last: nothing of the checks is lost.
        let [noisy, denoised, mixed] = errors(1.0 / 256.0, 9, &truth);
        assert!(denoised > 100.0 * noisy && mixed <= noisy, "{noisy} {denoised} {mixed}");
    }

    #[test]
    fn a_good_filter_is_left_alone() {
        let flat = Image::from_elem((3, HEIGHT, WIDTH), 0.7);
        for seed in 0..5 {
            let [noisy, denoised, mixed] = errors(0.5, seed, &flat);
            assert!(
                denoised < 0.1 * noisy && mixed < 1.02 * denoised,
                "{noisy} {denoised} {mixed}"
            );
        }
    }

    #[test]
    fn the_ends_are_exact_and_extremes_finite() {
        let image = |value| Image::from_elem((3, 5, 4), value);
        let blend = |noisy: f32, denoised: f32, noise: f32| {
            let mut mixed = image(denoised);
            let fractions = blend(&image(noisy), &mut mixed, &image(noise), &image(0.5 * noise));
            (mixed[[0, 2, 2]], fractions.mean)
        };
        // Without noise every change is harm; without change there is none.
        assert_eq!(blend(1.0, 2.0, 0.0), (1.0, 0.0));
        assert_eq!(blend(1.0, 1.0, 0.5), (1.0, 1.0));
        assert_eq!(blend(0.0, 0.0, 0.0), (0.0, 1.0));
        // Noise as large as the change: nothing speaks against it.
        assert_eq!(blend(1.0, 1.1, 0.5), (1.1, 1.0));
        for large in [1e15, -1e15] {
            assert!(blend(large, 1.0, 1e15).0.is_finite() && blend(1.0, large, 0.1).0.is_finite());
        }
    }

    #[test]
    fn one_firefly_gives_nothing_back() {
        // A pixel of 1000 that the filter took out, with a variance that is known as badly as such are: the change is 100
        // times what the variance says. One pixel is no evidence.
        let mut noisy = Image::from_elem((3, 31, 31), 1.0);
        noisy.slice_mut(ndarray::s![.., 15, 15]).fill(1000.0);
        let denoised = Image::from_elem((3, 31, 31), 1.0);
        let mut noise = Image::zeros((3, 31, 31));
        noise.slice_mut(ndarray::s![.., 15, 15]).fill(700.0);
        let mut mixed = denoised.clone();
        let filtered = Image::zeros((3, 31, 31));
        blend(&noisy, &mut mixed, &noise, &filtered);
        assert_eq!(mixed, denoised);
    }
}
