//! Cutting a picture into tiles that are filtered one after the other, so that memory stays bounded.
//!
//! A tile reads more than it writes: what a pixel of the result depends on lies within the overlap, so that tiles and a
//! whole picture give the same. Where a tile reads up to the border of the picture it has none to add.

use std::ops::Range;

/// How tiles must be cut for a kind of network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Grid {
    /// Tiles start at multiples of it, and what the network is given has such a size.
    pub(super) multiple: usize,
    /// Pixels read beyond those written, a multiple of `multiple`.
    pub(super) overlap: usize,
    /// Pixels that a tile may read.
    pub(super) most_pixels: usize,
}

/// A tile: what is read of the picture, and what is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    /// Rows that are read.
    pub(super) rows: Range<usize>,
    /// Columns that are read.
    pub(super) columns: Range<usize>,
    /// Rows that are written.
    pub(super) core_rows: Range<usize>,
    /// Columns that are written.
    pub(super) core_columns: Range<usize>,
    /// Height and width of what the network is given: those read, rounded up.
    pub(super) padded: [usize; 2],
}

impl Tile {
    /// Height and width of what is read.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.rows.len(), self.columns.len()]
    }

    /// Rows and columns that are written, as counted from the first ones that are read.
    pub(super) fn core(&self) -> [Range<usize>; 2] {
        let within = |core: &Range<usize>, read: &Range<usize>| {
            core.start - read.start..core.end - read.start
        };
        [within(&self.core_rows, &self.rows), within(&self.core_columns, &self.columns)]
    }
}

impl Grid {
    /// The tiles of a picture: as few pixels read in all as the bound on each allows.
    pub(super) fn tiles(&self, width: usize, height: usize) -> Vec<Tile> {
        let cost = |(rows, columns): &(Vec<Cut>, Vec<Cut>)| {
            let read = |cuts: &[Cut]| cuts.iter().map(|cut| cut.read.len()).sum::<usize>();
            let most = |cuts: &[Cut]| cuts.iter().map(|cut| self.padded(cut)).max().unwrap_or(0);
            // A picture so large that not even the smallest tiles are within the bound takes those.
            let excess = (most(rows) * most(columns)).saturating_sub(self.most_pixels);
            (excess, read(rows) * read(columns))
        };
        let choices =
            |length: usize| (1..=MOST_CUTS).filter_map(move |parts| self.cut(length, parts));
        let best = choices(height)
            .flat_map(|rows| choices(width).map(move |columns| (rows.clone(), columns)))
            .min_by_key(cost);
        let (rows, columns) = best.expect("one part is always possible");
        rows.iter()
            .flat_map(|row| {
                columns.iter().map(move |column| Tile {
                    rows: row.read.clone(),
                    columns: column.read.clone(),
                    core_rows: row.write.clone(),
                    core_columns: column.write.clone(),
                    padded: [self.padded(row), self.padded(column)],
                })
            })
            .collect()
    }

    /// Cuts a length into parts that read equally much, the last perhaps a little less: the network's memory is then as
    /// good for the next tile. `None` where so many parts would write nothing.
    fn cut(&self, length: usize, parts: usize) -> Option<Vec<Cut>> {
        let overlaps = 2 * self.overlap * (parts - 1);
        let read = (length + overlaps).div_ceil(parts).next_multiple_of(self.multiple);
        let step = read.checked_sub(2 * self.overlap).filter(|&step| step > 0 || parts == 1);
        let step = if parts == 1 { length } else { step? };
        let cut = |part: usize| {
            let start = part * step;
            let end = (start + read).min(length);
            let write_start = if part == 0 { 0 } else { start + self.overlap };
            let write_end = if part + 1 == parts { length } else { start + step + self.overlap };
            (write_start < write_end && write_end <= length)
                .then_some(Cut { read: start..end, write: write_start..write_end })
        };
        (0..parts).map(cut).collect()
    }

    fn padded(&self, cut: &Cut) -> usize {
        cut.read.len().next_multiple_of(self.multiple)
    }
}

/// Most cuts along an axis: 32 of 700 pixels are a picture 22 000 wide.
const MOST_CUTS: usize = 32;

/// One of the parts along an axis.
#[derive(Clone, Debug)]
struct Cut {
    read: Range<usize>,
    write: Range<usize>,
}

/// The pixel that a padded row or column shows: the picture reflected at its last pixel, as often as need be.
pub(super) fn reflect(index: usize, length: usize) -> usize {
    if length == 1 {
        return 0;
    }
    let period = 2 * (length - 1);
    let phase = index % period;
    phase.min(period - phase)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid { multiple: 16, overlap: 32, most_pixels: 128 * 128 };

    #[test]
    fn every_pixel_is_written_once_and_seen_with_its_surroundings() {
        for (width, height) in [(1, 1), (1, 500), (500, 3), (15, 17), (128, 128), (300, 211)] {
            let mut written = vec![0; width * height];
            for tile in GRID.tiles(width, height) {
                for y in tile.core_rows.clone() {
                    for x in tile.core_columns.clone() {
                        written[y * width + x] += 1;
                    }
                }
                for (read, core, length, padded) in [
                    (&tile.rows, &tile.core_rows, height, tile.padded[0]),
                    (&tile.columns, &tile.core_columns, width, tile.padded[1]),
                ] {
                    assert!(read.start.is_multiple_of(16) && padded.is_multiple_of(16));
                    assert!(read.start == 0 || core.start - read.start >= 32);
                    assert!(read.end == length || read.end - core.end >= 32);
                    assert!(padded >= read.len() && padded < read.len() + 16);
                }
                assert!(tile.padded[0] * tile.padded[1] <= 128 * 128, "{tile:?}");
            }
            assert!(written.iter().all(|&count| count == 1), "{width}x{height}");
        }
    }

    #[test]
    fn a_small_picture_is_one_tile() {
        assert_eq!(GRID.tiles(100, 120).len(), 1);
        assert_eq!(GRID.tiles(128, 129).len(), 2);
    }

    #[test]
    fn a_reflection_goes_to_and_fro() {
        let seen = |length| (0..8).map(|index| reflect(index, length)).collect::<Vec<_>>();
        assert_eq!(seen(1), [0; 8]);
        assert_eq!(seen(2), [0, 1, 0, 1, 0, 1, 0, 1]);
        assert_eq!(seen(4), [0, 1, 2, 3, 2, 1, 0, 1]);
    }
}
