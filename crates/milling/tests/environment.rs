//! The milling environment: one step of the crate, added up; batches; plans of spots.
#![allow(clippy::unwrap_used, reason = "helpers of tests may unwrap")]

use std::ops::ControlFlow;

use lasergym_batch::{Autoreset, BatchError};
use lasergym_milling::{
    Batch, BatchOptions, Environment, EnvironmentOptions, GradientMemory, MillingError, Objective,
    ObservationMode, Profile, SIZE_PX, Spot, SpotPlanner,
};
use proptest::prelude::*;

fn options(process: usize) -> EnvironmentOptions {
    let name = Profile::shipped_names()[process];
    EnvironmentOptions { max_spots: 12, ..EnvironmentOptions::new(Profile::shipped(name).unwrap()) }
}

fn any_actions(count: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
    prop::collection::vec([-1.3_f32..1.3, -1.3_f32..1.3, -1.3_f32..1.3], count)
}

fn mode() -> impl Strategy<Value = ObservationMode> {
    prop_oneof![Just(ObservationMode::Residual), Just(ObservationMode::Layers)]
}

fn observation(environment: &Environment, mode: ObservationMode) -> Vec<u8> {
    let mut bytes = vec![0; mode.len()];
    mode.write(environment, &mut bytes);
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The return is the fall of the tracking error, which is that of the surface; the surface is
    /// what the simulator makes of the spots; clones replay.
    #[test]
    fn rewards_add_up_to_the_fall_of_the_error(
        process in 0..2_usize,
        seed: u64,
        pointing in prop_oneof![Just(0.0), 0.0..20.0],
        dwell_error in prop_oneof![Just(0.0), 0.0..0.5],
        actions in any_actions(12),
    ) {
        let options =
            EnvironmentOptions { pointing_error_um: pointing, dwell_error, ..options(process) };
        let mut environment = Environment::new(options).unwrap();
        environment.reset(Some(seed));
        let mut twin = environment.clone();
        let mut spots = Vec::new();
        let mut sum = 0.0;
        for action in actions {
            let step = environment.step(action).unwrap();
            prop_assert_eq!(step, twin.step(action).unwrap());
            sum += step.reward;
            spots.push(step.spot);
            if step.terminated {
                break;
            }
        }
        let (depth, target) = (environment.depth_um(), environment.target_um());
        let error: f64 = depth.iter().zip(target).map(|(d, t)| (d - t).abs()).sum();
        let percent = 100.0 * error / target.iter().sum::<f64>();
        let progress = environment.progress();
        prop_assert!((progress.tracking_error_percent - percent).abs() < 1e-9);
        prop_assert!((sum - (1.0 - percent / 100.0)).abs() < 1e-11);
        prop_assert!((sum - environment.episode_return()).abs() < 1e-11);
        let parts = progress.machined_fraction - progress.off_target_fraction;
        prop_assert!((sum - parts).abs() < 1e-11);

        let grid = *environment.simulator().grid();
        let mut surface = vec![0.0; grid.len()];
        environment.simulator().mill_spots(&spots, &mut surface).unwrap();
        let margin = (grid.rows - SIZE_PX) / 2;
        for (row, depths) in depth.chunks_exact(SIZE_PX).enumerate() {
            let start = (margin + row) * grid.columns + margin;
            prop_assert_eq!(depths, &surface[start..start + SIZE_PX]);
        }
        environment.reset(None);
        twin.reset(None);
        prop_assert_eq!(environment.target_um(), twin.target_um());
    }

    /// A batch is its environments, one by one, whatever the mode and the number of threads; and what
    /// it writes is the whole observation.
    #[test]
    fn a_batch_is_its_environments(
        process in 0..2_usize,
        mode in mode(),
        autoreset in prop_oneof![Just(Autoreset::NextStep), Just(Autoreset::SameStep)],
        limit in prop_oneof![Just(None), (1..7_u32).prop_map(Some)],
        threads in 1..3_usize,
        max_spots in 1..6_u32,
        actions in any_actions(24),
    ) {
        let options = EnvironmentOptions {
            max_spots, dwell_error: 0.1, pointing_error_um: 3.0, ..options(process)
        };
        let single = Environment::new(options).unwrap();
        let mut batch = Batch::new(single.clone(), BatchOptions {
            environments: 3, autoreset, observation: mode, max_episode_steps: limit, threads,
        }).unwrap();
        let mut singles = vec![single; 3];
        let mut steps = [0; 3];
        let mut over = [false; 3];
        let mut written = vec![0; 3 * mode.len()];
        let same = autoreset == Autoreset::SameStep;
        let mut last = vec![0; if same { written.len() } else { 0 }];
        batch.reset(&[Some(5), Some(6), Some(7)], None, &mut written).unwrap();
        for (seed, single) in (5..).zip(&mut singles) {
            single.reset(Some(seed));
        }
        for actions in actions.chunks_exact(3) {
            batch.step(actions, &mut written, &mut last).unwrap();
            for (k, record) in batch.records().enumerate() {
                let place = k * mode.len()..(k + 1) * mode.len();
                if over[k] {
                    singles[k].reset(None);
                    (over[k], steps[k]) = (false, 0);
                    prop_assert_eq!(record.reward.to_bits(), 0.0_f64.to_bits());
                } else {
                    let step = singles[k].step(actions[k]).unwrap();
                    steps[k] += 1;
                    let truncated = limit.is_some_and(|limit| steps[k] >= limit);
                    prop_assert_eq!(record.reward.to_bits(), step.reward.to_bits());
                    prop_assert_eq!(record.terminated, step.terminated);
                    prop_assert_eq!(record.truncated, truncated);
                    if step.terminated || truncated {
                        let finished = record.finished.unwrap();
                        prop_assert_eq!(finished.progress, singles[k].progress());
                        if same {
                            prop_assert!(last[place.clone()] == observation(&singles[k], mode));
                            singles[k].reset(None);
                            steps[k] = 0;
                        } else {
                            over[k] = true;
                        }
                    }
                }
                prop_assert!(written[place] == observation(&singles[k], mode));
            }
        }
    }

    /// The gradient with respect to dwell and y of every spot is the central difference.
    #[test]
    fn the_gradient_of_spots_is_the_central_difference(
        process in 0..2_usize,
        places in prop::collection::vec((0.2..0.8_f64, 0.2..0.8_f64, 0.2..0.9_f64), 4),
    ) {
        let mut environment = Environment::new(options(process)).unwrap();
        environment.reset(Some(3));
        let (side, longest) = (environment.side_um(), environment.longest_dwell_s());
        let spots: Vec<Spot> = places
            .into_iter()
            .map(|(x, y, part)| Spot {
                x_um: 0.5 * side + 0.05 * side * x,
                y_um: 0.5 * side + 0.05 * side * y,
                dwell_s: part * longest,
            })
            .collect();
        let simulator = environment.simulator();
        let grid = *simulator.grid();
        // Rough ground: flat ground has slopes of exactly 0 beside the first spot.
        let start: Vec<f64> = (0..grid.len()).map(|k| 0.02 * ((k * 37) % 101) as f64).collect();
        let target = vec![0.3 * environment.full_scale_um(); grid.len()];
        let objective = Objective::new(grid, target, 0..grid.rows, 0..grid.columns).unwrap();
        let value = |spots: &[Spot]| {
            let mut surface = start.clone();
            simulator.mill_spots(spots, &mut surface).unwrap();
            objective.value(&surface).unwrap()
        };
        let memory = &mut GradientMemory::default();
        let found = simulator.spots_gradient(&spots, &start, &objective, memory).unwrap();
        prop_assert_eq!(found.objective.to_bits(), value(&spots).to_bits());
        let difference = |k: usize, h: f64, change: fn(&mut Spot, f64)| {
            let at = |h: f64| {
                let mut spots = spots.clone();
                change(&mut spots[k], h);
                value(&spots)
            };
            let slope = |h: f64| (at(h) - at(-h)) / (2.0 * h);
            let (coarse, fine) = (slope(h), slope(h / 2.0));
            fine + (fine - coarse) / 3.0
        };
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        for k in 0..spots.len() {
            let dwell = difference(k, 1e-3 * longest, |spot, h| spot.dwell_s += h);
            prop_assert!(
                (found.dwell[k] - dwell).abs() <= 1e-6 * largest(&found.dwell),
                "dwell {}: {} and {}", k, found.dwell[k], dwell
            );
            let y = difference(k, 1e-5 * side, |spot, h| spot.y_um += h);
            prop_assert!(
                (found.y[k] - y).abs() <= 1e-6 * largest(&found.y),
                "y {}: {} and {}", k, found.y[k], y
            );
        }
    }
}

#[test]
fn the_adjoint_is_far_better_than_pixel_by_pixel() {
    for process in 0..2 {
        let options =
            EnvironmentOptions { max_spots: 200, tolerance_percent: 0.0, ..options(process) };
        let mut environment = Environment::new(options).unwrap();
        for seed in 0..2 {
            environment.reset(Some(seed));
            let go_on = &mut |_| ControlFlow::Continue(());
            let usual = SpotPlanner::PixelByPixel.plan(&environment, go_on).unwrap();
            let best = SpotPlanner::Adjoint.plan(&environment, go_on).unwrap();
            assert!(!best.partial && best.actions.len() <= 200);
            let (usual, best_error) =
                (usual.progress.tracking_error_percent, best.progress.tracking_error_percent);
            assert!(best_error < 0.6 * usual, "process {process}: {best_error} after {usual}");
            let mut replayed = environment.clone();
            let sum: f64 = best.actions.iter().map(|a| replayed.step(*a).unwrap().reward).sum();
            assert!((sum - best.episode_return).abs() < 1e-12);
            assert_eq!(replayed.progress(), best.progress);
        }
    }
}

#[test]
fn a_stopped_planner_returns_what_it_has() {
    let mut environment = Environment::new(options(0)).unwrap();
    environment.reset(Some(1));
    let plan = SpotPlanner::Adjoint.plan(&environment, &mut |_| ControlFlow::Break(())).unwrap();
    assert!(plan.partial && !plan.actions.is_empty());
}

#[test]
fn episodes_end_within_the_tolerance_or_out_of_spots() {
    let mut environment = Environment::new(options(0)).unwrap();
    environment.reset(Some(2));
    for k in 1..=12 {
        let step = environment.step([0.9, -0.9, -1.0]).unwrap();
        assert_eq!(step.terminated, k == 12);
    }
    assert!(!environment.is_success());
    let tolerant = EnvironmentOptions { tolerance_percent: 99.0, ..options(0) };
    let mut environment = Environment::new(tolerant).unwrap();
    environment.reset(Some(2));
    while !environment.step([0.0, 0.0, 1.0]).unwrap().terminated {}
    assert!(environment.is_success());
}

#[test]
fn actions_are_clipped_and_must_be_finite() {
    let mut environment = Environment::new(options(0)).unwrap();
    let over = MillingError::Batch(BatchError::EpisodeOver { environment: 0 });
    assert_eq!(environment.step([0.0; 3]), Err(over));
    environment.reset(Some(1));
    let before = environment.depth_um();
    for bad in [[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [0.0, 0.0, f32::NAN]] {
        assert!(matches!(environment.step(bad), Err(MillingError::ActionNotFinite { .. })));
    }
    assert_eq!(environment.depth_um(), before);
    let mut twin = environment.clone();
    assert_eq!(environment.step([7.0, -7.0, 3.0]), twin.step([1.0, -1.0, 1.0]));
}

#[test]
fn bad_targets_are_refused_and_the_episode_goes_on() {
    let mut environment = Environment::new(options(1)).unwrap();
    environment.reset(Some(1));
    let kept = environment.target_um().to_vec();
    let all = SIZE_PX * SIZE_PX;
    assert!(matches!(environment.reset_to(&[1.0]), Err(MillingError::WrongLength { .. })));
    assert_eq!(environment.reset_to(&vec![0.0; all]), Err(MillingError::EmptyTarget));
    let mut bad = vec![1.0; all];
    bad[3 * SIZE_PX + 4] = f64::NAN;
    assert!(matches!(
        environment.reset_to(&bad),
        Err(MillingError::TargetValue { row: 3, column: 4, .. })
    ));
    assert_eq!(environment.target_um(), kept);
    let fixed = EnvironmentOptions { target_um: Some(bad), ..options(1) };
    assert!(matches!(Environment::new(fixed), Err(MillingError::TargetValue { .. })));
    let coarse = EnvironmentOptions { pixel_um: Some(1e3), ..options(1) };
    assert!(matches!(Environment::new(coarse), Err(MillingError::GridTooCoarse { .. })));
}

#[test]
fn spots_off_the_grid_or_too_long_are_refused() {
    let environment = Environment::new(options(1)).unwrap();
    let simulator = environment.simulator();
    let mut surface = vec![0.0; simulator.grid().len()];
    let middle = Spot { x_um: 500.0, y_um: 500.0, dwell_s: 1e-3 };
    for (spot, expected) in [
        (Spot { x_um: -1e3, ..middle }, "x_um"),
        (Spot { y_um: f64::NAN, ..middle }, "y_um"),
        (Spot { dwell_s: -1.0, ..middle }, "dwell_s"),
    ] {
        match simulator.mill_spots(&[middle, spot], &mut surface) {
            Err(MillingError::Spot { index: 1, name, .. }) => assert_eq!(name, expected),
            other => panic!("{expected}: {other:?}"),
        }
    }
    let long = Spot { dwell_s: 10.0, ..middle };
    assert!(matches!(
        simulator.mill_spots(&[long], &mut surface),
        Err(MillingError::Unstable { .. })
    ));
    assert!(surface.iter().all(|depth| *depth == 0.0));
}
