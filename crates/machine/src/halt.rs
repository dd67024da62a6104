//! Why a job does not go on.

use crate::{Fault, JobError};

/// Why a job stops before it is done.
#[derive(Debug)]
pub(crate) enum Halt {
    /// The user wants to stop.
    Interrupted,
    /// The machine has failed.
    Fault(Fault),
    /// The job cannot be written down.
    Error(JobError),
}

impl From<Fault> for Halt {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<JobError> for Halt {
    fn from(error: JobError) -> Self {
        Self::Error(error)
    }
}
