//! What a caller of the optimiser can get wrong.

use thiserror::Error;

/// Why a CMA-ES run cannot start or go on.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum CmaEsError {
    /// The start point has no coordinate.
    #[error("the start point is empty; give at least one coordinate")]
    EmptyStart,
    /// A coordinate of the start point is NaN or infinite.
    #[error("coordinate {index} of the start point is {value}; give a finite number")]
    NonFiniteStart {
        /// Which coordinate, from 0.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The initial step size is not a positive finite number.
    #[error("the initial step size is {sigma}; give a finite number above 0")]
    BadSigma {
        /// The step size.
        sigma: f64,
    },
    /// The population has too few members to rank.
    #[error("a population of {population_size} is too small; give at least {minimum}")]
    PopulationTooSmall {
        /// The population size asked for.
        population_size: usize,
        /// The least one accepted.
        minimum: usize,
    },
    /// The population or the covariance matrix would not fit in memory.
    #[error(
        "{dimension} variables with a population of {population_size} need more than {limit} values; reduce one of them"
    )]
    ProblemTooLarge {
        /// Number of variables.
        dimension: usize,
        /// Population size.
        population_size: usize,
        /// Largest accepted number of values in the population or in the covariance matrix.
        limit: usize,
    },
    /// The evaluation limit does not cover one generation.
    #[error(
        "{max_evaluations} evaluations do not cover one generation of {population_size}; allow more"
    )]
    BudgetTooSmall {
        /// The limit asked for.
        max_evaluations: usize,
        /// Population size.
        population_size: usize,
    },
    /// The generation limit is zero.
    #[error("a limit of 0 generations leaves nothing to do; allow at least 1")]
    NoGenerations,
    /// The target cost is NaN.
    #[error("the target cost is NaN; give a number or leave it out")]
    TargetNan,
    /// A tolerance is negative or NaN.
    #[error("tolerance {name} is {value}; give 0 (off) or a positive number")]
    BadTolerance {
        /// Name of the field in `Tolerances`.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The growth factor of the population is not above 1.
    #[error("the population growth factor is {factor}; give a finite number above 1")]
    BadGrowthFactor {
        /// The factor.
        factor: f64,
    },
    /// The two bounds, or the bounds and the start point, have different lengths.
    #[error("{bounds} bounds for {expected} values; give one lower and one upper bound for each")]
    BoundsLength {
        /// Number of bounds given.
        bounds: usize,
        /// Number expected.
        expected: usize,
    },
    /// A lower bound is not below its upper bound, or one of them is NaN.
    #[error("bounds {index} are [{lower}, {upper}]; the lower must be below the upper")]
    EmptyInterval {
        /// Which coordinate, from 0.
        index: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// A finite bound is so large that intervals overflow.
    #[error(
        "bounds {index} are [{lower}, {upper}], beyond {limit:e}; use an infinite bound instead"
    )]
    BoundTooLarge {
        /// Which coordinate, from 0.
        index: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
        /// Largest magnitude of a finite bound.
        limit: f64,
    },
    /// The start point lies outside the bounds.
    #[error(
        "coordinate {index} of the start point is {value}, outside [{lower}, {upper}]; start inside the bounds"
    )]
    StartOutOfBounds {
        /// Which coordinate, from 0.
        index: usize,
        /// Its value.
        value: f64,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// Costs were told before a population was asked for.
    #[error("costs told without a population to rank; call ask first")]
    TellBeforeAsk,
    /// The number of costs is not the population size.
    #[error("{costs} costs told for a population of {population_size}; tell one cost for each")]
    CostsLength {
        /// Number of costs told.
        costs: usize,
        /// Population size.
        population_size: usize,
    },
    /// Every cost of a generation is NaN, so that there is nothing to rank.
    #[error("every cost of generation {generation} is NaN; check the objective or the start point")]
    AllCostsNan {
        /// Generation, from 0.
        generation: usize,
    },
}
