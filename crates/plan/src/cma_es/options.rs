//! Settings of a run and their validation.

use super::boundary::Bounds;
use super::error::CmaEsError;

/// Largest accepted number of values in the population (variables × members) and in the
/// covariance matrix (variables × variables): 800 MB each.
pub const MAX_POPULATION_VALUES: usize = 100_000_000;

/// The smallest population that has a worse and a better half.
const MIN_POPULATION: usize = 4;

/// How candidates of a generation enter the covariance matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CovarianceUpdate {
    /// The better half adds variance, the worse half removes it (negative weights of eq. (53)).
    /// Faster on most problems.
    #[default]
    Active,
    /// Only the better half counts; all other weights are 0.
    PositiveOnly,
}

/// When a run counts as converged or lost. A value of 0 switches its test off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerances {
    /// Stop when the best costs of the last 10 + ⌈30 n/λ⌉ generations and all costs of the last
    /// one lie within this range, in units of cost. Default 1e-11.
    pub tol_fun: f64,
    /// Stop when the best costs of the last 10 + ⌈30 n/λ⌉ generations lie within this range, in
    /// units of cost. Default 1e-12.
    pub tol_fun_hist: f64,
    /// Stop when the standard deviation of every coordinate and the evolution path are below this
    /// part of the initial step size. Default 1e-12.
    pub tol_x: f64,
    /// Stop when the longest axis of the distribution has grown by more than this factor, which
    /// means the initial step size was far too small or the cost is unbounded. Default 1e4.
    pub tol_x_up: f64,
    /// Stop when the covariance matrix has a larger condition number than this. Default 1e14,
    /// where double precision ends.
    pub condition: f64,
    /// Stop when neither the best nor the median cost has improved over the last fifth of the
    /// run, counted in generations; this is the least number of generations for the verdict, and
    /// 30 n/λ more are added. Default 120.
    pub stagnation_generations: usize,
}

impl Default for Tolerances {
    fn default() -> Self {
        Self {
            tol_fun: 1e-11,
            tol_fun_hist: 1e-12,
            tol_x: 1e-12,
            tol_x_up: 1e4,
            condition: 1e14,
            stagnation_generations: 120,
        }
    }
}

/// Settings of one CMA-ES run; `Default` is the tutorial's choice for every one of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CmaEsOptions {
    /// Candidates per generation λ, at least 4; `None` takes 4 + ⌊3 ln n⌋ (eq. (48)). More explore
    /// more widely and cost more per generation.
    pub population_size: Option<usize>,
    /// Seed of the PCG64 generator; the same seed gives the same run.
    pub seed: u64,
    /// The box the variables live in; `None` leaves them free.
    pub bounds: Option<Bounds>,
    /// Whether bad candidates count. Default [`CovarianceUpdate::Active`].
    pub covariance_update: CovarianceUpdate,
    /// Evaluations never exceeded, over all restarts; `None` sets no limit.
    pub max_evaluations: Option<usize>,
    /// Generations of one run; `None` sets no limit.
    pub max_generations: Option<usize>,
    /// Stop at the first cost at or below this; `None` looks for the minimum.
    pub target_cost: Option<f64>,
    /// When a run counts as converged or lost.
    pub tolerances: Tolerances,
}

/// Population size λ for `dimension` variables when none is asked for, eq. (48).
pub(super) fn default_population_size(dimension: usize) -> usize {
    4 + (3.0 * (dimension as f64).ln()).floor() as usize
}

impl CmaEsOptions {
    /// Checks these settings together with the start point and initial step size of a run.
    pub(super) fn validate(&self, start: &[f64], sigma: f64) -> Result<(), CmaEsError> {
        if start.is_empty() {
            return Err(CmaEsError::EmptyStart);
        }
        if let Some((index, &value)) = start.iter().enumerate().find(|(_, x)| !x.is_finite()) {
            return Err(CmaEsError::NonFiniteStart { index, value });
        }
        if !(sigma.is_finite() && sigma > 0.0) {
            return Err(CmaEsError::BadSigma { sigma });
        }
        let population_size = self.population_size_for(start.len());
        self.validate_sizes(start.len(), population_size)?;
        if self.target_cost.is_some_and(f64::is_nan) {
            return Err(CmaEsError::TargetNan);
        }
        self.tolerances.validate()?;
        self.bounds.as_ref().map_or(Ok(()), |bounds| bounds.check_start(start))
    }

    /// Population size of a run with `dimension` variables.
    pub(super) fn population_size_for(&self, dimension: usize) -> usize {
        self.population_size.unwrap_or_else(|| default_population_size(dimension))
    }

    fn validate_sizes(&self, dimension: usize, population_size: usize) -> Result<(), CmaEsError> {
        if population_size < MIN_POPULATION {
            return Err(CmaEsError::PopulationTooSmall {
                population_size,
                minimum: MIN_POPULATION,
            });
        }
        let largest_side = dimension.max(population_size);
        if dimension.checked_mul(largest_side).is_none_or(|values| values > MAX_POPULATION_VALUES) {
            return Err(CmaEsError::ProblemTooLarge {
                dimension,
                population_size,
                limit: MAX_POPULATION_VALUES,
            });
        }
        if let Some(max_evaluations) = self.max_evaluations.filter(|&max| max < population_size) {
            return Err(CmaEsError::BudgetTooSmall { max_evaluations, population_size });
        }
        if self.max_generations == Some(0) {
            return Err(CmaEsError::NoGenerations);
        }
        Ok(())
    }
}

impl Tolerances {
    fn validate(&self) -> Result<(), CmaEsError> {
        let named = [
            ("tol_fun", self.tol_fun),
            ("tol_fun_hist", self.tol_fun_hist),
            ("tol_x", self.tol_x),
            ("tol_x_up", self.tol_x_up),
            ("condition", self.condition),
        ];
        match named.into_iter().find(|(_, value)| value.is_nan() || *value < 0.0) {
            Some((name, value)) => Err(CmaEsError::BadTolerance { name, value }),
            None => Ok(()),
        }
    }
}
