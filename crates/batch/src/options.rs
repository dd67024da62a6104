//! Settings of a batch.

use crate::BatchError;

/// What happens when an episode ends, as in `gymnasium.vector.AutoresetMode`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Autoreset {
    /// The step after the last ignores its action and resets.
    #[default]
    NextStep,
    /// The last step resets at once; the final observation is stored beside the new one.
    SameStep,
    /// The caller resets.
    Disabled,
}

/// Settings of a batch; `M` is the kind of observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BatchOptions<M> {
    /// Number of environments, at least 1.
    pub environments: usize,
    /// What happens when an episode ends.
    pub autoreset: Autoreset,
    /// What the agent sees.
    pub observation: M,
    /// Steps after which an episode is truncated, at least 1; none by default.
    pub max_episode_steps: Option<u32>,
    /// Worker threads, at least 1. Results do not depend on their number.
    pub threads: usize,
}

impl<M> BatchOptions<M> {
    /// Checks the counts.
    ///
    /// # Errors
    /// [`BatchError::InvalidOption`] names the first that is 0.
    pub fn validate(&self) -> Result<(), BatchError> {
        let at_least_one = |value: usize, name| match value {
            0 => Err(BatchError::InvalidOption {
                name,
                value: value.to_string(),
                expected: "at least 1",
            }),
            _ => Ok(()),
        };
        at_least_one(self.environments, "num_envs")?;
        at_least_one(self.threads, "threads")?;
        at_least_one(self.max_episode_steps.map_or(1, |steps| steps as usize), "max_episode_steps")
    }
}
