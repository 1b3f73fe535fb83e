//! Pearson's χ² test of counts against expectations.

use statrs::distribution::{ChiSquared, ContinuousCDF};

/// The result of a χ² test.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChiSquare {
    /// `Σ (observed - expected)² / expected` over the pooled cells.
    pub statistic: f64,
    /// Degrees of freedom: pooled cells, less one.
    pub degrees: usize,
    /// Probability of a statistic at least this large if the expectations are right.
    pub p: f64,
}

/// Below this expectation a cell is joined with others, because the statistic of rare events is not χ² distributed.
const RARE: f64 = 5.0;

/// Tests counts against the probabilities of their cells. The cells need not cover everything: what `probabilities`
/// lack to one, and what the counts lack to `total`, is a cell of its own (light absorbed, samples rejected). Cells that
/// expect fewer than five counts are joined into one.
///
/// # Panics
/// If the probabilities sum to clearly more than one, or if there are more counts than `total`.
pub(crate) fn chi_square(counts: &[u64], probabilities: &[f64], total: u64) -> ChiSquare {
    assert_eq!(counts.len(), probabilities.len());
    let (counted, mass) = (counts.iter().sum::<u64>(), probabilities.iter().sum::<f64>());
    assert!(counted <= total, "{counted} counts of {total}");
    assert!(mass < 1.0 + 1e-3, "a density that integrates to {mass}");
    let outside = ((total - counted) as f64, (1.0 - mass).max(0.0) * total as f64);
    let cells = counts
        .iter()
        .zip(probabilities)
        .map(|(&o, &p)| (o as f64, p * total as f64))
        .chain([outside]);

    let mut rare = (0.0, 0.0);
    let (mut statistic, mut pooled) = (0.0, 0usize);
    for (observed, expected) in cells {
        if expected < RARE {
            rare = (rare.0 + observed, rare.1 + expected);
        } else {
            statistic += (observed - expected) * (observed - expected) / expected;
            pooled += 1;
        }
    }
    // Rare cells that do not reach the threshold even together are judged as if they did: events that are expected
    // nearly never, seen often, still fail the test.
    if rare.0 > 0.0 || rare.1 >= RARE {
        statistic += (rare.0 - rare.1) * (rare.0 - rare.1) / rare.1.max(RARE);
        pooled += 1;
    }
    let degrees = pooled.saturating_sub(1);
    let p = match degrees {
        0 => 1.0,
        _ => ChiSquared::new(degrees as f64).expect("degrees are positive").sf(statistic),
    };
    ChiSquare { statistic, degrees, p }
}

#[test]
fn chi_square_accepts_the_right_density_and_refuses_a_wrong_one() {
    let mut random = super::random::Random::new(1);
    let mut counts = [0u64; 10];
    for _ in 0..100_000 {
        // Density 2x: cell i holds (2i + 1) / 100.
        counts[(random.next_f64().sqrt() * 10.0) as usize] += 1;
    }
    let right: Vec<f64> = (0..10).map(|i| f64::from(2 * i + 1) / 100.0).collect();
    let fit = chi_square(&counts, &right, 100_000);
    // Ten cells, and an empty one for what lies outside, which is not counted.
    assert!(fit.p > 1e-3 && fit.degrees == 9 && fit.statistic < 30.0, "{fit:?}");
    let mut wrong = right.clone();
    wrong[3] += 0.005;
    wrong[9] -= 0.005;
    assert!(chi_square(&counts, &wrong, 100_000).p < 1e-4);
    // Mass that is missing on one side only.
    assert!(chi_square(&counts, &right, 101_000).p < 1e-4);
    assert!(chi_square(&counts[..9], &right[..9], 100_000).p > 1e-3);
}
