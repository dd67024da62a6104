//! Whole plans by a trained policy.

use std::ops::ControlFlow;
use std::sync::Arc;

use crate::job::reward_of;
use crate::{Job, Plan, PlanError, PlanProgress, Planner, PlannerKind};

use super::policy_agent::PolicyAgent;

/// Lets a trained policy decide pulse after pulse, until none is left or nothing more is gained at
/// any pixel centre.
#[derive(Debug, Clone)]
pub struct AgentPlanner {
    /// The policy.
    pub agent: Arc<PolicyAgent>,
}

impl Planner for AgentPlanner {
    fn kind(&self) -> PlannerKind {
        PlannerKind::Policy
    }

    fn plan(
        &self,
        job: &Job,
        progress: &mut dyn FnMut(&PlanProgress<'_>) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        let mut memory = self.agent.memory();
        let mut state = self.agent.start(job);
        let mut positions = Vec::with_capacity(job.max_pulses().min(1024));
        let mut gain_px = 0;
        while !state.is_finished() {
            let position = self.agent.decide(&state, &mut memory)?;
            gain_px += state.pulse(position).gain_px();
            positions.push(position);
            let flow = progress(&PlanProgress {
                planner: self.kind(),
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
}
