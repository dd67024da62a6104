//! Environments of one task stepped together.

use lasergym_batch::{BatchError, Batched, Landing};
use lasergym_geom::{Bitmap, WORKPIECE_SIZE_PX};

use crate::action::{Action, check_finite};
use crate::observation::{Eraser, Words};
use crate::{AblationError, Environment, Footprint, ObservationMode, Progress};

/// Environments of one task that step together.
pub type Batch = lasergym_batch::Batch<Environment>;

/// Settings of a batch.
pub type BatchOptions = lasergym_batch::BatchOptions<ObservationMode>;

/// A finished episode.
pub type EpisodeStatistics = lasergym_batch::EpisodeStatistics<Progress>;

/// What one step did to one environment.
pub type StepRecord = lasergym_batch::StepRecord<Progress>;

/// The footprint of a pulse, and room for what it changes.
#[derive(Debug)]
pub struct StepRoom {
    footprint: Footprint,
    words: Words,
}

impl Batched for Environment {
    type Action = Action;
    type Target = Bitmap;
    type Mode = ObservationMode;
    type Progress = Progress;
    type Scratch = StepRoom;
    type Error = AblationError;

    fn observation_len(&self, mode: ObservationMode) -> usize {
        mode.len()
    }

    fn write_observation(&self, mode: ObservationMode, observation: &mut [u8]) {
        mode.write(self, observation);
    }

    fn start_stream(&mut self, seed: u64) {
        self.seed(seed);
    }

    fn begin(&mut self, seed: Option<u64>) {
        self.reset(seed);
    }

    fn begin_with(&mut self, target: &Bitmap) -> Result<(), AblationError> {
        self.reset_to(target)
    }

    #[inline]
    fn check_action(action: Action, environment: usize) -> Result<(), AblationError> {
        check_finite(action, environment)
    }

    fn scratch(&self) -> StepRoom {
        StepRoom { footprint: Footprint::EMPTY, words: [[0; 2]; WORKPIECE_SIZE_PX] }
    }

    #[inline]
    fn act(
        &mut self,
        action: Action,
        mode: ObservationMode,
        observation: &mut [u8],
        room: &mut StepRoom,
    ) -> Landing {
        room.footprint.set(self.aim(action));
        let mut eraser = Eraser { mode, words: &mut room.words, observation };
        let landing = self.land(&room.footprint, &mut eraser);
        mode.write_budget(self, observation);
        landing
    }

    fn truncate(&mut self) {
        self.end();
    }

    fn progress(&self) -> Progress {
        Environment::progress(self)
    }

    fn episode_return(&self) -> f64 {
        Environment::episode_return(self)
    }

    fn is_success(&self) -> bool {
        Environment::is_success(self)
    }
}

impl From<BatchError> for AblationError {
    fn from(error: BatchError) -> Self {
        match error {
            BatchError::InvalidOption { name, value, expected } => {
                Self::InvalidOption { name, value, expected }
            }
            BatchError::EpisodeOver { environment } => Self::EpisodeOver { environment },
            BatchError::WrongLength { name, actual, expected } => {
                Self::WrongLength { name, actual, expected }
            }
            BatchError::Threads { threads, reason } => Self::Threads { threads, reason },
        }
    }
}
