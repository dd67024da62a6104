//! Greedy planning: the next pulse is the one that gains most at once.

use std::ops::ControlFlow;

use lasergym_geom::Point;

use crate::polish::{PolishOptions, polish};
use crate::pulse_by_pulse::plan_pulse_by_pulse;
use crate::{Decider, Job, JobState, Plan, PlanError, PlanProgress, Planner, PlannerKind};

/// Pulse after pulse, each where hits − misses − `ring_weight` × (target left within 3 px about the
/// mark) is largest at a pixel centre, then polished by its immediate gain. Ends when no pulse
/// gains anything or the job allows no more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Greedy {
    /// How much a remaining target pixel in the ring about a pulse counts against it, in [0, 1].
    /// Above 0 pulses hug borders and finished ground and leave fewer strips; 0.35 does best on
    /// random shapes. Default 0: the immediate gain alone.
    pub ring_weight: f64,
    /// Sub-pixel refinement of each pulse.
    pub polish: PolishOptions,
}

impl Default for Greedy {
    fn default() -> Self {
        Self { ring_weight: 0.0, polish: PolishOptions::default() }
    }
}

impl Greedy {
    fn validate(&self) -> Result<(), PlanError> {
        if !(0.0..=1.0).contains(&self.ring_weight) {
            return Err(PlanError::InvalidOption {
                name: "ring_weight",
                value: self.ring_weight.to_string(),
                expected: "in [0, 1]",
            });
        }
        self.polish.validate()
    }
}

impl Decider for Greedy {
    fn ring_weight(&self) -> f64 {
        self.ring_weight
    }

    fn decide(&mut self, state: &JobState) -> Result<Option<Point>, PlanError> {
        self.validate()?;
        let (row, column) = state.scores().best();
        let center = Point::new(column as f64 + 0.5, row as f64 + 0.5);
        let (position, gain_px) = polish(state.job(), state.workpiece(), center, self.polish);
        Ok((gain_px > 0).then_some(position))
    }
}

impl Planner for Greedy {
    fn kind(&self) -> PlannerKind {
        PlannerKind::Greedy
    }

    fn plan(
        &self,
        job: &Job,
        progress: &mut dyn FnMut(&PlanProgress<'_>) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        plan_pulse_by_pulse(self.kind(), job, &mut { *self }, progress)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_ablation::{Workpiece, star};

    fn job(max_pulses: usize) -> Job {
        Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, max_pulses).unwrap()
    }

    fn gains(job: &Job, positions: &[Point]) -> Vec<i32> {
        let mut workpiece = job.workpiece().clone();
        positions.iter().map(|&p| workpiece.pulse(&job.footprint(p)).gain_px()).collect()
    }

    #[test]
    fn without_polish_no_pulse_gains_more_than_the_one_before() {
        let greedy = Greedy {
            polish: PolishOptions { range_px: 0.0, ..PolishOptions::default() },
            ..Greedy::default()
        };
        let plan = greedy.plan_to_end(&job(100)).unwrap();
        let gains = gains(&job(100), &plan.positions);
        assert!(gains.is_sorted_by(|a, b| a >= b), "{gains:?}");
        assert!(gains.iter().all(|&gain| gain > 0));
    }

    #[test]
    fn greedy_ends_when_nothing_is_gained_or_the_budget_is_spent() {
        assert_eq!(Greedy::default().plan_to_end(&job(7)).unwrap().positions.len(), 7);
        let plan = Greedy::default().plan_to_end(&job(10_000)).unwrap();
        assert!(plan.positions.len() < 200, "{}", plan.positions.len());
        assert!(!plan.partial);
    }

    #[test]
    fn polish_raises_the_reward_on_the_star() {
        let plain = Greedy {
            polish: PolishOptions { range_px: 0.0, ..PolishOptions::default() },
            ..Greedy::default()
        };
        let [plain, polished] =
            [plain, Greedy::default()].map(|greedy| greedy.plan_to_end(&job(40)).unwrap());
        assert!(polished.score.reward > plain.score.reward);
        assert!(polished.score.reward >= 0.459, "{:?}", polished.score);
    }

    #[test]
    fn a_cancelled_plan_is_the_beginning_of_the_whole_one() {
        let whole = Greedy::default().plan_to_end(&job(20)).unwrap();
        let mut calls = 0;
        let part = Greedy::default()
            .plan(&job(20), &mut |progress| {
                calls += 1;
                assert_eq!(progress.best_positions.len(), calls);
                if calls == 5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })
            .unwrap();
        assert!(part.partial);
        assert_eq!(part.positions, whole.positions[..5]);
    }

    #[test]
    fn a_ring_weight_out_of_range_is_refused() {
        for ring_weight in [-0.1, 1.1, f64::NAN] {
            let error =
                Greedy { ring_weight, ..Greedy::default() }.plan_to_end(&job(1)).unwrap_err();
            assert!(matches!(error, PlanError::InvalidOption { name: "ring_weight", .. }));
        }
    }

    #[test]
    fn the_ring_score_works_with_every_radius() {
        for radius_px in [0.4, 9.0, 49.0, 50.0] {
            let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), radius_px, 5).unwrap();
            let plan = Greedy { ring_weight: 0.35, ..Greedy::default() }.plan_to_end(&job).unwrap();
            assert!(plan.score.reward > 0.0 || radius_px > 40.0);
        }
    }
}
