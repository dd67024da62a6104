//! Which pulses of a plan cover what, and what moving one of them changes.

use lasergym_ablation::Workpiece;
use lasergym_geom::Row;

use super::cover_rows::CoverRows;
use super::lattice::{Lattice, LatticeDisc, Place, signed};
use super::window::Window;

/// Cover of the pixels by a set of pulses on the lattice.
///
/// The rows have a margin of the disc's reach, so that a footprint begins at the row and column,
/// counted with margin, of the pixel that its pulse lies in.
#[derive(Debug, Clone)]
pub(super) struct Cover<W> {
    disc: LatticeDisc<W>,
    rows: CoverRows,
}

impl<W: Window> Cover<W> {
    /// The cover of `workpiece` by no pulse of `lattice`, with room for `max_pulses`.
    pub(super) fn new(workpiece: &Workpiece, lattice: &Lattice, max_pulses: usize) -> Self {
        let disc = LatticeDisc::new(lattice);
        let rows = CoverRows::new(workpiece, disc.reach(), max_pulses);
        Self { disc, rows }
    }

    /// What moving a pulse from `from` to `to` adds to hits − misses, px. The two are at most
    /// [`MAX_STEP_PX`] apart along x and along y.
    #[inline]
    pub(super) fn move_gain_px(&self, from: Place, to: Place) -> i32 {
        let change = side_by_side(&self.disc, from, to);
        let rows = self.rows.sensitive_from(change.first_row);
        let mut gain_px = 0;
        for ((row, &lost), &gained) in rows.iter().zip(change.lost).zip(change.gained) {
            let (lost, gained) = change.shifted(lost, gained);
            let load = |bits| W::load(bits, change.byte);
            let more = (gained & load(&row.bare_target)) | (lost & load(&row.single_ground));
            let less = (gained & load(&row.bare_ground)) | (lost & load(&row.single_target));
            gain_px += more.count() - less.count();
        }
        gain_px
    }

    /// Moves a pulse from `from` to `to`, as [`Self::move_gain_px`].
    #[inline]
    pub(super) fn shift(&mut self, from: Place, to: Place) {
        let change = side_by_side(&self.disc, from, to);
        for (k, (&lost, &gained)) in change.lost.iter().zip(change.gained).enumerate() {
            let (lost, gained) = change.shifted(lost, gained);
            if lost != W::EMPTY {
                self.rows.uncover(change.first_row + k, change.byte, lost);
            }
            if gained != W::EMPTY {
                self.rows.cover(change.first_row + k, change.byte, gained);
            }
        }
    }

    /// Takes the pulse at `place` away and reports every row of the workpiece in which pixels are
    /// bare now as (row, target, ground). Returns what that adds to hits − misses, px.
    #[inline]
    pub(super) fn lift(&mut self, place: Place, mut bared: impl FnMut(usize, Row, Row)) -> i32 {
        self.stamp(place, CoverRows::uncover, |row, t, g| {
            bared(row, t, g);
            g.count_ones().cast_signed() - t.count_ones().cast_signed()
        })
    }

    /// Fires a pulse at `place` and reports every row of the workpiece in which pixels are not bare
    /// any more as (row, target, ground). Returns what that adds to hits − misses, px.
    #[inline]
    pub(super) fn fire(&mut self, place: Place, mut machined: impl FnMut(usize, Row, Row)) -> i32 {
        self.stamp(place, CoverRows::cover, |row, t, g| {
            machined(row, t, g);
            t.count_ones().cast_signed() - g.count_ones().cast_signed()
        })
    }

    /// Changes the cover row by row and sums what `report` makes of the changes.
    #[inline]
    fn stamp(
        &mut self,
        place: Place,
        change: impl Fn(&mut CoverRows, usize, usize, W) -> (W, W),
        mut report: impl FnMut(usize, Row, Row) -> i32,
    ) -> i32 {
        let (first_row, column) = place.pixel();
        let (byte, shift) = (column / 8, (column % 8) as u32);
        let reach = self.disc.reach();
        let workpiece_column = signed(reach) - signed(8 * byte);
        let mut gain_px = 0;
        for (k, &mask) in self.disc.masks(place).iter().enumerate() {
            let (target, ground) = change(&mut self.rows, first_row + k, byte, mask << shift);
            if target | ground != W::EMPTY {
                gain_px += report(
                    first_row + k - reach,
                    target.row_from(workpiece_column),
                    ground.row_from(workpiece_column),
                );
            }
        }
        gain_px
    }
}

/// The footprints at `from` and at `to`, side by side.
#[inline]
fn side_by_side<W: Window>(disc: &LatticeDisc<W>, from: Place, to: Place) -> Change<'_, W> {
    let ((from_row, from_column), (to_row, to_column)) = (from.pixel(), to.pixel());
    let first_row = from_row.min(to_row);
    let rows = from_row.abs_diff(to_row) + disc.rows();
    let byte = from_column.min(to_column) / 8;
    Change {
        first_row,
        byte,
        lost: &disc.masks_after(from_row - first_row, from)[..rows],
        gained: &disc.masks_after(to_row - first_row, to)[..rows],
        lost_shift: (from_column - 8 * byte) as u32,
        gained_shift: (to_column - 8 * byte) as u32,
    }
}

/// Two footprints, row by row, and where their pixels lie in a window that shows both.
struct Change<'a, W> {
    first_row: usize,
    byte: usize,
    lost: &'a [W],
    gained: &'a [W],
    lost_shift: u32,
    gained_shift: u32,
}

impl<W: Window> Change<'_, W> {
    /// The pixels of a row that only the first and that only the second footprint covers.
    #[inline]
    fn shifted(&self, lost: W, gained: W) -> (W, W) {
        let (lost, gained) = (lost << self.lost_shift, gained << self.gained_shift);
        (lost & !gained, gained & !lost)
    }
}

#[cfg(test)]
mod tests {
    use super::super::lattice::{EDGE, MAX_STEP_PX, STEPS_PER_PX};
    use super::*;
    use lasergym_ablation::{Footprint, Pulse, star};
    use lasergym_geom::{Bitmap, WORKPIECE_SIZE_PX};
    use proptest::prelude::*;

    /// Hits − misses of all pulses, by the process itself.
    fn gain_px(workpiece: &Workpiece, lattice: &Lattice, places: &[Place], radius_px: f64) -> i32 {
        let mut workpiece = workpiece.clone();
        places
            .iter()
            .map(|place| {
                let pulse = Pulse { position: lattice.position(*place), radius_px };
                workpiece.pulse(&Footprint::of(pulse)).gain_px()
            })
            .sum()
    }

    fn place() -> impl Strategy<Value = Place> {
        (0..=EDGE, 0..=EDGE).prop_map(|(x, y)| Place { x, y })
    }

    /// What each of the moves is said to gain, and what is gained in the end, is what the process
    /// says.
    fn follows_the_process<W: Window>(
        radius_px: f64,
        places: &mut [Place],
        moves: &[(usize, Place)],
    ) -> Result<(), TestCaseError> {
        let workpiece = Workpiece::partly_machined(
            &Bitmap::from_fn(|j, i| star(20.0).contains(j, i) && (j + i) % 7 != 0),
            &Bitmap::from_fn(|j, i| (j * i) % 5 != 0),
        );
        let lattice = Lattice::new(radius_px);
        let mut cover = Cover::<W>::new(&workpiece, &lattice, places.len());
        let mut bare = workpiece.clone();
        let mut sum_px = 0;
        for k in 0..places.len() {
            let pulse = Pulse { position: lattice.position(places[k]), radius_px };
            let mut expected = [[0; 2]; WORKPIECE_SIZE_PX];
            bare.pulse_with(&Footprint::of(pulse), |row, hits, misses| {
                expected[row][0] |= hits;
                expected[row][1] |= misses;
            });
            let mut machined = [[0; 2]; WORKPIECE_SIZE_PX];
            sum_px += cover.fire(places[k], |row, target, ground| machined[row] = [target, ground]);
            prop_assert_eq!(machined, expected);
            prop_assert_eq!(sum_px, gain_px(&workpiece, &lattice, &places[..=k], radius_px));
        }
        for &(k, to) in moves {
            let k = k % places.len();
            let limit = (signed(MAX_STEP_PX) - 1) * STEPS_PER_PX;
            let near =
                |from: i32, to: i32| (from + (to - from).clamp(-limit, limit)).clamp(0, EDGE);
            let near = Place { x: near(places[k].x, to.x), y: near(places[k].y, to.y) };
            sum_px += cover.move_gain_px(places[k], near);
            cover.shift(places[k], near);
            places[k] = near;
            prop_assert_eq!(sum_px, gain_px(&workpiece, &lattice, places, radius_px));
            sum_px += cover.lift(near, |_, _, _| ());
            sum_px += cover.fire(to, |_, _, _| ());
            places[k] = to;
            prop_assert_eq!(sum_px, gain_px(&workpiece, &lattice, places, radius_px));
        }
        for &place in &*places {
            sum_px += cover.lift(place, |_, _, _| ());
        }
        prop_assert_eq!(sum_px, 0);
        let empty = Cover::<W>::new(&workpiece, &lattice, places.len());
        prop_assert_eq!(cover.rows, empty.rows);
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn gains_are_those_of_the_process(
            narrow_px in prop_oneof![Just(9.0), 0.1..24.0],
            wide_px in prop_oneof![Just(50.0), 24.0..50.0],
            mut places in proptest::collection::vec(place(), 1..40),
            moves in proptest::collection::vec((0_usize..40, place()), 20),
        ) {
            let mut again = places.clone();
            follows_the_process::<u64>(narrow_px, &mut places, &moves)?;
            follows_the_process::<u128>(wide_px, &mut again, &moves)?;
        }
    }

    #[test]
    fn all_pulses_in_one_place_can_be_taken_away_again() {
        let mut places = vec![Place { x: 800, y: 800 }; 37];
        follows_the_process::<u64>(9.0, &mut places, &[(5, Place { x: 0, y: EDGE })]).unwrap();
    }
}
