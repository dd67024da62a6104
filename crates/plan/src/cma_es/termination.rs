//! Why a run ends: the stopping criteria of the tutorial's Appendix B.3.

use std::collections::VecDeque;
use std::fmt;

use nalgebra::DVector;

use super::covariance::Covariance;
use super::options::CmaEsOptions;

/// Generations of history kept for [`Termination::Stagnation`].
const MAX_HISTORY: usize = 20_000;

/// Generations between two tests for [`Termination::Stagnation`], which sorts the history.
const STAGNATION_INTERVAL: usize = 10;

/// Why a run has ended.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Termination {
    /// A cost at or below the target was found.
    TargetReached {
        /// The best cost.
        cost: f64,
    },
    /// Another generation would exceed the evaluation limit.
    MaxEvaluations {
        /// Evaluations used.
        evaluations: usize,
    },
    /// The generation limit is reached.
    MaxGenerations {
        /// Generations used.
        generations: usize,
    },
    /// The covariance matrix is no longer finite, after costs or variables of extreme size.
    NotFinite,
    /// The covariance matrix is too ill-conditioned for double precision.
    ConditionNumber {
        /// Ratio of its largest to its smallest eigenvalue.
        condition: f64,
    },
    /// The distribution has grown out of proportion; the initial step size was too small or the
    /// cost is unbounded.
    TolXUp {
        /// Longest axis over the initial step size.
        growth: f64,
    },
    /// A tenth of a standard deviation along a principal axis no longer changes the mean.
    NoEffectAxis {
        /// Which axis.
        axis: usize,
    },
    /// A fifth of a standard deviation no longer changes a coordinate of the mean.
    NoEffectCoordinate {
        /// Which coordinate.
        coordinate: usize,
    },
    /// The best cost has been exactly the same for 10 + ⌈30 n/λ⌉ generations.
    EqualFunctionValues {
        /// That many generations.
        generations: usize,
    },
    /// The best costs of recent generations and all costs of the last one hardly differ.
    TolFun {
        /// Their range, in units of cost.
        range: f64,
    },
    /// The best costs of recent generations hardly differ.
    TolFunHist {
        /// Their range, in units of cost.
        range: f64,
    },
    /// The distribution has become too narrow to matter.
    TolX {
        /// Largest standard deviation of a coordinate.
        deviation: f64,
    },
    /// Neither the best nor the median cost has improved for long.
    Stagnation {
        /// Length of the history without improvement, in generations.
        generations: usize,
    },
    /// The caller asked to stop.
    Cancelled,
}

impl Termination {
    /// The reason as one lower-case word with hyphens, such as `tol-fun`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TargetReached { .. } => "target-reached",
            Self::MaxEvaluations { .. } => "max-evaluations",
            Self::MaxGenerations { .. } => "max-generations",
            Self::NotFinite => "not-finite",
            Self::ConditionNumber { .. } => "condition-number",
            Self::TolXUp { .. } => "tol-x-up",
            Self::NoEffectAxis { .. } => "no-effect-axis",
            Self::NoEffectCoordinate { .. } => "no-effect-coordinate",
            Self::EqualFunctionValues { .. } => "equal-function-values",
            Self::TolFun { .. } => "tol-fun",
            Self::TolFunHist { .. } => "tol-fun-hist",
            Self::TolX { .. } => "tol-x",
            Self::Stagnation { .. } => "stagnation",
            Self::Cancelled => "cancelled",
        }
    }
}

impl fmt::Display for Termination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TargetReached { cost } => {
                write!(f, "the target is reached with a cost of {cost}")
            }
            Self::MaxEvaluations { evaluations } => {
                write!(f, "the evaluation limit is reached after {evaluations}")
            }
            Self::MaxGenerations { generations } => {
                write!(f, "the generation limit of {generations} is reached")
            }
            Self::NotFinite => write!(f, "the covariance matrix is no longer finite"),
            Self::ConditionNumber { condition } => {
                write!(f, "the covariance matrix has a condition number of {condition:.1e}")
            }
            Self::TolXUp { growth } => {
                write!(
                    f,
                    "the distribution has grown {growth:.1e} times; start with a larger step size"
                )
            }
            Self::NoEffectAxis { axis } => {
                write!(f, "a step along principal axis {axis} no longer changes the mean")
            }
            Self::NoEffectCoordinate { coordinate } => {
                write!(f, "a step in coordinate {coordinate} no longer changes the mean")
            }
            Self::EqualFunctionValues { generations } => {
                write!(f, "the best cost has not changed for {generations} generations")
            }
            Self::TolFun { range } => write!(f, "all recent costs lie within {range:.1e}"),
            Self::TolFunHist { range } => write!(f, "the recent best costs lie within {range:.1e}"),
            Self::TolX { deviation } => {
                write!(f, "the largest standard deviation is down to {deviation:.1e}")
            }
            Self::Stagnation { generations } => {
                write!(f, "no improvement in the last {generations} generations")
            }
            Self::Cancelled => write!(f, "cancelled"),
        }
    }
}

/// The state of a run after a generation, as far as the criteria look at it.
pub(super) struct Snapshot<'a> {
    pub(super) generation: usize,
    pub(super) evaluations: usize,
    pub(super) population_size: usize,
    pub(super) best_cost: f64,
    /// Costs of the generation, best first.
    pub(super) sorted_costs: &'a [f64],
    pub(super) mean: &'a DVector<f64>,
    pub(super) sigma: f64,
    pub(super) initial_sigma: f64,
    pub(super) covariance_path: &'a DVector<f64>,
    pub(super) covariance: &'a Covariance,
}

/// Best and median costs of past generations, newest last.
#[derive(Debug, Clone, Default)]
pub(super) struct CostHistory {
    best: VecDeque<f64>,
    median: VecDeque<f64>,
    scratch: Vec<f64>,
}

impl CostHistory {
    /// Adds a generation, given its costs in ascending order.
    pub(super) fn push(&mut self, sorted_costs: &[f64]) {
        if self.best.len() == MAX_HISTORY {
            self.best.pop_front();
            self.median.pop_front();
        }
        self.best.push_back(sorted_costs[0]);
        self.median.push_back(sorted_costs[sorted_costs.len() / 2]);
    }

    /// The first criterion met, in the order of the variants of [`Termination`].
    pub(super) fn check(
        &mut self,
        state: &Snapshot<'_>,
        options: &CmaEsOptions,
    ) -> Option<Termination> {
        limits(state, options)
            .or_else(|| numerical(state, options))
            .or_else(|| self.cost_range(state, options))
            .or_else(|| small_steps(state, options))
            .or_else(|| self.stagnation(state, options))
    }

    fn cost_range(&self, state: &Snapshot<'_>, options: &CmaEsOptions) -> Option<Termination> {
        let window = 10 + (30 * state.mean.len()).div_ceil(state.population_size);
        if self.best.len() < window {
            return None;
        }
        let recent = self.best.iter().rev().take(window);
        let (low, high) = recent.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &cost| {
            (low.min(cost), high.max(cost))
        });
        if low >= high {
            return Some(Termination::EqualFunctionValues { generations: window });
        }
        let (generation_low, generation_high) =
            (state.sorted_costs[0], state.sorted_costs[state.sorted_costs.len() - 1]);
        let range = high.max(generation_high) - low.min(generation_low);
        if range < options.tolerances.tol_fun {
            return Some(Termination::TolFun { range });
        }
        let range = high - low;
        (range < options.tolerances.tol_fun_hist).then_some(Termination::TolFunHist { range })
    }

    /// Compares the medians of the first and the last three tenths of the window.
    fn stagnation(&mut self, state: &Snapshot<'_>, options: &CmaEsOptions) -> Option<Termination> {
        let least = options.tolerances.stagnation_generations;
        if least == 0 || !state.generation.is_multiple_of(STAGNATION_INTERVAL) {
            return None;
        }
        let window = (state.generation / 5)
            .max(least.saturating_add((30 * state.mean.len()).div_ceil(state.population_size)))
            .min(MAX_HISTORY);
        if self.best.len() < window {
            return None;
        }
        let part = (window * 3 / 10).max(1);
        let Self { best, median, scratch } = self;
        let stagnant = [best, median].into_iter().all(|history| {
            let first = history.len() - window;
            let early = median_of(scratch, history.range(first..first + part));
            let late = median_of(scratch, history.range(history.len() - part..));
            late >= early
        });
        stagnant.then_some(Termination::Stagnation { generations: window })
    }
}

/// Median of `values`, which are copied to `scratch`; `values` is not empty.
fn median_of<'a>(scratch: &mut Vec<f64>, values: impl Iterator<Item = &'a f64>) -> f64 {
    scratch.clear();
    scratch.extend(values);
    let middle = scratch.len() / 2;
    *scratch.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Target and budget.
fn limits(state: &Snapshot<'_>, options: &CmaEsOptions) -> Option<Termination> {
    let &Snapshot { generation, evaluations, population_size, best_cost, .. } = state;
    if options.target_cost.is_some_and(|target| best_cost <= target) {
        return Some(Termination::TargetReached { cost: best_cost });
    }
    if options.max_evaluations.is_some_and(|max| evaluations + population_size > max) {
        return Some(Termination::MaxEvaluations { evaluations });
    }
    options
        .max_generations
        .is_some_and(|max| generation >= max)
        .then_some(Termination::MaxGenerations { generations: generation })
}

/// The limits of double precision.
fn numerical(state: &Snapshot<'_>, options: &CmaEsOptions) -> Option<Termination> {
    let &Snapshot { mean, sigma, covariance, .. } = state;
    let tolerances = &options.tolerances;
    if !sigma.is_finite() || !mean.iter().all(|x| x.is_finite()) {
        return Some(Termination::NotFinite);
    }
    let condition = covariance.condition();
    if tolerances.condition > 0.0 && condition > tolerances.condition {
        return Some(Termination::ConditionNumber { condition });
    }
    let growth = sigma * covariance.longest_axis() / state.initial_sigma;
    if tolerances.tol_x_up > 0.0 && growth > tolerances.tol_x_up {
        return Some(Termination::TolXUp { growth });
    }
    let axis = state.generation % mean.len();
    let step = covariance.axes().column(axis);
    if mean.iter().zip(&step).all(|(&m, &y)| same(m, m + 0.1 * sigma * y)) {
        return Some(Termination::NoEffectAxis { axis });
    }
    let coordinate = mean.iter().enumerate().position(|(i, &m)| {
        let deviation = covariance.matrix()[(i, i)].max(0.0).sqrt();
        same(m, m + 0.2 * sigma * deviation)
    })?;
    Some(Termination::NoEffectCoordinate { coordinate })
}

/// Whether a step from `before` to `after` is lost to rounding.
fn same(before: f64, after: f64) -> bool {
    before.to_bits() == after.to_bits()
}

fn small_steps(state: &Snapshot<'_>, options: &CmaEsOptions) -> Option<Termination> {
    let limit = options.tolerances.tol_x * state.initial_sigma;
    let widest = state.covariance.largest_variance().sqrt();
    let deviation = state.sigma * widest;
    let path = state.sigma * state.covariance_path.amax();
    (deviation < limit && path < limit).then_some(Termination::TolX { deviation })
}
