//! What the simulated devices refuse.

use crate::{DriverError, FaultKind};

/// Every error of the simulator.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulatedError {
    /// An option outside its range.
    #[error("{name} is {value}, but must be in [{least}, {most}]")]
    InvalidOption {
        /// Name of the option.
        name: &'static str,
        /// The value given.
        value: f64,
        /// Lowest value that is accepted.
        least: f64,
        /// Highest value that is accepted.
        most: f64,
    },
    /// A name that no preset has.
    #[error("there is no preset named {name:?}: use one of {accepted}")]
    UnknownPreset {
        /// The name given.
        name: String,
        /// The names there are.
        accepted: String,
    },
    /// A position beyond the limits of the stage.
    #[error("the stage cannot go to ({x_um}, {y_um}) µm: each must be in [{least_um}, {most_um}]")]
    OutOfLimits {
        /// x, µm.
        x_um: f64,
        /// y, µm.
        y_um: f64,
        /// Lowest coordinate, µm.
        least_um: f64,
        /// Highest coordinate, µm.
        most_um: f64,
    },
    /// Firing a laser that is not armed.
    #[error("the laser is not armed: arm it before it fires")]
    NotArmed,
    /// An exposure that the camera does not have.
    #[error("the camera cannot expose for {exposure_s} s: give a time in (0, {most_s}] s")]
    Exposure {
        /// Exposure asked for, s.
        exposure_s: f64,
        /// Longest exposure, s.
        most_s: f64,
    },
    /// A saved state that is none.
    #[error("this is not the state of a rig ({reason}): save it again")]
    State {
        /// What does not fit.
        reason: String,
    },
}

impl DriverError for SimulatedError {
    fn kind(&self) -> FaultKind {
        match self {
            Self::OutOfLimits { .. } => FaultKind::OutOfLimits,
            Self::NotArmed => FaultKind::Interlock,
            _ => FaultKind::Other,
        }
    }
}
