//! A machine word that shows part of a row of pixels.

use std::fmt::Debug;
use std::ops::{BitAnd, BitOr, BitOrAssign, Not, Shl};

use lasergym_geom::Row;

/// Bytes of a row of pixels with its margins.
pub(super) const ROW_BYTES: usize = 32;

/// Bytes at which a window may begin: any byte of the workpiece.
const WINDOW_STARTS: usize = 16;

/// Some consecutive pixels of a row, bit 0 the leftmost. A window begins at a whole byte.
pub(super) trait Window:
    Copy
    + Debug
    + PartialEq
    + Send
    + Sync
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitOrAssign
    + Not<Output = Self>
    + Shl<u32, Output = Self>
{
    /// No pixel.
    const EMPTY: Self;

    /// Pixel number `k` alone.
    fn bit(k: usize) -> Self;

    /// The pixels from byte `byte` of `row` on.
    fn load(row: &[u8; ROW_BYTES], byte: usize) -> Self;

    /// Writes the pixels from byte `byte` of `row` on.
    fn store(self, row: &mut [u8; ROW_BYTES], byte: usize);

    /// Number of pixels.
    fn count(self) -> i32;

    /// The pixels as those of a row whose column 0 is bit `column` of the window, which may lie
    /// outside it.
    fn row_from(self, column: i32) -> Row;
}

macro_rules! window {
    ($word:ty, $bytes:literal) => {
        impl Window for $word {
            const EMPTY: Self = 0;

            #[inline]
            fn bit(k: usize) -> Self {
                1 << k
            }

            #[inline]
            fn load(row: &[u8; ROW_BYTES], byte: usize) -> Self {
                let mut bytes = [0; $bytes];
                bytes.copy_from_slice(&row[byte % WINDOW_STARTS..][..$bytes]);
                Self::from_le_bytes(bytes)
            }

            #[inline]
            fn store(self, row: &mut [u8; ROW_BYTES], byte: usize) {
                row[byte % WINDOW_STARTS..][..$bytes].copy_from_slice(&self.to_le_bytes());
            }

            #[inline]
            fn count(self) -> i32 {
                self.count_ones().cast_signed()
            }

            #[inline]
            fn row_from(self, column: i32) -> Row {
                let row = Row::from(self);
                if column < 0 { row << -column } else { row >> column }
            }
        }
    };
}

window!(u64, 8);
window!(u128, 16);
