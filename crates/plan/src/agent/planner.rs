//! Whole plans by a trained policy.

use std::ops::ControlFlow;
use std::sync::Arc;

use crate::pulse_by_pulse::plan_pulse_by_pulse;
use crate::{Job, JobState, Plan, PlanError, PlanProgress, Planner, PlannerKind};

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
        let decide = |state: &JobState| {
            if state.is_finished() {
                return Ok(None);
            }
            self.agent.decide(state, &mut memory).map(Some)
        };
        plan_pulse_by_pulse(self.kind(), self.agent.start(job), decide, progress)
    }
}
