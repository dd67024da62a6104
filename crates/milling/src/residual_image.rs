//! What an agent sees: what is left to remove, as an image.

use std::ops::Range;

use crate::{Environment, SIZE_PX};

/// Bytes of one channel.
const CHANNEL_LEN: usize = SIZE_PX * SIZE_PX;

/// Which channels an observation has; each is 100 × 100 bytes, rows from top to bottom. Depths are
/// scaled by the full scale of the environment and cut off beyond it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ObservationMode {
    /// One channel: 128 where the target is reached, 255 where the full scale is left to remove, 1
    /// where the ground is as much too deep.
    #[default]
    Residual,
    /// Three channels: what is left to remove, up to 255; how much too deep the ground is, up to 255;
    /// spots left over `max_spots`, scaled to 255, everywhere. With them the process is Markov.
    Layers,
}

impl ObservationMode {
    /// Number of channels.
    #[must_use]
    pub const fn channels(self) -> usize {
        match self {
            Self::Residual => 1,
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

    /// Writes the whole observation of `environment`, which has [`len`](Self::len) bytes.
    pub fn write(self, environment: &Environment, observation: &mut [u8]) {
        self.write_window(environment, 0..SIZE_PX, 0..SIZE_PX, observation);
        self.write_budget(environment, observation);
    }

    /// Writes the pixels of some rows and columns.
    pub(crate) fn write_window(
        self,
        environment: &Environment,
        rows: Range<usize>,
        columns: Range<usize>,
        observation: &mut [u8],
    ) {
        let per_um = 1.0 / environment.full_scale_um();
        for row in rows {
            let start = row * SIZE_PX + columns.start;
            let (depths, targets) = environment.row(row);
            let pixels = depths[columns.clone()].iter().zip(&targets[columns.clone()]);
            match self {
                Self::Residual => {
                    let bytes = observation[start..].iter_mut();
                    for (byte, (depth, target)) in bytes.zip(pixels) {
                        let part = ((target - depth) * per_um).clamp(-1.0, 1.0);
                        // Adding a half and cutting off rounds values above 0.
                        *byte = (128.5 + 127.0 * part) as u8;
                    }
                }
                Self::Layers => {
                    let (left, rest) = observation.split_at_mut(CHANNEL_LEN);
                    let bytes = left[start..].iter_mut().zip(&mut rest[start..]);
                    for ((left, beyond), (depth, target)) in bytes.zip(pixels) {
                        let part = (target - depth) * per_um;
                        *left = (0.5 + 255.0 * part.clamp(0.0, 1.0)) as u8;
                        *beyond = (0.5 + 255.0 * (-part).clamp(0.0, 1.0)) as u8;
                    }
                }
            }
        }
    }

    /// Writes the spots left, where they are shown.
    pub(crate) fn write_budget(self, environment: &Environment, observation: &mut [u8]) {
        if self == Self::Layers {
            let part = f64::from(environment.spots_left()) / f64::from(environment.max_spots());
            observation[2 * CHANNEL_LEN..3 * CHANNEL_LEN].fill((0.5 + 255.0 * part) as u8);
        }
    }
}
