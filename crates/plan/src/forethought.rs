//! The plan for the rest of a job that is kept from decision to decision.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lasergym_geom::Point;

use crate::{
    Completion, Decider, ExpectedCompletion, Job, JobState, MAX_POINTING_ERROR_PX, PlanError,
    PulseBlur,
};

/// Metropolis moves between two looks at the clock.
const MOVES_AT_ONCE: u64 = 3000;

/// The same of moves that are judged by expected gain, which take longer.
const EXPECTED_MOVES_AT_ONCE: u64 = 600;

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

    /// Spends all on `refine`, which is told numbers of moves: with a time limit, counted from
    /// `began`, always `moves_at_once`.
    fn spend(self, began: Instant, moves_at_once: u64, mut refine: impl FnMut(u64)) {
        match self {
            Self::Moves(moves) => refine(moves),
            Self::Time(time) => loop {
                refine(moves_at_once);
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
    /// Standard deviation of the pulses' displacement, px; 0 plans for pulses that hit their aim.
    pointing_error_px: f64,
    /// What that makes of pulses of a radius.
    blur: Option<(f64, Arc<PulseBlur>)>,
}

impl Forethought {
    pub(crate) fn new(thinking: Thinking, seed: u64) -> Self {
        Self { thinking, seed, planned: Vec::new(), pointing_error_px: 0.0, blur: None }
    }

    /// Plans on the gain that is expected of pulses displaced by `pointing_error_px`.
    pub(crate) fn expect(&mut self, pointing_error_px: f64) -> Result<(), PlanError> {
        if !(0.0..=MAX_POINTING_ERROR_PX).contains(&pointing_error_px) {
            return Err(PlanError::InvalidOption {
                name: "pointing_error_px",
                value: pointing_error_px.to_string(),
                expected: "in [0, 8] px",
            });
        }
        self.pointing_error_px = pointing_error_px;
        self.blur = None;
        Ok(())
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
        let rest = state.rest()?;
        if self.pointing_error_px > 0.0 {
            return self.decide_expecting(&rest, seed, began);
        }
        let mut completion = Completion::new(&rest, &self.planned, seed)?;
        self.thinking.spend(began, MOVES_AT_ONCE, |moves| completion.refine(moves));
        self.planned = completion.positions();
        let best = (0..self.planned.len()).max_by_key(|&k| {
            // The first of equals.
            (state.gain_px(self.planned[k]), std::cmp::Reverse(k))
        });
        match best {
            Some(best) if state.gain_px(self.planned[best]) > 0 => {
                Ok(Some(self.planned.remove(best)))
            }
            _ => imagination.decide(state),
        }
    }

    /// Refines the plan by what is expected of it and takes out the pulse of largest expected gain;
    /// none where that is not above 0.
    fn decide_expecting(
        &mut self,
        rest: &Job,
        seed: u64,
        began: Instant,
    ) -> Result<Option<Point>, PlanError> {
        let radius_px = rest.pulse_radius_px();
        let blur = match &self.blur {
            Some((known_px, blur)) if known_px.total_cmp(&radius_px).is_eq() => Arc::clone(blur),
            _ => Arc::new(PulseBlur::new(radius_px, self.pointing_error_px)?),
        };
        let mut completion = ExpectedCompletion::new(rest, &self.planned, &blur, seed);
        self.blur = Some((radius_px, blur));
        self.thinking.spend(began, EXPECTED_MOVES_AT_ONCE, |moves| completion.refine(moves));
        self.planned = completion.positions();
        let gains_px: Vec<f64> =
            self.planned.iter().map(|&position| completion.first_gain_px(position)).collect();
        let best = (0..gains_px.len()).max_by(|&a, &b| gains_px[a].total_cmp(&gains_px[b]));
        Ok(best.filter(|&best| gains_px[best] > 0.0).map(|best| self.planned.remove(best)))
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
