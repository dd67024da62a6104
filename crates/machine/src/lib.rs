//! Laser machining under a camera: the drivers of a machine, a simulated one, the vision that finds
//! each mark, and jobs that correct what went wrong and lose nothing.

mod calibration;
mod calibration_run;
mod driver;
mod error;
mod fault;
mod frame;
mod halt;
mod interlock;
mod job;
mod journal;
mod observation;
pub mod simulator;
mod supervise;
pub mod vision;

pub use calibration::{
    CalibrationError, CalibrationModel, CalibrationOptions, CalibrationPair, CameraCalibration,
};
pub use calibration_run::CalibrationRun;
pub use driver::{Camera, DriverError, FaultKind, Laser, Stage, StageLimits};
pub use error::JobError;
pub use fault::{Device, Fault};
pub use frame::{Frame, FrameError};
pub use job::{
    Drivers, JobDescription, JobOptions, JobProgress, JobRecord, JobReport, JobStatus, MachineJob,
    ObserverMaker, PhaseTimes, read_job,
};
pub use journal::{
    BeginRecord, Damage, DamageKind, EndRecord, FaultRecord, FiredRecord, FramePreview,
    FrameRecord, IntentOrigin, IntentRecord, JOURNAL_VERSION, JobFolder, JobStorage,
    JournalReading, JournalVerdict, MAX_JOURNAL_BYTES, MarkRecord, ObservedRecord, PositionRecord,
    Record, ResumedRecord, frame_preview, read_journal,
};
pub use observation::{Mark, Observation, Observer, ObserverError, Verdict};
pub use supervise::{Deadlines, Supervised};
