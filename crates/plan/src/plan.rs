//! What a planner answers.

use lasergym_ablation::Score;
use lasergym_geom::Point;

use crate::{Job, PlanError};

/// Pulses in firing order and what they achieve.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Centres of the pulses in firing order, px.
    pub positions: Vec<Point>,
    /// What they add to the workpiece of the job, as [`Job::score`].
    pub score: Score,
    /// Whether the planner was stopped before it had finished; the plan is its best until then.
    pub partial: bool,
}

impl Plan {
    /// The plan of `positions`, judged on `job`.
    ///
    /// # Errors
    /// [`PlanError::PositionNotFinite`].
    pub fn new(job: &Job, positions: Vec<Point>, partial: bool) -> Result<Self, PlanError> {
        let score = job.score(&positions)?;
        Ok(Self { positions, score, partial })
    }
}
