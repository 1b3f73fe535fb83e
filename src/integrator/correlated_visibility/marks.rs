//! Which pixels exchange energy: those that saw light partly occluded, and their neighbours.

use serde::{Deserialize, Serialize};

/// A set of pixels of a picture, row by row.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Marks {
    width: u32,
    height: u32,
    /// The place of each pixel among the marked ones, or [`NOT_MARKED`].
    slots: Vec<u32>,
    count: u32,
}

const NOT_MARKED: u32 = u32::MAX;

/// How much of the light that was looked for at a pixel was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    /// Shadow rays that arrived; behind a mask by their transmittance.
    pub visible: f64,
    /// All of them.
    pub of: u32,
}

impl Seen {
    /// Did some but not all of the light arrive?
    pub fn is_partial(&self) -> bool {
        self.visible > 0.0 && self.visible < f64::from(self.of)
    }
}

impl Marks {
    /// The pixels of which `is_marked` holds, and those at most `dilation` columns and rows from one.
    pub fn new(
        [width, height]: [u32; 2],
        dilation: u32,
        is_marked: impl Fn(usize) -> bool,
    ) -> Self {
        let (columns, rows) = (width as usize, height as usize);
        let raw: Vec<bool> = (0..columns * rows).map(is_marked).collect();
        let reach = dilation as usize;
        let near = |position: usize, size: usize| {
            position.saturating_sub(reach)..(position + reach + 1).min(size)
        };
        // A square is the product of two lines.
        let along: Vec<bool> = (0..raw.len())
            .map(|i| near(i % columns, columns).any(|x| raw[i / columns * columns + x]))
            .collect();
        let mut count = 0;
        let slots = (0..raw.len())
            .map(|i| {
                if near(i / columns, rows).any(|y| along[y * columns + i % columns]) {
                    count += 1;
                    count - 1
                } else {
                    NOT_MARKED
                }
            })
            .collect();
        Self { width, height, slots, count }
    }

    /// How many pixels are marked.
    pub fn len(&self) -> usize {
        self.count as usize
    }

    /// Is none marked?
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The place of a pixel among the marked ones, `None` if it is not one of them.
    #[inline]
    pub fn slot(&self, pixel: usize) -> Option<usize> {
        let slot = self.slots[pixel];
        (slot != NOT_MARKED).then_some(slot as usize)
    }

    /// The marked pixels in order: the inverse of [`Marks::slot`].
    pub fn pixels(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.slots.len()).filter(|&pixel| self.slots[pixel] != NOT_MARKED)
    }

    /// The place of the pixel `offset` columns and rows away from `pixel`; `None` outside the picture or the marks.
    #[inline]
    pub(super) fn neighbour(&self, pixel: u32, [dx, dy]: [i32; 2]) -> Option<usize> {
        let x = (pixel % self.width).checked_add_signed(dx).filter(|&x| x < self.width)?;
        let y = (pixel / self.width).checked_add_signed(dy).filter(|&y| y < self.height)?;
        self.slot((y * self.width + x) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_grow_by_squares_within_the_picture() {
        let marks = |dilation| Marks::new([7, 5], dilation, |pixel| pixel == 7 + 1);
        assert_eq!(marks(0).pixels().collect::<Vec<_>>(), [8]);
        assert_eq!(marks(1).pixels().collect::<Vec<_>>(), [0, 1, 2, 7, 8, 9, 14, 15, 16]);
        assert_eq!(marks(2).len(), 4 * 4);
        assert_eq!(marks(u32::MAX / 2).len(), 35);
        for (slot, pixel) in marks(2).pixels().enumerate() {
            assert_eq!(marks(2).slot(pixel), Some(slot));
        }
        assert!(Marks::new([7, 5], 2, |_| false).is_empty());
    }

    #[test]
    fn neighbours_outside_the_picture_or_the_marks_do_not_exist() {
        let marks = Marks::new([7, 5], 0, |pixel| pixel != 9);
        assert_eq!(marks.neighbour(8, [1, 0]), None);
        assert_eq!(marks.neighbour(8, [-1, -1]), Some(0));
        for outside in [[-2, 0], [0, -2], [6, 0], [0, 4]] {
            assert_eq!(marks.neighbour(8, outside), None);
        }
    }

    #[test]
    fn only_light_that_arrives_in_part_is_partial() {
        let seen = |visible, of| Seen { visible, of }.is_partial();
        assert!(seen(1.0, 4) && seen(0.5, 1));
        assert!(!seen(0.0, 4) && !seen(4.0, 4) && !seen(0.0, 0));
    }
}
