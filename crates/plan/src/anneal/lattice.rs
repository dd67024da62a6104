//! Pulse positions on a fine lattice, for which footprints are table look-ups.
//!
//! Lattice coordinates are multiples of 1/16 px. Such numbers and their squares are exact in `f64`,
//! so the pixel-centre rule does not change when a pulse moves by whole pixels: a table of one
//! footprint for each position within a pixel holds exactly what [`Footprint::of`] says anywhere.

use lasergym_ablation::{Footprint, Pulse};
use lasergym_geom::{Point, WORKPIECE_SIZE_PX};

use super::window::Window;

/// Lattice positions per pixel along x and along y.
pub(super) const STEPS_PER_PX: i32 = 16;

/// Longest step of a pulse, along x and along y, that is judged as one change, px.
pub(super) const MAX_STEP_PX: usize = 8;

/// Lattice coordinate of the right and of the lower edge of the workpiece.
pub(super) const EDGE: i32 = signed(WORKPIECE_SIZE_PX) * STEPS_PER_PX;

/// A number of pixels as a lattice coordinate's type; far from overflow.
pub(super) const fn signed(pixels: usize) -> i32 {
    (pixels as u32).cast_signed()
}

/// A pulse position, both coordinates in 0..=[`EDGE`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Place {
    pub(super) x: i32,
    pub(super) y: i32,
}

impl Place {
    /// The lattice position nearest to `position`, on the workpiece.
    pub(super) fn near(position: Point) -> Self {
        let snap = |value: f64| ((value * f64::from(STEPS_PER_PX)).round() as i32).clamp(0, EDGE);
        Self { x: snap(position.x), y: snap(position.y) }
    }

    /// The centre of the pixel at (`row`, `column`).
    pub(super) fn pixel_center(row: usize, column: usize) -> Self {
        let center = |pixel: usize| signed(pixel) * STEPS_PER_PX + STEPS_PER_PX / 2;
        Self { x: center(column), y: center(row) }
    }

    /// The same position in px.
    pub(super) fn position(self) -> Point {
        Point::new(f64::from(self.x), f64::from(self.y)) * f64::from(STEPS_PER_PX).recip()
    }

    /// The pixel (row, column) that the position lies in; 100 on the far edges.
    #[inline]
    pub(super) fn pixel(self) -> (usize, usize) {
        ((self.y / STEPS_PER_PX) as usize, (self.x / STEPS_PER_PX) as usize)
    }
}

/// Footprints of pulses of one radius at every position within a pixel.
///
/// Bit k of row q is the pixel in column c − reach + k and row p − reach + q, where (p, c) is the
/// pixel that the pulse lies in. [`MAX_STEP_PX`] empty rows lie above and below each footprint, so
/// that the rows of two that are a step apart can be read side by side.
#[derive(Debug, Clone)]
pub(super) struct LatticeDisc<W> {
    /// Whole pixels that a pulse reaches, rounded up.
    reach: usize,
    /// Rows of every footprint: 2 × reach + 1.
    rows: usize,
    masks: Vec<W>,
}

impl<W: Window> LatticeDisc<W> {
    pub(super) fn new(radius_px: f64) -> Self {
        let reach = radius_px.ceil() as usize;
        let rows = 2 * reach + 1;
        let padded_rows = rows + 2 * MAX_STEP_PX;
        let mut masks = vec![W::EMPTY; (STEPS_PER_PX * STEPS_PER_PX) as usize * padded_rows];
        for (k, masks) in masks.chunks_exact_mut(padded_rows).enumerate() {
            let steps = STEPS_PER_PX as usize;
            let within = Point::new((k % steps) as f64, (k / steps) as f64) * (1.0 / steps as f64);
            disc_masks(radius_px, within, reach, &mut masks[MAX_STEP_PX..]);
        }
        Self { reach, rows, masks }
    }

    pub(super) fn reach(&self) -> usize {
        self.reach
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// The footprint of a pulse at `place`, row by row.
    #[inline]
    pub(super) fn masks(&self, place: Place) -> &[W] {
        &self.padded_masks(place)[MAX_STEP_PX..][..self.rows]
    }

    /// As [`Self::masks`], from `lead` empty rows above the footprint on; `lead` is at most
    /// [`MAX_STEP_PX`].
    #[inline]
    pub(super) fn masks_after(&self, lead: usize, place: Place) -> &[W] {
        &self.padded_masks(place)[MAX_STEP_PX - lead..]
    }

    #[inline]
    fn padded_masks(&self, place: Place) -> &[W] {
        let within = (place.y % STEPS_PER_PX) * STEPS_PER_PX + place.x % STEPS_PER_PX;
        let padded_rows = self.rows + 2 * MAX_STEP_PX;
        &self.masks[within as usize * padded_rows..][..padded_rows]
    }
}

/// The footprint of a pulse at `within` a pixel. Pulses in the four corners of the workpiece each
/// show one quadrant, so that none is cut off.
fn disc_masks<W: Window>(radius_px: f64, within: Point, reach: usize, masks: &mut [W]) {
    let far = WORKPIECE_SIZE_PX - 1;
    for row_pixel in [0, far] {
        for column_pixel in [0, far] {
            let position = Point::new(column_pixel as f64 + within.x, row_pixel as f64 + within.y);
            let footprint = Footprint::of(Pulse { position, radius_px });
            let (first_row, spans) = footprint.rows();
            for (k, span) in spans.iter().enumerate() {
                for column in span.first..span.end {
                    let row = first_row + k + reach - row_pixel;
                    masks[row] |= W::bit(usize::from(column) + reach - column_pixel);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Whether the pixels of the table are those of the footprint, on the workpiece.
    fn agrees<W: Window>(disc: &LatticeDisc<W>, place: Place, radius_px: f64) -> bool {
        let footprint = Footprint::of(Pulse { position: place.position(), radius_px });
        let (first_row, spans) = footprint.rows();
        let (row, column) = place.pixel();
        let masks = disc.masks(place);
        (0..WORKPIECE_SIZE_PX).all(|j| {
            let span = j.checked_sub(first_row).and_then(|k| spans.get(k));
            let mask = (j + disc.reach).checked_sub(row).and_then(|k| masks.get(k));
            (0..WORKPIECE_SIZE_PX).all(|i| {
                let covered =
                    span.is_some_and(|s| (usize::from(s.first)..usize::from(s.end)).contains(&i));
                let bit = (i + disc.reach).checked_sub(column).filter(|&k| k < disc.rows);
                let in_table = bit.zip(mask).is_some_and(|(k, &mask)| mask & W::bit(k) != W::EMPTY);
                covered == in_table
            })
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn the_table_is_the_footprint(
            narrow_px in prop_oneof![Just(9.0), 0.1..20.0],
            wide_px in prop_oneof![Just(50.0), 20.0..50.0],
            places in proptest::collection::vec((0..=EDGE, 0..=EDGE), 20),
        ) {
            let narrow = LatticeDisc::<u64>::new(narrow_px);
            let wide = LatticeDisc::<u128>::new(wide_px);
            for (x, y) in places {
                let place = Place { x, y };
                prop_assert_eq!(Place::near(place.position()), place);
                prop_assert!(agrees(&narrow, place, narrow_px), "{:?}", place);
                prop_assert!(agrees(&wide, place, wide_px), "{:?}", place);
            }
        }
    }

    #[test]
    fn every_place_within_a_pixel_is_in_the_table() {
        let disc = LatticeDisc::<u64>::new(9.0);
        for x in 0..STEPS_PER_PX {
            for y in 0..STEPS_PER_PX {
                assert!(agrees(&disc, Place { x: 50 * STEPS_PER_PX + x, y: y + 800 }, 9.0));
            }
        }
    }
}
