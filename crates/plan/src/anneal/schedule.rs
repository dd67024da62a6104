//! How much of a run's budget is spent.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use super::options::AnnealBudget;

/// The budget of one phase of one restart, and what is spent of it.
#[derive(Debug, Clone, Copy)]
pub(super) enum Schedule {
    /// Ends at a moment.
    Time { start: Instant, length: Duration },
    /// Ends after a number of iterations.
    Iterations { done: u64, total: u64 },
}

impl Schedule {
    /// The schedule of `share` of `budget`, whose iterations cost `moves_each` Metropolis moves.
    pub(super) fn new(budget: AnnealBudget, share: f64, moves_each: u64) -> Self {
        match budget {
            AnnealBudget::Time(time) => {
                Self::Time { start: Instant::now(), length: time.mul_f64(share) }
            }
            AnnealBudget::Iterations(total) => {
                Self::Iterations { done: 0, total: (total as f64 * share) as u64 / moves_each }
            }
        }
    }

    /// Part of the budget that is spent, in [0, 1].
    pub(super) fn fraction(&self) -> f64 {
        match *self {
            Self::Time { start, length } => {
                if length.is_zero() {
                    return 1.0;
                }
                (start.elapsed().as_secs_f64() / length.as_secs_f64()).min(1.0)
            }
            Self::Iterations { done, total } => {
                if total == 0 {
                    1.0
                } else {
                    done as f64 / total as f64
                }
            }
        }
    }

    /// The next iterations to do, at most `most`, or the end of the phase.
    pub(super) fn next(&mut self, most: u64) -> ControlFlow<(), u64> {
        match self {
            Self::Time { start, length } => {
                if start.elapsed() < *length {
                    ControlFlow::Continue(most)
                } else {
                    ControlFlow::Break(())
                }
            }
            Self::Iterations { done, total } => {
                let count = most.min(*total - *done);
                *done += count;
                if count > 0 { ControlFlow::Continue(count) } else { ControlFlow::Break(()) }
            }
        }
    }
}
