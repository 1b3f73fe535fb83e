//! Sampling-importance-resampling of light × scattering (Rubin 1987; Burke, Ghosh and Heidrich 2005, "Bidirectional
//! Importance Sampling for Direct Illumination"): many cheap candidates, few shadow rays.
//!
//! `M` candidates of the mixture density `q = γ q_emitter + (1 − γ) q_surface` have weights `w_i = p̂_i / q_i`, where `p̂` is the
//! luminance of throughput × radiance × scattering, visibility left out. `L̂ = Σ w_i / M` estimates the unshadowed
//! luminance; `N` of the candidates, chosen with probabilities `v_i / Σ v`, estimate the shadowed colour:
//! `Î = L̂ / N · Σ C_n / p̂_n · w_n / v_n · V_n`. It is unbiased for all `M, N ≥ 1`: given the candidates, its expectation is
//! `1/M Σ C_i / q_i · V_i` (Talbot, Cline and Egbert 2005, "Importance Resampling for Global Illumination", with `v = w`).
//! Here `v_i = (1 − ε) w_i + ε Σ w / n` gives each of the `n` candidates with light a share that does not depend on it: a
//! light of 1e-8 beside one of 1e8 behind a wall would else never be looked for.

use super::light::Lights;
use crate::integrator::receiver::{Receiver, Scattering};
use crate::math::Rgb;
use crate::sampler::Sampler;
use crate::scene::Scene;
use glam::{DVec3, Vec3};

/// A direction that light may come from.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    direction: Vec3,
    /// Infinite for the environment.
    distance: f32,
    diffuse: Rgb,
    specular: Rgb,
    /// `p̂`: luminance of the unshadowed light, per steradian.
    luminance: f64,
}

/// A chosen candidate with its shadow ray traced.
#[derive(Clone, Copy, Debug)]
pub struct Chosen {
    /// Unit vector to the light.
    pub direction: Vec3,
    /// How far it is; infinite for the environment.
    pub distance: f32,
    /// Its part of the estimate that goes to the diffuse layer.
    pub diffuse: Rgb,
    /// All other light of it.
    pub specular: Rgb,
    /// Luminance of both together.
    pub energy: f64,
}

/// What a receiver was found to get.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Estimate `L̂` of the luminance, shadows left out.
    pub unshadowed: f64,
    /// Number of the `N` chosen candidates that are visible; one behind a mask counts as its transmittance.
    pub visible: f64,
    /// `N`, or 0 where no candidate had any light.
    pub chosen: u32,
    /// Shadow rays traced: a candidate that was chosen more than once needs but one.
    pub shadow_rays: u32,
    /// Candidates that were dropped because they were not finite.
    pub invalid: u32,
}

/// The working memory of one thread.
#[derive(Debug, Default)]
pub struct Resampler {
    candidates: Vec<Candidate>,
    weights: Vec<f64>,
    /// What candidates are chosen by.
    chances: Vec<f64>,
}

/// Part `ε` of the shadow rays that goes to any candidate alike. It makes the noise of unoccluded light a little larger: by the
/// variance of `w / v`, at most `ε / (1 − ε)`, over `N`.
const ANY: f64 = 1.0 / 32.0;

impl Resampler {
    /// Estimates the direct light of `receiver` from `candidates` candidates and `shadow_rays` of them, and appends the
    /// visible ones to `found`: their sum is the estimate.
    pub(super) fn gather<S: Sampler>(
        &mut self,
        scene: &Scene,
        lights: &Lights<'_>,
        receiver: &Receiver<'_>,
        [candidates, shadow_rays]: [u32; 2],
        sampler: &mut S,
        found: &mut Vec<Chosen>,
    ) -> Gathered {
        let mut gathered = Gathered::default();
        if lights.is_dark {
            return gathered;
        }
        self.propose(lights, receiver, candidates, sampler);
        self.weights.iter_mut().filter(|weight| !weight.is_finite()).for_each(|weight| {
            *weight = 0.0;
            gathered.invalid += 1;
        });
        let total: f64 = self.weights.iter().sum();
        let u = f64::from(sampler.next_1d());
        if total <= 0.0 {
            return gathered;
        }
        gathered.unshadowed = total / f64::from(candidates);
        gathered.chosen = shadow_rays;
        let lit = self.weights.iter().filter(|&&weight| weight > 0.0).count();
        let any = ANY * total / lit as f64;
        let chance = |&weight: &f64| if weight > 0.0 { (1.0 - ANY) * weight + any } else { 0.0 };
        self.chances.clear();
        self.chances.extend(self.weights.iter().map(chance));
        resample(&self.chances, shadow_rays, u, |index, times| {
            let candidate = &self.candidates[index];
            gathered.shadow_rays += 1;
            let visibility = receiver.visibility(scene, candidate.direction, candidate.distance);
            if visibility <= 0.0 {
                return;
            }
            gathered.visible += f64::from(times) * f64::from(visibility);
            let energy = gathered.unshadowed * f64::from(visibility) * f64::from(times)
                / f64::from(shadow_rays)
                * (self.weights[index] / self.chances[index]);
            let scale = (energy / candidate.luminance) as f32;
            found.push(Chosen {
                direction: candidate.direction,
                distance: candidate.distance,
                diffuse: candidate.diffuse * scale,
                specular: candidate.specular * scale,
                energy,
            });
        });
        gathered
    }

    /// Makes the candidates and their weights. How many come from the emitters is random only where the share of the
    /// candidates is not whole, and the numbers of each kind are a lattice with a random shift: any one candidate has the
    /// density of the mixture on average, which is all that the estimate needs.
    fn propose<S: Sampler>(
        &mut self,
        lights: &Lights<'_>,
        receiver: &Receiver<'_>,
        count: u32,
        sampler: &mut S,
    ) {
        self.candidates.clear();
        self.weights.clear();
        let mut shift = || sampler.next_2d().extend(sampler.next_1d());
        let (emitter_shift, surface_shift) = (shift(), shift());
        let from_emitters =
            (lights.share * f64::from(count) + f64::from(sampler.next_1d())).floor() as u32;
        let emitted = (0..from_emitters.min(count))
            .filter_map(|index| from_emitter(lights, receiver, lattice(index, emitter_shift)));
        let scattered = (0..count.saturating_sub(from_emitters))
            .filter_map(|index| from_surface(lights, receiver, lattice(index, surface_shift)));
        for (candidate, weight) in emitted.chain(scattered) {
            self.candidates.push(candidate);
            self.weights.push(weight);
        }
    }
}

/// A candidate that an emitter proposes, and its weight.
#[inline]
fn from_emitter(lights: &Lights<'_>, receiver: &Receiver<'_>, u: Vec3) -> Option<(Candidate, f64)> {
    let light = lights.sample(&receiver.at, u.z, u.truncate())?;
    let scattering = receiver.scatter(light.direction);
    let at = (light.direction, light.distance);
    candidate(at, scattering, light.radiance, lights.mixture(light.pdf, scattering.pdf))
}

/// A candidate that the surface's own sampling proposes, and its weight.
#[inline]
fn from_surface(lights: &Lights<'_>, receiver: &Receiver<'_>, u: Vec3) -> Option<(Candidate, f64)> {
    let direction = receiver.sample_smooth(u.z, u.truncate())?;
    let scattering = receiver.scatter(direction);
    let light = lights.along(&receiver.at, direction);
    let (radiance, emitter_pdf) = lights.radiance_and_pdf(&receiver.at, &light, direction);
    let at = light.seen_from(receiver.at.position);
    candidate(at, scattering, radiance, lights.mixture(emitter_pdf, scattering.pdf))
}

/// A candidate of the given density and its weight; `None` without light, but not where that is no number.
#[inline]
fn candidate(
    (direction, distance): (Vec3, f32),
    scattering: Scattering,
    radiance: Rgb,
    pdf: f64,
) -> Option<(Candidate, f64)> {
    let (diffuse, specular) = (scattering.diffuse * radiance, scattering.specular * radiance);
    let luminance = f64::from((diffuse + specular).luminance());
    let candidate = Candidate { direction, distance, diffuse, specular, luminance };
    (luminance > 0.0 || luminance.is_nan()).then(|| (candidate, luminance / pdf))
}

/// Calls `choose(index, times)` for those of `weights` that systematic resampling chooses, `count` in all: the number of
/// times is `count · weight / total` on average over `u` in `[0, 1)`, and never off by one or more.
pub fn resample(weights: &[f64], count: u32, u: f64, mut choose: impl FnMut(usize, u32)) {
    let total: f64 = weights.iter().sum();
    let scale = f64::from(count) / total;
    let (mut sum, mut done) = (0.0, 0);
    for (index, weight) in weights.iter().enumerate() {
        sum += weight;
        // The number of points u, u + 1, … below the sum; rounding must not lose the last one.
        let below = ((sum * scale - u).ceil().max(0.0) as u32).min(count);
        if below > done {
            choose(index, below - done);
            done = below;
        }
    }
    if done < count
        && let Some(last) = weights.iter().rposition(|&weight| weight > 0.0)
    {
        choose(last, count - done);
    }
}

/// Point `index` of Roberts's three-dimensional lattice (2018, "The Unreasonable Effectiveness of Quasirandom Sequences"):
/// multiples of the powers of 1/φ, φ⁴ = φ + 1, shifted on the torus, so that each point is uniform.
#[inline]
fn lattice(index: u32, shift: Vec3) -> Vec3 {
    const STEP: DVec3 =
        DVec3::new(0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3);
    let point = shift.as_dvec3() + STEP * f64::from(index);
    // Rounding to single precision must not give 1.
    (point - point.floor()).as_vec3().min(Vec3::splat(1.0 - f32::EPSILON / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_candidates_of_one_to_three_are_the_worked_example() {
        // METHODS N.10: p̂ = (1, 3), q = 1, L̂ = 2; visible is the first alone, chosen with probability 1/4: mean 0.5.
        let weights = [1.0, 3.0];
        let unshadowed = weights.iter().sum::<f64>() / 2.0;
        let mut mean = 0.0;
        for step in 0..1000 {
            resample(&weights, 1, (f64::from(step) + 0.5) / 1000.0, |index, times| {
                assert_eq!(times, 1);
                mean += if index == 0 { unshadowed / 1000.0 } else { 0.0 };
            });
        }
        assert!((mean - 0.5).abs() < 1e-12, "{mean}");
    }

    #[test]
    fn choices_are_as_many_as_asked_for_and_in_proportion() {
        let weights = [0.0, 5.0, 1e-9, 2.0, 0.0, 3.0, 0.0];
        for count in [1, 4, 10, 1000] {
            let steps = 400;
            let mut times_chosen = [0u32; 7];
            for step in 0..steps {
                let mut all = 0;
                resample(&weights, count, f64::from(step) / f64::from(steps), |index, times| {
                    times_chosen[index] += times;
                    all += times;
                });
                assert_eq!(all, count);
            }
            for (index, weight) in weights.iter().enumerate() {
                let expected = weight / 10.0 * f64::from(count * steps);
                let chosen = f64::from(times_chosen[index]);
                // Each edge between two weights is met to within one of the steps.
                assert!((chosen - expected).abs() <= 2.0 * f64::from(count), "{index} of {count}");
                assert!(*weight > 0.0 || chosen == 0.0);
            }
        }
    }

    #[test]
    fn lattice_points_stay_below_one() {
        for index in 0..10_000 {
            let point = lattice(index, Vec3::new(0.0, 0.999_999_9, 0.5));
            assert!(point.min_element() >= 0.0 && point.max_element() < 1.0, "{point}");
        }
    }
}
