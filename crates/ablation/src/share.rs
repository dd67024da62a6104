//! The part of a batch that one thread steps.

use crate::action::Action;
use crate::environment::Phase;
use crate::observation::{Eraser, Words};
use crate::{Autoreset, BatchOptions, Environment, EpisodeStatistics, Footprint, StepRecord};
use lasergym_geom::WORKPIECE_SIZE_PX;

/// Environments of a share that is not divided further.
const SMALLEST_SHARE: usize = 64;

/// Where an environment of a batch is in its episode.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Episode {
    pub(crate) phase: Phase,
    pub(crate) steps: u32,
}

/// Consecutive environments of a batch with what belongs to them.
#[derive(Debug)]
pub(crate) struct Share<'a> {
    pub(crate) options: BatchOptions,
    /// Index of the first environment in the batch.
    pub(crate) first: usize,
    pub(crate) environments: &'a mut [Environment],
    pub(crate) episodes: &'a mut [Episode],
    pub(crate) records: &'a mut [StepRecord],
    pub(crate) observations: &'a mut [u8],
    /// As long as `observations`, or empty where no final observations are kept.
    pub(crate) final_observations: &'a mut [u8],
}

impl Share<'_> {
    /// Halves the share again and again and calls `work` for the parts, on the worker threads.
    pub(crate) fn divide(self, work: &(impl Fn(Share) + Sync)) {
        let half = self.environments.len() / 2;
        if half < SMALLEST_SHARE {
            return work(self);
        }
        let len = half * self.options.observation.len();
        let final_len = len.min(self.final_observations.len());
        let environments = self.environments.split_at_mut(half);
        let episodes = self.episodes.split_at_mut(half);
        let records = self.records.split_at_mut(half);
        let observations = self.observations.split_at_mut(len);
        let final_observations = self.final_observations.split_at_mut(final_len);
        let left = Share {
            options: self.options,
            first: self.first,
            environments: environments.0,
            episodes: episodes.0,
            records: records.0,
            observations: observations.0,
            final_observations: final_observations.0,
        };
        let right = Share {
            options: self.options,
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

    /// Fires one pulse in every environment, or resets it. `actions` are those of the batch.
    pub(crate) fn step(&mut self, actions: &[Action]) {
        let BatchOptions { autoreset, observation: mode, .. } = self.options;
        let mut footprint = Footprint::EMPTY;
        let mut words: Words = [[0; 2]; WORKPIECE_SIZE_PX];
        for k in 0..self.environments.len() {
            if self.episodes[k].phase != Phase::Running {
                self.begin(k, None);
                self.records[k] = StepRecord::of_reset(self.environments[k].progress());
                continue;
            }
            footprint.set(self.environments[k].aim(actions[self.first + k]));
            self.land(k, &footprint, &mut words);
            if self.episodes[k].phase == Phase::Over && autoreset == Autoreset::SameStep {
                let observation = k * mode.len()..(k + 1) * mode.len();
                self.final_observations[observation.clone()]
                    .copy_from_slice(&self.observations[observation]);
                self.begin(k, None);
                self.records[k].progress = self.environments[k].progress();
            }
        }
    }

    /// Begins an episode in environment `k` and writes its observation.
    fn begin(&mut self, k: usize, seed: Option<u64>) {
        self.environments[k].reset(seed);
        self.episodes[k] = Episode { phase: Phase::Running, steps: 0 };
        let mode = self.options.observation;
        mode.write(&self.environments[k], &mut self.observations[k * mode.len()..][..mode.len()]);
    }

    /// Machines the footprint of the pulse that environment `k` has aimed, and writes what changed.
    #[inline]
    fn land(&mut self, k: usize, footprint: &Footprint, words: &mut Words) {
        let BatchOptions { observation: mode, max_episode_steps, .. } = self.options;
        let observation = &mut self.observations[k * mode.len()..][..mode.len()];
        let environment = &mut self.environments[k];
        let mut eraser = Eraser { mode, words, observation };
        let landing = environment.land(footprint, &mut eraser);
        mode.write_budget(environment, observation);
        let episode = &mut self.episodes[k];
        episode.steps += 1;
        let truncated = max_episode_steps.is_some_and(|limit| episode.steps >= limit);
        if truncated {
            environment.truncate();
        }
        let over = landing.terminated || truncated;
        if over {
            episode.phase = Phase::Over;
        }
        let progress = environment.progress();
        self.records[k] = StepRecord {
            reward: landing.reward,
            terminated: landing.terminated,
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
