//! Environments that step together: what the batches of all processes have in common, and the random
//! stream of an environment.
//!
//! A process implements [`Batched`] for its environment; [`Batch`] then steps many of them, on one
//! thread or several, with the autoreset modes of Gymnasium. Results do not depend on the number of
//! threads.

mod batch;
mod batched;
mod episode;
mod error;
mod options;
mod share;
mod stream;

pub use batch::Batch;
pub use batched::{Batched, Landing};
pub use episode::{EpisodeStatistics, Phase, StepRecord};
pub use error::BatchError;
pub use options::{Autoreset, BatchOptions};
pub use stream::Stream;
