//! Annealing: a fixed number of pulses, moved about at falling temperature.
//!
//! First pulses are lifted and put back where the exact [gain map](crate::GainMap) is largest,
//! nearby or anywhere; then single pulses make Metropolis moves at sub-pixel positions (Metropolis
//! et al. 1953; Kirkpatrick et al. 1983), each judged by the exact change of reward.

mod completion;
mod cover;
mod cover_rows;
mod expected;
mod lattice;
mod metropolis;
mod options;
mod planner;
mod replacement;
mod replanning;
mod restarts;
mod run;
mod schedule;
mod window;

pub use completion::Completion;
pub use expected::{ExpectedCompletion, MAX_POINTING_ERROR_PX, PulseBlur};
pub use options::{AnnealBudget, AnnealOptions, MOVES_PER_REPLACEMENT, Ramp};
pub use planner::Anneal;
pub use replanning::{Replanning, ReplanningOptions};
