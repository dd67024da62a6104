//! Drives runs to the end, with restarts that grow the population.

use std::ops::ControlFlow;

use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::error::CmaEsError;
use super::optimiser::CmaEs;
use super::options::{CmaEsOptions, MAX_POPULATION_VALUES};
use super::termination::Termination;

/// Times the population grows at most; runs with a limit on evaluations go on at that size,
/// others end there.
pub const MAX_GROWTHS: u32 = 9;

/// What follows a run that has converged, stagnated or broken down.
///
/// A restart begins at a point uniform in the bounds where both are finite and at the start point
/// in the other variables.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Restarts {
    /// Nothing: one run. For costs with one minimum, or when the budget suits one run.
    #[default]
    None,
    /// Each run has `factor` times the population of the one before, which smooths a rugged cost
    /// with a regular structure. 2 is usual.
    Ipop {
        /// Growth of the population per restart, above 1.
        factor: f64,
    },
    /// Runs with a doubling population alternate, at equal evaluations, with runs of small
    /// population and small step size that search locally. For a cost of unknown structure.
    Bipop,
}

/// The state after a generation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress<'a> {
    /// Which run, from 0; above 0 are restarts.
    pub run: usize,
    /// Candidates per generation of this run.
    pub population_size: usize,
    /// Generations of this run.
    pub generation: usize,
    /// Evaluations of all runs.
    pub evaluations: usize,
    /// Step size of this run, in units of the variables.
    pub sigma: f64,
    /// Lowest cost of this generation.
    pub generation_best_cost: f64,
    /// Lowest cost of all runs.
    pub best_cost: f64,
    /// Its candidate.
    pub best_x: &'a [f64],
}

/// The best candidate of all runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// The candidate, length n, inside the bounds.
    pub x: Vec<f64>,
    /// Its cost.
    pub cost: f64,
    /// Evaluations of all runs.
    pub evaluations: usize,
    /// Generations of all runs.
    pub generations: usize,
    /// Number of runs, at least 1.
    pub runs: usize,
    /// What ended the last run, or all of them.
    pub termination: Termination,
}

/// Minimises `objective`, a function of n variables, from `start` with initial step size `sigma`.
///
/// The candidates of a generation are scored in parallel on the current rayon pool; the result is
/// the same for any number of threads. NaN counts as infinitely bad. After each generation
/// `progress` may end the search with [`ControlFlow::Break`], which returns the best so far with
/// [`Termination::Cancelled`]. `options.max_evaluations` covers all runs,
/// `options.max_generations` each.
///
/// # Errors
/// As [`CmaEs::new`] and [`CmaEs::tell`], and [`CmaEsError::BadGrowthFactor`].
pub fn minimise(
    objective: impl Fn(&[f64]) -> f64 + Sync,
    start: &[f64],
    sigma: f64,
    options: &CmaEsOptions,
    restarts: Restarts,
    progress: impl FnMut(&Progress<'_>) -> ControlFlow<()>,
) -> Result<Minimum, CmaEsError> {
    let score = |population: &[f64], costs: &mut [f64]| {
        population
            .par_chunks_exact(start.len())
            .zip(costs.par_iter_mut())
            .for_each(|(x, cost)| *cost = objective(x));
    };
    minimise_population(score, start, sigma, options, restarts, progress)
}

/// As [`minimise`], for an objective that scores a whole population: it is given λ × n values,
/// one candidate after another, and writes their λ costs.
///
/// # Errors
/// As [`minimise`].
pub fn minimise_population(
    mut objective: impl FnMut(&[f64], &mut [f64]),
    start: &[f64],
    sigma: f64,
    options: &CmaEsOptions,
    restarts: Restarts,
    mut progress: impl FnMut(&Progress<'_>) -> ControlFlow<()>,
) -> Result<Minimum, CmaEsError> {
    options.validate(start, sigma)?;
    let mut schedule = Schedule::new(restarts, start.len(), options)?;
    let mut best = Minimum {
        x: start.to_vec(),
        cost: f64::INFINITY,
        evaluations: 0,
        generations: 0,
        runs: 0,
        termination: Termination::Cancelled,
    };
    let mut run_start = start.to_vec();
    let mut plan = schedule.first();
    loop {
        let run_options = CmaEsOptions {
            population_size: Some(plan.population_size),
            seed: plan.seed,
            max_evaluations: plan.max_evaluations,
            ..options.clone()
        };
        let mut run = CmaEs::new(&run_start, sigma * plan.sigma_factor, run_options)?;
        best.runs += 1;
        best.termination = drive(&mut run, &mut objective, &mut progress, &mut best)?;
        if matches!(best.termination, Termination::TargetReached { .. } | Termination::Cancelled) {
            return Ok(best);
        }
        schedule.account(&plan, run.evaluations());
        match schedule.next(best.evaluations) {
            Next::Run(next) => plan = next,
            Next::Exhausted => {
                best.termination = Termination::MaxEvaluations { evaluations: best.evaluations };
                return Ok(best);
            }
            Next::Done => return Ok(best),
        }
        schedule.draw_start(start, options, &mut run_start);
    }
}

/// Drives one run to its end, adding its evaluations and improvements to `best`.
fn drive(
    run: &mut CmaEs,
    objective: &mut impl FnMut(&[f64], &mut [f64]),
    progress: &mut impl FnMut(&Progress<'_>) -> ControlFlow<()>,
    best: &mut Minimum,
) -> Result<Termination, CmaEsError> {
    let mut costs = vec![f64::NAN; run.population_size()];
    loop {
        objective(run.ask(), &mut costs);
        run.tell(&costs)?;
        best.generations += 1;
        best.evaluations += costs.len();
        if let Some(found) = run.best()
            && (found.cost < best.cost || best.generations == 1)
        {
            best.cost = found.cost;
            best.x.copy_from_slice(found.x);
        }
        let flow = progress(&Progress {
            run: best.runs - 1,
            population_size: run.population_size(),
            generation: run.generation(),
            evaluations: best.evaluations,
            sigma: run.sigma(),
            generation_best_cost: run.generation_best_cost(),
            best_cost: best.cost,
            best_x: &best.x,
        });
        if flow.is_break() {
            return Ok(Termination::Cancelled);
        }
        if let Some(termination) = run.termination() {
            return Ok(termination);
        }
    }
}

/// The two kinds of runs of [`Restarts::Bipop`]; all runs of the other kinds are large.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Regime {
    Large,
    Small,
}

/// One run to come.
#[derive(Debug, Clone, Copy)]
struct Plan {
    regime: Regime,
    population_size: usize,
    sigma_factor: f64,
    seed: u64,
    max_evaluations: Option<usize>,
}

/// What to do after a run.
enum Next {
    Run(Plan),
    /// The evaluation limit leaves no room for another run.
    Exhausted,
    /// No restart is wanted.
    Done,
}

/// Population, step size and budget of each run.
struct Schedule {
    restarts: Restarts,
    rng: Pcg64,
    seed: u64,
    max_evaluations: Option<usize>,
    default_population: usize,
    population_limit: usize,
    /// Times the population has grown.
    growths: u32,
    large_evaluations: usize,
    small_evaluations: usize,
    last_large_evaluations: usize,
}

impl Schedule {
    fn new(
        restarts: Restarts,
        dimension: usize,
        options: &CmaEsOptions,
    ) -> Result<Self, CmaEsError> {
        if let Restarts::Ipop { factor } = restarts
            && !(factor.is_finite() && factor > 1.0)
        {
            return Err(CmaEsError::BadGrowthFactor { factor });
        }
        Ok(Self {
            restarts,
            // A stream of its own: the runs draw from the streams of their seeds.
            rng: Pcg64::new(u128::from(options.seed), 1),
            seed: options.seed,
            max_evaluations: options.max_evaluations,
            default_population: options.population_size_for(dimension),
            population_limit: MAX_POPULATION_VALUES / dimension,
            growths: 0,
            large_evaluations: 0,
            small_evaluations: 0,
            last_large_evaluations: 0,
        })
    }

    fn first(&self) -> Plan {
        Plan {
            regime: Regime::Large,
            population_size: self.default_population,
            sigma_factor: 1.0,
            seed: self.seed,
            max_evaluations: self.max_evaluations,
        }
    }

    /// Books the `evaluations` of a run that followed `plan`.
    fn account(&mut self, plan: &Plan, evaluations: usize) {
        match plan.regime {
            Regime::Large => {
                self.large_evaluations += evaluations;
                self.last_large_evaluations = evaluations;
            }
            Regime::Small => self.small_evaluations += evaluations,
        }
    }

    /// The run after `evaluations` in all.
    fn next(&mut self, evaluations: usize) -> Next {
        let left = self.max_evaluations.map(|max| max - evaluations);
        let plan = match self.restarts {
            Restarts::None => return Next::Done,
            Restarts::Ipop { factor } => self.large(factor, left),
            // The regime that has used fewer evaluations is next; Hansen 2009, section 2.
            Restarts::Bipop
                if self.growths > 0 && self.small_evaluations < self.large_evaluations =>
            {
                Some(self.small(left))
            }
            Restarts::Bipop => self.large(2.0, left),
        };
        let Some(plan) = plan else { return Next::Done };
        if plan.max_evaluations.is_some_and(|max| max < plan.population_size) {
            return Next::Exhausted;
        }
        Next::Run(plan)
    }

    fn large(&mut self, factor: f64, left: Option<usize>) -> Option<Plan> {
        if self.growths == MAX_GROWTHS && left.is_none() {
            return None;
        }
        self.growths = (self.growths + 1).min(MAX_GROWTHS);
        Some(Plan {
            regime: Regime::Large,
            population_size: self.large_population(factor),
            sigma_factor: 1.0,
            seed: self.rng.random(),
            max_evaluations: left,
        })
    }

    /// The population after the growths so far.
    fn large_population(&self, factor: f64) -> usize {
        let grown = self.default_population as f64 * factor.powf(f64::from(self.growths));
        (grown.round() as usize).clamp(self.default_population, self.population_limit)
    }

    /// `λ_default` (½ `λ_large`/`λ_default`)^(U²), step size 10^(−2U) and half the evaluations of the
    /// last large run; Hansen 2009, section 2.
    fn small(&mut self, left: Option<usize>) -> Plan {
        let smallest = self.default_population as f64;
        let ratio = 0.5 * self.large_population(2.0) as f64 / smallest;
        let exponent = self.rng.random::<f64>().powi(2);
        let population_size = (smallest * ratio.powf(exponent)).floor() as usize;
        let population_size = population_size.max(self.default_population);
        let budget = (self.last_large_evaluations / 2).max(population_size);
        Plan {
            regime: Regime::Small,
            population_size,
            sigma_factor: 10.0_f64.powf(-2.0 * self.rng.random::<f64>()),
            seed: self.rng.random(),
            max_evaluations: Some(left.map_or(budget, |left| left.min(budget))),
        }
    }

    /// Draws where a restart begins.
    fn draw_start(&mut self, start: &[f64], options: &CmaEsOptions, run_start: &mut [f64]) {
        run_start.copy_from_slice(start);
        let Some(bounds) = &options.bounds else { return };
        for (x, (&lower, &upper)) in
            run_start.iter_mut().zip(bounds.lower().iter().zip(bounds.upper()))
        {
            if lower.is_finite() && upper.is_finite() {
                *x = (lower + self.rng.random::<f64>() * (upper - lower)).clamp(lower, upper);
            }
        }
    }
}
