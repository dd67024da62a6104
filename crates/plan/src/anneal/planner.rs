//! The annealing planner.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use lasergym_geom::Point;

use crate::job::reward_of;
use crate::polish::PolishOptions;
use crate::{GainMap, Greedy, Job, Plan, PlanError, PlanProgress, Planner, PlannerKind};

use super::lattice::{Lattice, MAX_STEP_PX, Place};
use super::metropolis::BestPlaces;
use super::options::{AnnealBudget, AnnealOptions};
use super::restarts::{Outcome, run_restarts};

/// Anneals a fixed number of pulses; the best planner there is, and better the longer it runs.
///
/// Pulses lie on a lattice of 1/16 px, where actions reach them. The plan is fired in the order of the immediate gains, and
/// pulses that gain nothing are left out, so that it may have fewer pulses than the job allows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Anneal {
    /// The settings.
    pub options: AnnealOptions,
}

impl Planner for Anneal {
    fn kind(&self) -> PlannerKind {
        PlannerKind::Anneal
    }

    fn plan(
        &self,
        job: &Job,
        progress: &mut dyn FnMut(&PlanProgress<'_>) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        let began = Instant::now();
        self.options.validate(job.max_pulses())?;
        let first = match &self.options.start {
            Some(start) => start.clone(),
            None => greedy_positions(job)?,
        };
        let start = start_places(job, &first);
        let lattice = Lattice::new(job.pulse_radius_px());
        let mut options = self.options.clone();
        if let AnnealBudget::Time(time) = &mut options.budget {
            *time = time.saturating_sub(began.elapsed()).max(Duration::from_micros(1));
        }
        let mut report = |fraction: f64, best: &BestPlaces| {
            let positions: Vec<Point> = lattice.positions(&best.places);
            progress(&PlanProgress {
                planner: self.kind(),
                fraction,
                best_reward: reward_of(best.gain_px),
                best_positions: &positions,
            })
        };
        let Outcome { best, stopped } = if job.pulse_radius_px() <= NARROW_RADIUS_PX {
            run_restarts::<u64>(job, &lattice, &options, &start, &mut report)?
        } else {
            run_restarts::<u128>(job, &lattice, &options, &start, &mut report)?
        };
        let annealed = lattice.positions(&best.places);
        let plan = Plan::new(job, by_gain(job, annealed), stopped)?;
        if self.options.start.is_some() {
            let unchanged = Plan::new(job, first, stopped)?;
            if unchanged.score.reward > plan.score.reward {
                return Ok(unchanged);
            }
        }
        Ok(plan)
    }
}

/// Largest radius for which a pulse, a step and the rounding to whole bytes fit a 64-bit window, px.
pub(super) const NARROW_RADIUS_PX: f64 = ((u64::BITS as usize - 1 - 7 - MAX_STEP_PX) / 2) as f64;

/// The pulses of the greedy plan.
fn greedy_positions(job: &Job) -> Result<Vec<Point>, PlanError> {
    let greedy = Greedy { polish: PolishOptions::default(), ..Greedy::default() };
    Ok(greedy.plan_to_end(job)?.positions)
}

/// As many places as the annealing moves about: `first`, and more pulses on top of them, which
/// gain and cost nothing there.
fn start_places(job: &Job, first: &[Point]) -> Vec<Place> {
    let mut places: Vec<Place> = first.iter().map(|&position| Place::near(position)).collect();
    if places.is_empty() {
        let (row, column, _) = GainMap::new(job.workpiece(), job.pulse_radius_px()).best();
        places.push(Place::pixel_center(row, column));
    }
    let distinct = places.len();
    for k in distinct..job.max_pulses().min(2 * distinct.max(50)) {
        places.push(places[k % distinct]);
    }
    places
}

/// `positions` in the order in which each gains most after those before it, without the last ones
/// if these gain nothing together.
fn by_gain(job: &Job, mut positions: Vec<Point>) -> Vec<Point> {
    let mut workpiece = job.workpiece().clone();
    let (mut gain_px, mut best_px, mut keep) = (0, 0, 0);
    for k in 0..positions.len() {
        let gains = positions[k..]
            .iter()
            .map(|&position| workpiece.preview(&job.footprint(position)).gain_px());
        // The first of equals, so that the order does not depend on the iterator.
        let next =
            gains.enumerate().reduce(|best, other| if other.1 > best.1 { other } else { best });
        let Some((offset, _)) = next else { break };
        positions.swap(k, k + offset);
        gain_px += workpiece.pulse(&job.footprint(positions[k])).gain_px();
        if gain_px > best_px {
            (best_px, keep) = (gain_px, k + 1);
        }
    }
    positions.truncate(keep);
    positions
}

#[cfg(test)]
mod tests {
    use super::super::options::Ramp;
    use super::*;
    use lasergym_ablation::{Stream, Workpiece, random_shape, score, star};
    use lasergym_geom::Bitmap;

    fn star_job(max_pulses: usize) -> Job {
        Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, max_pulses).unwrap()
    }

    fn anneal(iterations: u64) -> Anneal {
        let budget = AnnealBudget::Iterations(iterations);
        Anneal { options: AnnealOptions { budget, ..AnnealOptions::default() } }
    }

    #[test]
    fn the_reported_score_is_that_of_the_process() {
        for seed in 0..5 {
            let target = random_shape(&mut Stream::from_seed(seed)).target;
            let job = Job::new(Workpiece::new(&target).unwrap(), 9.0, 30).unwrap();
            let plan = anneal(20_000).plan_to_end(&job).unwrap();
            assert_eq!(plan.score, score(&target, &plan.positions, 9.0).unwrap());
            assert!(plan.positions.len() <= 30 && !plan.partial);
        }
    }

    #[test]
    fn half_a_million_moves_machine_the_star() {
        let plan = anneal(500_000).plan_to_end(&star_job(40)).unwrap();
        assert!(plan.score.reward >= 0.462, "{:?}", plan.score);
    }

    #[test]
    fn a_seed_gives_one_plan_for_any_number_of_threads() {
        let plan = |seed, threads| {
            let mut anneal = anneal(20_000);
            anneal.options = AnnealOptions { seed, threads, restarts: 3, ..anneal.options };
            anneal.plan_to_end(&star_job(40)).unwrap()
        };
        let one = plan(5, 1);
        assert_eq!(plan(5, 1), one);
        assert_eq!(plan(5, 2), one);
        assert_eq!(plan(5, 4), one);
        assert_ne!(plan(6, 1), one);
    }

    #[test]
    fn the_result_is_never_worse_than_the_plan_to_start_from() {
        let good = anneal(300_000).plan_to_end(&star_job(40)).unwrap();
        // Off the lattice, and far too hot to come back.
        let start: Vec<Point> =
            good.positions.iter().map(|&p| p + Point::new(1e-3, -1e-3)).collect();
        let start_reward = star_job(40).score(&start).unwrap().reward;
        let mut hot = anneal(3000);
        hot.options.temperature_px = Ramp { from: 100.0, to: 100.0 };
        hot.options.start = Some(start);
        let plan = hot.plan_to_end(&star_job(40)).unwrap();
        assert!(plan.score.reward >= start_reward);
    }

    #[test]
    fn a_partly_machined_workpiece_is_completed_with_the_pulses_left() {
        let whole = Greedy::default().plan_to_end(&star_job(40)).unwrap();
        let mut workpiece = Workpiece::new(&star(0.0)).unwrap();
        let job = star_job(40);
        for &position in &whole.positions[..20] {
            workpiece.pulse(&job.footprint(position));
        }
        let rest = Job::new(workpiece, 9.0, 20).unwrap();
        let plan = anneal(200_000).plan_to_end(&rest).unwrap();
        assert!(plan.positions.len() <= 20);
        let together = [&whole.positions[..20], &plan.positions].concat();
        assert!(job.score(&together).unwrap().reward > whole.score.reward);
    }

    #[test]
    fn a_cancelled_run_leaves_the_best_so_far() {
        for threads in [1, 2] {
            let mut anneal = Anneal::default();
            anneal.options.budget = AnnealBudget::Time(Duration::from_secs(500));
            anneal.options = AnnealOptions { threads, restarts: threads, ..anneal.options };
            let mut reward = 0.0;
            let mut calls = 0;
            let plan = anneal
                .plan(&star_job(40), &mut |progress| {
                    assert_eq!(progress.planner, PlannerKind::Anneal);
                    assert!(progress.best_reward >= reward);
                    let positions = progress.best_positions;
                    let score = score(&star(0.0), positions, 9.0).unwrap();
                    assert!((score.reward - progress.best_reward).abs() == 0.0);
                    (reward, calls) = (progress.best_reward, calls + 1);
                    if calls >= 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
                })
                .unwrap();
            assert!(plan.partial);
            assert!(plan.score.reward >= reward && plan.positions.len() <= 40);
        }
    }

    #[test]
    fn pulses_that_gain_nothing_are_left_out() {
        // A single disc needs a single pulse, whatever is allowed.
        let disc = Bitmap::from_fn(|j, i| {
            let (dx, dy) = (i as f64 + 0.5 - 40.0, j as f64 + 0.5 - 60.0);
            dx * dx + dy * dy <= 81.0
        });
        let job = Job::new(Workpiece::new(&disc).unwrap(), 9.0, 50).unwrap();
        let plan = anneal(20_000).plan_to_end(&job).unwrap();
        assert_eq!(plan.positions.len(), 1);
        assert!((plan.score.reward - job.reward_limit()).abs() < 1e-12);
    }

    #[test]
    fn every_radius_is_annealed() {
        for radius_px in [0.3, 1.0, 5.5, 23.9, 24.0, 24.1, 37.0, 50.0] {
            let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), radius_px, 6).unwrap();
            let greedy = Greedy::default().plan_to_end(&job).unwrap();
            let plan = anneal(3000).plan_to_end(&job).unwrap();
            assert!(plan.score.reward >= greedy.score.reward, "radius {radius_px} px");
        }
    }

    #[test]
    fn a_target_that_no_pulse_gains_on_gets_an_empty_plan() {
        let dot = Bitmap::from_fn(|j, i| (j, i) == (50, 50));
        let job = Job::new(Workpiece::new(&dot).unwrap(), 9.0, 3).unwrap();
        let plan = anneal(3000).plan_to_end(&job).unwrap();
        assert!(plan.positions.is_empty());
        assert!(plan.score.reward.abs() < 1e-12);
    }

    fn refused(change: impl FnOnce(&mut AnnealOptions)) -> PlanError {
        let mut options = AnnealOptions::default();
        change(&mut options);
        Anneal { options }.plan_to_end(&star_job(3)).unwrap_err()
    }

    fn refused_option(change: impl FnOnce(&mut AnnealOptions)) -> &'static str {
        match refused(change) {
            PlanError::InvalidOption { name, .. } => name,
            other => panic!("{other}"),
        }
    }

    #[test]
    fn a_time_budget_of_zero_is_refused() {
        assert_eq!(
            refused_option(|o| o.budget = AnnealBudget::Time(Duration::ZERO)),
            "time budget"
        );
    }

    #[test]
    fn zero_iterations_are_refused() {
        assert_eq!(refused_option(|o| o.budget = AnnealBudget::Iterations(0)), "iterations");
    }

    #[test]
    fn zero_restarts_and_threads_are_refused() {
        assert_eq!(refused_option(|o| o.restarts = 0), "restarts");
        assert_eq!(refused_option(|o| o.threads = 0), "threads");
        assert_eq!(refused_option(|o| o.threads = 5000), "threads");
    }

    #[test]
    fn shares_temperatures_and_steps_out_of_range_are_refused() {
        assert_eq!(refused_option(|o| o.jump_share = 1.1), "jump_share");
        assert_eq!(refused_option(|o| o.replacement_share = f64::NAN), "replacement_share");
        let cold = Ramp { from: 1.0, to: 0.0 };
        assert_eq!(refused_option(|o| o.temperature_px = cold), "temperature_px");
        assert_eq!(
            refused_option(|o| o.replacement_temperature_px = cold),
            "replacement_temperature_px"
        );
        assert_eq!(refused_option(|o| o.step_px = Ramp { from: f64::NAN, to: 1.0 }), "step_px");
    }

    #[test]
    fn a_start_with_too_many_pulses_is_refused() {
        let error = refused(|o| o.start = Some(vec![Point::new(50.0, 50.0); 4]));
        assert_eq!(error, PlanError::StartTooLong { pulses: 4, max_pulses: 3 });
    }

    #[test]
    fn a_start_that_is_not_finite_is_refused() {
        let error = refused(|o| o.start = Some(vec![Point::new(f64::NAN, 50.0)]));
        assert!(matches!(error, PlanError::PositionNotFinite { index: 0, .. }), "{error}");
    }
}
