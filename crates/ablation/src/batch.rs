//! Many environments stepped together, on one thread or several.

use rayon::prelude::*;

use crate::action::Action;
use crate::{AblationError, Environment, ObservationMode, Options, Progress, Task};

/// Environments that one task of a worker thread steps at least.
const MIN_ENVIRONMENTS_PER_TASK: usize = 64;

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

/// One environment of a batch.
#[derive(Debug, Clone)]
struct Slot {
    environment: Environment,
    steps: u32,
    over: bool,
    record: StepRecord,
}

/// Environments of one task that step together.
#[derive(Debug)]
pub struct Batch {
    slots: Vec<Slot>,
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
        let slot = Slot {
            record: StepRecord {
                reward: 0.0,
                terminated: false,
                truncated: false,
                progress: Progress { machined_fraction: 0.0, off_target_fraction: 0.0, pulses: 0 },
                finished: None,
            },
            environment: Environment::new(task, process)?,
            steps: 0,
            over: false,
        };
        let threads = options.threads;
        let pool = (threads > 1)
            .then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build())
            .transpose()
            .map_err(|error| AblationError::Threads { threads, reason: error.to_string() })?;
        Ok(Self { slots: vec![slot; options.environments], options, pool })
    }

    /// Number of environments.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Always false: a batch has at least one environment.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// The settings of the batch.
    #[must_use]
    pub fn options(&self) -> &BatchOptions {
        &self.options
    }

    /// Environment `index`.
    #[must_use]
    pub fn environment(&self, index: usize) -> Option<&Environment> {
        self.slots.get(index).map(|slot| &slot.environment)
    }

    /// What the last step or reset did, one record an environment.
    pub fn records(&self) -> impl Iterator<Item = &StepRecord> {
        self.slots.iter().map(|slot| &slot.record)
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
        let count = self.slots.len();
        check_length("seeds", seeds.len(), count)?;
        check_length("reset_mask", mask.map_or(count, <[bool]>::len), count)?;
        let mode = self.options.observation;
        check_length("observations", observations.len(), count * mode.len())?;
        self.for_each(observations, &mut [], |index, slot, observation, _| {
            if mask.is_none_or(|mask| mask[index]) {
                slot.begin(seeds[index], mode, observation);
                slot.record = slot.blank_record();
            }
        });
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
        let BatchOptions { autoreset, observation: mode, max_episode_steps, .. } = self.options;
        let count = self.slots.len();
        check_length("actions", actions.len(), count)?;
        check_length("observations", observations.len(), count * mode.len())?;
        let final_len = if autoreset == Autoreset::SameStep { count * mode.len() } else { 0 };
        check_length("final_observations", final_observations.len(), final_len)?;
        for (index, (slot, &action)) in self.slots.iter().zip(actions).enumerate() {
            if !(slot.over && autoreset == Autoreset::NextStep) {
                slot.environment.check(action, index)?;
            }
        }
        self.for_each(observations, final_observations, |index, slot, observation, last| {
            if slot.over && autoreset == Autoreset::NextStep {
                slot.begin(None, mode, observation);
                slot.record = slot.blank_record();
                return;
            }
            slot.step(actions[index], mode, max_episode_steps, observation);
            if slot.over && autoreset == Autoreset::SameStep {
                last.copy_from_slice(observation);
                slot.begin(None, mode, observation);
                slot.record.progress = slot.environment.progress();
            }
        });
        Ok(())
    }

    /// Calls `work(index, slot, observation, final observation)` for every environment, on the
    /// worker threads where there are several. Final observations are empty slices where none are kept.
    fn for_each(
        &mut self,
        observations: &mut [u8],
        final_observations: &mut [u8],
        work: impl Fn(usize, &mut Slot, &mut [u8], &mut [u8]) + Sync,
    ) {
        let len = self.options.observation.len();
        let slots = &mut self.slots;
        match &self.pool {
            None => {
                let mut finals = final_observations.chunks_exact_mut(len);
                for (index, (slot, observation)) in
                    slots.iter_mut().zip(observations.chunks_exact_mut(len)).enumerate()
                {
                    work(index, slot, observation, finals.next().unwrap_or_default());
                }
            }
            Some(pool) => {
                let step = MIN_ENVIRONMENTS_PER_TASK;
                let final_step = if final_observations.is_empty() { 0 } else { len };
                let mut rest = final_observations;
                let finals: Vec<&mut [u8]> = slots
                    .chunks(step)
                    .map(|chunk| {
                        let (head, tail) =
                            std::mem::take(&mut rest).split_at_mut(chunk.len() * final_step);
                        rest = tail;
                        head
                    })
                    .collect();
                pool.install(|| {
                    slots
                        .par_chunks_mut(step)
                        .zip(observations.par_chunks_mut(step * len))
                        .zip(finals)
                        .enumerate()
                        .for_each(|(chunk, ((slots, observations), finals))| {
                            let mut finals = finals.chunks_exact_mut(len);
                            for (k, (slot, observation)) in
                                slots.iter_mut().zip(observations.chunks_exact_mut(len)).enumerate()
                            {
                                let last = finals.next().unwrap_or_default();
                                work(chunk * step + k, slot, observation, last);
                            }
                        });
                });
            }
        }
    }
}

impl Slot {
    /// Begins an episode and writes its observation.
    fn begin(&mut self, seed: Option<u64>, mode: ObservationMode, observation: &mut [u8]) {
        self.environment.reset(seed);
        self.steps = 0;
        self.over = false;
        mode.write(&self.environment, observation);
    }

    /// The record of a step that only reset.
    fn blank_record(&self) -> StepRecord {
        StepRecord {
            reward: 0.0,
            terminated: false,
            truncated: false,
            progress: self.environment.progress(),
            finished: None,
        }
    }

    /// Fires one pulse and writes what changed.
    #[inline]
    fn step(
        &mut self,
        action: Action,
        mode: ObservationMode,
        max_episode_steps: Option<u32>,
        observation: &mut [u8],
    ) {
        let step = self
            .environment
            .fire(action, |row, hits, misses| mode.erase(row, hits, misses, observation));
        mode.write_budget(&self.environment, observation);
        self.steps += 1;
        let truncated = max_episode_steps.is_some_and(|limit| self.steps >= limit);
        if truncated {
            self.environment.truncate();
        }
        self.over = step.terminated || truncated;
        let progress = self.environment.progress();
        self.record = StepRecord {
            reward: step.reward,
            terminated: step.terminated,
            truncated,
            progress,
            finished: self.over.then(|| EpisodeStatistics {
                episode_return: self.environment.episode_return(),
                length: self.steps,
                progress,
                is_success: self.environment.is_success(),
            }),
        };
    }
}

fn check_length(name: &'static str, actual: usize, expected: usize) -> Result<(), AblationError> {
    if actual == expected {
        Ok(())
    } else {
        Err(AblationError::WrongLength { name, actual, expected })
    }
}
