//! What can go wrong with a job apart from its machine.

use std::io;

use lasergym_plan::PlanError;

use crate::Device;

/// Every error of a job that is not a [`crate::Fault`] of the machine.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// An option lies outside its range.
    #[error("{name} is {value}, but must be {expected}")]
    InvalidOption {
        /// Name of the option.
        name: &'static str,
        /// The value given.
        value: String,
        /// What is accepted.
        expected: &'static str,
    },
    /// The job itself is none.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The workpiece is not what a job begins with.
    #[error(
        "the workpiece is machined already: begin a job with a pristine one, or resume its own"
    )]
    NotPristine,
    /// The folder holds a job already.
    #[error("{path} holds a job already: resume it, or give another folder")]
    JobExists {
        /// The folder.
        path: String,
    },
    /// Another process works on the job.
    #[error("another process works on the job in {path}: wait for it, or stop it")]
    JobRuns {
        /// The folder.
        path: String,
    },
    /// The folder holds no job.
    #[error("{path} holds no job that could be resumed: {reason}")]
    NoJob {
        /// The folder.
        path: String,
        /// What is missing.
        reason: String,
    },
    /// The folder of the job cannot be written or read.
    #[error("cannot {action} {path}: {source}")]
    Storage {
        /// What was tried.
        action: &'static str,
        /// The file or folder.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// The journal has reached its size limit.
    #[error("the journal has reached {limit} bytes: begin another job")]
    JournalFull {
        /// Most bytes of a journal.
        limit: u64,
    },
    /// A record that could not be read back.
    #[error("a journal record cannot be written: {reason}")]
    Record {
        /// What does not fit.
        reason: String,
    },
    /// The intact part of the journal makes no sense.
    #[error(
        "record {n} of the journal makes no sense: {reason}; it is from another version, or edited"
    )]
    Journal {
        /// Sequence number of the record.
        n: u64,
        /// What does not fit.
        reason: String,
    },
    /// A frame that is needed to go on cannot be used.
    #[error(
        "{file} cannot be used ({reason}): without it nobody knows what has been machined since"
    )]
    Frame {
        /// The file.
        file: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The job is resumed in another way than it was begun.
    #[error("the job was begun with {name} {journal}, but is resumed with {given}: use the same")]
    DifferentJob {
        /// What differs.
        name: &'static str,
        /// As the job was begun.
        journal: String,
        /// As it is to be resumed.
        given: String,
    },
    /// A thread for a driver could not be started.
    #[error("could not start a thread for the {device}: {reason}")]
    Thread {
        /// Whose thread.
        device: Device,
        /// What the system said.
        reason: String,
    },
}
