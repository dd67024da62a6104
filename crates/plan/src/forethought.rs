//! The plan for the rest of a job that is kept from decision to decision.

use std::time::{Duration, Instant};

use lasergym_geom::Point;

use crate::{Completion, Decider, JobState, PlanError};

/// Metropolis moves between two looks at the clock.
const MOVES_AT_ONCE: u64 = 3000;

/// How long is thought about each pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Thinking {
    /// Wall time of a decision; with none nothing is refined.
    Time(Duration),
    /// Metropolis moves of a decision, the same on every machine; with none nothing is refined.
    Moves(u64),
}

impl Thinking {
    /// Whether there is nothing to spend.
    #[must_use]
    pub(crate) fn is_none(self) -> bool {
        matches!(self, Self::Time(Duration::ZERO) | Self::Moves(0))
    }

    /// Refines `completion`, counting the time from `began`.
    fn refine(self, completion: &mut Completion, began: Instant) {
        match self {
            Self::Moves(moves) => completion.refine(moves),
            Self::Time(time) => loop {
                completion.refine(MOVES_AT_ONCE);
                if began.elapsed() >= time {
                    break;
                }
            },
        }
    }
}

/// Pulses that are still to come, refined before each decision.
#[derive(Debug, Clone)]
pub(crate) struct Forethought {
    thinking: Thinking,
    seed: u64,
    planned: Vec<Point>,
}

impl Forethought {
    pub(crate) fn new(thinking: Thinking, seed: u64) -> Self {
        Self { thinking, seed, planned: Vec::new() }
    }

    /// Whether no pulse is planned yet.
    pub(crate) fn is_empty(&self) -> bool {
        self.planned.is_empty()
    }

    /// Goes on from `planned`.
    pub(crate) fn set(&mut self, planned: Vec<Point>) {
        self.planned = planned;
    }

    /// Lets `imagination` add the pulses that the plan does not have yet, refines all of them
    /// ([`Completion`]) and takes the one that gains most at once out of the plan.
    ///
    /// # Errors
    /// As [`Decider::decide`], and [`PlanError::InvalidOption`] for pulses of a radius above 24 px.
    pub(crate) fn decide(
        &mut self,
        state: &JobState,
        imagination: &mut dyn Decider,
    ) -> Result<Option<Point>, PlanError> {
        if state.is_finished() {
            return Ok(None);
        }
        let began = Instant::now();
        self.planned.truncate(state.pulses_left());
        self.imagine(state, imagination)?;
        let seed = self.seed.wrapping_add(state.pulses_left() as u64);
        let mut completion = Completion::new(&state.rest()?, &self.planned, seed)?;
        self.thinking.refine(&mut completion, began);
        self.planned = completion.positions();
        let best = (0..self.planned.len()).max_by_key(|&k| {
            // The first of equals.
            (state.gain_px(self.planned[k]), std::cmp::Reverse(k))
        });
        match best {
            Some(best) => Ok(Some(self.planned.remove(best))),
            None => imagination.decide(state),
        }
    }

    fn imagine(
        &mut self,
        state: &JobState,
        imagination: &mut dyn Decider,
    ) -> Result<(), PlanError> {
        if self.planned.len() == state.pulses_left() {
            return Ok(());
        }
        let mut imagined = state.clone();
        for &position in &self.planned {
            imagined.pulse(position);
        }
        while !imagined.is_finished() {
            let Some(position) = imagination.decide(&imagined)? else { break };
            imagined.pulse(position);
            self.planned.push(position);
        }
        Ok(())
    }
}
