//! The part of a batch that one thread steps.

use crate::batched::{Batched, Landing};
use crate::{Autoreset, BatchOptions, EpisodeStatistics, Phase, StepRecord};

/// Environments of a share that is not divided further.
const SMALLEST_SHARE: usize = 64;

/// Where an environment of a batch is in its episode.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Episode {
    pub(crate) phase: Phase,
    pub(crate) steps: u32,
}

/// Consecutive environments of a batch with what belongs to them.
pub(crate) struct Share<'a, E: Batched> {
    pub(crate) options: BatchOptions<E::Mode>,
    /// Bytes of one observation.
    pub(crate) observation_len: usize,
    /// Index of the first environment in the batch.
    pub(crate) first: usize,
    pub(crate) environments: &'a mut [E],
    pub(crate) episodes: &'a mut [Episode],
    pub(crate) records: &'a mut [StepRecord<E::Progress>],
    pub(crate) observations: &'a mut [u8],
    /// As long as `observations`, or empty where no final observations are kept.
    pub(crate) final_observations: &'a mut [u8],
}

impl<E: Batched> Share<'_, E> {
    /// Halves the share again and again and calls `work` for the parts, on the worker threads.
    pub(crate) fn divide(self, work: &(impl Fn(Share<E>) + Sync)) {
        let half = self.environments.len() / 2;
        if half < SMALLEST_SHARE {
            return work(self);
        }
        let len = half * self.observation_len;
        let final_len = len.min(self.final_observations.len());
        let environments = self.environments.split_at_mut(half);
        let episodes = self.episodes.split_at_mut(half);
        let records = self.records.split_at_mut(half);
        let observations = self.observations.split_at_mut(len);
        let final_observations = self.final_observations.split_at_mut(final_len);
        let left = Share {
            options: self.options,
            observation_len: self.observation_len,
            first: self.first,
            environments: environments.0,
            episodes: episodes.0,
            records: records.0,
            observations: observations.0,
            final_observations: final_observations.0,
        };
        let right = Share {
            options: self.options,
            observation_len: self.observation_len,
            first: self.first + half,
            environments: environments.1,
            episodes: episodes.1,
            records: records.1,
            observations: observations.1,
            final_observations: final_observations.1,
        };
        rayon::join(|| left.divide(work), || right.divide(work));
    }

    /// Begins an episode in every environment that `mask` names. `seeds` and `mask` are those of
    /// the batch.
    pub(crate) fn reset(&mut self, seeds: &[Option<u64>], mask: Option<&[bool]>) {
        for k in 0..self.environments.len() {
            if mask.is_none_or(|mask| mask[self.first + k]) {
                self.begin(k, seeds[self.first + k]);
                self.records[k] = StepRecord::of_reset(self.environments[k].progress());
            }
        }
    }

    /// Does one step in every environment, or resets it. `actions` are those of the batch.
    pub(crate) fn step(&mut self, actions: &[E::Action]) {
        let Some(first) = self.environments.first() else { return };
        let mut scratch = first.scratch();
        for k in 0..self.environments.len() {
            if self.episodes[k].phase != Phase::Running {
                self.begin(k, None);
                self.records[k] = StepRecord::of_reset(self.environments[k].progress());
                continue;
            }
            self.act(k, actions[self.first + k], &mut scratch);
            if self.episodes[k].phase == Phase::Over
                && self.options.autoreset == Autoreset::SameStep
            {
                let observation = k * self.observation_len..(k + 1) * self.observation_len;
                self.final_observations[observation.clone()]
                    .copy_from_slice(&self.observations[observation]);
                self.begin(k, None);
                self.records[k].progress = self.environments[k].progress();
            }
        }
    }

    /// Begins an episode in environment `k` and writes its observation.
    fn begin(&mut self, k: usize, seed: Option<u64>) {
        self.environments[k].begin(seed);
        self.episodes[k] = Episode { phase: Phase::Running, steps: 0 };
        let observation =
            &mut self.observations[k * self.observation_len..][..self.observation_len];
        self.environments[k].write_observation(self.options.observation, observation);
    }

    /// Does one step in environment `k` and writes what changed.
    #[inline]
    fn act(&mut self, k: usize, action: E::Action, scratch: &mut E::Scratch) {
        let BatchOptions { observation: mode, max_episode_steps, .. } = self.options;
        let observation =
            &mut self.observations[k * self.observation_len..][..self.observation_len];
        let environment = &mut self.environments[k];
        let Landing { reward, terminated } = environment.act(action, mode, observation, scratch);
        let episode = &mut self.episodes[k];
        episode.steps += 1;
        let truncated = max_episode_steps.is_some_and(|limit| episode.steps >= limit);
        if truncated {
            environment.truncate();
        }
        let over = terminated || truncated;
        if over {
            episode.phase = Phase::Over;
        }
        let progress = environment.progress();
        self.records[k] = StepRecord {
            reward,
            terminated,
            truncated,
            progress,
            finished: over.then(|| EpisodeStatistics {
                episode_return: environment.episode_return(),
                length: episode.steps,
                progress,
                is_success: environment.is_success(),
            }),
        };
    }
}
