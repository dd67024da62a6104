//! The pulse-by-pulse laser ablation process of Xie et al., "Motion control for laser machining via
//! reinforcement learning", Optics Express (2022): targets, pulses, reward, environments.
//!
//! A pulse machines every pixel whose centre lies within the pulse radius of its position. Each
//! pixel of the target that is machined earns one ten-thousandth, each pixel beside the target
//! costs as much, and ground that is already machined is free.
//!
//! ```
//! use lasergym_ablation::{Environment, Options, Task};
//!
//! let mut environment = Environment::new(Task::Star, Options::default())?;
//! environment.reset(Some(7));
//! let step = environment.step([0.0, 0.0])?;
//! assert_eq!(step.reward, 256.0 / 10_000.0);
//! # Ok::<(), lasergym_ablation::AblationError>(())
//! ```

mod action;
mod batch;
mod environment;
mod error;
mod footprint;
mod observation;
mod options;
mod random_shape;
mod score;
mod star;
mod task;
mod workpiece;

pub use action::{Action, position_px, reachable_position};
pub use batch::{Batch, BatchOptions, EpisodeStatistics, StepRecord};
pub use environment::{Environment, Progress, Step};
pub use error::AblationError;
pub use footprint::{Footprint, MAX_PULSE_RADIUS_PX, Pulse, Span};
pub use lasergym_batch::{Autoreset, Stream};
pub use observation::ObservationMode;
pub use options::{DEFAULT_PULSE_RADIUS_PX, Options};
pub use random_shape::{RandomShape, random_shape};
pub use score::{Score, score};
pub use star::{STAR_OUTER_RADIUS_PX, star};
pub use task::Task;
pub use workpiece::{PulseOutcome, REWARD_PER_PX, Workpiece};
