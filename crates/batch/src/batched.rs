//! What an environment must be able to do to be stepped in a batch.

use crate::BatchError;

/// What one step did to an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landing {
    /// Reward of the step.
    pub reward: f64,
    /// Whether the process ended the episode.
    pub terminated: bool,
}

/// An environment whose copies a [`crate::Batch`] steps together. Each has a random stream of its own.
pub trait Batched: Clone + Send + Sync {
    /// One action.
    type Action: Copy + Sync;
    /// What a workpiece is to look like.
    type Target: ?Sized;
    /// Which of the possible observations is written.
    type Mode: Copy + Send + Sync;
    /// How far an episode has come.
    type Progress: Copy + Send;
    /// Room that steps need, made once for many of them.
    type Scratch;
    /// The error of the process.
    type Error: From<BatchError>;

    /// Bytes of one observation.
    fn observation_len(&self, mode: Self::Mode) -> usize;

    /// Writes the whole observation.
    fn write_observation(&self, mode: Self::Mode, observation: &mut [u8]);

    /// Starts the random stream anew.
    fn start_stream(&mut self, seed: u64);

    /// Begins an episode; with `seed` the random stream starts anew.
    fn begin(&mut self, seed: Option<u64>);

    /// Begins an episode with the given target; the random stream goes on.
    ///
    /// # Errors
    /// A target that cannot be machined; the episode under way is kept.
    fn begin_with(&mut self, target: &Self::Target) -> Result<(), Self::Error>;

    /// Refuses actions that are not finite; `environment` is the index for the error.
    ///
    /// # Errors
    /// Of the process, with the action.
    fn check_action(action: Self::Action, environment: usize) -> Result<(), Self::Error>;

    /// Room for steps.
    fn scratch(&self) -> Self::Scratch;

    /// Does one step with an action that [`Batched::check_action`] accepts and writes what it changes
    /// into the observation. The episode is running.
    fn act(
        &mut self,
        action: Self::Action,
        mode: Self::Mode,
        observation: &mut [u8],
        scratch: &mut Self::Scratch,
    ) -> Landing;

    /// Ends the episode without a further step, as a time limit does.
    fn truncate(&mut self);

    /// How far the episode has come.
    fn progress(&self) -> Self::Progress;

    /// Sum of the rewards since the episode began.
    fn episode_return(&self) -> f64;

    /// Whether the target is reached.
    fn is_success(&self) -> bool;
}
