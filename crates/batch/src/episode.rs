//! What is known of episodes and their steps.

/// The phase of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Phase {
    /// Before the first reset.
    #[default]
    NotBegun,
    /// Steps are accepted.
    Running,
    /// The episode has ended.
    Over,
}

/// A finished episode; `P` is the progress of the process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpisodeStatistics<P> {
    /// Sum of its rewards.
    pub episode_return: f64,
    /// Number of its steps.
    pub length: u32,
    /// How far it came.
    pub progress: P,
    /// Whether the target was reached.
    pub is_success: bool,
}

/// What one step did to one environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepRecord<P> {
    /// Reward of the step; 0 in a step that resets.
    pub reward: f64,
    /// Whether the process ended the episode.
    pub terminated: bool,
    /// Whether `max_episode_steps` ended it.
    pub truncated: bool,
    /// How far the episode has come that the observation shows.
    pub progress: P,
    /// The episode that this step finished.
    pub finished: Option<EpisodeStatistics<P>>,
}

impl<P> StepRecord<P> {
    /// The record of a step that only reset.
    pub(crate) fn of_reset(progress: P) -> Self {
        Self { reward: 0.0, terminated: false, truncated: false, progress, finished: None }
    }
}
