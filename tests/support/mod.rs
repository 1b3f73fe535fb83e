//! Statistics for tests: histograms and χ² for densities, batches and z for means, random numbers with a seed.
//!
//! Every test has a fixed seed, so it either always passes or always fails; the significance levels bound how probable it
//! is that correct code was given an unlucky seed. One run of the suite spends [`LEVEL`] on each family of tests, divided
//! among the members by [`sidak`].

pub(crate) mod batches;
pub(crate) mod chi_square;
pub(crate) mod mean;
pub(crate) mod random;
pub(crate) mod scenes;
pub(crate) mod sphere;

/// Probability that a family of tests refuses correct code.
pub(crate) const LEVEL: f64 = 1e-4;

/// Level of each of `count` independent tests, so that all together refuse correct code with probability `level`
/// (Šidák 1967): `1 - (1 - level)^(1 / count)`.
pub(crate) fn sidak(level: f64, count: usize) -> f64 {
    -((-level).ln_1p() / count as f64).exp_m1()
}

#[test]
fn sidak_shares_a_level() {
    let each = sidak(0.01, 100);
    assert!((1.0 - (1.0 - each).powi(100) - 0.01).abs() < 1e-12);
    assert!((sidak(0.01, 1) - 0.01).abs() < 1e-15);
}
