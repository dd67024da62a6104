//! Annealing again after every pulse.

use lasergym_geom::Point;

use crate::forethought::{Forethought, Thinking};
use crate::{Decider, Greedy, JobState, PlanError, Planner};

use super::{Anneal, AnnealBudget, AnnealOptions};

/// Weight of the ring for the pulses that the plan lacks: the one that does best on random shapes.
const RING_WEIGHT: f64 = 0.35;

/// Settings of [`Replanning`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReplanningOptions {
    /// How long the plan before the first pulse takes.
    pub first: AnnealBudget,
    /// How long the rest of the plan is refined before each pulse.
    pub thinking: Thinking,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for ReplanningOptions {
    /// Half a million moves first, 20 000 before each pulse: the same on every machine, and about a
    /// second and 3 ms.
    fn default() -> Self {
        Self {
            first: AnnealBudget::Iterations(500_000),
            thinking: Thinking::Moves(20_000),
            seed: 0,
        }
    }
}

/// Anneals a plan for the whole job, fires the pulse of it that gains most at once, and anneals the
/// rest again from what was really machined.
#[derive(Debug, Clone)]
pub struct Replanning {
    options: ReplanningOptions,
    greedy: Greedy,
    forethought: Forethought,
}

impl Replanning {
    /// Replanning with `options`.
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`] for an empty budget.
    pub fn new(options: ReplanningOptions) -> Result<Self, PlanError> {
        anneal_options(options).validate(0)?;
        let greedy = Greedy { ring_weight: RING_WEIGHT, ..Greedy::default() };
        let forethought = Forethought::new(options.thinking, options.seed);
        Ok(Self { options, greedy, forethought })
    }
}

fn anneal_options(options: ReplanningOptions) -> AnnealOptions {
    AnnealOptions { budget: options.first, seed: options.seed, ..AnnealOptions::default() }
}

impl Decider for Replanning {
    fn ring_weight(&self) -> f64 {
        self.greedy.ring_weight
    }

    fn decide(&mut self, state: &JobState) -> Result<Option<Point>, PlanError> {
        if self.forethought.is_empty() && !state.is_finished() {
            let anneal = Anneal { options: anneal_options(self.options) };
            self.forethought.set(anneal.plan_to_end(&state.rest()?)?.positions);
        }
        self.forethought.decide(state, &mut self.greedy)
    }

    fn recall(&mut self, state: &JobState, _: Point) -> Result<(), PlanError> {
        self.decide(state).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FixedPlan, Job};
    use lasergym_ablation::{Stream, Workpiece, random_shape};
    use std::time::Duration;

    fn jobs() -> Vec<Job> {
        (0..6)
            .map(|seed| {
                let target = random_shape(&mut Stream::from_seed(seed)).target;
                let pulses = target.area_px().div_ceil(125) as usize;
                Job::new(Workpiece::new(&target).unwrap(), 9.0, pulses).unwrap()
            })
            .collect()
    }

    fn gain_px(job: &Job, decider: &mut dyn Decider, displacement_px: f64) -> i32 {
        let mut stream = Stream::from_seed(4);
        let mut state = decider.start(job);
        let mut gain_px = 0;
        while state.pulses_left() > 0 {
            let Some(position) = decider.decide(&state).unwrap() else { break };
            gain_px += state.pulse(position + stream.displacement(displacement_px)).gain_px();
        }
        gain_px
    }

    fn replanning() -> Replanning {
        let options = ReplanningOptions {
            first: AnnealBudget::Iterations(50_000),
            thinking: Thinking::Moves(5000),
            seed: 1,
        };
        Replanning::new(options).unwrap()
    }

    #[test]
    fn it_beats_greedy() {
        let greedy = Greedy { ring_weight: RING_WEIGHT, ..Greedy::default() };
        let gains =
            |job: &Job| [gain_px(job, &mut replanning(), 0.0), gain_px(job, &mut { greedy }, 0.0)];
        let [replanned, greedy] =
            jobs().iter().map(gains).fold([0; 2], |sum, g| [sum[0] + g[0], sum[1] + g[1]]);
        assert!(replanned > greedy, "{replanned} {greedy}");
    }

    #[test]
    fn it_beats_its_own_plan_open_loop_where_pulses_land_elsewhere() {
        let (mut replanned, mut fixed) = (0, 0);
        for job in jobs() {
            let anneal = Anneal { options: anneal_options(replanning().options) };
            let positions = anneal.plan_to_end(&job).unwrap().positions;
            fixed += gain_px(&job, &mut FixedPlan::new(positions).unwrap(), 1.0);
            replanned += gain_px(&job, &mut replanning(), 1.0);
        }
        assert!(replanned > fixed, "{replanned} {fixed}");
    }

    #[test]
    fn an_empty_budget_is_refused() {
        let first = AnnealBudget::Time(Duration::ZERO);
        let error = Replanning::new(ReplanningOptions { first, ..ReplanningOptions::default() });
        assert!(matches!(error, Err(PlanError::InvalidOption { name: "time budget", .. })));
    }
}
