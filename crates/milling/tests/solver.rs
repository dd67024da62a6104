//! The inverse solver on small targets.
#![allow(clippy::unwrap_used, reason = "helpers of tests may unwrap")]

use std::ops::ControlFlow;

use lasergym_milling::{
    DepthMap, JobOptions, MillingError, MillingJob, Profile, SolveOptions, SolveStage,
};

/// Waves and a hollow, as deep as the process likes it.
fn job(process: &str) -> MillingJob {
    let profile = Profile::shipped(process).unwrap();
    let reach_um = profile.process.footprint.reach_um();
    let pixel_um = 0.15 * reach_um;
    let (least, _) = profile.dwell_range_s_mm();
    let least_um = profile.layer_depth_um(least);
    let depths = (0..32 * 36)
        .map(|k| {
            let (x, y) = (f64::from(k % 36) / 36.0 - 0.5, f64::from(k / 36) / 32.0 - 0.5);
            let hollow = 0.5 * (-(x * x + y * y) / 0.04).exp();
            least_um * (1.35 + hollow + 0.3 * (5.0 * x).sin())
        })
        .collect();
    let target = DepthMap::new(32, 36, pixel_um, depths).unwrap();
    MillingJob::new(&target, profile, JobOptions::default()).unwrap()
}

#[test]
fn both_processes_halve_the_error_and_free_passes_lower_it_further() {
    for process in Profile::shipped_names() {
        let job = job(process);
        let solution =
            job.solve(&SolveOptions::default(), &mut |_| ControlFlow::Continue(())).unwrap();
        assert!(!solution.partial);
        let (pixel, straight) = (solution.pixel_by_pixel.percent, solution.straight.percent);
        let best = solution.error.percent;
        assert!(straight < 0.6 * pixel, "{process}: {pixel}, {straight}, {best}");
        assert!(best < 0.5 * pixel && best < straight, "{process}: {pixel}, {straight}, {best}");
        // The passes leave the surface and keep the limits that the solution states.
        let mut depth_um = vec![0.0; job.grid().len()];
        job.simulator().mill(&solution.path, &mut depth_um).unwrap();
        assert_eq!(depth_um, solution.depth_um);
        let (least, most) = job.profile().dwell_range_s_mm();
        assert!(solution.path.dwell_s_mm.iter().all(|dwell| (least..=most).contains(dwell)));
    }
}

#[test]
fn the_objective_never_rises_within_a_stage() {
    let job = job("waterjet-garnet");
    let options = SolveOptions { iterations: 15, free_iterations: 10, ..SolveOptions::default() };
    let solution = job.solve(&options, &mut |_| ControlFlow::Continue(())).unwrap();
    for pair in solution.convergence.windows(2) {
        assert!(pair[1].fraction >= pair[0].fraction);
        assert!(pair[1].objective <= pair[0].objective);
    }
    assert_eq!(solution.convergence.last().unwrap().stage, SolveStage::Free);
}

#[test]
fn a_stopped_solver_returns_the_best_so_far() {
    let job = job("laser-graphite");
    let mut calls = 0;
    let solution = job
        .solve(&SolveOptions::default(), &mut |_| {
            calls += 1;
            if calls == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
        .unwrap();
    assert!(solution.partial);
    assert_eq!((calls, solution.convergence.len()), (3, 4));
    assert!(solution.error.percent < solution.pixel_by_pixel.percent);
}

#[test]
fn the_same_job_gives_the_same_bits() {
    let options = SolveOptions { iterations: 6, free_iterations: 4, ..SolveOptions::default() };
    let solve =
        || job("laser-graphite").solve(&options, &mut |_| ControlFlow::Continue(())).unwrap();
    assert_eq!(solve(), solve());
}

#[test]
fn measuring_between_layers_corrects_a_wrong_model() {
    // The plant removes 5 % less than the model says. Half of the layers are milled as planned, the
    // rest after measuring.
    let profile = Profile::shipped("laser-graphite").unwrap();
    let target = DepthMap::new(24, 24, 6.0, vec![40.0; 576]).unwrap();
    let job = MillingJob::new(&target, profile.clone(), JobOptions { layers: Some(4) }).unwrap();
    let mut plant = profile;
    plant.process.footprint = plant.process.footprint.scaled(1.0, 0.95).unwrap();
    let plant = MillingJob::new(&target, plant, JobOptions { layers: Some(4) }).unwrap();
    let options = SolveOptions { iterations: 15, free_iterations: 0, ..SolveOptions::default() };
    let go_on = &mut |_: &_| ControlFlow::Continue(());
    let planned = job.solve(&options, go_on).unwrap();
    let mut surface = vec![0.0; job.grid().len()];
    plant.simulator().mill(&planned.path, &mut surface).unwrap();
    let open = job.objective().tracking_error(&surface).unwrap().percent;

    let mut surface = vec![0.0; job.grid().len()];
    let (first, _) = planned.path.split_at_pass(3 * job.layout().passes);
    plant.simulator().mill(&first, &mut surface).unwrap();
    let rest = job.solve_from(&surface, 1, &options, go_on).unwrap();
    plant.simulator().mill(&rest.path, &mut surface).unwrap();
    let closed = job.objective().tracking_error(&surface).unwrap().percent;
    assert!(closed < 0.4 * open, "{closed} after {open}");
}

#[test]
fn options_out_of_range_are_named() {
    let job = job("laser-graphite");
    let defaults = SolveOptions::default();
    for (options, expected) in [
        (SolveOptions { iterations: 0, ..defaults }, "iterations"),
        (SolveOptions { switching_rounds: 101, ..defaults }, "switching_rounds"),
        (SolveOptions { free_iterations: 10_001, ..defaults }, "free_iterations"),
        (SolveOptions { free_range: 0.0, ..defaults }, "free_range"),
        (SolveOptions { least_fall: f64::NAN, ..defaults }, "least_fall"),
    ] {
        match job.solve(&options, &mut |_| ControlFlow::Continue(())) {
            Err(MillingError::InvalidOption { name, .. }) => assert_eq!(name, expected),
            other => panic!("{expected}: {other:?}"),
        }
    }
}
