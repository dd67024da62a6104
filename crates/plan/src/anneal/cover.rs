//! How often each pixel is covered by the pulses of a plan, and what moving one of them changes.

use lasergym_ablation::Workpiece;
use lasergym_geom::{Bitmap, Row, WORKPIECE_SIZE_PX};

use super::lattice::{LatticeDisc, Place};
use super::window::{ROW_BYTES, Window};

/// One bit for each pixel of a row, with a margin of the disc's reach on the left.
type Bits = [u8; ROW_BYTES];

/// The pixels of one row on which a change of cover shows in the reward.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Sensitive {
    /// Target and ground covered by no pulse: what a new pulse would gain and lose.
    bare_target: Bits,
    bare_ground: Bits,
    /// Target and ground covered by one pulse: what it would take along.
    single_target: Bits,
    single_ground: Bits,
}

/// Cover of the pixels by a set of pulses on the lattice.
///
/// Rows and columns have a margin of the disc's reach all round, so that no pulse on the workpiece
/// is cut off; its footprint begins at the row and column, counted with margin, of its own pixel.
#[derive(Debug, Clone)]
pub(super) struct Cover<W> {
    disc: LatticeDisc<W>,
    /// Pixels that can be gained and lost at all.
    target: Vec<Bits>,
    ground: Vec<Bits>,
    sensitive: Vec<Sensitive>,
    /// Number of pulses over each pixel in binary: digit k of row j is entry j × digits + k.
    counts: Vec<Bits>,
    digits: usize,
}

impl<W: Window> Cover<W> {
    /// The cover of `workpiece` by no pulse, with room for `max_pulses`.
    pub(super) fn new(workpiece: &Workpiece, radius_px: f64, max_pulses: usize) -> Self {
        let disc = LatticeDisc::new(radius_px);
        let target = with_margin(workpiece.remaining(), disc.reach());
        let ground = with_margin(workpiece.forbidden(), disc.reach());
        let sensitive = target
            .iter()
            .zip(&ground)
            .map(|(&bare_target, &bare_ground)| Sensitive {
                bare_target,
                bare_ground,
                ..Sensitive::default()
            })
            .collect();
        let digits = (usize::BITS - max_pulses.leading_zeros()) as usize;
        let counts = vec![Bits::default(); target.len() * digits];
        Self { disc, target, ground, sensitive, counts, digits }
    }

    /// What moving a pulse from `from` to `to` adds to hits − misses, px. The two are at most
    /// [`MAX_STEP_PX`] apart along x and along y.
    #[inline]
    pub(super) fn move_gain_px(&self, from: Place, to: Place) -> i32 {
        let change = self.change(from, to);
        let rows = &self.sensitive[change.first_row..][..change.lost.len()];
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

    /// Moves a pulse from `from` to `to`, which are at most [`MAX_STEP_PX`] apart along x and y.
    #[inline]
    pub(super) fn shift(&mut self, from: Place, to: Place) {
        let (first_row, last_row) = span_of(from.pixel().0, to.pixel().0);
        let rows = last_row - first_row + self.disc.rows();
        for k in 0..rows {
            let change = self.change(from, to);
            let byte = change.byte;
            let (lost, gained) = change.shifted(change.lost[k], change.gained[k]);
            if lost != W::EMPTY {
                self.uncover(first_row + k, byte, lost);
            }
            if gained != W::EMPTY {
                self.cover(first_row + k, byte, gained);
            }
        }
    }

    /// Takes the pulse at `place` away and reports every row of the workpiece in which pixels are
    /// bare now as (row, target, ground). Returns what that adds to hits − misses, px.
    #[inline]
    pub(super) fn lift(&mut self, place: Place, mut bared: impl FnMut(usize, Row, Row)) -> i32 {
        self.stamp(
            place,
            |cover, row, byte, mask| cover.uncover(row, byte, mask),
            |row, t, g| {
                bared(row, t, g);
                g.count_ones().cast_signed() - t.count_ones().cast_signed()
            },
        )
    }

    /// Fires a pulse at `place` and reports every row of the workpiece in which pixels are not bare
    /// any more as (row, target, ground). Returns what that adds to hits − misses, px.
    #[inline]
    pub(super) fn fire(&mut self, place: Place, mut machined: impl FnMut(usize, Row, Row)) -> i32 {
        self.stamp(
            place,
            |cover, row, byte, mask| cover.cover(row, byte, mask),
            |row, t, g| {
                machined(row, t, g);
                t.count_ones().cast_signed() - g.count_ones().cast_signed()
            },
        )
    }

    /// Changes the cover row by row and sums what `report` makes of the changes.
    #[inline]
    fn stamp(
        &mut self,
        place: Place,
        change: impl Fn(&mut Self, usize, usize, W) -> (W, W),
        mut report: impl FnMut(usize, Row, Row) -> i32,
    ) -> i32 {
        let (first_row, column) = place.pixel();
        let (byte, shift) = (column / 8, (column % 8) as u32);
        let reach = self.disc.reach();
        let workpiece_column = reach as i32 - 8 * byte as i32;
        let mut gain_px = 0;
        for k in 0..self.disc.rows() {
            let mask = self.disc.masks(place)[k] << shift;
            let (target, ground) = change(self, first_row + k, byte, mask);
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

    /// Covers the pixels `mask` of a row once more and says which target and ground was bare.
    #[inline]
    fn cover(&mut self, row: usize, byte: usize, mask: W) -> (W, W) {
        let mut carry = mask;
        for digit in &mut self.counts[row * self.digits..][..self.digits] {
            let bits = W::load(digit, byte);
            ((bits & !carry) | (carry & !bits)).store(digit, byte);
            carry = carry & bits;
            if carry == W::EMPTY {
                break;
            }
        }
        let row = &mut self.sensitive[row];
        let advance = |bare: &mut Bits, single: &mut Bits| {
            let (b, s) = (W::load(bare, byte), W::load(single, byte));
            (b & !mask).store(bare, byte);
            ((s & !mask) | (b & mask)).store(single, byte);
            b & mask
        };
        (
            advance(&mut row.bare_target, &mut row.single_target),
            advance(&mut row.bare_ground, &mut row.single_ground),
        )
    }

    /// Covers the pixels `mask` of a row once less and says which target and ground is bare now.
    #[inline]
    fn uncover(&mut self, row: usize, byte: usize, mask: W) -> (W, W) {
        let mut borrow = mask;
        let mut single = mask;
        for (k, digit) in self.counts[row * self.digits..][..self.digits].iter_mut().enumerate() {
            let bits = W::load(digit, byte);
            let left = (bits & !borrow) | (borrow & !bits);
            left.store(digit, byte);
            borrow = borrow & !bits;
            single = if k == 0 { single & left } else { single & !left };
        }
        let retreat = |bare: &mut Bits, once: &mut Bits, all: &Bits| {
            let (b, s) = (W::load(bare, byte), W::load(once, byte));
            (b | (s & mask)).store(bare, byte);
            ((s & !mask) | (single & W::load(all, byte))).store(once, byte);
            s & mask
        };
        let (target, ground) = (&self.target[row], &self.ground[row]);
        let row = &mut self.sensitive[row];
        (
            retreat(&mut row.bare_target, &mut row.single_target, target),
            retreat(&mut row.bare_ground, &mut row.single_ground, ground),
        )
    }

    /// The footprints at `from` and at `to`, side by side.
    #[inline]
    fn change(&self, from: Place, to: Place) -> Change<'_, W> {
        let ((from_row, from_column), (to_row, to_column)) = (from.pixel(), to.pixel());
        let (first_row, last_row) = span_of(from_row, to_row);
        let rows = last_row - first_row + self.disc.rows();
        let byte = from_column.min(to_column) / 8;
        Change {
            first_row,
            byte,
            lost: &self.disc.masks_after(from_row - first_row, from)[..rows],
            gained: &self.disc.masks_after(to_row - first_row, to)[..rows],
            lost_shift: (from_column - 8 * byte) as u32,
            gained_shift: (to_column - 8 * byte) as u32,
        }
    }
}

/// The smaller and the larger of two.
#[inline]
fn span_of(a: usize, b: usize) -> (usize, usize) {
    (a.min(b), a.max(b))
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

/// The rows of `bitmap` with a margin of `reach` pixels all round, and one more row below, where
/// pulses on the lower edge of the workpiece lie.
fn with_margin(bitmap: &Bitmap, reach: usize) -> Vec<Bits> {
    let mut rows = vec![Bits::default(); WORKPIECE_SIZE_PX + 2 * reach + 1];
    for (row, column) in bitmap.pixels() {
        let column = column + reach;
        rows[row + reach][column / 8] |= 1 << (column % 8);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::super::lattice::{EDGE, MAX_STEP_PX, STEPS_PER_PX};
    use super::*;
    use lasergym_ablation::{Footprint, Pulse, star};
    use proptest::prelude::*;

    /// Hits − misses of all pulses, by the process itself.
    fn gain_px(workpiece: &Workpiece, places: &[Place], radius_px: f64) -> i32 {
        let mut workpiece = workpiece.clone();
        places
            .iter()
            .map(|place| {
                let pulse = Pulse { position: place.position(), radius_px };
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
        let mut cover = Cover::<W>::new(&workpiece, radius_px, places.len());
        let mut bare = workpiece.clone();
        let mut sum_px = 0;
        for k in 0..places.len() {
            sum_px += cover.fire(places[k], |row, target, ground| {
                let (first_row, spans) = (row, [target, ground]);
                let mut machined = Vec::new();
                let pulse = Pulse { position: places[k].position(), radius_px };
                bare.clone().pulse_with(&Footprint::of(pulse), |row, hits, misses| {
                    machined.push((row, [hits, misses]));
                });
                assert!(machined.contains(&(first_row, spans)));
            });
            bare.pulse(&Footprint::of(Pulse { position: places[k].position(), radius_px }));
            prop_assert_eq!(sum_px, gain_px(&workpiece, &places[..=k], radius_px));
        }
        for &(k, to) in moves {
            let k = k % places.len();
            let limit = (MAX_STEP_PX as i32 - 1) * STEPS_PER_PX;
            let near =
                |from: i32, to: i32| (from + (to - from).clamp(-limit, limit)).clamp(0, EDGE);
            let near = Place { x: near(places[k].x, to.x), y: near(places[k].y, to.y) };
            sum_px += cover.move_gain_px(places[k], near);
            cover.shift(places[k], near);
            places[k] = near;
            prop_assert_eq!(sum_px, gain_px(&workpiece, places, radius_px));
            sum_px += cover.lift(near, |_, _, _| ());
            sum_px += cover.fire(to, |_, _, _| ());
            places[k] = to;
            prop_assert_eq!(sum_px, gain_px(&workpiece, places, radius_px));
        }
        for &place in &*places {
            sum_px += cover.lift(place, |_, _, _| ());
        }
        prop_assert_eq!(sum_px, 0);
        let empty = Cover::<W>::new(&workpiece, radius_px, places.len());
        prop_assert_eq!(cover.sensitive, empty.sensitive);
        prop_assert_eq!(cover.counts, empty.counts);
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
