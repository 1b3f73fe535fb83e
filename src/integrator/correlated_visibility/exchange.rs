//! Metropolis exchange of energy between marked pixels (Ghosh and Heidrich 2006, "Correlated Visibility Sampling for Direct
//! Illumination"), with the equal deposition of energy redistribution path tracing (Cline, Talbot and Egbert 2005).
//!
//! A state is a marked pixel, one of its `K` hits and a [`Light`] there. Its target density is the luminance of the light that
//! arrives, `p̂ V / K`, over the light's own measure: steradians of the environment, area of an emitter. So a light keeps its
//! meaning when the pixel changes, and the mutations are
//! - *pixel*: another marked pixel of a square window, any of its hits, the same light. As probable as its reverse, since a pixel
//!   that is not marked refuses the move instead of being passed over.
//! - *direction*: a jump around the direction to the light, its angle log-uniform, to whatever shines from there. As probable
//!   as its reverse per steradian at the receiver, where the target per steradian is the one to compare.
//! - *both*: a pixel, then a jump around where the light is seen from there. The reverse jump starts from where the *new* light
//!   is seen from the old receiver; for the environment that is the same angle, for points nearby it is not.
//! - *independence*: a new direction from the mixture that the candidates have.
//!
//! Every seed carries energy; chains of equal energy a step start from the seeds in proportion to it. Since each mutation is
//! in balance with the target over the marked pixels, the expected picture does not change, whatever the length of a chain.

use super::light::{Light, Lights};
use super::marks::Marks;
use super::moves::{Move, Mutation, accept, jump, jump_pdf};
use super::sir::Chosen;
use crate::integrator::receiver::Receiver;
use crate::math::Rgb;
use crate::sampler::Sampler;
use crate::scene::Scene;
use glam::Vec3;

/// Everything that a mutation needs to know.
pub(super) struct Exchange<'e, 'a> {
    pub(super) scene: &'a Scene,
    pub(super) lights: &'e Lights<'a>,
    pub(super) marks: &'e Marks,
    /// Film pixel of each marked one.
    pub(super) pixels: &'e [u32],
    /// `K` hits of each marked pixel; `None` where the camera ray met no receiver.
    pub(super) receivers: &'e [Option<Receiver<'a>>],
    /// `K`.
    pub(super) hits: u32,
    /// Most columns and rows between a pixel and one that it exchanges energy with.
    pub(super) window: u32,
}

/// A state of a chain.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    /// Which of the receivers.
    pub(super) receiver: u32,
    pub(super) light: Light,
    /// Unit vector to the light, and its distance.
    pub(super) direction: Vec3,
    distance: f32,
    /// Light of unit luminance: the state's colour over its target density.
    diffuse: Rgb,
    specular: Rgb,
    /// `p̂ V`, per steradian.
    target: f64,
    /// Density with which the surface's own sampling chooses the direction, per steradian.
    surface_pdf: f32,
}

/// Energy left at a state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Deposit {
    /// Which of the marked pixels.
    pub(super) slot: u32,
    /// Luminance.
    pub(super) energy: f64,
    /// Colour of unit luminance.
    pub(super) diffuse: Rgb,
    pub(super) specular: Rgb,
}

/// Where a chain starts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seed {
    /// Which of the receivers.
    pub(super) receiver: u32,
    /// Unit vector to the light, and its distance.
    pub(super) direction: Vec3,
    pub(super) distance: f32,
    /// Its part of the pixel's luminance.
    pub(super) energy: f64,
    /// Its light, for a seed that cannot move.
    pub(super) diffuse: Rgb,
    pub(super) specular: Rgb,
}

impl Seed {
    /// That of a chosen candidate.
    pub(super) fn new(receiver: u32, chosen: &Chosen) -> Self {
        let Chosen { direction, distance, energy, diffuse, specular } = *chosen;
        Self { receiver, direction, distance, energy, diffuse, specular }
    }
}

/// The lights found in one direction by two ways must be as near to each other as this, relative to their distance.
const SAME_LIGHT: f32 = 1e-3;

/// A colour over its luminance, which may be so small that its reciprocal is no f32: light of 1e-8 in the tail of a lobe.
fn over(colour: Rgb, luminance: f64) -> Rgb {
    colour.map(|value| (f64::from(value) / luminance) as f32)
}

impl<'e, 'a> Exchange<'e, 'a> {
    /// Runs a chain of `steps` from `seed` that leaves `energy` at each of them. Each step's energy is split between the state
    /// and the proposal by the probability of accepting it.
    pub(super) fn run<S: Sampler>(
        &self,
        seed: &Seed,
        steps: u32,
        energy: f64,
        sampler: &mut S,
        deposits: &mut Vec<Deposit>,
    ) {
        let Some(mut state) = self.start(seed) else {
            // Not one of the exchange's states: rounding at an emitter's edge, or an emitter with holes. It stays.
            deposits.push(self.stay(seed, energy * f64::from(steps)));
            return;
        };
        let mut resting = 0.0;
        for _ in 0..steps {
            let next = Move::sample(self.window, self.hits, sampler);
            let Some((proposal, acceptance)) = self.mutate(&state, &next, sampler) else {
                resting += energy;
                continue;
            };
            debug_assert!((0.0..=1.0).contains(&acceptance), "acceptance {acceptance}");
            resting += (1.0 - acceptance) * energy;
            if f64::from(sampler.next_1d()) < acceptance {
                self.deposit(&state, resting, deposits);
                state = proposal;
                resting = acceptance * energy;
            } else {
                self.deposit(&proposal, acceptance * energy, deposits);
            }
        }
        self.deposit(&state, resting, deposits);
    }

    /// Energy left where a seed is.
    pub(super) fn stay(&self, seed: &Seed, energy: f64) -> Deposit {
        Deposit {
            slot: seed.receiver / self.hits,
            energy,
            diffuse: over(seed.diffuse, seed.energy),
            specular: over(seed.specular, seed.energy),
        }
    }

    fn deposit(&self, state: &State, energy: f64, deposits: &mut Vec<Deposit>) {
        if energy > 0.0 {
            let State { receiver, diffuse, specular, .. } = *state;
            deposits.push(Deposit { slot: receiver / self.hits, energy, diffuse, specular });
        }
    }

    /// The state of a seed, which has been seen to be visible.
    pub(super) fn start(&self, seed: &Seed) -> Option<State> {
        let receiver = self.receivers[seed.receiver as usize].as_ref()?;
        let light = self.lights.along(&receiver.at, seed.direction);
        let found = light.seen_from(receiver.at.position).1;
        is_same(found, seed.distance).then(|| self.state(seed.receiver, light))?
    }

    /// The state of a light at a receiver, its shadow ray traced; `None` where no light arrives.
    fn state(&self, index: u32, light: Light) -> Option<State> {
        let receiver = self.receivers[index as usize].as_ref()?;
        let (direction, distance) = light.seen_from(receiver.at.position);
        let scattering = receiver.scatter(direction);
        if (scattering.diffuse + scattering.specular).is_black() {
            return None;
        }
        let radiance = self.lights.radiance(&light, direction);
        let (diffuse, specular) = (scattering.diffuse * radiance, scattering.specular * radiance);
        let luminance = f64::from((diffuse + specular).luminance());
        // NaN is no light, either.
        if !(luminance > 0.0 && luminance.is_finite()) {
            return None;
        }
        let visibility = receiver.visibility(self.scene, direction, distance);
        (visibility > 0.0).then(|| State {
            receiver: index,
            light,
            direction,
            distance,
            diffuse: over(diffuse, luminance),
            specular: over(specular, luminance),
            target: luminance * f64::from(visibility),
            surface_pdf: scattering.pdf,
        })
    }

    /// A mutated state and the probability of accepting it; `None` where there is no light.
    pub(super) fn mutate<S: Sampler>(
        &self,
        from: &State,
        next: &Move,
        sampler: &mut S,
    ) -> Option<(State, f64)> {
        match next.kind {
            Mutation::Pixel => self.mutate_pixel(from, next),
            Mutation::Direction => self.mutate_direction(from, sampler),
            Mutation::Both => self.mutate_both(from, next, sampler),
            Mutation::Independence => self.mutate_independently(from, sampler),
        }
    }

    fn mutate_pixel(&self, from: &State, next: &Move) -> Option<(State, f64)> {
        let to = self.state(self.other_receiver(from, next)?, from.light)?;
        let own_measure =
            |state: &State| state.target * state.light.solid_angle(state.direction, state.distance);
        Some((to, accept(own_measure(&to), own_measure(from))))
    }

    fn mutate_direction<S: Sampler>(&self, from: &State, sampler: &mut S) -> Option<(State, f64)> {
        let direction = jump(from.direction, sampler.next_2d());
        let receiver = self.receivers[from.receiver as usize].as_ref()?;
        let to = self.state(from.receiver, self.lights.along(&receiver.at, direction))?;
        let is_possible = jump_pdf(from.direction, to.direction) > 0.0;
        is_possible.then(|| (to, accept(to.target, from.target)))
    }

    fn mutate_both<S: Sampler>(
        &self,
        from: &State,
        next: &Move,
        sampler: &mut S,
    ) -> Option<(State, f64)> {
        let index = self.other_receiver(from, next)?;
        let receiver = self.receivers[index as usize].as_ref()?;
        let carried = from.light.seen_from(receiver.at.position).0;
        let direction = jump(carried, sampler.next_2d());
        let to = self.state(index, self.lights.along(&receiver.at, direction))?;
        let here = self.receivers[from.receiver as usize].as_ref()?;
        let carried_back = to.light.seen_from(here.at.position).0;
        // Densities are per steradian at the receiver that the jump arrives at, and so are the targets.
        let forward = jump_pdf(carried, to.direction);
        let backward = jump_pdf(carried_back, from.direction);
        (forward > 0.0).then(|| (to, accept(to.target * backward, from.target * forward)))
    }

    fn mutate_independently<S: Sampler>(
        &self,
        from: &State,
        sampler: &mut S,
    ) -> Option<(State, f64)> {
        let receiver = self.receivers[from.receiver as usize].as_ref()?;
        let is_from_emitter = f64::from(sampler.next_1d()) < self.lights.share;
        let (u, selection) = (sampler.next_2d(), sampler.next_1d());
        let light = if is_from_emitter {
            let sample = self.lights.sample(&receiver.at, selection, u)?;
            let light = self.lights.along(&receiver.at, sample.direction);
            // Another emitter in front of the one that was chosen hides it.
            is_same(light.seen_from(receiver.at.position).1, sample.distance).then_some(light)?
        } else {
            self.lights.along(&receiver.at, receiver.sample_smooth(selection, u)?)
        };
        let to = self.state(from.receiver, light)?;
        let pdf = |state: &State| {
            let (_, emitter_pdf) =
                self.lights.radiance_and_pdf(&receiver.at, &state.light, state.direction);
            self.lights.mixture(emitter_pdf, state.surface_pdf)
        };
        Some((to, accept(to.target * pdf(from), from.target * pdf(&to))))
    }

    /// The receiver of another marked pixel that a move leads to; `None` where it leads out of the marks, or where the
    /// receiver is missing.
    fn other_receiver(&self, from: &State, next: &Move) -> Option<u32> {
        let pixel = self.pixels[(from.receiver / self.hits) as usize];
        let slot = self.marks.neighbour(pixel, next.offset)?;
        let receiver = slot as u32 * self.hits + (from.receiver % self.hits + next.hit) % self.hits;
        self.receivers[receiver as usize].as_ref().map(|_| receiver)
    }
}

/// Are two distances to lights in the same direction those of one light? Infinite ones are.
fn is_same(distance: f32, other: f32) -> bool {
    // A lamp in front of the sky is not the sky, though all is within a part of infinity.
    distance == other || (other.is_finite() && (distance - other).abs() <= SAME_LIGHT * other)
}

#[cfg(test)]
mod tests {
    use super::is_same;

    #[test]
    fn a_lamp_is_not_the_sky_behind_it() {
        assert!(is_same(f32::INFINITY, f32::INFINITY) && is_same(2.001, 2.0));
        assert!(!is_same(2.0, f32::INFINITY) && !is_same(f32::INFINITY, 2.0));
        assert!(!is_same(2.01, 2.0));
    }
}
