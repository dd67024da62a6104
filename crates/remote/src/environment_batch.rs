//! Many environments stepped together.

use crate::{RandomLayout, RemoteError, ScanAction, ScanEnvironment, ScanProgress};

/// What happens when an episode ends, as in `gymnasium.vector.AutoresetMode`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ScanAutoreset {
    /// The step after the last ignores its action and resets.
    #[default]
    NextStep,
    /// The last step resets at once; the final observation is stored beside the new one.
    SameStep,
    /// The caller resets.
    Disabled,
}

/// What one step did to one environment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScanRecord {
    /// Reward of the step; 0 in a step that resets.
    pub reward: f64,
    /// Whether the process ended the episode.
    pub terminated: bool,
    /// Whether the limit of steps ended it.
    pub truncated: bool,
    /// How far the episode has come that the observation shows.
    pub progress: ScanProgress,
    /// The episode that this step finished: its progress, return and length.
    pub finished: Option<(ScanProgress, f64, u32)>,
}

/// Environments of one kind of layout that step together.
#[derive(Debug, Clone)]
pub struct ScanBatch {
    environments: Vec<ScanEnvironment>,
    records: Vec<ScanRecord>,
    returns: Vec<(f64, u32)>,
    truncated: Vec<bool>,
    autoreset: ScanAutoreset,
    max_episode_steps: Option<u32>,
}

impl ScanBatch {
    /// `count` environments before their first reset; `max_episode_steps` truncates episodes.
    ///
    /// # Errors
    /// As [`ScanEnvironment::new`].
    pub fn new(
        layout: RandomLayout,
        count: usize,
        autoreset: ScanAutoreset,
        max_episode_steps: Option<u32>,
    ) -> Result<Self, RemoteError> {
        let environment = ScanEnvironment::new(layout)?;
        Ok(Self {
            environments: vec![environment; count],
            records: vec![ScanRecord::default(); count],
            returns: vec![(0.0, 0); count],
            truncated: vec![false; count],
            autoreset,
            max_episode_steps,
        })
    }

    /// What the last step or reset did.
    #[must_use]
    pub fn records(&self) -> &[ScanRecord] {
        &self.records
    }

    /// The environments.
    #[must_use]
    pub fn environments(&self) -> &[ScanEnvironment] {
        &self.environments
    }

    /// Begins an episode in every environment that `mask` names (all without one), with `seeds[i]`
    /// where given, and writes its observation.
    ///
    /// # Errors
    /// [`RemoteError::WrongLength`].
    pub fn reset(
        &mut self,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        observations: &mut [f32],
    ) -> Result<(), RemoteError> {
        let count = self.environments.len();
        check_length("seeds", seeds.len(), count)?;
        check_length("reset_mask", mask.map_or(count, <[bool]>::len), count)?;
        let len = self.environments[0].observation_len();
        check_length("observations", observations.len(), count * len)?;
        for (index, observation) in observations.chunks_exact_mut(len).enumerate() {
            if mask.is_none_or(|mask| mask[index]) {
                self.begin(index, seeds[index])?;
                self.records[index] = ScanRecord {
                    progress: self.environments[index].progress(),
                    ..ScanRecord::default()
                };
                self.environments[index].observe(observation)?;
            }
        }
        Ok(())
    }

    /// Steps every environment and writes its observation; with [`ScanAutoreset::SameStep`]
    /// `final_observations` receives the last observation of each finished episode.
    ///
    /// # Errors
    /// An action out of range, an episode that is over with nobody to reset it, an array of the wrong
    /// length. Nothing has happened then.
    pub fn step(
        &mut self,
        actions: &[[i64; 2]],
        observations: &mut [f32],
        final_observations: &mut [f32],
    ) -> Result<(), RemoteError> {
        let count = self.environments.len();
        let len = self.environments[0].observation_len();
        check_length("actions", actions.len(), count)?;
        check_length("observations", observations.len(), count * len)?;
        let same_step = self.autoreset == ScanAutoreset::SameStep;
        let final_len = if same_step { count * len } else { 0 };
        check_length("final_observations", final_observations.len(), final_len)?;
        let mut checked: Vec<Option<ScanAction>> = Vec::with_capacity(count);
        for (index, environment) in self.environments.iter().enumerate() {
            let over = environment.is_over() || self.truncated[index];
            checked.push(match (over, self.autoreset) {
                (false, _) => Some(environment.action(actions[index])?),
                (true, ScanAutoreset::NextStep) if self.returns[index].1 > 0 => None,
                (true, _) => return Err(RemoteError::EpisodeOver { environment: index }),
            });
        }
        for (index, action) in checked.into_iter().enumerate() {
            let observation = &mut observations[index * len..][..len];
            let Some(action) = action else {
                self.begin(index, None)?;
                let progress = self.environments[index].progress();
                self.records[index] = ScanRecord { progress, ..ScanRecord::default() };
                self.environments[index].observe(observation)?;
                continue;
            };
            self.play(index, action)?;
            if self.records[index].finished.is_some() && same_step {
                let last = &mut final_observations[index * len..][..len];
                self.environments[index].observe(last)?;
                self.begin(index, None)?;
                self.records[index].progress = self.environments[index].progress();
            }
            self.environments[index].observe(observation)?;
        }
        Ok(())
    }

    fn play(&mut self, index: usize, action: ScanAction) -> Result<(), RemoteError> {
        let environment = &mut self.environments[index];
        let step = environment.step(action)?;
        let progress = environment.progress();
        let (episode_return, length) = &mut self.returns[index];
        *episode_return += step.reward;
        *length += 1;
        let truncated =
            !step.terminated && self.max_episode_steps.is_some_and(|limit| *length >= limit);
        self.truncated[index] = truncated;
        self.records[index] = ScanRecord {
            reward: step.reward,
            terminated: step.terminated,
            truncated,
            progress,
            finished: (step.terminated || truncated).then_some((
                progress,
                *episode_return,
                *length,
            )),
        };
        Ok(())
    }

    fn begin(&mut self, index: usize, seed: Option<u64>) -> Result<(), RemoteError> {
        self.returns[index] = (0.0, 0);
        self.truncated[index] = false;
        self.environments[index].reset(seed)
    }
}

fn check_length(name: &'static str, actual: usize, expected: usize) -> Result<(), RemoteError> {
    if actual == expected {
        Ok(())
    } else {
        Err(RemoteError::WrongLength { name, actual, expected })
    }
}
