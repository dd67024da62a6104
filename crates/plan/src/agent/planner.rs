//! A trained policy as a decider, and whole plans by it.

use std::ops::ControlFlow;
use std::sync::Arc;

use lasergym_geom::Point;

use crate::pulse_by_pulse::plan_pulse_by_pulse;
use crate::{Decider, Job, JobState, Plan, PlanError, PlanProgress, Planner, PlannerKind};

use super::policy_agent::{AgentMemory, PolicyAgent};

/// Lets a trained policy decide pulse after pulse, until nothing more is gained at any pixel centre.
#[derive(Debug)]
pub struct PolicyDecider {
    agent: Arc<PolicyAgent>,
    memory: AgentMemory,
}

impl PolicyDecider {
    /// Decisions of `agent`.
    #[must_use]
    pub fn new(agent: Arc<PolicyAgent>) -> Self {
        Self { memory: agent.memory(), agent }
    }
}

impl Decider for PolicyDecider {
    fn ring_weight(&self) -> f64 {
        self.agent.decision().ring_weight()
    }

    fn decide(&mut self, state: &JobState) -> Result<Option<Point>, PlanError> {
        if state.is_finished() {
            return Ok(None);
        }
        self.agent.decide(state, &mut self.memory).map(Some)
    }
}

/// Whole plans by a trained policy.
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
        let mut decider = PolicyDecider::new(Arc::clone(&self.agent));
        plan_pulse_by_pulse(self.kind(), job, &mut decider, progress)
    }
}
