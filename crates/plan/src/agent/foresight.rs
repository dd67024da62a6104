//! Think, then act: the rest of the job is imagined, refined and begun, pulse after pulse.

use std::ops::ControlFlow;
use std::sync::Arc;

use lasergym_geom::Point;

use crate::forethought::{Forethought, Thinking};
use crate::pulse_by_pulse::plan_pulse_by_pulse;
use crate::{Decider, Job, JobState, Plan, PlanError, PlanProgress, Planner, PlannerKind};

use super::planner::PolicyDecider;
use super::policy_agent::PolicyAgent;

/// Decides with a trained policy and a refined plan of all that is left.
///
/// The policy imagines the rest of the job, Metropolis moves refine it ([`crate::Completion`]), and
/// the pulse of it that gains most at once is fired. After whatever that pulse has really machined
/// the others are refined again: the plan is kept from decision to decision. Without any thinking the
/// policy decides alone.
#[derive(Debug)]
pub struct Foresight {
    policy: PolicyDecider,
    thinking: Thinking,
    forethought: Forethought,
}

impl Foresight {
    /// Foresight with the policy `agent`; `seed` is that of the moves.
    #[must_use]
    pub fn new(agent: Arc<PolicyAgent>, thinking: Thinking, seed: u64) -> Self {
        let forethought = Forethought::new(thinking, seed);
        Self { policy: PolicyDecider::new(agent), thinking, forethought }
    }
}

impl Decider for Foresight {
    fn ring_weight(&self) -> f64 {
        self.policy.ring_weight()
    }

    fn decide(&mut self, state: &JobState) -> Result<Option<Point>, PlanError> {
        if self.thinking.is_none() {
            return self.policy.decide(state);
        }
        self.forethought.decide(state, &mut self.policy)
    }

    fn recall(&mut self, state: &JobState, _: Point) -> Result<(), PlanError> {
        self.decide(state).map(|_| ())
    }
}

/// Whole plans by [`Foresight`].
#[derive(Debug, Clone)]
pub struct ForesightPlanner {
    /// The policy.
    pub agent: Arc<PolicyAgent>,
    /// How long is thought about each pulse. 20 ms are a good time.
    pub thinking: Thinking,
    /// Seed of the moves.
    pub seed: u64,
}

impl Planner for ForesightPlanner {
    fn kind(&self) -> PlannerKind {
        PlannerKind::AgentMpc
    }

    fn plan(
        &self,
        job: &Job,
        progress: &mut dyn FnMut(&PlanProgress<'_>) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        let mut foresight = Foresight::new(Arc::clone(&self.agent), self.thinking, self.seed);
        plan_pulse_by_pulse(self.kind(), job, &mut foresight, progress)
    }
}

#[cfg(test)]
mod tests {
    use super::super::zero_policy::spatial;
    use super::*;
    use crate::AgentPlanner;
    use lasergym_ablation::{Stream, Workpiece, random_shape, star};
    use std::time::Duration;

    fn planner(agent: &Arc<PolicyAgent>, thinking: Thinking) -> ForesightPlanner {
        ForesightPlanner { agent: Arc::clone(agent), thinking, seed: 3 }
    }

    fn job(seed: u64) -> Job {
        let target = random_shape(&mut Stream::from_seed(seed)).target;
        let pulses = target.area_px().div_ceil(125) as usize;
        Job::new(Workpiece::new(&target).unwrap(), 9.0, pulses).unwrap()
    }

    #[test]
    fn without_thought_it_is_the_policy() {
        let agent = Arc::new(spatial());
        for thinking in [Thinking::Moves(0), Thinking::Time(Duration::ZERO)] {
            let plan = planner(&agent, thinking).plan_to_end(&job(1)).unwrap();
            let alone = AgentPlanner { agent: Arc::clone(&agent) }.plan_to_end(&job(1)).unwrap();
            assert_eq!(plan, alone);
        }
    }

    #[test]
    fn thought_pays_and_the_same_seed_thinks_the_same() {
        let agent = Arc::new(spatial());
        let (mut thoughtful, mut alone) = (0.0, 0.0);
        for seed in 0..8 {
            let job = job(seed);
            let foresight = planner(&agent, Thinking::Moves(5000));
            let plan = foresight.plan_to_end(&job).unwrap();
            assert_eq!(plan, foresight.plan_to_end(&job).unwrap());
            assert_eq!(plan.score, job.score(&plan.positions).unwrap());
            assert!(plan.positions.len() <= job.max_pulses());
            thoughtful += plan.score.reward / job.reward_limit();
            let policy = AgentPlanner { agent: Arc::clone(&agent) };
            alone += policy.plan_to_end(&job).unwrap().score.reward / job.reward_limit();
        }
        assert!(thoughtful > alone + 8.0 * 0.005, "{thoughtful} {alone}");
    }

    #[test]
    fn a_pulse_that_lands_elsewhere_is_made_up_for() {
        let agent = Arc::new(spatial());
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 40).unwrap();
        let rewards = [0, 5000].map(|moves| {
            let mut stream = Stream::from_seed(4);
            let thinking = Thinking::Moves(moves);
            let mut foresight = Foresight::new(Arc::clone(&agent), thinking, 0);
            let mut state = agent.start(&job);
            let mut gain_px = 0;
            while !state.is_finished() {
                let position =
                    foresight.decide(&state).unwrap().unwrap() + stream.displacement(1.0);
                gain_px += state.pulse(position).gain_px();
            }
            gain_px
        });
        assert!(rewards[1] > rewards[0], "{rewards:?}");
    }

    #[test]
    fn a_time_limit_ends_the_thought() {
        let agent = Arc::new(spatial());
        let state = agent.start(&job(2));
        let thinking = Thinking::Time(Duration::from_millis(1));
        let mut foresight = Foresight::new(Arc::clone(&agent), thinking, 0);
        let position = foresight.decide(&state).unwrap().unwrap();
        assert!(state.gain_px(position) > 0);
    }

    #[test]
    fn pulses_too_wide_for_completions_are_refused() {
        let agent = Arc::new(spatial());
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 30.0, 3).unwrap();
        let error = planner(&agent, Thinking::Moves(10)).plan_to_end(&job).unwrap_err();
        assert!(matches!(error, PlanError::InvalidOption { name: "pulse_radius_px", .. }));
    }
}
