//! CMA-ES as a planner: the benchmark of Xie et al. 2022, section 2.4.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use lasergym_ablation::reachable_position;
use lasergym_geom::{Point, WORKPIECE_SIZE_PX};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::cma_es::{Bounds, CmaEsOptions, Restarts, Termination, minimise_population};
use crate::job::reward_of;
use crate::{Job, Plan, PlanError, PlanProgress, Planner, PlannerKind};

/// Most pulses of a job for CMA-ES: beyond, its covariance matrix takes minutes a generation.
pub const MAX_CMA_ES_PULSES: usize = 500;

/// How long CMA-ES searches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CmaEsBudget {
    /// Wall time.
    Time(Duration),
    /// Plans that are scored, at least one population. The result is then the same for any number
    /// of threads.
    Evaluations(usize),
}

/// Searches all pulse positions of a plan at once, 2 variables a pulse, for the largest reward.
///
/// The search starts around random places on the target. Every plan has exactly `max_pulses`
/// pulses.
#[derive(Debug, Clone, PartialEq)]
pub struct CmaEsPlanner {
    /// How long to search. Default 30 s.
    pub budget: CmaEsBudget,
    /// Seed of the start and of the search.
    pub seed: u64,
    /// Plans per generation, at least 4. Default 40, as in the measurements of this project.
    pub population_size: usize,
    /// Initial standard deviation of the positions, px, in (0, 100]. Default 10.
    pub sigma_px: f64,
    /// What follows when a run has converged. Default [`Restarts::Ipop`] with factor 2.
    pub restarts: Restarts,
    /// Threads that score a population, in 1..=1024. Default 1.
    pub threads: usize,
}

impl Default for CmaEsPlanner {
    fn default() -> Self {
        Self {
            budget: CmaEsBudget::Time(Duration::from_secs(30)),
            seed: 0,
            population_size: 40,
            sigma_px: 10.0,
            restarts: Restarts::Ipop { factor: 2.0 },
            threads: 1,
        }
    }
}

impl CmaEsPlanner {
    fn validate(&self, job: &Job) -> Result<(), PlanError> {
        let invalid =
            |name, value: String, expected| Err(PlanError::InvalidOption { name, value, expected });
        if self.budget == CmaEsBudget::Time(Duration::ZERO) {
            return invalid("time budget", "0 s".to_owned(), "above 0");
        }
        if self.budget == CmaEsBudget::Evaluations(0) {
            return invalid("evaluations", "0".to_owned(), "at least one population");
        }
        if !(self.sigma_px > 0.0 && self.sigma_px <= WORKPIECE_SIZE_PX as f64) {
            return invalid("sigma_px", self.sigma_px.to_string(), "in (0, 100]");
        }
        if !(1..=1024).contains(&self.threads) {
            return invalid("threads", self.threads.to_string(), "in 1..=1024");
        }
        if job.max_pulses() > MAX_CMA_ES_PULSES {
            let limit = MAX_CMA_ES_PULSES;
            return Err(PlanError::TooManyVariables { max_pulses: job.max_pulses(), limit });
        }
        Ok(())
    }
}

impl Planner for CmaEsPlanner {
    fn kind(&self) -> PlannerKind {
        PlannerKind::CmaEs
    }

    fn plan(
        &self,
        job: &Job,
        progress: &mut dyn FnMut(&PlanProgress<'_>) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        let began = Instant::now();
        self.validate(job)?;
        let dimension = 2 * job.max_pulses();
        let options = CmaEsOptions {
            population_size: Some(self.population_size),
            seed: self.seed,
            bounds: Some(Bounds::cube(dimension, 0.0, WORKPIECE_SIZE_PX as f64)?),
            max_evaluations: match self.budget {
                CmaEsBudget::Time(_) => None,
                CmaEsBudget::Evaluations(evaluations) => Some(evaluations),
            },
            ..CmaEsOptions::default()
        };
        let pool = (self.threads > 1).then(|| thread_pool(self.threads)).transpose()?;
        let score_population = |population: &[f64], costs: &mut [f64]| match &pool {
            None => {
                for (plan, cost) in population.chunks_exact(dimension).zip(costs) {
                    *cost = cost_of(job, plan);
                }
            }
            Some(pool) => pool.install(|| {
                population
                    .par_chunks_exact(dimension)
                    .zip(costs)
                    .for_each(|(plan, cost)| *cost = cost_of(job, plan));
            }),
        };
        let mut cancelled = false;
        let after_generation = |state: &crate::cma_es::Progress<'_>| {
            let spent = match self.budget {
                CmaEsBudget::Time(time) => began.elapsed().as_secs_f64() / time.as_secs_f64(),
                CmaEsBudget::Evaluations(most) => state.evaluations as f64 / most as f64,
            };
            let flow = progress(&PlanProgress {
                planner: PlannerKind::CmaEs,
                fraction: spent.min(1.0),
                best_reward: -state.best_cost,
                best_positions: &positions_of(state.best_x),
            });
            cancelled = flow.is_break();
            if spent >= 1.0 { ControlFlow::Break(()) } else { flow }
        };
        let minimum = minimise_population(
            score_population,
            &random_start(job, self.seed),
            self.sigma_px,
            &options,
            self.restarts,
            after_generation,
        )?;
        let partial = cancelled && minimum.termination == Termination::Cancelled;
        Plan::new(job, positions_of(&minimum.x), partial)
    }
}

/// The lower the better: the reward with its sign changed.
fn cost_of(job: &Job, plan: &[f64]) -> f64 {
    -reward_of(job.outcome(&positions_of(plan)).gain_px())
}

/// Positions, ones that actions can reach, from the variables x, y of each pulse in turn.
fn positions_of(plan: &[f64]) -> Vec<Point> {
    let pulses = plan.as_chunks::<2>().0;
    pulses.iter().map(|&[x, y]| reachable_position(Point::new(x, y))).collect()
}

/// Variables of pulses on target pixels drawn at random.
fn random_start(job: &Job, seed: u64) -> Vec<f64> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let pixels: Vec<(usize, usize)> = job.target().pixels().collect();
    (0..job.max_pulses())
        .flat_map(|_| {
            let (row, column) = pixels[rng.random_range(0..pixels.len())];
            [column as f64 + 0.5, row as f64 + 0.5]
        })
        .collect()
}

fn thread_pool(threads: usize) -> Result<rayon::ThreadPool, PlanError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| PlanError::Threads { threads, reason: error.to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_ablation::{Workpiece, score, star};

    fn job(max_pulses: usize) -> Job {
        Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, max_pulses).unwrap()
    }

    fn quick(evaluations: usize) -> CmaEsPlanner {
        CmaEsPlanner { budget: CmaEsBudget::Evaluations(evaluations), ..CmaEsPlanner::default() }
    }

    #[test]
    fn the_reported_score_is_that_of_the_process() {
        let plan = quick(4000).plan_to_end(&job(12)).unwrap();
        assert_eq!(plan.score, score(&star(0.0), &plan.positions, 9.0).unwrap());
        assert!(plan.positions.len() == 12 && !plan.partial);
        assert!(plan.score.reward > 0.2, "{:?}", plan.score);
    }

    #[test]
    fn a_seed_gives_one_plan_for_any_number_of_threads() {
        let plan = |seed, threads| {
            CmaEsPlanner { seed, threads, ..quick(800) }.plan_to_end(&job(10)).unwrap()
        };
        assert_eq!(plan(1, 2), plan(1, 1));
        assert_ne!(plan(2, 1), plan(1, 1));
    }

    #[test]
    fn a_cancelled_search_leaves_the_best_so_far() {
        let mut reward = f64::NEG_INFINITY;
        let plan = quick(100_000)
            .plan(&job(10), &mut |progress| {
                assert!(progress.best_reward >= reward);
                reward = progress.best_reward;
                if progress.fraction > 0.01 {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            })
            .unwrap();
        assert!(plan.partial);
        assert!((plan.score.reward - reward).abs() < 1e-12);
    }

    #[test]
    fn a_spent_time_budget_is_no_cancellation() {
        let budget = CmaEsBudget::Time(Duration::from_millis(5));
        let plan = CmaEsPlanner { budget, ..quick(1) }.plan_to_end(&job(10)).unwrap();
        assert!(!plan.partial);
    }

    fn refused(planner: &CmaEsPlanner) -> &'static str {
        match planner.plan_to_end(&job(3)).unwrap_err() {
            PlanError::InvalidOption { name, .. } => name,
            other => panic!("{other}"),
        }
    }

    #[test]
    fn a_budget_of_zero_is_refused() {
        let budget = CmaEsBudget::Time(Duration::ZERO);
        assert_eq!(refused(&CmaEsPlanner { budget, ..quick(1) }), "time budget");
        assert_eq!(refused(&quick(0)), "evaluations");
    }

    #[test]
    fn a_step_size_out_of_range_is_refused() {
        for sigma_px in [0.0, -1.0, 101.0, f64::NAN] {
            assert_eq!(refused(&CmaEsPlanner { sigma_px, ..quick(100) }), "sigma_px");
        }
    }

    #[test]
    fn a_number_of_threads_out_of_range_is_refused() {
        assert_eq!(refused(&CmaEsPlanner { threads: 0, ..quick(100) }), "threads");
    }

    #[test]
    fn a_population_that_is_too_small_is_refused() {
        let error = CmaEsPlanner { population_size: 2, ..quick(100) }.plan_to_end(&job(3));
        assert!(matches!(error, Err(PlanError::CmaEs(_))));
    }

    #[test]
    fn a_job_with_too_many_pulses_is_refused() {
        let error = quick(100).plan_to_end(&job(501)).unwrap_err();
        assert_eq!(error, PlanError::TooManyVariables { max_pulses: 501, limit: 500 });
    }
}
