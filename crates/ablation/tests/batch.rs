//! A batch is its environments, one by one; and it touches nothing else.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a helper that fails fails its test")]

use lasergym_ablation::{
    AblationError, Action, Autoreset, Batch, BatchOptions, Environment, EpisodeStatistics,
    ObservationMode, Options, StepRecord, Stream, Task, Workpiece, star,
};
use lasergym_geom::{Bitmap, WORKPIECE_SIZE_PX};
use proptest::prelude::*;

const CHANNEL_LEN: usize = WORKPIECE_SIZE_PX * WORKPIECE_SIZE_PX;

/// A byte that no observation holds where pixels can change.
const SENTINEL: u8 = 77;

fn task() -> impl Strategy<Value = Task> {
    prop_oneof![
        Just(Task::Star),
        Just(Task::RotatedStar),
        Just(Task::RandomShape),
        Just(Task::Pattern(Box::new(star(17.0)))),
    ]
}

fn mode() -> impl Strategy<Value = ObservationMode> {
    prop_oneof![Just(ObservationMode::Remaining), Just(ObservationMode::Layers)]
}

prop_compose! {
    fn process()(
        pulse_radius_px in prop_oneof![3 => Just(9.0), 1 => 0.5..50.0],
        max_pulses in 1_u32..12,
        completion in prop_oneof![Just(0.99), 0.05..0.5],
        pointing_error_px in prop_oneof![Just(0.0), 0.0..4.0],
        radius_error in prop_oneof![Just(0.0), 0.0..0.3],
        stop_on_miss: bool,
    ) -> Options {
        Options {
            pulse_radius_px, max_pulses, completion, pointing_error_px, radius_error, stop_on_miss,
        }
    }
}

prop_compose! {
    fn batch_options()(
        // Batches of 128 and more are divided among threads.
        environments in prop_oneof![1_usize..20, 120_usize..300],
        autoreset in prop_oneof![
            Just(Autoreset::NextStep), Just(Autoreset::SameStep), Just(Autoreset::Disabled),
        ],
        observation in mode(),
        max_episode_steps in proptest::option::of(1_u32..10),
        threads in 1_usize..=4,
    ) -> BatchOptions {
        BatchOptions { environments, autoreset, observation, max_episode_steps, threads }
    }
}

/// Actions a little beyond the workpiece, a third of them on a lattice.
fn actions(stream: &mut Stream, count: usize) -> Vec<Action> {
    (0..count)
        .map(|k| {
            std::array::from_fn(|_| {
                let u = 2.2 * stream.uniform() - 1.1;
                if k % 3 == 0 { (u * 100.0).round() as f32 / 100.0 } else { u as f32 }
            })
        })
        .collect()
}

fn observed(environment: &Environment, mode: ObservationMode) -> Vec<u8> {
    let mut observation = vec![SENTINEL; mode.len()];
    mode.write(environment, &mut observation);
    observation
}

/// One environment of a batch, stepped by itself.
struct Single {
    environment: Environment,
    steps: u32,
    over: bool,
}

impl Single {
    /// What a step of the batch has to record, and the final observation where one is to be kept.
    fn step(&mut self, action: Action, options: &BatchOptions) -> (StepRecord, Option<Vec<u8>>) {
        if self.over && options.autoreset == Autoreset::NextStep {
            self.reset(None);
            let progress = self.environment.progress();
            let record = StepRecord {
                reward: 0.0,
                terminated: false,
                truncated: false,
                progress,
                finished: None,
            };
            return (record, None);
        }
        let step = self.environment.step(action).unwrap();
        self.steps += 1;
        let truncated = options.max_episode_steps == Some(self.steps);
        self.over = step.terminated || truncated;
        let mut record = StepRecord {
            reward: step.reward,
            terminated: step.terminated,
            truncated,
            progress: self.environment.progress(),
            finished: self.over.then(|| EpisodeStatistics {
                episode_return: self.environment.episode_return(),
                length: self.steps,
                progress: self.environment.progress(),
                is_success: self.environment.is_success(),
            }),
        };
        let mut last = None;
        if self.over && options.autoreset == Autoreset::SameStep {
            last = Some(observed(&self.environment, options.observation));
            self.reset(None);
            record.progress = self.environment.progress();
        }
        (record, last)
    }

    fn reset(&mut self, seed: Option<u64>) {
        self.environment.reset(seed);
        (self.steps, self.over) = (0, false);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_batch_equals_its_environments(
        task in task(),
        process in process(),
        options in batch_options(),
        seed: u64,
    ) {
        let (count, mode) = (options.environments, options.observation);
        let mut batch = Batch::new(Environment::new(task.clone(), process).unwrap(), options).unwrap();
        let mut observations = vec![SENTINEL; count * mode.len()];
        let kept = options.autoreset == Autoreset::SameStep;
        let mut finals = vec![SENTINEL; if kept { count * mode.len() } else { 0 }];
        let seeds: Vec<_> = (0..count as u64).map(|k| Some(seed.wrapping_add(k))).collect();
        batch.reset(&seeds, None, &mut observations).unwrap();
        let mut singles: Vec<_> = seeds
            .iter()
            .map(|&seed| {
                let environment = Environment::new(task.clone(), process).unwrap();
                let mut single = Single { environment, steps: 0, over: false };
                single.reset(seed);
                single
            })
            .collect();
        let mut stream = Stream::from_seed(seed);
        for round in 0..30 {
            if options.autoreset == Autoreset::Disabled && singles.iter().any(|single| single.over) {
                let mask: Vec<_> = singles.iter().map(|single| single.over).collect();
                let seeds: Vec<_> = (0..count as u64).map(|k| (k % 2 == 0).then_some(k)).collect();
                batch.reset(&seeds, Some(&mask), &mut observations).unwrap();
                for (single, seed) in singles.iter_mut().zip(seeds) {
                    if single.over {
                        single.reset(seed);
                    }
                }
            }
            let actions = actions(&mut stream, count);
            finals.fill(SENTINEL);
            batch.step(&actions, &mut observations, &mut finals).unwrap();
            for (k, (single, record)) in singles.iter_mut().zip(batch.records()).enumerate() {
                let (expected, last) = single.step(actions[k], &options);
                prop_assert_eq!(record, &expected, "environment {} in round {}", k, round);
                prop_assert_eq!(
                    batch.environment(k).unwrap().workpiece(),
                    single.environment.workpiece()
                );
                let part = k * mode.len()..(k + 1) * mode.len();
                prop_assert!(
                    observations[part.clone()] == observed(&single.environment, mode),
                    "observation of environment {} in round {}", k, round
                );
                if kept {
                    let expected = last.unwrap_or_else(|| vec![SENTINEL; mode.len()]);
                    prop_assert!(finals[part] == expected, "final observation of {}", k);
                }
            }
        }
    }

    /// Only the pixels that a pulse machines are written, whatever the buffer holds.
    #[test]
    fn only_changed_pixels_are_written(
        task in task(),
        mode in mode(),
        radius_px in prop_oneof![Just(9.0), 0.5..50.0],
        seed: u64,
    ) {
        let options = BatchOptions {
            environments: 10,
            autoreset: Autoreset::NextStep,
            observation: mode,
            max_episode_steps: None,
            threads: 1,
        };
        let process = Options { pulse_radius_px: radius_px, completion: 1.0, ..Options::default() };
        let mut batch = Batch::new(Environment::new(task, process).unwrap(), options).unwrap();
        let mut observations = vec![0; 10 * mode.len()];
        batch.reset(&[Some(seed); 10], None, &mut observations).unwrap();
        let mut stream = Stream::from_seed(seed);
        for _ in 0..20 {
            let before: Vec<Workpiece> =
                (0..10).map(|k| batch.environment(k).unwrap().workpiece().clone()).collect();
            observations.fill(SENTINEL);
            batch.step(&actions(&mut stream, 10), &mut observations, &mut []).unwrap();
            if batch.records().any(|record| record.terminated) {
                break;
            }
            for (k, before) in before.iter().enumerate() {
                let after = batch.environment(k).unwrap().workpiece();
                let channels: Vec<_> =
                    observations[k * mode.len()..][..mode.len()].chunks(CHANNEL_LEN).collect();
                prop_assert!(channels[0] == erased(before.remaining(), after.remaining()));
                if mode == ObservationMode::Layers {
                    prop_assert!(channels[1] == erased(before.forbidden(), after.forbidden()));
                    prop_assert!(channels[2].iter().all(|&level| level == channels[2][0]));
                }
            }
        }
    }
}

/// Sentinels, and 0 where a pixel has gone.
fn erased(before: &Bitmap, after: &Bitmap) -> Vec<u8> {
    let mut channel = vec![SENTINEL; CHANNEL_LEN];
    for (row, column) in before.pixels().filter(|&(row, column)| !after.contains(row, column)) {
        channel[row * WORKPIECE_SIZE_PX + column] = 0;
    }
    channel
}

/// All that a caller can see of a batch.
fn state(batch: &Batch) -> (Vec<StepRecord>, Vec<Workpiece>, Vec<u32>) {
    let environments = || (0..batch.len()).filter_map(|k| batch.environment(k));
    (
        batch.records().copied().collect(),
        environments().map(|environment| environment.workpiece().clone()).collect(),
        environments().map(Environment::pulses_left).collect(),
    )
}

fn batch_of_three(autoreset: Autoreset) -> (Batch, Vec<u8>) {
    let options = BatchOptions {
        environments: 3,
        autoreset,
        observation: ObservationMode::Remaining,
        max_episode_steps: None,
        threads: 1,
    };
    let process = Options { max_pulses: 2, ..Options::default() };
    (
        Batch::new(Environment::new(Task::Star, process).unwrap(), options).unwrap(),
        vec![0; 3 * CHANNEL_LEN],
    )
}

#[test]
fn errors_leave_everything_as_it_was() {
    let (mut batch, mut observations) = batch_of_three(Autoreset::Disabled);
    let before_reset = batch.step(&[[0.0; 2]; 3], &mut observations, &mut []);
    assert_eq!(before_reset, Err(AblationError::EpisodeOver { environment: 0 }));
    batch.reset(&[None; 3], None, &mut observations).unwrap();
    batch.step(&[[0.0; 2]; 3], &mut observations, &mut []).unwrap();
    let (expected, shown) = (state(&batch), observations.clone());
    let wrong_length =
        |name, actual, expected| AblationError::WrongLength { name, actual, expected };

    let results = [
        batch.step(&[[0.5; 2]; 2], &mut observations, &mut []),
        batch.step(&[[0.5; 2]; 3], &mut observations[1..], &mut []),
        batch.step(&[[0.5; 2]; 3], &mut observations, &mut [0; 10]),
        batch.reset(&[None; 2], None, &mut observations),
        batch.reset(&[None; 3], Some(&[true]), &mut observations),
        batch.reset(&[None; 3], None, &mut observations[..CHANNEL_LEN]),
    ];
    let errors = [
        wrong_length("actions", 2, 3),
        wrong_length("observations", 3 * CHANNEL_LEN - 1, 3 * CHANNEL_LEN),
        wrong_length("final_observations", 10, 0),
        wrong_length("seeds", 2, 3),
        wrong_length("reset_mask", 1, 3),
        wrong_length("observations", CHANNEL_LEN, 3 * CHANNEL_LEN),
    ];
    assert_eq!(results, errors.map(Err));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let actions = [[0.5, 0.5], [0.5, 0.5], [0.5, bad]];
        let result = batch.step(&actions, &mut observations, &mut []);
        assert!(matches!(result, Err(AblationError::ActionNotFinite { environment: 2, .. })));
    }
    assert_eq!(state(&batch), expected);
    assert!(observations == shown);

    // One episode runs on, two are over.
    batch.step(&[[0.0; 2]; 3], &mut observations, &mut []).unwrap();
    batch.reset(&[None; 3], Some(&[true, false, false]), &mut observations).unwrap();
    let (expected, shown) = (state(&batch), observations.clone());
    let over = batch.step(&[[0.5; 2]; 3], &mut observations, &mut []);
    assert_eq!(over, Err(AblationError::EpisodeOver { environment: 1 }));
    assert_eq!(state(&batch), expected);
    assert!(observations == shown);
}

#[test]
fn final_observations_are_needed_when_episodes_reset_at_once() {
    let (mut batch, mut observations) = batch_of_three(Autoreset::SameStep);
    batch.reset(&[None; 3], None, &mut observations).unwrap();
    let missing = batch.step(&[[0.0; 2]; 3], &mut observations, &mut []);
    let (actual, expected) = (0, 3 * CHANNEL_LEN);
    let name = "final_observations";
    assert_eq!(missing, Err(AblationError::WrongLength { name, actual, expected }));
}

#[test]
fn the_action_of_a_step_that_resets_is_not_looked_at() {
    let (mut batch, mut observations) = batch_of_three(Autoreset::NextStep);
    batch.reset(&[None; 3], None, &mut observations).unwrap();
    for _ in 0..2 {
        batch.step(&[[0.0; 2]; 3], &mut observations, &mut []).unwrap();
    }
    assert!(batch.records().all(|record| record.terminated));
    batch.step(&[[f32::NAN; 2]; 3], &mut observations, &mut []).unwrap();
    assert!(batch.records().all(|record| !record.terminated && record.progress.pulses == 0));
}

#[test]
fn without_seeds_the_streams_are_those_of_the_indices() {
    let options = BatchOptions {
        environments: 5,
        autoreset: Autoreset::NextStep,
        observation: ObservationMode::Remaining,
        max_episode_steps: None,
        threads: 1,
    };
    let reset = |seeds: [Option<u64>; 5]| {
        let mut batch =
            Batch::new(Environment::new(Task::RandomShape, Options::default()).unwrap(), options)
                .unwrap();
        let mut observations = vec![0; 5 * CHANNEL_LEN];
        batch.reset(&seeds, None, &mut observations).unwrap();
        observations
    };
    assert!(reset([None; 5]) == reset([0, 1, 2, 3, 4].map(Some)));
}

#[test]
fn options_outside_their_range_are_named() {
    let valid = *batch_of_three(Autoreset::NextStep).0.options();
    for (options, expected) in [
        (BatchOptions { environments: 0, ..valid }, "num_envs"),
        (BatchOptions { threads: 0, ..valid }, "threads"),
        (BatchOptions { max_episode_steps: Some(0), ..valid }, "max_episode_steps"),
    ] {
        let environment = Environment::new(Task::Star, Options::default()).unwrap();
        match Batch::new(environment, options) {
            Err(AblationError::InvalidOption { name, .. }) => assert_eq!(name, expected),
            other => panic!("{other:?}"),
        }
    }
}

/// 65 536 environments with their records and observations take less than 1 GB.
#[test]
fn environments_are_small() {
    let bytes =
        size_of::<Environment>() + size_of::<StepRecord>() + ObservationMode::Remaining.len();
    assert!(size_of::<Environment>() < 3400, "{}", size_of::<Environment>());
    assert!(65_536 * bytes < 1_000_000_000, "{bytes} bytes an environment");
}
