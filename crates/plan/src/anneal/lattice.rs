//! Pulse positions on a fine lattice, for which footprints are table look-ups.
//!
//! Lattice places are 1/16 px apart, and their positions multiples of 1/4096 px. Such numbers and
//! their squares are exact in `f64`, so the pixel-centre rule does not change when a pulse moves by
//! whole pixels: a table of one footprint for each place within a pixel holds exactly what
//! [`Footprint::of`] says anywhere.
//!
//! Environments take positions as `f32` actions, which moves them a little. No pixel centre lies so
//! near the rim of a pulse on the lattice that this could change what the pulse covers.

use lasergym_ablation::{Footprint, Pulse, reachable_position};
use lasergym_geom::{Point, WORKPIECE_SIZE_PX};

use super::window::Window;

/// Lattice positions per pixel along x and along y.
pub(super) const STEPS_PER_PX: i32 = 16;

/// Longest step of a pulse, along x and along y, that is judged as one change, px.
pub(super) const MAX_STEP_PX: usize = 8;

/// Distance from the rim within which the rounding of actions might change the cover of a pixel, px.
const RIM_PX: f64 = 2e-5;

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

    /// The pixel (row, column) that the position lies in; 100 on the far edges.
    #[inline]
    pub(super) fn pixel(self) -> (usize, usize) {
        ((self.y / STEPS_PER_PX) as usize, (self.x / STEPS_PER_PX) as usize)
    }

    /// The number of the place within its pixel.
    #[inline]
    fn within(self) -> usize {
        ((self.y % STEPS_PER_PX) * STEPS_PER_PX + self.x % STEPS_PER_PX) as usize
    }
}

/// Where the places of the lattice lie within their pixels, for pulses of one radius.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    radius_px: f64,
    /// Position within the pixel of the place in (row, column) of the steps within it.
    within: Vec<Point>,
}

impl Lattice {
    /// The lattice for pulses of `radius_px`. Places where a pulse has a pixel centre on its rim
    /// give way by up to 1/512 px.
    pub(super) fn new(radius_px: f64) -> Self {
        let steps = STEPS_PER_PX as usize;
        let within = (0..steps * steps)
            .map(|k| {
                let place =
                    Point::new((k % steps) as f64, (k / steps) as f64) * (1.0 / steps as f64);
                let moved = |k: i32| {
                    let step_px = f64::from(k) / 4096.0;
                    Point::new(place.x + step_px, place.y + 2.0 * step_px)
                };
                (0..5).map(moved).find(|&p| !meets_center(p, radius_px)).unwrap_or(place)
            })
            .collect();
        Self { radius_px, within }
    }

    /// As [`Self::position`], of all `places`.
    pub(super) fn positions(&self, places: &[Place]) -> Vec<Point> {
        places.iter().map(|&place| self.position(place)).collect()
    }

    /// The position of `place`, px, as an action reaches it.
    pub(super) fn position(&self, place: Place) -> Point {
        let (row, column) = place.pixel();
        reachable_position(Point::new(column as f64, row as f64) + self.within[place.within()])
    }
}

/// Whether the centre of a pixel lies within [`RIM_PX`] of the rim of a pulse at `within` a pixel.
fn meets_center(within: Point, radius_px: f64) -> bool {
    let reach = radius_px.ceil() as i32;
    (-reach..=reach).any(|row| {
        let dy = f64::from(row) + 0.5 - within.y;
        let half_width = (radius_px * radius_px - dy * dy).max(0.0).sqrt();
        [within.x - half_width, within.x + half_width].into_iter().any(|x| {
            // The pixel whose centre is nearest to the rim in this row.
            let dx = x.floor() + 0.5 - within.x;
            (dx.hypot(dy) - radius_px).abs() < RIM_PX
        })
    })
}

/// Footprints of pulses of one radius at every place within a pixel.
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
    pub(super) fn new(lattice: &Lattice) -> Self {
        let reach = lattice.radius_px.ceil() as usize;
        let rows = 2 * reach + 1;
        let padded_rows = rows + 2 * MAX_STEP_PX;
        let mut masks = vec![W::EMPTY; lattice.within.len() * padded_rows];
        for (masks, &within) in masks.chunks_exact_mut(padded_rows).zip(&lattice.within) {
            disc_masks(lattice.radius_px, within, reach, &mut masks[MAX_STEP_PX..]);
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
        let padded_rows = self.rows + 2 * MAX_STEP_PX;
        &self.masks[place.within() * padded_rows..][..padded_rows]
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
    fn agrees<W: Window>(disc: &LatticeDisc<W>, lattice: &Lattice, place: Place) -> bool {
        let position = lattice.position(place);
        let footprint = Footprint::of(Pulse { position, radius_px: lattice.radius_px });
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
            let narrow_lattice = Lattice::new(narrow_px);
            let wide_lattice = Lattice::new(wide_px);
            let narrow = LatticeDisc::<u64>::new(&narrow_lattice);
            let wide = LatticeDisc::<u128>::new(&wide_lattice);
            for (x, y) in places {
                let place = Place { x, y };
                prop_assert_eq!(Place::near(narrow_lattice.position(place)), place);
                prop_assert!(agrees(&narrow, &narrow_lattice, place), "{:?}", place);
                prop_assert!(agrees(&wide, &wide_lattice, place), "{:?}", place);
            }
        }
    }

    #[test]
    fn every_place_on_the_workpiece_is_in_the_table() {
        let lattice = Lattice::new(9.0);
        let disc = LatticeDisc::<u64>::new(&lattice);
        for k in 0..64 * STEPS_PER_PX {
            // Every place within a pixel several times, all over the workpiece.
            let place = Place { x: k * 37 % (EDGE + 1), y: k / 16 * 13 % (EDGE + 1) };
            assert!(agrees(&disc, &lattice, place), "{place:?}");
        }
    }

    #[test]
    fn a_pulse_with_pixel_centers_on_its_rim_gives_way() {
        let lattice = Lattice::new(9.0);
        let center = Place::pixel_center(50, 50);
        assert!(meets_center(Point::new(0.5, 0.5), 9.0));
        let position = lattice.position(center);
        assert!(position != Point::new(50.5, 50.5));
        assert!(position.distance(Point::new(50.5, 50.5)) < 1e-2);
    }
}
