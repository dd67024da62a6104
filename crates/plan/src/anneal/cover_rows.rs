//! The pixels of the workpiece and how often each is covered.

use lasergym_ablation::Workpiece;
use lasergym_geom::{Bitmap, WORKPIECE_SIZE_PX};

use super::window::{ROW_BYTES, Window};

/// One bit for each pixel of a row, with a margin on the left.
type Bits = [u8; ROW_BYTES];

/// The pixels of one row on which a change of cover shows in the reward.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Sensitive {
    /// Target covered by no pulse, which a new pulse would gain.
    pub(super) bare_target: Bits,
    /// Ground covered by no pulse, which a new pulse would cost.
    pub(super) bare_ground: Bits,
    /// Target covered by one pulse, which would be lost without it.
    pub(super) single_target: Bits,
    /// Ground covered by one pulse, which would be saved without it.
    pub(super) single_ground: Bits,
}

/// Rows of pixels with a margin all round, in which pulses at the edges of the workpiece are not
/// cut off.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct CoverRows {
    /// Pixels that can be gained and lost at all.
    target: Vec<Bits>,
    ground: Vec<Bits>,
    sensitive: Vec<Sensitive>,
    /// Number of pulses over each pixel in binary: digit k of row j is entry j × digits + k.
    counts: Vec<Bits>,
    digits: usize,
}

impl CoverRows {
    /// The rows of `workpiece` with a margin of `margin` pixels, covered by no pulse, with room for
    /// `max_pulses`.
    pub(super) fn new(workpiece: &Workpiece, margin: usize, max_pulses: usize) -> Self {
        let target = with_margin(workpiece.remaining(), margin);
        let ground = with_margin(workpiece.forbidden(), margin);
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
        Self { target, ground, sensitive, counts, digits }
    }

    /// The rows from number `first` on, counted with margin.
    #[inline]
    pub(super) fn sensitive_from(&self, first: usize) -> &[Sensitive] {
        &self.sensitive[first..]
    }

    /// Covers the pixels `mask` of a row once more and says which target and ground was bare.
    #[inline]
    pub(super) fn cover<W: Window>(&mut self, row: usize, byte: usize, mask: W) -> (W, W) {
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
    pub(super) fn uncover<W: Window>(&mut self, row: usize, byte: usize, mask: W) -> (W, W) {
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
}

/// The rows of `bitmap` with a margin of `margin` pixels all round, and one more row below, where
/// pulses on the lower edge of the workpiece lie.
fn with_margin(bitmap: &Bitmap, margin: usize) -> Vec<Bits> {
    let mut rows = vec![Bits::default(); WORKPIECE_SIZE_PX + 2 * margin + 1];
    for (row, column) in bitmap.pixels() {
        let column = column + margin;
        rows[row + margin][column / 8] |= 1 << (column % 8);
    }
    rows
}
