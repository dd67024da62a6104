//! A job under way: what has been machined, and how promising every place is now.

use lasergym_ablation::{PulseOutcome, Workpiece};
use lasergym_geom::Point;

use crate::{Job, PlanError, RingScores};

/// A job after some of its pulses, for planners that decide pulse by pulse.
#[derive(Debug, Clone)]
pub struct JobState {
    job: Job,
    workpiece: Workpiece,
    scores: RingScores,
    pulses_left: usize,
}

impl JobState {
    /// `job` before its first pulse, with ring scores of `ring_weight`.
    #[must_use]
    pub fn new(job: &Job, ring_weight: f64) -> Self {
        Self {
            workpiece: job.workpiece().clone(),
            scores: RingScores::new(job.workpiece(), job.pulse_radius_px(), ring_weight),
            pulses_left: job.max_pulses(),
            job: job.clone(),
        }
    }

    /// The job as it was before the first pulse.
    #[must_use]
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// The workpiece now.
    #[must_use]
    pub fn workpiece(&self) -> &Workpiece {
        &self.workpiece
    }

    /// How promising each pixel centre is now.
    #[must_use]
    pub fn scores(&self) -> &RingScores {
        &self.scores
    }

    /// Pulses that the job still allows.
    #[must_use]
    pub fn pulses_left(&self) -> usize {
        self.pulses_left
    }

    /// Hits − misses that a pulse at `position` would add, px.
    #[must_use]
    #[inline]
    pub fn gain_px(&self, position: Point) -> i32 {
        self.workpiece.preview(&self.job.footprint(position)).gain_px()
    }

    /// The ring score of a pulse at `position`, px: what [`RingScores`] says of pixel centres, at any
    /// place; −∞ where it would gain nothing.
    #[must_use]
    pub fn score_px(&self, position: Point) -> f64 {
        let outcome = self.workpiece.preview(&self.job.footprint(position));
        if outcome.gain_px() <= 0 {
            return f64::NEG_INFINITY;
        }
        f64::from(outcome.gain_px())
            - self.scores.ring_penalty_px(&self.workpiece, position, outcome)
    }

    /// Whether no pulse is left, or none at a pixel centre would gain anything.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.pulses_left == 0 || self.scores.gains().best().2 <= 0
    }

    /// What is left of the job, as one of its own.
    ///
    /// # Errors
    /// [`PlanError::NothingRemains`], [`PlanError::NoPulses`] for a job that is done.
    pub fn rest(&self) -> Result<Job, PlanError> {
        Job::new(self.workpiece.clone(), self.job.pulse_radius_px(), self.pulses_left)
    }

    /// Machines a pulse at `position` and counts it.
    pub fn pulse(&mut self, position: Point) -> PulseOutcome {
        self.pulses_left = self.pulses_left.saturating_sub(1);
        self.scores.pulse(&mut self.workpiece, &self.job, position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_ablation::star;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn gains_add_up_to_the_outcome_of_the_plan(
            pulses in proptest::collection::vec((0.0..100.0, 0.0..100.0), 1..20),
        ) {
            let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 20).unwrap();
            let positions: Vec<Point> = pulses.iter().map(|&(x, y)| Point::new(x, y)).collect();
            let mut state = JobState::new(&job, 0.35);
            let mut sum_px = 0;
            for &position in &positions {
                let score_px = state.score_px(position);
                prop_assert_eq!(score_px.is_finite(), state.gain_px(position) > 0);
                let expected_px = state.gain_px(position);
                prop_assert_eq!(state.pulse(position).gain_px(), expected_px);
                sum_px += expected_px;
            }
            prop_assert_eq!(sum_px, job.outcome(&positions).gain_px());
            prop_assert_eq!(state.pulses_left(), 20 - positions.len());
        }
    }

    #[test]
    fn a_job_without_pulses_left_is_finished() {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 1).unwrap();
        let mut state = JobState::new(&job, 0.0);
        assert!(!state.is_finished());
        state.pulse(Point::new(50.0, 50.0));
        assert!(state.is_finished());
    }
}
