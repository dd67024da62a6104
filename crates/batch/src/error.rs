//! What can go wrong with a batch of environments.

/// Every error of this crate.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BatchError {
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
