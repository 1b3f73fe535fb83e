//! Where chains start, so that they need not forget it.
//!
//! A pool of weighted candidates estimates the normalisation `b = ∫ f` and gives the chains their seeds, chosen in
//! proportion to weight. Then `E[b̂ · 1{X₀ ∈ A}] = ∫_A f` for every set `A`, whatever the size of the pool, and a kernel that
//! keeps `f` keeps this for all later states: there is no start-up bias (Veach and Guibas 1997, section 5.1; METHODS 5.2).
//! It needs the *same* pool for both: `b` from elsewhere with seeds of few candidates is biased.

/// 2⁶⁴ over the golden ratio, odd: multiples of it, modulo 2⁶⁴, are spread evenly however many there are.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// A pool of candidates for the first states of chains.
#[derive(Clone, Debug)]
pub struct Bootstrap<T> {
    /// Candidates with the sum of the weights up to and including their own.
    candidates: Vec<(T, f64)>,
    draws: u64,
    /// Sum of the squares of the draws' weights.
    squares: f64,
    invalid: u64,
}

impl<T> Default for Bootstrap<T> {
    fn default() -> Self {
        Self { candidates: Vec::new(), draws: 0, squares: 0.0, invalid: 0 }
    }
}

impl<T> Bootstrap<T> {
    /// Adds the candidates of one independent draw, such as the paths that one pair of random walks connects to, each with
    /// its weight `f / p`: the target density over the density of finding it so. A draw without candidates counts, too; a
    /// weight that is negative or not finite is dropped and counted.
    pub fn add_draw(&mut self, candidates: impl IntoIterator<Item = (T, f64)>) {
        let mut of_draw = 0.0;
        for (candidate, weight) in candidates {
            if !(weight.is_finite() && weight >= 0.0) {
                self.invalid += 1;
            } else if weight > 0.0 {
                of_draw += weight;
                let before = self.total();
                self.candidates.push((candidate, before + weight));
            }
        }
        self.draws += 1;
        self.squares += of_draw * of_draw;
    }

    /// Adds the draws of another pool behind those of this one.
    pub fn append(&mut self, other: Self) {
        let before = self.total();
        let later = other.candidates.into_iter().map(|(candidate, sum)| (candidate, before + sum));
        self.candidates.extend(later);
        self.draws += other.draws;
        self.squares += other.squares;
        self.invalid += other.invalid;
    }

    /// The normalisation `b`: the mean weight of a draw; 0 where nothing shines.
    pub fn mean(&self) -> f64 {
        self.total() / self.draws.max(1) as f64
    }

    /// Standard error of [`Bootstrap::mean`]; 0 with fewer than two draws.
    pub fn error(&self) -> f64 {
        let n = self.draws as f64;
        if n < 2.0 {
            return 0.0;
        }
        let variance = (self.squares / n - self.mean() * self.mean()).max(0.0);
        (variance / (n - 1.0)).sqrt()
    }

    /// Candidates of positive weight.
    pub fn len(&self) -> usize {
        self.candidates.len()
    }

    /// Is there nothing to start from?
    pub fn is_empty(&self) -> bool {
        self.candidates.is_empty()
    }

    /// Weights that were negative or not finite.
    pub fn invalid(&self) -> u64 {
        self.invalid
    }

    /// The seed of chain `k`: the candidate at the part `u_k = u + k (√5 − 1) / 2 mod 1` of the sum of all weights. With `u`
    /// uniform in `[0, 1)` each `u_k` is, so that each seed by itself is chosen in proportion to weight; and the `u_k` of any
    /// number of first chains are spread so evenly (Kronecker's sequence of the golden ratio, the one of lowest discrepancy)
    /// that candidate `i` is among `n` of them `n wᵢ / Σw` times, but for one or two. `None` of an empty pool.
    pub fn seed(&self, k: u64, u: f64) -> Option<&T> {
        let start = (u * 2f64.powi(64)) as u64;
        let place = start.wrapping_add(k.wrapping_mul(GOLDEN)) as f64 * 2f64.powi(-64);
        let place = place * self.total();
        let index = self.candidates.partition_point(|&(_, sum)| sum <= place);
        self.candidates.get(index).or(self.candidates.last()).map(|(candidate, _)| candidate)
    }

    fn total(&self) -> f64 {
        self.candidates.last().map_or(0.0, |&(_, sum)| sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_error_are_those_of_the_draws() {
        let mut pool = Bootstrap::default();
        pool.add_draw([('a', 1.0), ('b', 2.0)]);
        pool.add_draw([]);
        pool.add_draw([('c', 6.0), ('d', 0.0), ('e', f64::NAN), ('f', -1.0), ('g', f64::INFINITY)]);
        // 3, 0 and 6: mean 3, variance 9, of the mean 3.
        assert!((pool.mean() - 3.0).abs() < 1e-12 && (pool.error() - 3f64.sqrt()).abs() < 1e-12);
        assert_eq!((pool.len(), pool.invalid()), (3, 3));
    }

    #[test]
    fn seeds_are_there_in_proportion_to_their_weight() {
        let mut pool = Bootstrap::default();
        pool.add_draw([(0usize, 1.0), (1, 2.0), (2, 5.0)]);
        let shares = [1.0 / 8.0, 2.0 / 8.0, 5.0 / 8.0];
        for u in [0.0, 0.3, 0.999_999] {
            let mut counts = [0; 3];
            for k in 0..10_000 {
                counts[*pool.seed(k, u).unwrap()] += 1;
                for (count, share) in counts.into_iter().zip(shares) {
                    let expected = share * (k + 1) as f64;
                    // Kesten 1966: an interval of any length is off by O(log n); here by less than 3.
                    assert!((f64::from(count) - expected).abs() < 3.0, "u {u}, k {k}: {counts:?}");
                }
            }
        }
        // Over u, each candidate's expected count for any one chain is its share.
        for k in [0, 1, 77] {
            let mut counts = [0; 3];
            for step in 0..1600 {
                counts[*pool.seed(k, f64::from(step) / 1600.0).unwrap()] += 1;
            }
            for (count, share) in counts.into_iter().zip(shares) {
                assert!((f64::from(count) - 1600.0 * share).abs() <= 1.0, "chain {k}: {counts:?}");
            }
        }
    }

    #[test]
    fn appended_pools_are_one_pool() {
        let draws = [vec![(0, 1.0), (1, 2.0)], vec![], vec![(2, 5.0), (3, f64::NAN)]];
        let (mut whole, mut joined) = (Bootstrap::default(), Bootstrap::default());
        for draw in draws {
            whole.add_draw(draw.clone());
            let mut part = Bootstrap::default();
            part.add_draw(draw);
            joined.append(part);
        }
        assert_eq!(joined.candidates, whole.candidates);
        assert_eq!((joined.draws, joined.squares, joined.invalid), (3, 34.0, 1));
    }

    #[test]
    fn a_black_pool_has_no_seeds() {
        let mut pool: Bootstrap<u8> = Bootstrap::default();
        assert_eq!((pool.mean(), pool.error(), pool.seed(4, 0.5)), (0.0, 0.0, None));
        pool.add_draw([(1, 0.0)]);
        pool.add_draw([]);
        assert_eq!((pool.mean(), pool.error(), pool.seed(4, 0.5)), (0.0, 0.0, None));
    }
}
