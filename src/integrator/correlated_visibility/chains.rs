//! The second pass: how many chains start from each sample, and what they leave.
//!
//! A constant share of every sample's energy stays where it is, which mixes the picture of the first pass with that of the
//! second; a constant mix of two unbiased pictures is unbiased. Every chain draws its moves for itself: the same offsets
//! for all chains would make the flow between two pixels less random, but its noise the same for all hits of a round, which
//! doubled the squared error at eight of them.

use super::exchange::{Deposit, Exchange, Seed};
use super::marks::Marks;
use super::{Stream, VisibilityRendering};
use crate::integrator::receiver::Receiver;
use crate::sampler::Sampler;
use rayon::prelude::*;

impl<'a> VisibilityRendering<'a> {
    /// The second pass: chains from the seeds, in their order.
    pub(super) fn exchange(
        &mut self,
        marks: &Marks,
        hits: u32,
        receivers: &[Option<Receiver<'a>>],
        seeds: &[Seed],
    ) {
        let found: f64 = seeds.iter().map(|seed| seed.energy).sum();
        let steps = self.settings.steps.max(1);
        let mutations = f64::from(self.settings.mutations) * f64::from(hits) * marks.len() as f64;
        // A constant share of every sample's energy stays, as if its own shadow ray were one of the mutations.
        let rays = self.settings.shadow_rays.max(1);
        let moving = f64::from(self.settings.mutations) / f64::from(self.settings.mutations + rays);
        self.found.ledger.found += moving * found;
        if found <= 0.0 {
            return;
        }
        let chain_energy = moving * found / mutations * f64::from(steps);
        let u = self.chain_sampler(Stream::Chains, u32::MAX).next_1d();
        let most = f64::from(self.settings.max_chains.max(1));
        let batches = chains_of(seeds, moving, chain_energy, most, f64::from(u));
        for batch in &batches {
            let chains = u64::from(batch.chains);
            self.found.ledger.chains += chains;
            self.found.ledger.mutations += chains * u64::from(steps);
            self.found.ledger.limited += u64::from(batch.energy > chain_energy);
            self.found.ledger.given += f64::from(batch.chains) * batch.energy;
        }
        let pixels: Vec<u32> = marks.pixels().map(|pixel| pixel as u32).collect();
        let exchange = Exchange {
            scene: self.scene,
            lights: &self.lights,
            marks,
            pixels: &pixels,
            receivers,
            hits,
            window: self.settings.window.max(1),
        };
        let (mut sums, mut deposited) = (std::mem::take(&mut self.found.sums), 0.0);
        let mut invalid = 0;
        let mut leave = |deposit: &Deposit| {
            let Deposit { slot, energy, diffuse, specular } = *deposit;
            if !((diffuse + specular).is_finite() && energy.is_finite()) {
                invalid += 1;
                return;
            }
            sums[pixels[slot as usize] as usize].deposit(diffuse, specular, energy);
        };
        for seed in seeds {
            leave(&exchange.stay(seed, (1.0 - moving) * seed.energy));
        }
        // Chains run in waves, so that what they leave is added up in their order and yet need not all be kept at once.
        for wave in batches.chunks(WAVE) {
            let deposits: Vec<Vec<Deposit>> = wave
                .par_chunks(64)
                .map(|batches| {
                    let mut deposits = Vec::new();
                    for batch in batches {
                        let energy = batch.energy / f64::from(steps);
                        for chain in 0..batch.chains {
                            let number = batch.first.wrapping_add(chain);
                            let mut sampler = self.chain_sampler(Stream::Chains, number);
                            let seed = &seeds[batch.seed];
                            exchange.run(seed, steps, energy, &mut sampler, &mut deposits);
                        }
                    }
                    deposits
                })
                .collect();
            for deposit in deposits.iter().flatten() {
                deposited += deposit.energy;
                leave(deposit);
            }
        }
        self.found.sums = sums;
        self.found.ledger.deposited += deposited;
        self.found.ledger.invalid += invalid;
    }
}

/// Samples whose chains run before their deposits are added up: some ten megabytes of deposits.
const WAVE: usize = 1 << 13;

/// Chains that start from one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Batch {
    /// Which sample.
    seed: usize,
    /// Number of the first chain among all, modulo 2³².
    first: u32,
    chains: u32,
    /// What each chain leaves, over all its steps.
    energy: f64,
}

/// How many chains start from each sample: the share `moving` of its energy over `chain_energy`, rounded up or down so that
/// the expectation over `u` in `[0, 1)` is exact. The rounding is systematic, one `u` for all samples, which spreads the chains
/// as evenly as the energy (Cline et al. 2005 draw a number for each). Beyond `most`, the energy of a chain makes up for what their
/// number lacks.
fn chains_of(seeds: &[Seed], moving: f64, chain_energy: f64, most: f64, u: f64) -> Vec<Batch> {
    let (mut sum, mut done, mut first) = (u, 0.0, 0u32);
    let mut batches = Vec::new();
    for (index, seed) in seeds.iter().enumerate() {
        let wanted = moving * seed.energy / chain_energy;
        let limited = wanted.min(most);
        sum += limited;
        let chains = (sum.floor() - done) as u32;
        if chains > 0 {
            let energy = chain_energy * (wanted / limited);
            batches.push(Batch { seed: index, first, chains, energy });
            done = sum.floor();
            first = first.wrapping_add(chains);
        }
    }
    batches
}
