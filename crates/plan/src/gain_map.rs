//! What the next pulse would gain, at every pixel centre.

use lasergym_ablation::{Footprint, Pulse, Workpiece};
use lasergym_geom::{Point, Row, WORKPIECE_SIZE_PX};

/// Positions that are updated together: one vector register of 16-bit numbers.
const LANES: usize = 8;

/// Positions of a row, rounded up to whole vectors; those beside the workpiece are never read.
const STRIDE: usize = WORKPIECE_SIZE_PX.next_multiple_of(LANES);

/// Columns beside the workpiece over which running sums are continued: the largest pulse radius and
/// the rounding to whole vectors.
const MARGIN: usize = 64;

/// Entries of the running sums of a row.
const SUMS: usize = MARGIN + STRIDE + MARGIN;

/// Hits − misses of a pulse at the centre of every pixel, px, kept exact while pixels change.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GainMap {
    /// For a pulse at a pixel centre: columns covered on either side of it, by rows from it.
    half_widths: Vec<usize>,
    gains: Vec<[i16; STRIDE]>,
}

impl GainMap {
    /// The gains on `workpiece` of pulses of `pulse_radius_px`, which is in (0, 50].
    #[must_use]
    pub fn new(workpiece: &Workpiece, pulse_radius_px: f64) -> Self {
        let mut map = Self {
            half_widths: half_widths(pulse_radius_px),
            gains: vec![[0; STRIDE]; WORKPIECE_SIZE_PX],
        };
        let rows = workpiece.remaining().rows().iter().zip(workpiece.forbidden().rows());
        for (row, (&remaining, &forbidden)) in rows.enumerate() {
            map.change(row, remaining, forbidden);
        }
        map
    }

    /// Hits − misses of a pulse at the centre of the pixel at (`row`, `column`), px.
    #[must_use]
    #[inline]
    pub fn gain_px(&self, row: usize, column: usize) -> i32 {
        i32::from(self.row(row)[column])
    }

    /// Gains along one row, px.
    #[must_use]
    #[inline]
    pub fn row(&self, row: usize) -> &[i16] {
        &self.gains[row][..WORKPIECE_SIZE_PX]
    }

    /// The pixel (row, column) with the largest gain, the first of several, and its gain, px.
    #[must_use]
    pub fn best(&self) -> (usize, usize, i32) {
        let mut best = (0, i16::MIN);
        for (row, gains) in self.gains.iter().enumerate() {
            let largest = gains[..WORKPIECE_SIZE_PX].iter().fold(i16::MIN, |a, &b| a.max(b));
            if largest > best.1 {
                best = (row, largest);
            }
        }
        let column = self.row(best.0).iter().position(|&gain| gain == best.1).unwrap_or(0);
        (best.0, column, i32::from(best.1))
    }

    /// Accounts for the pixels of `row` that a pulse has machined.
    #[inline]
    pub fn machined(&mut self, row: usize, hits: Row, misses: Row) {
        self.change(row, misses, hits);
    }

    /// Accounts for the pixels of `row` that a pulse had machined and that are pristine again.
    #[inline]
    pub fn restored(&mut self, row: usize, hits: Row, misses: Row) {
        self.change(row, hits, misses);
    }

    /// Raises the worth of the pixels `up` of `row` by one and lowers that of `down`.
    ///
    /// A pulse in another row covers the columns x − h ..= x + h of this one, so its gain changes
    /// by a difference of two running sums.
    fn change(&mut self, row: usize, up: Row, down: Row) {
        let changed = up | down;
        if changed == 0 {
            return;
        }
        let first = changed.trailing_zeros() as usize;
        let end = (Row::BITS - changed.leading_zeros()) as usize;
        let sums = running_sums(first, end, up, down);
        let reach = self.half_widths.len() - 1;
        for position_row in row.saturating_sub(reach)..(row + reach + 1).min(WORKPIECE_SIZE_PX) {
            let half_width = self.half_widths[row.abs_diff(position_row)];
            // Whole vectors: further out both sums are equal and nothing changes.
            let from = first.saturating_sub(half_width) / LANES * LANES;
            let to = (end + half_width).next_multiple_of(LANES).min(STRIDE);
            let gains = self.gains[position_row][from..to].as_chunks_mut::<LANES>().0;
            let right = sums[MARGIN + from + half_width + 1..][..to - from].as_chunks::<LANES>().0;
            let left = sums[MARGIN + from - half_width..][..to - from].as_chunks::<LANES>().0;
            for ((gains, right), left) in gains.iter_mut().zip(right).zip(left) {
                for lane in 0..LANES {
                    gains[lane] += right[lane] - left[lane];
                }
            }
        }
    }
}

/// Entry `MARGIN + k`: (pixels of `up`) − (pixels of `down`) in the columns below k. Both lie in the
/// columns `first..end`.
#[inline]
fn running_sums(first: usize, end: usize, up: Row, down: Row) -> [i16; SUMS] {
    let mut sums = [0; SUMS];
    let mut sum = 0;
    let (mut up, mut down) = (up >> first, down >> first);
    for entry in &mut sums[MARGIN + first + 1..=MARGIN + end] {
        sum += (up & 1) as i16 - (down & 1) as i16;
        (up, down) = (up >> 1, down >> 1);
        *entry = sum;
    }
    sums[MARGIN + end + 1..].fill(sum);
    sums
}

/// Columns that a pulse at a pixel centre covers on either side of it, by rows from it.
fn half_widths(pulse_radius_px: f64) -> Vec<usize> {
    // Pulses in the corners see the whole of one quadrant.
    let position = Point::new(0.5, 0.5);
    let footprint = Footprint::of(Pulse { position, radius_px: pulse_radius_px });
    footprint.rows().1.iter().map(|span| usize::from(span.end) - 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_ablation::star;
    use proptest::prelude::*;

    fn brute_force(workpiece: &Workpiece, radius_px: f64, row: usize, column: usize) -> i32 {
        let position = Point::new(column as f64 + 0.5, row as f64 + 0.5);
        workpiece.preview(&Footprint::of(Pulse { position, radius_px })).gain_px()
    }

    fn is_exact(map: &GainMap, workpiece: &Workpiece, radius_px: f64) -> bool {
        (0..WORKPIECE_SIZE_PX).all(|row| {
            (0..WORKPIECE_SIZE_PX).all(|column| {
                map.gain_px(row, column) == brute_force(workpiece, radius_px, row, column)
            })
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn gains_are_previews_after_pulses_and_after_taking_them_back(
            radius_px in prop_oneof![Just(9.0), 0.2..50.0, Just(50.0)],
            angle_deg in 0.0..360.0,
            pulses in proptest::collection::vec((-10.0..110.0, -10.0..110.0), 1..12),
        ) {
            let mut workpiece = Workpiece::new(&star(angle_deg)).unwrap();
            let mut map = GainMap::new(&workpiece, radius_px);
            prop_assert!(is_exact(&map, &workpiece, radius_px));
            let pristine = map.clone();
            let mut changes = Vec::new();
            for (x, y) in pulses {
                let footprint = Footprint::of(Pulse { position: Point::new(x, y), radius_px });
                workpiece.pulse_with(&footprint, |row, hits, misses| {
                    map.machined(row, hits, misses);
                    changes.push((row, hits, misses));
                });
            }
            prop_assert!(is_exact(&map, &workpiece, radius_px));
            let (row, column, gain_px) = map.best();
            prop_assert_eq!(map.gain_px(row, column), gain_px);
            prop_assert!((0..WORKPIECE_SIZE_PX).all(|j| map.row(j).iter().all(|&g| i32::from(g) <= gain_px)));
            for (row, hits, misses) in changes {
                map.restored(row, hits, misses);
            }
            prop_assert_eq!(map, pristine);
        }
    }

    #[test]
    fn the_smallest_and_the_largest_pulse_keep_within_the_map() {
        for radius_px in [1e-6, 0.5, 50.0] {
            let workpiece = Workpiece::new(&star(0.0)).unwrap();
            assert!(is_exact(&GainMap::new(&workpiece, radius_px), &workpiece, radius_px));
        }
    }
}
