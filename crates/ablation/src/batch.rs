//! Many environments stepped together, on one thread or several.

use crate::action::{Action, check_finite};
use crate::environment::Phase;
use crate::share::{Episode, Share};
use crate::{AblationError, Environment, ObservationMode, Options, Progress, Task};
use lasergym_geom::Bitmap;

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

/// Settings of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BatchOptions {
    /// Number of environments, at least 1.
    pub environments: usize,
    /// What happens when an episode ends.
    pub autoreset: Autoreset,
    /// What the agent sees.
    pub observation: ObservationMode,
    /// Steps after which an episode is truncated, at least 1; none by default.
    pub max_episode_steps: Option<u32>,
    /// Worker threads, at least 1. Results do not depend on their number.
    pub threads: usize,
}

impl BatchOptions {
    fn validate(&self) -> Result<(), AblationError> {
        let at_least_one = |value: usize, name| match value {
            0 => Err(AblationError::InvalidOption {
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

/// A finished episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpisodeStatistics {
    /// Sum of its rewards.
    pub episode_return: f64,
    /// Number of its steps.
    pub length: u32,
    /// How far it came.
    pub progress: Progress,
    /// Whether the target was completed.
    pub is_success: bool,
}

/// What one step did to one environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepRecord {
    /// Reward of the pulse; 0 in a step that resets.
    pub reward: f64,
    /// Whether the process ended the episode.
    pub terminated: bool,
    /// Whether `max_episode_steps` ended it.
    pub truncated: bool,
    /// How far the episode has come that the observation shows.
    pub progress: Progress,
    /// The episode that this step finished.
    pub finished: Option<EpisodeStatistics>,
}

impl StepRecord {
    /// The record of a step that only reset.
    pub(crate) fn of_reset(progress: Progress) -> Self {
        Self { reward: 0.0, terminated: false, truncated: false, progress, finished: None }
    }
}

/// Environments of one task that step together.
#[derive(Debug)]
pub struct Batch {
    environments: Vec<Environment>,
    episodes: Vec<Episode>,
    records: Vec<StepRecord>,
    options: BatchOptions,
    pool: Option<rayon::ThreadPool>,
}

impl Batch {
    /// A batch before its first reset; environment `i` has the random stream of seed `i`.
    ///
    /// # Errors
    /// An option outside its range, a pattern that cannot be machined, threads that do not start.
    pub fn new(task: Task, process: Options, options: BatchOptions) -> Result<Self, AblationError> {
        options.validate()?;
        let environment = Environment::new(task, process)?;
        let record = StepRecord::of_reset(environment.progress());
        let threads = options.threads;
        let pool = (threads > 1)
            .then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build())
            .transpose()
            .map_err(|error| AblationError::Threads { threads, reason: error.to_string() })?;
        let count = options.environments;
        let mut environments = vec![environment; count];
        for (environment, seed) in environments.iter_mut().zip(0..) {
            environment.start_stream(seed);
        }
        Ok(Self {
            environments,
            episodes: vec![Episode::default(); count],
            records: vec![record; count],
            options,
            pool,
        })
    }

    /// Number of environments.
    #[must_use]
    pub fn len(&self) -> usize {
        self.environments.len()
    }

    /// Always false: a batch has at least one environment.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.environments.is_empty()
    }

    /// The settings of the batch.
    #[must_use]
    pub fn options(&self) -> &BatchOptions {
        &self.options
    }

    /// Environment `index`.
    #[must_use]
    pub fn environment(&self, index: usize) -> Option<&Environment> {
        self.environments.get(index)
    }

    /// What the last step or reset did, one record an environment.
    pub fn records(&self) -> impl Iterator<Item = &StepRecord> {
        self.records.iter()
    }

    /// Begins an episode in every environment that `mask` names (all without a mask), with
    /// `seeds[i]` where given, and writes its observation; the others are left as they are.
    ///
    /// # Errors
    /// [`AblationError::WrongLength`] when an array does not fit the batch.
    pub fn reset(
        &mut self,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        observations: &mut [u8],
    ) -> Result<(), AblationError> {
        let count = self.len();
        check_length("seeds", seeds.len(), count)?;
        check_length("reset_mask", mask.map_or(count, <[bool]>::len), count)?;
        let mode = self.options.observation;
        check_length("observations", observations.len(), count * mode.len())?;
        self.share_out(observations, &mut [], |mut share| share.reset(seeds, mask));
        Ok(())
    }

    /// Begins an episode with the given target in environment `index` and writes its observation;
    /// its random stream goes on.
    ///
    /// # Errors
    /// An index beyond the batch, observations of the wrong length, a target that is empty or full.
    /// Nothing has happened then.
    pub fn reset_to(
        &mut self,
        index: usize,
        target: &Bitmap,
        observations: &mut [u8],
    ) -> Result<(), AblationError> {
        let mode = self.options.observation;
        check_length("observations", observations.len(), self.len() * mode.len())?;
        let Some(environment) = self.environments.get_mut(index) else {
            return Err(AblationError::InvalidOption {
                name: "index",
                value: index.to_string(),
                expected: "below the number of environments",
            });
        };
        environment.reset_to(target)?;
        mode.write(environment, &mut observations[index * mode.len()..][..mode.len()]);
        self.episodes[index] = Episode { phase: Phase::Running, steps: 0 };
        self.records[index] = StepRecord::of_reset(environment.progress());
        Ok(())
    }

    /// Fires one pulse in every environment. `observations` holds what the last call wrote; only
    /// what changes is written. With [`Autoreset::SameStep`], `final_observations` receives the
    /// last observation of each finished episode; else it may be empty.
    ///
    /// # Errors
    /// An action that is not finite, an environment whose episode is over (only with
    /// [`Autoreset::Disabled`], or before the first reset), an array of the wrong length. Nothing
    /// has happened then.
    pub fn step(
        &mut self,
        actions: &[Action],
        observations: &mut [u8],
        final_observations: &mut [u8],
    ) -> Result<(), AblationError> {
        let BatchOptions { autoreset, observation: mode, .. } = self.options;
        let count = self.len();
        check_length("actions", actions.len(), count)?;
        check_length("observations", observations.len(), count * mode.len())?;
        let final_len = if autoreset == Autoreset::SameStep { count * mode.len() } else { 0 };
        check_length("final_observations", final_observations.len(), final_len)?;
        for (environment, (episode, &action)) in self.episodes.iter().zip(actions).enumerate() {
            match episode.phase {
                Phase::Running => check_finite(action, environment)?,
                Phase::Over if autoreset == Autoreset::NextStep => (),
                _ => return Err(AblationError::EpisodeOver { environment }),
            }
        }
        self.share_out(observations, final_observations, |mut share| share.step(actions));
        Ok(())
    }

    /// Calls `work` for shares that make up the batch, on the worker threads where there are
    /// several.
    fn share_out(
        &mut self,
        observations: &mut [u8],
        final_observations: &mut [u8],
        work: impl Fn(Share) + Sync,
    ) {
        let share = Share {
            options: self.options,
            first: 0,
            environments: &mut self.environments,
            episodes: &mut self.episodes,
            records: &mut self.records,
            observations,
            final_observations,
        };
        match &self.pool {
            None => work(share),
            Some(pool) => pool.install(|| share.divide(&work)),
        }
    }
}

fn check_length(name: &'static str, actual: usize, expected: usize) -> Result<(), AblationError> {
    if actual == expected {
        Ok(())
    } else {
        Err(AblationError::WrongLength { name, actual, expected })
    }
}
