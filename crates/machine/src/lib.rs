//! Laser machining under a camera: the drivers of a machine, a simulated one, the vision that finds
//! each mark, and jobs that correct what went wrong and lose nothing.

mod calibration;
mod calibration_run;
mod driver;
mod frame;
mod observation;
pub mod simulator;
pub mod vision;

pub use calibration::{
    CalibrationError, CalibrationModel, CalibrationOptions, CalibrationPair, CameraCalibration,
};
pub use calibration_run::CalibrationRun;
pub use driver::{Camera, DriverError, FaultKind, Laser, Stage, StageLimits};
pub use frame::{Frame, FrameError};
pub use observation::{Mark, Observation, Observer, ObserverError, Verdict};
