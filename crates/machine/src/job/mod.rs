//! Jobs in a closed loop: decide, fire, look, and go on from what was seen.

mod account;
mod controller;
mod options;
mod pointing;
mod recovery;
mod report;
mod rig;

pub use controller::MachineJob;
pub use options::{Drivers, JobDescription, JobOptions, ObserverMaker};
pub use report::{JobProgress, JobRecord, JobReport, JobStatus, PhaseTimes, read_job};
