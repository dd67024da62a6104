//! A set of workpiece pixels, one bit each.

use crate::WORKPIECE_SIZE_PX;

/// One row of pixels: bit `i` is column `i`. Bits from [`WORKPIECE_SIZE_PX`] up are zero.
pub type Row = u128;

/// `PREFIX[n]` has the columns `0..n` set.
static PREFIX: [Row; WORKPIECE_SIZE_PX + 1] = {
    let mut masks = [0; WORKPIECE_SIZE_PX + 1];
    let mut n = 1;
    while n <= WORKPIECE_SIZE_PX {
        masks[n] = (masks[n - 1] << 1) | 1;
        n += 1;
    }
    masks
};

/// The row in which exactly the columns `first..end` are set; `end` is clipped to the workpiece,
/// and the row is empty when `first >= end`.
#[must_use]
#[inline]
pub fn row_mask(first: usize, end: usize) -> Row {
    let end = end.min(WORKPIECE_SIZE_PX);
    PREFIX[end] ^ PREFIX[first.min(end)]
}

/// A set of pixels of the workpiece, shape (row, column) = (100, 100), row 0 at the top.
#[derive(Clone, PartialEq, Eq)]
pub struct Bitmap {
    rows: [Row; WORKPIECE_SIZE_PX],
}

impl Bitmap {
    /// No pixel.
    pub const EMPTY: Self = Self { rows: [0; WORKPIECE_SIZE_PX] };

    /// Every pixel of the workpiece.
    #[must_use]
    pub fn full() -> Self {
        Self { rows: [row_mask(0, WORKPIECE_SIZE_PX); WORKPIECE_SIZE_PX] }
    }

    /// The pixels for which `contains(row, column)` holds.
    #[must_use]
    pub fn from_fn(mut contains: impl FnMut(usize, usize) -> bool) -> Self {
        let mut bitmap = Self::EMPTY;
        for (j, row) in bitmap.rows.iter_mut().enumerate() {
            for i in 0..WORKPIECE_SIZE_PX {
                *row |= Row::from(contains(j, i)) << i;
            }
        }
        bitmap
    }

    /// Whether the pixel at (`row`, `column`) belongs to the set; false outside the workpiece.
    #[must_use]
    pub fn contains(&self, row: usize, column: usize) -> bool {
        row < WORKPIECE_SIZE_PX && column < WORKPIECE_SIZE_PX && self.rows[row] >> column & 1 == 1
    }

    /// The rows from top to bottom.
    #[must_use]
    #[inline]
    pub fn rows(&self) -> &[Row; WORKPIECE_SIZE_PX] {
        &self.rows
    }

    /// The rows from top to bottom, to be changed in place.
    ///
    /// Callers keep the bits from [`WORKPIECE_SIZE_PX`] up at zero; [`row_mask`] does.
    #[inline]
    pub fn rows_mut(&mut self) -> &mut [Row; WORKPIECE_SIZE_PX] {
        &mut self.rows
    }

    /// Number of pixels in the set.
    #[must_use]
    pub fn area_px(&self) -> u32 {
        self.rows.iter().map(|row| row.count_ones()).sum()
    }

    /// Whether the set has no pixel.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.iter().all(|&row| row == 0)
    }

    /// The pixels of the workpiece that are not in the set.
    #[must_use]
    pub fn complement(&self) -> Self {
        let full = row_mask(0, WORKPIECE_SIZE_PX);
        Self { rows: self.rows.map(|row| full & !row) }
    }

    /// Positions (row, column) of the pixels, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.rows.iter().enumerate().flat_map(|(j, &row)| columns(row).map(move |i| (j, i)))
    }
}

/// Columns of the set bits of `row`, ascending.
fn columns(mut row: Row) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        if row == 0 {
            return None;
        }
        let column = row.trailing_zeros() as usize;
        row &= row - 1;
        Some(column)
    })
}

impl std::fmt::Debug for Bitmap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Bitmap({} px)", self.area_px())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn row_mask_sets_the_half_open_range(first in 0_usize..140, end in 0_usize..140) {
            let expected = (first..end.min(WORKPIECE_SIZE_PX)).fold(0, |row: Row, i| row | 1 << i);
            prop_assert_eq!(row_mask(first, end), expected);
        }

        #[test]
        fn a_bitmap_and_its_complement_share_the_workpiece(
            pixels in proptest::collection::hash_set((0_usize..100, 0_usize..100), 0..200)
        ) {
            let bitmap = Bitmap::from_fn(|j, i| pixels.contains(&(j, i)));
            prop_assert_eq!(bitmap.area_px() as usize, pixels.len());
            prop_assert_eq!(bitmap.complement().area_px() as usize, 10_000 - pixels.len());
            prop_assert_eq!(bitmap.pixels().collect::<std::collections::HashSet<_>>(), pixels);
            prop_assert_eq!(bitmap.complement().complement(), bitmap);
        }
    }

    #[test]
    fn nothing_lies_outside_the_workpiece() {
        assert!(!Bitmap::full().contains(0, WORKPIECE_SIZE_PX));
        assert!(!Bitmap::full().contains(WORKPIECE_SIZE_PX, 0));
        assert_eq!(Bitmap::full().area_px(), 10_000);
        assert!(Bitmap::full().complement().is_empty());
    }
}
