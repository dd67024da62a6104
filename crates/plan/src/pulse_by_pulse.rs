//! Plans that grow by one pulse after another.

use std::ops::ControlFlow;

use crate::job::reward_of;
use crate::{Decider, Job, Plan, PlanError, PlanProgress, PlannerKind};

/// Plans `job` by firing where `decider` says, until it says nowhere, no pulse is left or `progress`,
/// told after each pulse, stops the `planner`.
///
/// # Errors
/// As [`Decider::decide`].
pub(crate) fn plan_pulse_by_pulse(
    planner: PlannerKind,
    job: &Job,
    decider: &mut dyn Decider,
    progress: &mut dyn FnMut(&PlanProgress<'_>) -> ControlFlow<()>,
) -> Result<Plan, PlanError> {
    let mut state = decider.start(job);
    let mut positions = Vec::new();
    let mut gain_px = 0;
    while state.pulses_left() > 0 {
        let Some(position) = decider.decide(&state)? else { break };
        gain_px += state.pulse(position).gain_px();
        positions.push(position);
        let flow = progress(&PlanProgress {
            planner,
            fraction: positions.len() as f64 / job.max_pulses() as f64,
            best_reward: reward_of(gain_px),
            best_positions: &positions,
        });
        if flow.is_break() {
            return Plan::new(job, positions, true);
        }
    }
    Plan::new(job, positions, false)
}
