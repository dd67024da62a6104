//! What an agent sees, written into buffers that the caller owns.

use crate::{Environment, Workpiece};
use lasergym_geom::{Bitmap, Row, WORKPIECE_SIZE_PX};

/// Bytes of one channel.
const CHANNEL_LEN: usize = WORKPIECE_SIZE_PX * WORKPIECE_SIZE_PX;

/// `EXPANDED[bits]` holds 255 in byte `k` where bit `k` is set.
static EXPANDED: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut bits = 0;
    while bits < 256 {
        let mut k = 0;
        while k < 8 {
            if bits >> k & 1 == 1 {
                table[bits][k] = 255;
            }
            k += 1;
        }
        bits += 1;
    }
    table
};

/// Which channels an observation has; each is 100 × 100 bytes, rows from top to bottom.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ObservationMode {
    /// One channel: 255 where target remains. This is what the paper's agent sees.
    #[default]
    Remaining,
    /// Three channels: 255 where target remains; 255 where pristine ground must stay; pulses left
    /// over `max_pulses`, scaled to 255, everywhere. With them the process is Markov.
    Layers,
}

impl ObservationMode {
    /// Number of channels.
    #[must_use]
    pub const fn channels(self) -> usize {
        match self {
            Self::Remaining => 1,
            Self::Layers => 3,
        }
    }

    /// Bytes of one observation, shape (channels, 100, 100).
    #[must_use]
    pub const fn len(self) -> usize {
        self.channels() * CHANNEL_LEN
    }

    /// Always false: every observation has pixels.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        false
    }

    /// Writes the whole observation of `environment`. Bytes beyond [`len`](Self::len) are left
    /// alone, missing ones are left out.
    pub fn write(self, environment: &Environment, observation: &mut [u8]) {
        let mut channels = observation.chunks_mut(CHANNEL_LEN);
        let workpiece: &Workpiece = environment.workpiece();
        if let Some(channel) = channels.next() {
            write_bitmap(workpiece.remaining(), channel);
        }
        if self == Self::Layers {
            if let Some(channel) = channels.next() {
                write_bitmap(workpiece.forbidden(), channel);
            }
            if let Some(channel) = channels.next() {
                channel.fill(budget_level(environment));
            }
        }
    }

    /// Writes what a pulse changed in one row.
    #[inline]
    pub(crate) fn erase(self, row: usize, hits: Row, misses: Row, observation: &mut [u8]) {
        erase_row(hits, &mut observation[row * WORKPIECE_SIZE_PX..][..WORKPIECE_SIZE_PX]);
        if self == Self::Layers {
            let start = CHANNEL_LEN + row * WORKPIECE_SIZE_PX;
            erase_row(misses, &mut observation[start..][..WORKPIECE_SIZE_PX]);
        }
    }

    /// Writes the pulses left, where they are shown.
    #[inline]
    pub(crate) fn write_budget(self, environment: &Environment, observation: &mut [u8]) {
        if self == Self::Layers {
            observation[2 * CHANNEL_LEN..].fill(budget_level(environment));
        }
    }
}

/// Pulses left over `max_pulses`, scaled to 255 and rounded to the nearest.
fn budget_level(environment: &Environment) -> u8 {
    let max_pulses = u64::from(environment.options().max_pulses);
    let left = u64::from(environment.pulses_left());
    ((510 * left + max_pulses) / (2 * max_pulses)) as u8
}

/// Writes 255 where `bitmap` is set and 0 elsewhere.
fn write_bitmap(bitmap: &Bitmap, channel: &mut [u8]) {
    for (bytes, &row) in channel.chunks_exact_mut(WORKPIECE_SIZE_PX).zip(bitmap.rows()) {
        for (eight, bits) in bytes.chunks_mut(8).zip(row.to_le_bytes()) {
            eight.copy_from_slice(&EXPANDED[usize::from(bits)][..eight.len()]);
        }
    }
}

/// Writes 0 from the first to the last bit of `erased`.
///
/// A pulse takes every set pixel of a span of columns, so all that lies between is 0 already.
#[inline]
fn erase_row(erased: Row, bytes: &mut [u8]) {
    if erased != 0 {
        let first = erased.trailing_zeros() as usize;
        let end = (Row::BITS - erased.leading_zeros()) as usize;
        bytes[first..end].fill(0);
    }
}
