//! Many environments stepped together, on one thread or several.

use crate::batched::Batched;
use crate::share::{Episode, Share};
use crate::{Autoreset, BatchError, BatchOptions, Phase, StepRecord};

/// Environments that step together.
#[derive(Debug)]
pub struct Batch<E: Batched> {
    environments: Vec<E>,
    episodes: Vec<Episode>,
    records: Vec<StepRecord<E::Progress>>,
    options: BatchOptions<E::Mode>,
    /// Bytes of one observation.
    observation_len: usize,
    pool: Option<rayon::ThreadPool>,
}

impl<E: Batched> Batch<E> {
    /// Copies of `environment` before their first reset; copy `i` has the random stream of seed `i`.
    ///
    /// # Errors
    /// An option outside its range, threads that do not start.
    pub fn new(environment: E, options: BatchOptions<E::Mode>) -> Result<Self, E::Error> {
        options.validate()?;
        let observation_len = environment.observation_len(options.observation);
        let record = StepRecord::of_reset(environment.progress());
        let threads = options.threads;
        let pool = (threads > 1)
            .then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build())
            .transpose()
            .map_err(|error| BatchError::Threads { threads, reason: error.to_string() })?;
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
            observation_len,
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
    pub fn options(&self) -> &BatchOptions<E::Mode> {
        &self.options
    }

    /// Environment `index`.
    #[must_use]
    pub fn environment(&self, index: usize) -> Option<&E> {
        self.environments.get(index)
    }

    /// What the last step or reset did, one record an environment.
    pub fn records(&self) -> impl Iterator<Item = &StepRecord<E::Progress>> {
        self.records.iter()
    }

    /// Begins an episode in every environment that `mask` names (all without a mask), with
    /// `seeds[i]` where given, and writes its observation; the others are left as they are.
    ///
    /// # Errors
    /// [`BatchError::WrongLength`] when an array does not fit the batch.
    pub fn reset(
        &mut self,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        observations: &mut [u8],
    ) -> Result<(), E::Error> {
        let count = self.len();
        check_length("seeds", seeds.len(), count)?;
        check_length("reset_mask", mask.map_or(count, <[bool]>::len), count)?;
        check_length("observations", observations.len(), count * self.observation_len)?;
        self.share_out(observations, &mut [], |mut share| share.reset(seeds, mask));
        Ok(())
    }

    /// Begins an episode with the given target in environment `index` and writes its observation;
    /// its random stream goes on.
    ///
    /// # Errors
    /// An index beyond the batch, observations of the wrong length, a target that cannot be machined.
    /// Nothing has happened then.
    pub fn reset_to(
        &mut self,
        index: usize,
        target: &E::Target,
        observations: &mut [u8],
    ) -> Result<(), E::Error> {
        let length = self.observation_len;
        check_length("observations", observations.len(), self.len() * length)?;
        let Some(environment) = self.environments.get_mut(index) else {
            return Err(BatchError::InvalidOption {
                name: "index",
                value: index.to_string(),
                expected: "below the number of environments",
            }
            .into());
        };
        environment.begin_with(target)?;
        let observation = &mut observations[index * length..][..length];
        environment.write_observation(self.options.observation, observation);
        self.episodes[index] = Episode { phase: Phase::Running, steps: 0 };
        self.records[index] = StepRecord::of_reset(environment.progress());
        Ok(())
    }

    /// Does one step in every environment. `observations` holds what the last call wrote; only
    /// what changes is written. With [`Autoreset::SameStep`], `final_observations` receives the
    /// last observation of each finished episode; else it may be empty.
    ///
    /// # Errors
    /// An action that is not finite, an environment whose episode is over (only with
    /// [`Autoreset::Disabled`], or before the first reset), an array of the wrong length. Nothing
    /// has happened then.
    pub fn step(
        &mut self,
        actions: &[E::Action],
        observations: &mut [u8],
        final_observations: &mut [u8],
    ) -> Result<(), E::Error> {
        let autoreset = self.options.autoreset;
        let count = self.len();
        let all_len = count * self.observation_len;
        check_length("actions", actions.len(), count)?;
        check_length("observations", observations.len(), all_len)?;
        let final_len = if autoreset == Autoreset::SameStep { all_len } else { 0 };
        check_length("final_observations", final_observations.len(), final_len)?;
        for (environment, (episode, &action)) in self.episodes.iter().zip(actions).enumerate() {
            match episode.phase {
                Phase::Running => E::check_action(action, environment)?,
                Phase::Over if autoreset == Autoreset::NextStep => (),
                _ => return Err(BatchError::EpisodeOver { environment }.into()),
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
        work: impl Fn(Share<E>) + Sync,
    ) {
        let share = Share {
            options: self.options,
            observation_len: self.observation_len,
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

fn check_length(name: &'static str, actual: usize, expected: usize) -> Result<(), BatchError> {
    if actual == expected {
        Ok(())
    } else {
        Err(BatchError::WrongLength { name, actual, expected })
    }
}
