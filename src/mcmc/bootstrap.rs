//! Where chains start, so that they need not forget it.
//!
//! A pool of weighted candidates estimates the normalisation `b = ∫ f` and gives the chains their seeds, chosen in
//! proportion to weight. Then `E[b̂ · 1{X₀ ∈ A}] = ∫_A f` for every set `A`, whatever the size of the pool, and a kernel that
//! keeps `f` keeps this for all later states: there is no start-up bias (Veach and Guibas 1997, section 5.1; METHODS 5.2).
//! It needs the *same* pool for both: `b` from elsewhere with seeds of few candidates is biased.

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

    /// The seeds of `count` chains: candidate `i` is there `count · wᵢ / Σw` times in expectation and never more than 1 off,
    /// by systematic resampling with the one number `u` in `[0, 1)` (Carpenter, Clifford and Fearnhead 1999, "Improved
    /// Particle Filter for Nonlinear Problems"). In the order of the pool; none of an empty one.
    pub fn seeds(&self, count: usize, u: f64) -> impl Iterator<Item = &T> {
        let total = self.total();
        let last = self.candidates.len().saturating_sub(1);
        let count = if self.is_empty() { 0 } else { count };
        (0..count).map(move |k| {
            let place = (k as f64 + u) / count as f64 * total;
            let index = self.candidates.partition_point(|&(_, sum)| sum <= place);
            &self.candidates[index.min(last)].0
        })
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
        pool.add_draw([(0, 1.0), (1, 2.0), (2, 5.0)]);
        for u in [0.0, 0.3, 0.999_999] {
            let seeds: Vec<i32> = pool.seeds(16, u).copied().collect();
            assert!(seeds.is_sorted());
            let counts = [0, 1, 2].map(|which| seeds.iter().filter(|&&seed| seed == which).count());
            assert_eq!(counts, [2, 4, 10], "u {u}");
        }
        // More chains than candidates, and fewer: each candidate's expected count over u is its share.
        let mut counts = [0; 3];
        for step in 0..1600 {
            for &seed in pool.seeds(1, f64::from(step) / 1600.0) {
                counts[seed as usize] += 1;
            }
        }
        assert_eq!(counts, [200, 400, 1000]);
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
        assert_eq!((pool.mean(), pool.error(), pool.seeds(4, 0.5).count()), (0.0, 0.0, 0));
        pool.add_draw([(1, 0.0)]);
        pool.add_draw([]);
        assert_eq!((pool.mean(), pool.error(), pool.seeds(4, 0.5).count()), (0.0, 0.0, 0));
    }
}
