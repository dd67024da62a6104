//! What an agent sees, written into buffers that the caller owns.

use crate::workpiece::Changes;
use crate::{Environment, Footprint, Workpiece};
use lasergym_geom::{Bitmap, WORKPIECE_SIZE_PX};

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
        let (left, max) = (environment.pulses_left(), environment.options().max_pulses);
        self.write_state(environment.workpiece(), left, max, observation);
    }

    /// As [`write`](Self::write), of a workpiece with `pulses_left` out of `max_pulses`, which is
    /// at least 1.
    pub fn write_state(
        self,
        workpiece: &Workpiece,
        pulses_left: u32,
        max_pulses: u32,
        observation: &mut [u8],
    ) {
        let mut channels = observation.chunks_mut(CHANNEL_LEN);
        if let Some(channel) = channels.next() {
            write_bitmap(workpiece.remaining(), channel);
        }
        if self == Self::Layers {
            if let Some(channel) = channels.next() {
                write_bitmap(workpiece.forbidden(), channel);
            }
            if let Some(channel) = channels.next() {
                channel.fill(budget_level(pulses_left, max_pulses));
            }
        }
    }

    /// Writes the pulses left, where they are shown.
    #[inline]
    pub(crate) fn write_budget(self, environment: &Environment, observation: &mut [u8]) {
        if self == Self::Layers {
            let (left, max) = (environment.pulses_left(), environment.options().max_pulses);
            observation[2 * CHANNEL_LEN..].fill(budget_level(left, max));
        }
    }
}

/// Pulses left over `max_pulses`, scaled to 255 and rounded to the nearest.
fn budget_level(pulses_left: u32, max_pulses: u32) -> u8 {
    let (left, max) = (u64::from(pulses_left), u64::from(max_pulses.max(1)));
    ((510 * left.min(max) + max) / (2 * max)) as u8
}

/// Writes 255 where `bitmap` is set and 0 elsewhere.
fn write_bitmap(bitmap: &Bitmap, channel: &mut [u8]) {
    for (bytes, &row) in channel.chunks_exact_mut(WORKPIECE_SIZE_PX).zip(bitmap.rows()) {
        for (eight, bits) in bytes.chunks_mut(8).zip(row.to_le_bytes()) {
            eight.copy_from_slice(&EXPANDED[usize::from(bits)][..eight.len()]);
        }
    }
}

/// Words of a pulse's hits and misses, one pair a row of its footprint.
pub(crate) type Words = [[u64; 2]; WORKPIECE_SIZE_PX];

/// Writes what a pulse changes into an observation: 0 where a pixel is machined, nothing elsewhere.
#[derive(Debug)]
pub(crate) struct Eraser<'a> {
    pub(crate) mode: ObservationMode,
    /// Room for one pulse.
    pub(crate) words: &'a mut Words,
    pub(crate) observation: &'a mut [u8],
}

impl Changes for Eraser<'_> {
    #[inline]
    fn row<const FIRST: usize>(&mut self, k: usize, hits: u64, misses: u64) {
        self.words[k] = [hits, misses];
    }

    #[inline]
    fn end<const FIRST: usize>(&mut self, footprint: &Footprint) {
        if footprint.columns().len() <= 24 {
            self.erase::<FIRST, 3>(footprint);
        } else if FIRST == 0 {
            self.erase::<FIRST, 8>(footprint);
        } else {
            self.erase::<FIRST, 7>(footprint);
        }
    }
}

impl Eraser<'_> {
    /// Writes 0 where the words are set, in `EIGHTS` groups of eight columns that take in the
    /// footprint; bit 0 of the words is column `FIRST`.
    #[inline]
    fn erase<const FIRST: usize, const EIGHTS: usize>(&mut self, footprint: &Footprint) {
        let (first_row, spans) = footprint.rows();
        let words = &self.words[..spans.len()];
        let first = footprint.columns().start.min(WORKPIECE_SIZE_PX - 8 * EIGHTS);
        let shift = first.saturating_sub(FIRST);
        let channels = if self.mode == ObservationMode::Layers { 2 } else { 1 };
        let channels = self.observation.chunks_exact_mut(CHANNEL_LEN).take(channels);
        for (k, channel) in channels.enumerate() {
            let rows = channel.as_chunks_mut::<WORKPIECE_SIZE_PX>().0;
            for (row, word) in rows[first_row..].iter_mut().zip(words) {
                if word[k] == 0 {
                    continue;
                }
                let mut bits = word[k] >> shift;
                for eight in row[first..][..8 * EIGHTS].as_chunks_mut::<8>().0 {
                    let kept = !u64::from_ne_bytes(EXPANDED[bits as usize & 255]);
                    *eight = (u64::from_ne_bytes(*eight) & kept).to_ne_bytes();
                    bits >>= 8;
                }
            }
        }
    }
}
