//! Deciding pulse by pulse: the interface of planners that see what every pulse has really done.

use lasergym_geom::Point;

use crate::{Job, JobState, PlanError};

/// Decides the next pulse from the state that the last one left, whatever that was.
pub trait Decider: Send {
    /// Weight of the ring in the scores that this decider reads, in [0, 1]; 0 where they are not read.
    fn ring_weight(&self) -> f64 {
        0.0
    }

    /// `job` before its first pulse, with the scores that this decider reads.
    fn start(&self, job: &Job) -> JobState {
        JobState::new(job, self.ring_weight())
    }

    /// Where the next pulse goes, px, or `None` when no further pulse is worth firing. `state` comes
    /// from [`Self::start`].
    ///
    /// # Errors
    /// Settings that do not fit the job, or a policy that fails.
    fn decide(&mut self, state: &JobState) -> Result<Option<Point>, PlanError>;

    /// Brings the memory to where it was after `decided` had been decided in `state`, for a job that
    /// goes on in another process. Told all decisions of the job in turn, a decider goes on as if it
    /// had made them. Those without memory have nothing to do.
    ///
    /// # Errors
    /// As [`Self::decide`].
    fn recall(&mut self, state: &JobState, decided: Point) -> Result<(), PlanError> {
        let _ = (state, decided);
        Ok(())
    }
}

impl<D: Decider + ?Sized> Decider for Box<D> {
    fn ring_weight(&self) -> f64 {
        (**self).ring_weight()
    }

    fn start(&self, job: &Job) -> JobState {
        (**self).start(job)
    }

    fn decide(&mut self, state: &JobState) -> Result<Option<Point>, PlanError> {
        (**self).decide(state)
    }

    fn recall(&mut self, state: &JobState, decided: Point) -> Result<(), PlanError> {
        (**self).recall(state, decided)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::zero_policy::spatial;
    use crate::{
        AnnealBudget, FixedPlan, Foresight, Greedy, PolicyDecider, Replanning, ReplanningOptions,
        Thinking,
    };
    use lasergym_ablation::{Stream, Workpiece, random_shape, star};
    use std::sync::Arc;

    fn deciders() -> Vec<Box<dyn Decider>> {
        let agent = Arc::new(spatial());
        let replanning = ReplanningOptions {
            first: AnnealBudget::Iterations(3000),
            thinking: Thinking::Moves(1000),
            seed: 5,
        };
        let fixed = (0..20).map(|k| Point::new(50.0 + f64::from(k), 50.0)).collect();
        vec![
            Box::new(Greedy { ring_weight: 0.35, ..Greedy::default() }),
            Box::new(PolicyDecider::new(Arc::clone(&agent))),
            Box::new(Foresight::new(agent, Thinking::Moves(1000), 5)),
            Box::new(Replanning::new(replanning).unwrap()),
            Box::new(FixedPlan::new(fixed).unwrap()),
        ]
    }

    /// The decisions of a whole job whose pulses land beside where they were aimed.
    fn decisions(decider: &mut dyn Decider, recall_first: usize, known: &[Point]) -> Vec<Point> {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 12).unwrap();
        let mut state = decider.start(&job);
        let mut stream = Stream::from_seed(4);
        let mut decided = Vec::new();
        while state.pulses_left() > 0 {
            let position = if decided.len() < recall_first {
                decider.recall(&state, known[decided.len()]).unwrap();
                known[decided.len()]
            } else {
                match decider.decide(&state).unwrap() {
                    Some(position) => position,
                    None => break,
                }
            };
            decided.push(position);
            state.pulse(position + stream.displacement(1.0));
        }
        decided
    }

    #[test]
    fn a_decider_that_recalls_goes_on_as_if_it_had_decided() {
        let whole: Vec<_> = deciders().iter_mut().map(|d| decisions(d, 0, &[])).collect();
        for recalled in [1, 5, 11] {
            for (decider, whole) in deciders().iter_mut().zip(&whole) {
                assert_eq!(whole.len(), 12);
                assert_eq!(&decisions(decider, recalled, whole), whole);
            }
        }
    }

    #[test]
    fn every_decider_but_an_open_loop_ends_with_the_job() {
        let target = random_shape(&mut Stream::from_seed(1)).target;
        let job = Job::new(Workpiece::new(&target).unwrap(), 9.0, 300).unwrap();
        for decider in &mut deciders()[..4] {
            let mut state = decider.start(&job);
            while let Some(position) = decider.decide(&state).unwrap() {
                state.pulse(position);
            }
            assert!(state.pulses_left() > 0);
            assert!(state.is_finished());
        }
    }
}
