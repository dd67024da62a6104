//! What can go wrong with a plan.

use lasergym_policy::PolicyError;

use crate::cma_es::CmaEsError;

/// Every error of the planners.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// A job without a pulse.
    #[error("max_pulses is 0: allow at least one pulse")]
    NoPulses,
    /// A job with more pulses than the workpiece has pixels.
    #[error(
        "max_pulses is {max_pulses}, more than the workpiece has pixels: allow at most {limit}"
    )]
    TooManyPulses {
        /// Pulses asked for.
        max_pulses: usize,
        /// Most that are accepted.
        limit: usize,
    },
    /// No pixel of the target remains.
    #[error(
        "no target remains on the workpiece: set at least one target pixel that is not machined yet"
    )]
    NothingRemains,
    /// A pulse radius that is not in (0, 50] px.
    #[error("the pulse radius is {radius_px} px: give one above 0 and at most {limit} px")]
    PulseRadius {
        /// Radius given, px.
        radius_px: f64,
        /// Largest that is accepted, px.
        limit: f64,
    },
    /// A position that is not finite.
    #[error("pulse {index} is at ({x}, {y}) px: both coordinates must be finite")]
    PositionNotFinite {
        /// Index of the pulse.
        index: usize,
        /// x, px.
        x: f64,
        /// y, px.
        y: f64,
    },
    /// A disturbance that is out of range.
    #[error("{name} is {value}, but must be {expected}")]
    Disturbance {
        /// Name of the value.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A raster grid with too many cells.
    #[error(
        "a raster grid of pitch {pitch_px} px has more than {limit} cells: use a larger pulse radius"
    )]
    RasterTooFine {
        /// Side of a cell, px.
        pitch_px: f64,
        /// Most cells that are accepted.
        limit: usize,
    },
    /// A name that no planner has.
    #[error("there is no planner named {name:?}: use one of {accepted}")]
    UnknownPlanner {
        /// The name given.
        name: String,
        /// The names there are.
        accepted: String,
    },
    /// A name that no shipped policy has.
    #[error("there is no shipped policy named {name:?}: use one of {accepted}")]
    UnknownPolicy {
        /// The name given.
        name: String,
        /// The names there are.
        accepted: String,
    },
    /// A setting of a planner lies outside its range.
    #[error("{name} is {value}, but must be {expected}")]
    InvalidOption {
        /// Name of the setting.
        name: &'static str,
        /// The value given.
        value: String,
        /// What is accepted.
        expected: &'static str,
    },
    /// A plan to start from has more pulses than the job allows.
    #[error(
        "the plan to start from has {pulses} pulses, but the job allows {max_pulses}: raise max_pulses or start from fewer"
    )]
    StartTooLong {
        /// Pulses of the plan to start from.
        pulses: usize,
        /// Pulses that the job allows.
        max_pulses: usize,
    },
    /// The worker threads could not be started.
    #[error("could not start {threads} worker threads ({reason}): ask for fewer")]
    Threads {
        /// Number of threads asked for.
        threads: usize,
        /// What the system said.
        reason: String,
    },
    /// A job with more pulses than CMA-ES can handle.
    #[error(
        "CMA-ES plans at most {limit} pulses, but the job allows {max_pulses}: allow fewer or use anneal"
    )]
    TooManyVariables {
        /// Pulses that the job allows.
        max_pulses: usize,
        /// Most that are accepted.
        limit: usize,
    },
    /// The optimiser of the CMA-ES planner refused its settings.
    #[error("CMA-ES: {0}")]
    CmaEs(#[from] CmaEsError),
    /// A policy file that cannot be used, or a network whose output is not finite.
    #[error("policy: {0}")]
    Policy(#[from] PolicyError),
    /// A policy whose manifest does not say how to decide, or not so that its network fits.
    #[error("the policy does not say how to decide about pulses ({reason}): export it again")]
    PolicyDecision {
        /// What does not fit.
        reason: String,
    },
}
