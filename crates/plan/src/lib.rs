//! Planners that decide where the next laser pulse goes: raster scan, greedy, annealing, CMA-ES
//! and trained policies, all behind [`Planner`].
//!
//! ```
//! use lasergym_ablation::{Workpiece, star};
//! use lasergym_plan::{Greedy, Job, Planner};
//!
//! let job = Job::new(Workpiece::new(&star(0.0))?, 9.0, 40)?;
//! let plan = Greedy::default().plan_to_end(&job)?;
//! assert!(plan.score.reward >= 0.459);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod agent;
mod anneal;
mod cma_es;
mod cma_es_planner;
mod decider;
mod disturbance;
mod error;
mod fixed_plan;
mod forethought;
mod gain_map;
mod greedy;
mod job;
mod job_state;
mod order;
mod plan;
mod planner;
mod polish;
#[cfg(feature = "pretrained")]
mod pretrained;
mod pulse_by_pulse;
mod raster;
mod ring_scores;
mod teacher;

pub use agent::{
    AgentMemory, AgentPlanner, CORRECTION_REACH_PX, Decision, Foresight, ForesightPlanner,
    PolicyAgent, PolicyDecider, SpatialDecision, VIEW_CHANNELS, VIEW_LEN, VIEW_SIZE, VIEW_WIDTH_PX,
    write_view,
};
pub use anneal::{
    Anneal, AnnealBudget, AnnealOptions, Completion, ExpectedCompletion, MAX_POINTING_ERROR_PX,
    MOVES_PER_REPLACEMENT, PulseBlur, Ramp, Replanning, ReplanningOptions,
};
pub use cma_es::{
    Best, Bounds, CmaEs, CmaEsError, CmaEsOptions, CovarianceUpdate, MAX_GROWTHS,
    MAX_POPULATION_VALUES, Minimum, Progress, Restarts, StrategyParameters, Termination,
    Tolerances, minimise, minimise_population,
};
pub use cma_es_planner::{CmaEsBudget, CmaEsPlanner, MAX_CMA_ES_PULSES};
pub use decider::Decider;
pub use disturbance::{Disturbance, DisturbedJob, disturbed_job};
pub use error::PlanError;
pub use fixed_plan::FixedPlan;
pub use forethought::Thinking;
pub use gain_map::GainMap;
pub use greedy::Greedy;
pub use job::{Job, MAX_JOB_PULSES};
pub use job_state::JobState;
pub use order::shortest_order;
pub use plan::Plan;
pub use planner::{PlanProgress, Planner, PlannerKind};
pub use polish::{PolishOptions, polish};
#[cfg(feature = "pretrained")]
pub use pretrained::Pretrained;
pub use raster::{Raster, RasterPitch};
pub use ring_scores::{RING_WIDTH_PX, RingScores};
pub use teacher::{PulseAllowance, Teacher, TeacherOptions};
