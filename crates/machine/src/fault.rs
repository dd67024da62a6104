//! What went wrong with a machine, and where.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{DriverError, FaultKind};

/// Longest message that is kept, bytes: drivers may print whole pages.
const MAX_MESSAGE_BYTES: usize = 2000;

/// Where a fault lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Device {
    /// The stage.
    Stage,
    /// The laser.
    Laser,
    /// The camera.
    Camera,
    /// What looks at the frames.
    Observer,
    /// What decides about the pulses.
    Planner,
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Stage => "stage",
            Self::Laser => "laser",
            Self::Camera => "camera",
            Self::Observer => "observer",
            Self::Planner => "planner",
        })
    }
}

/// A fault of a machine: it ends a job with the laser off and the stage stopped.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{device}: {message}")]
pub struct Fault {
    /// Where it lies.
    pub device: Device,
    /// What kind of fault it is.
    pub kind: FaultKind,
    /// What happened.
    pub message: String,
}

impl Fault {
    /// A fault of `device`; a long message is cut.
    #[must_use]
    pub fn new(device: Device, kind: FaultKind, message: impl Into<String>) -> Self {
        let mut message = message.into();
        if message.len() > MAX_MESSAGE_BYTES {
            let end = (0..=MAX_MESSAGE_BYTES).rev().find(|&end| message.is_char_boundary(end));
            message.truncate(end.unwrap_or(0));
        }
        Self { device, kind, message }
    }

    /// The fault that an error of a driver is.
    #[must_use]
    pub fn of(device: Device, error: &impl DriverError) -> Self {
        Self::new(device, error.kind(), error.to_string())
    }
}

impl DriverError for Fault {
    fn kind(&self) -> FaultKind {
        self.kind
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_message_is_cut_between_characters() {
        let fault = Fault::new(Device::Camera, FaultKind::Other, "µ".repeat(3000) + "x");
        assert_eq!(fault.message, "µ".repeat(1000));
        assert!(fault.to_string().starts_with("camera: µ"));
    }
}
