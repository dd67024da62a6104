//! Milling environments stepped together.

use lasergym_batch::{Batched, Landing};

use crate::environment::{Action, check_finite};
use crate::{Environment, MillingError, ObservationMode, Progress, SpotRoom};

/// Milling environments that step together.
pub type Batch = lasergym_batch::Batch<Environment>;

/// Settings of a batch.
pub type BatchOptions = lasergym_batch::BatchOptions<ObservationMode>;

/// A finished episode.
pub type EpisodeStatistics = lasergym_batch::EpisodeStatistics<Progress>;

/// What one step did to one environment.
pub type StepRecord = lasergym_batch::StepRecord<Progress>;

impl Batched for Environment {
    type Action = Action;
    type Target = [f64];
    type Mode = ObservationMode;
    type Progress = Progress;
    type Scratch = SpotRoom;
    type Error = MillingError;

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

    fn begin_with(&mut self, target: &[f64]) -> Result<(), MillingError> {
        self.reset_to(target)
    }

    fn check_action(action: Action, environment: usize) -> Result<(), MillingError> {
        check_finite(action, environment)
    }

    fn scratch(&self) -> SpotRoom {
        self.simulator().spot_room()
    }

    fn act(
        &mut self,
        action: Action,
        mode: ObservationMode,
        observation: &mut [u8],
        room: &mut SpotRoom,
    ) -> Landing {
        let spot = self.aim(action);
        let (landing, rows, columns) = self.mill(&spot, room);
        mode.write_window(self, rows, columns, observation);
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
