//! METHODS 13.3 and Appendix I: chains in small spaces, where the truth is a number.

use crate::support::mean::{Mean, p_of_z};
use crate::support::{LEVEL, sidak};
use quietlight::mcmc::{Chain, Failure, Kernels, LogUniform, Proposal, TwoTailed, acceptance};
use quietlight::sampler::IndependentSampler;

/// Asserts that means of independent replicas agree with the truth, bin by bin: mean z² and largest |z| (METHODS 12.1).
/// The bins of one replica depend on each other, which counts as a quarter of the bins.
fn z_of(bins: &[Mean], truth: &[f64]) -> (f64, f64) {
    let z: Vec<f64> = bins
        .iter()
        .zip(truth)
        .map(|(bin, truth)| (bin.mean() - truth) / bin.variance_of_mean().sqrt())
        .collect();
    let mean_square = z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64;
    (mean_square, z.iter().fold(0.0, |largest: f64, z| largest.max(z.abs())))
}

fn is_right(bins: &[Mean], truth: &[f64]) -> Result<(), String> {
    let (mean_square, largest) = z_of(bins, truth);
    let effective = bins.len() as f64 / 4.0;
    let bound = 1.0 + 4.0 * (2.0 / effective).sqrt();
    let p = p_of_z(largest);
    if mean_square < bound && p > sidak(LEVEL, bins.len()) {
        Ok(())
    } else {
        Err(format!("mean z² {mean_square:.2}, bound {bound:.2}; largest |z| {largest:.2}"))
    }
}

/// Appendix I.1: five states of these weights, and a proposal matrix that is not symmetric. Where one way is
/// impossible, so is the other: but for one pair, from which there is no return.
const WEIGHTS: [f64; 5] = [1.0, 2.0, 3.0, 4.0, 0.5];
const PROPOSALS: [[f64; 5]; 5] = [
    [0.1, 0.5, 0.0, 0.3, 0.1],
    [0.2, 0.2, 0.4, 0.1, 0.1],
    [0.0, 0.3, 0.1, 0.2, 0.4],
    [0.6, 0.1, 0.2, 0.1, 0.0],
    [0.3, 0.3, 0.2, 0.2, 0.0],
];

type Matrix = [[f64; 5]; 5];

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..5).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Probabilities of going from state to state in one step.
fn transitions() -> Matrix {
    let mut matrix: Matrix = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let proposal = Proposal::of_densities(
                j,
                [WEIGHTS[i], WEIGHTS[j]],
                [PROPOSALS[i][j], PROPOSALS[j][i]],
            );
            let possible = i != j && PROPOSALS[i][j] > 0.0;
            if possible {
                PROPOSALS[i][j] * acceptance(&proposal, [1.0; 2]).unwrap_or(0.0)
            } else {
                0.0
            }
        })
    });
    for (i, row) in matrix.iter_mut().enumerate() {
        row[i] = 1.0 - row.iter().sum::<f64>();
    }
    matrix
}

#[test]
fn five_states_come_to_their_weights_whatever_the_proposals() {
    let step = transitions();
    let total: f64 = WEIGHTS.iter().sum();
    let target = WEIGHTS.map(|weight| weight / total);
    for i in 0..5 {
        assert!(step[i].iter().all(|&p| (0.0..=1.0).contains(&p)), "{:?}", step[i]);
        let after: f64 = (0..5).map(|k| target[k] * step[k][i]).sum();
        assert!((after - target[i]).abs() < 1e-12, "state {i}: {after}");
        for j in 0..5 {
            let (there, back) = (target[i] * step[i][j], target[j] * step[j][i]);
            assert!((there - back).abs() < 1e-15, "{i} to {j}: {there} and {back}");
        }
    }
    // From any state, after 2^12 steps.
    let mut power = step;
    for _ in 0..12 {
        power = product(&power, &power);
    }
    for row in power {
        for (p, expected) in row.iter().zip(target) {
            assert!((p - expected).abs() < 1e-12, "{row:?}");
        }
    }
    // There is no return from 3 to 4, and none the other way.
    assert_eq!(step[3][4] + step[4][3], 0.0);
}

#[test]
fn only_a_finite_positive_ratio_moves_a_chain() {
    let of = |forward, backward, selection| {
        acceptance(&Proposal { state: (), forward, backward }, selection)
    };
    assert_eq!(of(0.5f64.ln(), 0.0, [0.2, 0.4]), Ok(1.0));
    assert!((of(0.25f64.ln(), 0.0, [0.2, 0.4]).unwrap() - 0.5).abs() < 1e-15);
    assert_eq!(of(800.0, -800.0, [1.0; 2]), Ok(1.0));
    assert_eq!(of(-800.0, 800.0, [1.0; 2]), Ok(0.0));
    assert_eq!(of(f64::NEG_INFINITY, 0.0, [1.0; 2]), Err(Failure::Dark));
    assert_eq!(of(0.0, f64::INFINITY, [1.0; 2]), Err(Failure::NoReturn));
    assert_eq!(of(0.0, 0.0, [1.0, 0.0]), Err(Failure::NoReturn));
    for (forward, backward) in [
        (f64::NAN, 0.0),
        (0.0, f64::NAN),
        (f64::INFINITY, 0.0),
        (0.0, f64::NEG_INFINITY),
        (f64::INFINITY, f64::INFINITY),
    ] {
        assert_eq!(of(forward, backward, [1.0; 2]), Err(Failure::NotFinite));
    }
    // Negative targets have no logarithm.
    let negative = Proposal::of_densities((), [1.0, -1.0], [1.0; 2]);
    assert_eq!(acceptance(&negative, [1.0; 2]), Err(Failure::NotFinite));
}

/// Appendix I.2: a broad hill and a narrow one on `[0, 1]`.
fn hills(x: f64) -> f64 {
    if !(0.0..1.0).contains(&x) {
        return 0.0;
    }
    (-50.0 * (x - 0.2).powi(2)).exp() + 0.1 * (-5000.0 * (x - 0.8).powi(2)).exp()
}

const BINS: usize = 50;

/// Integral of [`hills`] over each bin, by the midpoints of 400 parts (the narrow hill is 11 of them wide).
fn integrals() -> [f64; BINS] {
    let part = 1.0 / (BINS * 400) as f64;
    std::array::from_fn(|bin| {
        (0..400).map(|i| hills((bin * 400 + i) as f64 * part + 0.5 * part) * part).sum()
    })
}

/// A new number anywhere; or a jump of 1e-4 to 0.2, only from the left half of the interval.
struct OnTheLine {
    /// Leaves the probabilities of choosing the kernels out of the acceptance: a mistake to be found.
    forgets_selection: bool,
}

impl OnTheLine {
    fn probability(&self, kernel: usize, x: f64) -> f64 {
        let sum = self.selection(0, &x) + self.selection(1, &x);
        self.selection(kernel, &x) / sum
    }
}

impl Kernels for OnTheLine {
    type State = f64;

    fn names(&self) -> &'static [&'static str] {
        &["anywhere", "jump"]
    }

    fn selection(&self, kernel: usize, x: &f64) -> f64 {
        if kernel == 0 || *x < 0.5 { 1.0 } else { 0.0 }
    }

    fn propose(
        &mut self,
        kernel: usize,
        x: &f64,
        numbers: &mut IndependentSampler,
    ) -> Result<Proposal<f64>, Failure> {
        let y = if kernel == 0 {
            numbers.next_f64()
        } else {
            let distance = LogUniform::new(1e-4, 0.2).sample(numbers.next_f64());
            if numbers.next_f64() < 0.5 { x + distance } else { x - distance }
        };
        if !(0.0..1.0).contains(&y) {
            return Err(Failure::Outside);
        }
        let mut proposal = Proposal::symmetric(y, [hills(*x), hills(y)]);
        let back = self.probability(kernel, y);
        if self.forgets_selection && back > 0.0 {
            proposal.backward += (back / self.probability(kernel, *x)).ln();
        }
        Ok(proposal)
    }
}

/// Replicas of `steps` mutations from states drawn with density ∝ [`hills`] by rejection: what they record in each bin,
/// per step.
fn replicas_on_the_line(count: u64, steps: u64, forgets_selection: bool) -> Vec<Mean> {
    let mut bins = vec![Mean::default(); BINS];
    for replica in 0..count {
        let mut numbers = IndependentSampler::new(11, replica as u32, 0);
        let start = loop {
            let x = numbers.next_f64();
            if numbers.next_f64() < hills(x) {
                break x;
            }
        };
        let mut chain = Chain::new(start, 2);
        let mut kernels = OnTheLine { forgets_selection };
        let mut recorded = [0.0; BINS];
        let mut record =
            |x: &f64, weight: f64| recorded[(x * BINS as f64) as usize] += weight / steps as f64;
        for _ in 0..steps {
            chain.step(&mut kernels, &mut numbers, &mut record);
        }
        chain.flush(&mut record);
        let sum: f64 = recorded.iter().sum();
        assert!((sum - 1.0).abs() < 1e-9, "a step records 1, these {sum}");
        bins.iter_mut().zip(recorded).for_each(|(bin, value)| bin.add(value));
    }
    bins
}

#[test]
fn kernels_chosen_by_the_state_keep_the_target() {
    let integrals = integrals();
    let total: f64 = integrals.iter().sum();
    let truth = integrals.map(|integral| integral / total);
    // Only bins that replicas reach often enough for a normal mean: 200 visits (METHODS 12.1).
    let tested = |bins: Vec<Mean>| -> (Vec<Mean>, Vec<f64>) {
        bins.into_iter().zip(truth).filter(|(_, truth)| *truth > 1e-4).unzip()
    };
    let (bins, expected) = tested(replicas_on_the_line(4000, 100, false));
    assert!(bins.len() > 25, "{} bins", bins.len());
    is_right(&bins, &expected).expect("the target is kept");
    let (bins, expected) = tested(replicas_on_the_line(4000, 100, true));
    is_right(&bins, &expected).expect_err("without the ratio of the selection the target is lost");
}

#[test]
fn expected_values_and_visits_have_the_same_mean_and_expected_values_vary_less() {
    // The weight of the narrow hill after one step from a state in equilibrium, and after 20.
    let narrow = |x: f64| f64::from(u8::from(x > 0.7));
    for steps in [1u64, 20] {
        let (mut expected, mut visited) = (Mean::default(), Mean::default());
        for replica in 0..40_000 {
            let mut numbers = IndependentSampler::new(12, replica, steps as u32);
            let start = loop {
                let x = numbers.next_f64();
                if numbers.next_f64() < hills(x) {
                    break x;
                }
            };
            let mut chain = Chain::new(start, 2);
            let mut kernels = OnTheLine { forgets_selection: false };
            let (mut weights, mut visits) = (0.0, 0.0);
            let mut record = |x: &f64, weight: f64| weights += weight * narrow(*x);
            for _ in 0..steps {
                chain.step(&mut kernels, &mut numbers, &mut record);
                visits += narrow(*chain.state());
            }
            chain.flush(&mut record);
            expected.add(weights / steps as f64);
            visited.add(visits / steps as f64);
        }
        let truth = integrals()[35..].iter().sum::<f64>() / integrals().iter().sum::<f64>();
        // Two numbers of steps and two ways to record.
        let level = sidak(LEVEL, 4);
        let (p, q) = (expected.p_against(truth), visited.p_against(truth));
        assert!(p > level && q > level, "{steps} steps: {p} {q}");
        // Of 40 000 replicas, whose sums of few rare visits have a kurtosis below 30: the variances are good to 3 %, and
        // the same chains make both, which leaves less than that in their ratio.
        assert!(
            expected.variance() < visited.variance(),
            "{steps} steps: {} {}",
            expected.variance(),
            visited.variance()
        );
    }
}

/// Appendix I.3: one to three numbers, of density `2^−k ∏ (1 + sin 6x)`.
fn waves(numbers: &[f64]) -> f64 {
    numbers.iter().map(|x| 0.5 * (1.0 + (6.0 * x).sin())).product()
}

/// Takes a piece out and puts another in: the bookkeeping of a bidirectional mutation without a scene.
struct Pieces {
    /// Takes the probability of the new length for that of the old: a mistake to be found.
    forgets_length: bool,
}

impl Kernels for Pieces {
    type State = Vec<f64>;

    fn names(&self) -> &'static [&'static str] {
        &["piece"]
    }

    fn selection(&self, _: usize, _: &Vec<f64>) -> f64 {
        1.0
    }

    fn propose(
        &mut self,
        _: usize,
        state: &Vec<f64>,
        numbers: &mut IndependentSampler,
    ) -> Result<Proposal<Vec<f64>>, Failure> {
        let length = |from: usize| TwoTailed::new(from as u32, 1, 3);
        let wanted = length(state.len()).sample(numbers.next_f64()) as usize;
        // One number more is taken out than the change of length needs, so that every number can change.
        let out = 1 + state.len().saturating_sub(wanted);
        let into = wanted + out - state.len();
        let places = (state.len() - out + 1) as f64;
        let places_back = (wanted - into + 1) as f64;
        let at = (numbers.next_f64() * places) as usize;
        let mut changed = state[..at].to_vec();
        changed.extend((0..into).map(|_| numbers.next_f64()));
        changed.extend(&state[at + out..]);
        let there = length(state.len()).pmf(wanted as u32) / places;
        let back = length(wanted).pmf(state.len() as u32) / places_back;
        let back = if self.forgets_length { there * places / places_back } else { back };
        Ok(Proposal::of_densities(changed.clone(), [waves(state), waves(&changed)], [there, back]))
    }
}

/// Replicas of 50 mutations from exact states: how long they are, and where their first and last number lie.
fn replicas_of_pieces(count: u32, forgets_length: bool) -> Vec<Mean> {
    const STEPS: usize = 50;
    const PLACES: usize = 10;
    let mut bins = vec![Mean::default(); 3 + 2 * PLACES];
    // ∫ (1 + sin 6x)/2 over [0, 1].
    let one = 0.5 * (1.0 + (1.0 - 6f64.cos()) / 6.0);
    for replica in 0..count {
        let mut numbers = IndependentSampler::new(13, replica, 0);
        let u = numbers.next_f64() * (one + one * one + one * one * one);
        let length = 1 + usize::from(u >= one) + usize::from(u >= one + one * one);
        let start: Vec<f64> = (0..length)
            .map(|_| {
                loop {
                    let x = numbers.next_f64();
                    if numbers.next_f64() < waves(&[x]) {
                        break x;
                    }
                }
            })
            .collect();
        let mut chain = Chain::new(start, 1);
        let mut kernels = Pieces { forgets_length };
        let mut recorded = vec![0.0; bins.len()];
        let mut record = |state: &Vec<f64>, weight: f64| {
            let weight = weight / STEPS as f64;
            let place = |x: f64| (x * PLACES as f64) as usize;
            recorded[state.len() - 1] += weight;
            recorded[3 + place(state[0])] += weight;
            recorded[3 + PLACES + place(state[state.len() - 1])] += weight;
        };
        for _ in 0..STEPS {
            chain.step(&mut kernels, &mut numbers, &mut record);
        }
        chain.flush(&mut record);
        bins.iter_mut().zip(recorded).for_each(|(bin, value)| bin.add(value));
    }
    bins
}

#[test]
fn chains_among_spaces_of_different_dimension_keep_the_target() {
    let one = 0.5 * (1.0 + (1.0 - 6f64.cos()) / 6.0);
    let total = one + one * one + one * one * one;
    let mut truth = vec![one / total, one * one / total, one * one * one / total];
    // Every number has the density (1 + sin 6x) / (2 one), whatever the length.
    let cumulative = |x: f64| 0.5 * (x + (1.0 - (6.0 * x).cos()) / 6.0) / one;
    for _ in 0..2 {
        truth.extend(
            (0..10).map(|i| cumulative(f64::from(i + 1) / 10.0) - cumulative(f64::from(i) / 10.0)),
        );
    }
    is_right(&replicas_of_pieces(8000, false), &truth).expect("the target is kept");
    is_right(&replicas_of_pieces(8000, true), &truth)
        .expect_err("without the probability of coming back to the length the target is lost");
}

#[test]
fn steps_without_a_kernel_and_failures_keep_their_weight_and_are_counted() {
    /// Nothing to change below 1/2; always a failure above.
    struct Stuck;
    impl Kernels for Stuck {
        type State = f64;
        fn names(&self) -> &'static [&'static str] {
            &["stuck"]
        }
        fn selection(&self, _: usize, x: &f64) -> f64 {
            f64::from(u8::from(*x > 0.5))
        }
        fn propose(
            &mut self,
            _: usize,
            _: &f64,
            _: &mut IndependentSampler,
        ) -> Result<Proposal<f64>, Failure> {
            Err(Failure::Blocked)
        }
    }
    for start in [0.2, 0.9] {
        let mut chain = Chain::new(start, 1);
        let mut numbers = IndependentSampler::new(1, 1, 1);
        let mut recorded = Vec::new();
        for _ in 0..7 {
            chain
                .step(&mut Stuck, &mut numbers, &mut |x: &f64, weight| recorded.push((*x, weight)));
        }
        assert!(recorded.is_empty());
        chain.flush(&mut |x: &f64, weight| recorded.push((*x, weight)));
        chain.flush(&mut |x: &f64, weight| recorded.push((*x, weight)));
        assert_eq!(recorded, [(start, 7.0)]);
        let statistics = chain.statistics();
        let idle = if start < 0.5 { 7 } else { 0 };
        assert_eq!((statistics.idle, statistics.longest_stay), (idle, 7));
        let kernel = &statistics.kernels[0];
        assert_eq!(kernel.proposed, 7 - idle);
        assert_eq!(kernel.failures[Failure::Blocked as usize], 7 - idle);
    }
}
