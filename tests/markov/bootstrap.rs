//! METHODS 5.2: pools of a handful of candidates, and chains of one mutation, have the right mean.

use crate::support::LEVEL;
use crate::support::mean::Mean;
use quietlight::mcmc::{Bootstrap, Chain, Failure, Kernels, Proposal};
use quietlight::sampler::IndependentSampler;

/// A dim floor and a narrow bright peak, whose integral is 0.9 of the whole 1.
fn peak(x: f64) -> f64 {
    if (0.30..0.32).contains(&x) { 45.0 } else { 0.1 / 0.98 }
}

struct Anywhere;

impl Kernels for Anywhere {
    type State = f64;

    fn names(&self) -> &'static [&'static str] {
        &["anywhere"]
    }

    fn selection(&self, _: usize, _: &f64) -> f64 {
        1.0
    }

    fn propose(
        &mut self,
        _: usize,
        x: &f64,
        numbers: &mut IndependentSampler,
    ) -> Result<Proposal<f64>, Failure> {
        // To near places only: one such step forgets nothing.
        let y = (x + 0.004 * (numbers.next_f64() - 0.5)).rem_euclid(1.0);
        Ok(Proposal::symmetric(y, [peak(*x), peak(y)]))
    }
}

fn pool(numbers: &mut IndependentSampler, candidates: usize) -> Bootstrap<f64> {
    let mut pool = Bootstrap::default();
    for _ in 0..candidates {
        let x = numbers.next_f64();
        pool.add_draw([(x, peak(x))]);
    }
    pool
}

/// The estimates of `∫ peak` over the peak alone by chains of one mutation, two from each pool of five: with the
/// normalisation of the same pool, and with that of another.
fn estimates(replicas: u32) -> [Mean; 2] {
    let mut means = [Mean::default(); 2];
    for replica in 0..replicas {
        let mut numbers = IndependentSampler::new(21, replica, 0);
        let (seeds, other) = (pool(&mut numbers, 5), pool(&mut numbers, 5));
        let u = numbers.next_f64();
        let mut inside = 0.0;
        for &seed in (0..2).filter_map(|k| seeds.seed(k, u)) {
            let mut chain = Chain::new(seed, 1);
            let mut record = |x: &f64, weight: f64| {
                if peak(*x) > 1.0 {
                    inside += weight / 2.0;
                }
            };
            chain.step(&mut Anywhere, &mut numbers, &mut record);
            chain.flush(&mut record);
        }
        means[0].add(seeds.mean() * inside);
        means[1].add(other.mean() * inside);
    }
    means
}

#[test]
fn chains_of_one_mutation_from_pools_of_five_have_no_start_up_bias() {
    let [same, other] = estimates(100_000);
    assert!(same.p_against(0.9) > LEVEL, "same pool: {} instead of 0.9", same.mean());
    assert!(other.p_against(0.9) < 1e-12, "another pool: {} should be biased", other.mean());
}
