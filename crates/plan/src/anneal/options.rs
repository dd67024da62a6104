//! Settings of the annealing planner.

use std::time::Duration;

use lasergym_geom::Point;

use crate::PlanError;
use crate::job::check_positions;

/// Metropolis moves that a re-placement counts for in an iteration budget: about the time it takes.
pub const MOVES_PER_REPLACEMENT: u64 = 50;

/// How long one restart works.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnnealBudget {
    /// Wall time of the whole plan, all restarts together.
    Time(Duration),
    /// Metropolis moves of each restart; a re-placement before them counts
    /// for [`MOVES_PER_REPLACEMENT`].
    /// The plan is then the same on every machine and for any number of threads.
    Iterations(u64),
}

impl Default for AnnealBudget {
    /// One second.
    fn default() -> Self {
        Self::Time(Duration::from_secs(1))
    }
}

/// A quantity that changes evenly from the beginning of a run to its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// Value at the beginning.
    pub from: f64,
    /// Value at the end.
    pub to: f64,
}

impl Ramp {
    /// The value after `fraction` of the run, on a geometric scale.
    #[must_use]
    pub(super) fn at(self, fraction: f64) -> f64 {
        self.from * (self.to / self.from).powf(fraction)
    }
}

/// Settings of [`crate::Anneal`].
#[derive(Debug, Clone, PartialEq)]
pub struct AnnealOptions {
    /// How long to work. Most of the gain comes in the first 0.1 s; ten times the time gains about
    /// another 0.0005 of the target's area.
    pub budget: AnnealBudget,
    /// Seed of the random numbers; each restart has a stream of its own.
    pub seed: u64,
    /// Independent runs, of which the best counts, in 1..=10 000. Under a time budget they share
    /// the time. Default 1: one long run does about as well
    /// as several short ones.
    pub restarts: usize,
    /// Threads that the restarts run on, in 1..=1024. Default 1.
    pub threads: usize,
    /// A plan to start from, which the result is never worse than; there may be fewer pulses than
    /// the job allows. Default `None`: start from the greedy plan.
    pub start: Option<Vec<Point>>,
    /// Part of the budget spent on re-placing pulses on pixel centres, in [0, 1]. Default 0.05: the
    /// rest does better at sub-pixel positions. 0 when the start is good already.
    pub replacement_share: f64,
    /// Temperature of the re-placements, px of gain, in [0.001, 1000]. Default 3 to 0.3.
    pub replacement_temperature_px: Ramp,
    /// Temperature of the Metropolis moves: a move that costs this many pixels of hits − misses is
    /// accepted once in e times. In [0.001, 1000]. Default 0.4 to 0.15: hotter than 0.3 in the end
    /// keeps pulses from settling, while colder hardly matters, since most moves that lead on cost
    /// nothing.
    pub temperature_px: Ramp,
    /// Standard deviation of a move along x and y, px, in [0.001, 1000]; steps end at 7 px.
    /// Default 1 to 0.3.
    pub step_px: Ramp,
    /// Part of the moves that put a pulse anywhere on the workpiece, in [0, 1]. Default 0.02.
    pub jump_share: f64,
}

impl Default for AnnealOptions {
    fn default() -> Self {
        Self {
            budget: AnnealBudget::default(),
            seed: 0,
            restarts: 1,
            threads: 1,
            start: None,
            replacement_share: 0.05,
            replacement_temperature_px: Ramp { from: 3.0, to: 0.3 },
            temperature_px: Ramp { from: 0.4, to: 0.15 },
            step_px: Ramp { from: 1.0, to: 0.3 },
            jump_share: 0.02,
        }
    }
}

impl AnnealOptions {
    /// Checks every setting, and that the plan to start from fits `max_pulses`.
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`] names the first setting out of range;
    /// [`PlanError::StartTooLong`], [`PlanError::PositionNotFinite`] for the plan to start from.
    pub fn validate(&self, max_pulses: usize) -> Result<(), PlanError> {
        let check = |ok: bool, name, value: String, expected| {
            if ok { Ok(()) } else { Err(PlanError::InvalidOption { name, value, expected }) }
        };
        match self.budget {
            AnnealBudget::Time(time) => {
                check(!time.is_zero(), "time budget", "0 s".to_owned(), "above 0")?;
            }
            AnnealBudget::Iterations(iterations) => {
                check(iterations > 0, "iterations", "0".to_owned(), "at least 1")?;
            }
        }
        let in_unit = |value: f64| (0.0..=1.0).contains(&value);
        check(
            (1..=10_000).contains(&self.restarts),
            "restarts",
            self.restarts.to_string(),
            "in 1..=10000",
        )?;
        check(
            (1..=1024).contains(&self.threads),
            "threads",
            self.threads.to_string(),
            "in 1..=1024",
        )?;
        for (name, share) in
            [("replacement_share", self.replacement_share), ("jump_share", self.jump_share)]
        {
            check(in_unit(share), name, share.to_string(), "in [0, 1]")?;
        }
        for (name, ramp) in [
            ("replacement_temperature_px", self.replacement_temperature_px),
            ("temperature_px", self.temperature_px),
            ("step_px", self.step_px),
        ] {
            let ok = [ramp.from, ramp.to].iter().all(|value| (1e-3..=1e3).contains(value));
            check(
                ok,
                name,
                format!("{} to {}", ramp.from, ramp.to),
                "in [0.001, 1000] throughout",
            )?;
        }
        let start = self.start.as_deref().unwrap_or_default();
        if start.len() > max_pulses {
            return Err(PlanError::StartTooLong { pulses: start.len(), max_pulses });
        }
        check_positions(start)
    }
}
