//! What can go wrong with an ablation environment.

/// Every error of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AblationError {
    /// An option lies outside its range.
    #[error("{name} is {value}, but must be {expected}")]
    InvalidOption {
        /// Name of the option.
        name: &'static str,
        /// The value given.
        value: String,
        /// What is accepted.
        expected: &'static str,
    },
    /// The target has no pixel, so nothing could be machined.
    #[error("the target is empty: set at least one pixel to be machined")]
    EmptyTarget,
    /// The target covers the whole workpiece, so nothing could be decided.
    #[error("the target covers the whole workpiece: leave at least one pixel that must stay")]
    FullTarget,
    /// An action has a component that is not a number or infinite.
    #[error(
        "action of environment {environment} is ({x}, {y}): both components must be finite, in [-1, 1]"
    )]
    ActionNotFinite {
        /// Index of the environment.
        environment: usize,
        /// First component.
        x: f32,
        /// Second component.
        y: f32,
    },
    /// A pulse position is not finite.
    #[error("pulse {index} is at ({x}, {y}) px: both coordinates must be finite")]
    PositionNotFinite {
        /// Index of the pulse.
        index: usize,
        /// x, px.
        x: f64,
        /// y, px.
        y: f64,
    },
    /// `step` was called on an episode that has ended, or before the first reset.
    #[error(
        "the episode of environment {environment} is over or has not begun: reset it before the next step"
    )]
    EpisodeOver {
        /// Index of the environment.
        environment: usize,
    },
    /// An array has the wrong number of entries.
    #[error("{name} has {actual} entries, but {expected} are needed")]
    WrongLength {
        /// Name of the array.
        name: &'static str,
        /// Entries given.
        actual: usize,
        /// Entries needed.
        expected: usize,
    },
    /// The worker threads could not be started.
    #[error("could not start {threads} worker threads: {reason}")]
    Threads {
        /// Number of threads asked for.
        threads: usize,
        /// What the system said.
        reason: String,
    },
}
