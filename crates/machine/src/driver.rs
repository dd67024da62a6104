//! What a machine must be able to do: stage, laser and camera.

use std::error::Error;

use lasergym_geom::Point;
use serde::{Deserialize, Serialize};

use crate::Frame;

/// Why a driver failed; decides what the job does about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum FaultKind {
    /// It did not answer in time.
    Timeout,
    /// The position is beyond the limits of the stage, or not a number.
    OutOfLimits,
    /// A door, an emergency stop or a shutter is open.
    Interlock,
    /// The device is gone.
    Disconnected,
    /// What it said cannot be true.
    Protocol,
    /// The stage did not come to rest where it was sent.
    OutOfTolerance,
    /// A position is not a number.
    NotFinite,
    /// A frame was exposed before it was asked for.
    StaleFrame,
    /// Pulse after pulse left nothing.
    LaserDead,
    /// Anything else.
    Other,
}

/// The error of a driver.
pub trait DriverError: Error + Send + Sync + 'static {
    /// What kind of fault it is.
    fn kind(&self) -> FaultKind;
}

/// Where a stage can go, µm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageLimits {
    /// Lowest x and y.
    pub least_um: Point,
    /// Highest x and y.
    pub most_um: Point,
}

impl StageLimits {
    /// Whether the stage can go to `position_um`; never for a NaN.
    #[must_use]
    pub fn contains(&self, position_um: Point) -> bool {
        (self.least_um.x..=self.most_um.x).contains(&position_um.x)
            && (self.least_um.y..=self.most_um.y).contains(&position_um.y)
    }
}

/// Carries the workpiece. Its position is the point of the workpiece that lies under the laser, µm:
/// x to the right, y down, (0, 0) the upper left corner of the pattern. 1 px of a pattern is 1 µm.
pub trait Stage: Send + 'static {
    /// The error of this driver.
    type Error: DriverError;

    /// Where the stage can go.
    fn limits_um(&self) -> StageLimits;

    /// Goes to `position_um` and returns when it has settled there.
    ///
    /// # Errors
    /// The position cannot be reached, or the device fails.
    fn move_to(&mut self, position_um: Point) -> Result<(), Self::Error>;

    /// Where the encoders say that the stage is.
    ///
    /// # Errors
    /// The device fails.
    fn position_um(&mut self) -> Result<Point, Self::Error>;

    /// Finds the origin of the encoders.
    ///
    /// # Errors
    /// The device fails.
    fn home(&mut self) -> Result<(), Self::Error>;

    /// Stops at once.
    ///
    /// # Errors
    /// The device fails.
    fn stop(&mut self) -> Result<(), Self::Error>;
}

/// Fires single pulses.
pub trait Laser: Send + 'static {
    /// The error of this driver.
    type Error: DriverError;

    /// Makes the laser ready to fire.
    ///
    /// # Errors
    /// The device fails, or an interlock is open.
    fn arm(&mut self) -> Result<(), Self::Error>;

    /// Fires one pulse.
    ///
    /// # Errors
    /// The device fails or is not armed. Whether the pulse was fired is then unknown.
    fn fire(&mut self) -> Result<(), Self::Error>;

    /// Makes the laser safe; harmless where it is safe already.
    ///
    /// # Errors
    /// The device fails.
    fn disarm(&mut self) -> Result<(), Self::Error>;
}

/// Sees the workpiece while the stage is at the imaging position.
pub trait Camera: Send + 'static {
    /// The error of this driver.
    type Error: DriverError;

    /// Sets the exposure time, s, above 0.
    ///
    /// # Errors
    /// The device fails or has no such exposure.
    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<(), Self::Error>;

    /// A frame whose exposure began after the call.
    ///
    /// # Errors
    /// The device fails.
    fn frame(&mut self) -> Result<Frame, Self::Error>;
}
