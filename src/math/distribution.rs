//! Choosing among weighted things: an alias table for lists, cumulative sums for grids.
//!
//! Weights that are negative, NaN or infinite count as zero. Sums are taken in `f64`, so that weights may differ by any
//! factor that `f64` holds.

use glam::Vec2;

/// What [`AliasTable::sample`] chose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Which entry.
    pub index: usize,
    /// Its probability.
    pub pmf: f32,
    /// What is left of the number that made the choice: again uniform in `[0, 1)`, with fewer bits.
    pub remainder: f32,
}

/// Chooses among `n` entries in constant time (Walker 1977; built by Vose 1991, "A Linear Algorithm for Generating
/// Random Numbers with a Given Distribution").
#[derive(Clone, Debug, Default)]
pub struct AliasTable {
    entries: Vec<AliasEntry>,
}

/// One of `n` equally probable columns: itself up to `threshold`, its alias above.
#[derive(Clone, Copy, Debug)]
struct AliasEntry {
    threshold: f32,
    alias: u32,
    pmf: f32,
}

impl AliasTable {
    /// The table for `weights`; `None` when no weight is positive.
    pub fn new(weights: &[f64]) -> Option<Self> {
        let probabilities = normalize(weights)?;
        let count = probabilities.len();
        let mut entries: Vec<AliasEntry> = (0u32..)
            .zip(&probabilities)
            .map(|(index, &pmf)| AliasEntry { threshold: 1.0, alias: index, pmf: pmf as f32 })
            .collect();

        // Fill each column that is too short from one that is too tall, until none is left.
        let mut heights: Vec<f64> = probabilities.iter().map(|pmf| pmf * count as f64).collect();
        let (mut short, mut tall): (Vec<usize>, Vec<usize>) =
            (0..count).partition(|&i| heights[i] < 1.0);
        while let (Some(&low), Some(&high)) = (short.last(), tall.last()) {
            short.pop();
            entries[low].threshold = heights[low] as f32;
            entries[low].alias = high as u32;
            heights[high] -= 1.0 - heights[low];
            if heights[high] < 1.0 {
                tall.pop();
                short.push(high);
            }
        }
        // Rounding may leave short columns that miss 1 by a hair: they keep threshold 1. An impossible entry must not
        // be among them, so those alias the most probable one.
        let likeliest =
            (0..count).max_by(|&a, &b| probabilities[a].total_cmp(&probabilities[b]))?;
        for (entry, &pmf) in entries.iter_mut().zip(&probabilities) {
            if pmf == 0.0 && entry.threshold > 0.0 {
                (entry.threshold, entry.alias) = (0.0, likeliest as u32);
            }
        }
        Some(Self { entries })
    }

    /// Chooses an entry by `u` in `[0, 1)`.
    #[inline]
    pub fn sample(&self, u: f32) -> Choice {
        let scaled = u * self.entries.len() as f32;
        // The product may round up to n.
        let column = (scaled as usize).min(self.entries.len() - 1);
        let fraction = (scaled - column as f32).min(ONE_MINUS_EPSILON);
        let entry = self.entries[column];
        if fraction < entry.threshold {
            let remainder = (fraction / entry.threshold).min(ONE_MINUS_EPSILON);
            Choice { index: column, pmf: entry.pmf, remainder }
        } else {
            let index = entry.alias as usize;
            let remainder =
                ((fraction - entry.threshold) / (1.0 - entry.threshold)).min(ONE_MINUS_EPSILON);
            Choice { index, pmf: self.entries[index].pmf, remainder }
        }
    }

    /// Probability of entry `index`.
    #[inline]
    pub fn pmf(&self, index: usize) -> f32 {
        self.entries[index].pmf
    }
}

/// What [`Grid::sample`] chose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Column and row.
    pub index: [usize; 2],
    /// Probability of the cell.
    pub pmf: f32,
    /// Where in the cell, uniform in `[0, 1)²`.
    pub position: Vec2,
}

/// A grid of cells, one chosen in proportion to its weight by inverting first the cumulative sum of the rows' weights,
/// then that of the row's cells. Unlike an alias table this keeps stratified points stratified. Guide tables (Chen and
/// Asau 1974, "On Generating Random Variates from an Empirical Distribution") tell where to search.
#[derive(Clone, Debug)]
pub struct Grid {
    width: usize,
    /// Cumulative probability of the rows: `height + 1` values from 0 to 1.
    rows: Vec<f32>,
    /// Cumulative conditional probability of the cells of each row: `width + 1` values a row.
    columns: Vec<f32>,
    /// Guide of `rows`.
    row_guide: Vec<u32>,
    /// Guides of each row's cells: `buckets(width) + 1` values a row.
    column_guides: Vec<u32>,
}

impl Grid {
    /// The grid of the weights, row by row, `width` a row; `None` when no weight is positive.
    ///
    /// # Panics
    /// When there is no whole number of rows.
    pub fn new(width: usize, weights: &[f64]) -> Option<Self> {
        assert!(
            width > 0 && weights.len().is_multiple_of(width),
            "{} weights in rows of {width}",
            weights.len()
        );
        // Dividing by the largest weight first keeps the sums finite.
        let largest = weights.iter().copied().map(usable).fold(0.0, f64::max);
        if largest == 0.0 {
            return None;
        }
        let scaled: Vec<f64> = weights.iter().map(|&weight| usable(weight) / largest).collect();
        let sums: Vec<f64> = scaled.chunks_exact(width).map(|row| row.iter().sum()).collect();
        let columns: Vec<f32> = scaled.chunks_exact(width).flat_map(cumulative).collect();
        let column_guides = columns.chunks_exact(width + 1).flat_map(guide).collect();
        let rows = cumulative(&sums);
        Some(Self { width, row_guide: guide(&rows), rows, columns, column_guides })
    }

    /// Chooses a cell, the row by `u.y` and the column by `u.x`, both in `[0, 1)`.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Cell {
        let (row, row_pmf, y) = invert(&self.rows, &self.row_guide, u.y);
        let guide_length = buckets(self.width) + 1;
        let guide = &self.column_guides[row * guide_length..][..guide_length];
        let (column, column_pmf, x) = invert(self.row(row), guide, u.x);
        Cell { index: [column, row], pmf: row_pmf * column_pmf, position: Vec2::new(x, y) }
    }

    /// Probability of the cell in the given column and row.
    #[inline]
    pub fn pmf(&self, [column, row]: [usize; 2]) -> f32 {
        let columns = self.row(row);
        (self.rows[row + 1] - self.rows[row]) * (columns[column + 1] - columns[column])
    }

    #[inline]
    fn row(&self, row: usize) -> &[f32] {
        let start = row * (self.width + 1);
        &self.columns[start..=start + self.width]
    }
}

/// The largest number below 1.
const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

/// The weight itself if it is positive and finite, else 0.
fn usable(weight: f64) -> f64 {
    if weight.is_finite() { weight.max(0.0) } else { 0.0 }
}

/// Weights divided by their sum; `None` when that is zero.
fn normalize(weights: &[f64]) -> Option<Vec<f64>> {
    // Dividing by the largest first keeps the sum finite.
    let largest = weights.iter().copied().map(usable).fold(0.0, f64::max);
    if largest == 0.0 {
        return None;
    }
    let sum: f64 = weights.iter().map(|&weight| usable(weight) / largest).sum();
    Some(weights.iter().map(|&weight| usable(weight) / largest / sum).collect())
}

/// Cumulative sums divided by the total: one value more than there are weights, from 0 to exactly 1. All zero for a row
/// without weight, which is never chosen.
fn cumulative(weights: &[f64]) -> Vec<f32> {
    let total: f64 = weights.iter().sum();
    if total == 0.0 {
        return vec![0.0; weights.len() + 1];
    }
    let mut sum = 0.0;
    let sums = weights.iter().map(|weight| {
        sum += weight;
        (sum / total) as f32
    });
    std::iter::once(0.0).chain(sums).collect()
}

/// Into how many equal parts a guide divides `[0, 1)` for `count` weights: on average two sums fall into each.
#[inline]
fn buckets(count: usize) -> usize {
    count.div_ceil(2)
}

/// The part of `[0, 1)`, of `count`, that holds `u`. Rounding may shift the parts' edges, but a larger number never
/// gets a lower part, and searches need no more than that.
#[inline]
fn bucket(u: f32, count: usize) -> usize {
    ((u * count as f32) as usize).min(count - 1)
}

/// For every part of `[0, 1)` how many of the cumulative sums lie in parts before it, and at the end how many there are.
fn guide(cumulative: &[f32]) -> Vec<u32> {
    let count = buckets(cumulative.len() - 1);
    (0..=count)
        .map(|part| cumulative.partition_point(|&sum| bucket(sum, count) < part) as u32)
        .collect()
}

/// The interval of the cumulative sums that holds `u`, its probability and the place of `u` in it.
#[inline]
fn invert(cumulative: &[f32], guide: &[u32], u: f32) -> (usize, f32, f32) {
    // Sums in parts before that of u are smaller than u, those in later parts larger: it remains to search its own part.
    let part = bucket(u, guide.len() - 1);
    let (first, last) = (guide[part] as usize, guide[part + 1] as usize);
    let end = first + cumulative[first..last].partition_point(|&sum| sum <= u);
    // The last sum is 1 and u is less, so that the interval found ends above u and has a positive length.
    let end = end.clamp(1, cumulative.len() - 1);
    let (low, high) = (cumulative[end - 1], cumulative[end]);
    let width = high - low;
    (end - 1, width, ((u - low) / width).min(ONE_MINUS_EPSILON))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::{IndependentSampler, Sampler};

    /// χ² of counts against probabilities, cells that expect fewer than 5 left out (they must then be rare), below the
    /// quantile of 1 - 1e-5.
    fn assert_distributed(counts: &[u32], probabilities: &[f64]) {
        let total = f64::from(counts.iter().sum::<u32>());
        let cells =
            counts.iter().zip(probabilities).map(|(&count, p)| (f64::from(count), p * total));
        let frequent: Vec<(f64, f64)> = cells.filter(|&(_, expected)| expected >= 5.0).collect();
        let chi_squared: f64 =
            frequent.iter().map(|(count, expected)| (count - expected).powi(2) / expected).sum();
        let freedom = (frequent.len() - 1).max(1) as f64;
        let spread = 2.0 / (9.0 * freedom);
        let bound = freedom * (1.0 - spread + 4.265 * spread.sqrt()).powi(3);
        assert!(
            chi_squared < bound,
            "χ² {chi_squared}, bound {bound}: {counts:?} {probabilities:?}"
        );
        for (&count, &p) in counts.iter().zip(probabilities) {
            assert!(p > 0.0 || count == 0, "an impossible entry was chosen {count} times");
        }
    }

    fn lists() -> Vec<Vec<f64>> {
        let mut sampler = IndependentSampler::new(1, 1, 1);
        let many = (0..1000).map(|_| f64::from(sampler.next_1d()).powi(6)).collect();
        vec![
            vec![1.0],
            vec![1.0, 2.0, 3.0, 4.0],
            vec![0.0, 1.0, 0.0, 0.0, 3.0, 0.0],
            vec![1e-300, 2e-300],
            vec![f64::MAX, f64::MAX, f64::MAX / 2.0],
            vec![1e8, 1e-8, f64::NAN, -1.0, f64::INFINITY, 3e8],
            many,
        ]
    }

    #[test]
    fn an_alias_table_has_the_given_probabilities() {
        for weights in lists() {
            let table = AliasTable::new(&weights).unwrap();
            let probabilities = normalize(&weights).unwrap();
            let mut sampler = IndependentSampler::new(2, 3, 4);
            let mut counts = vec![0; weights.len()];
            for _ in 0..200_000 {
                let choice = table.sample(sampler.next_1d());
                counts[choice.index] += 1;
                assert_eq!(choice.pmf, table.pmf(choice.index));
                assert!((0.0..1.0).contains(&choice.remainder));
            }
            assert_distributed(&counts, &probabilities);
            for (index, probability) in probabilities.iter().enumerate() {
                assert!((f64::from(table.pmf(index)) - probability).abs() <= 1e-7 * probability);
            }
        }
    }

    #[test]
    fn the_remainder_is_uniform_within_every_entry() {
        let weights = [1.0, 2.0, 3.0, 4.0];
        let table = AliasTable::new(&weights).unwrap();
        let mut counts = vec![0; 64];
        for i in 0..(1 << 18) {
            let choice = table.sample((i as f32 + 0.5) / (1 << 18) as f32);
            counts[choice.index * 16 + (choice.remainder * 16.0) as usize] += 1;
        }
        // Not random: each count is right to a few steps of the comb.
        for (i, &count) in counts.iter().enumerate() {
            let expected = weights[i / 16] / 10.0 / 16.0 * f64::from(1 << 18);
            assert!((f64::from(count) - expected).abs() < 4.0, "{i}: {count}, expected {expected}");
        }
    }

    #[test]
    fn nothing_positive_is_no_distribution() {
        for weights in [vec![], vec![0.0], vec![-1.0, f64::NAN, f64::INFINITY, 0.0]] {
            assert!(AliasTable::new(&weights).is_none());
            assert!(Grid::new(1, &weights).is_none());
        }
    }

    #[test]
    fn a_grid_has_the_given_probabilities_and_keeps_points_in_their_cells() {
        for weights in lists() {
            for width in [1, 2].into_iter().filter(|width| weights.len().is_multiple_of(*width)) {
                let grid = Grid::new(width, &weights).unwrap();
                let probabilities = normalize(&weights).unwrap();
                let mut sampler = IndependentSampler::new(5, 6, 7);
                let mut counts = vec![0; weights.len()];
                for _ in 0..200_000 {
                    let cell = grid.sample(sampler.next_2d());
                    let [column, row] = cell.index;
                    counts[row * width + column] += 1;
                    assert_eq!(cell.pmf, grid.pmf(cell.index));
                    assert!(
                        (0.0..1.0).contains(&cell.position.x)
                            && (0.0..1.0).contains(&cell.position.y)
                    );
                }
                assert_distributed(&counts, &probabilities);
                // Numbers exactly on the edges of cells: none may fall into a cell without weight.
                let edges = |sums: &[f32]| {
                    sums.iter().copied().filter(|&sum| sum < 1.0).collect::<Vec<f32>>()
                };
                for (y, row) in edges(&grid.rows).into_iter().zip(0..) {
                    for x in edges(grid.row(row)) {
                        let cell = grid.sample(Vec2::new(x, y));
                        assert!(
                            cell.pmf > 0.0 && cell.position.is_finite(),
                            "{weights:?} {x} {y}: {cell:?}"
                        );
                    }
                }
                let total: f32 = (0..weights.len()).map(|i| grid.pmf([i % width, i / width])).sum();
                assert!((total - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn the_guide_leads_where_a_search_of_all_sums_does() {
        let mut sampler = IndependentSampler::new(8, 9, 10);
        for (count, power) in [(1, 1), (2, 1), (7, 3), (64, 20), (513, 2), (1000, 60)] {
            let weights: Vec<f64> =
                (0..count).map(|_| f64::from(sampler.next_1d()).powi(power)).collect();
            let sums = cumulative(&weights);
            let guide = guide(&sums);
            let parts = guide.len() - 1;
            // Random numbers, the sums themselves and the edges of the guide's parts, and the neighbours of all.
            let random: Vec<f32> = (0..2_000).map(|_| sampler.next_1d()).collect();
            let edges = (0..parts).map(|part| part as f32 / parts as f32);
            for u in random.into_iter().chain(sums.iter().copied()).chain(edges) {
                for u in [u.next_down(), u, u.next_up()] {
                    let u = u.clamp(0.0, ONE_MINUS_EPSILON);
                    let expected = sums.partition_point(|&sum| sum <= u) - 1;
                    assert_eq!(invert(&sums, &guide, u).0, expected, "{count} weights, {u}");
                }
            }
        }
    }

    #[test]
    fn a_grid_keeps_stratified_points_stratified() {
        // Inversion is monotonous: as u.x grows, so does the place.
        let grid = Grid::new(5, &[1.0, 0.0, 5.0, 2.0, 0.5]).unwrap();
        let place = |u: f32| {
            let cell = grid.sample(Vec2::new(u, 0.3));
            cell.index[0] as f32 + cell.position.x
        };
        let places: Vec<f32> = (0..1000).map(|i| place(i as f32 / 1000.0)).collect();
        assert!(places.is_sorted());
        assert_eq!(grid.sample(Vec2::ZERO).index, [0, 0]);
        assert_eq!(grid.sample(Vec2::splat(ONE_MINUS_EPSILON)).index, [4, 0]);
    }
}
