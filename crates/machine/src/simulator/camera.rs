//! A simulated camera.

use std::time::Instant;

use super::{Rig, SimulatedError};
use crate::{Camera, Frame};

/// Longest exposure, s.
const MAX_EXPOSURE_S: f64 = 10.0;

/// The camera of a [`Rig`]. It looks at what lies about the laser, and shows ground up to 12 µm
/// beyond what it sees from the imaging position; farther away it shows the last of that.
#[derive(Debug, Clone)]
pub struct SimulatedCamera {
    rig: Rig,
}

impl SimulatedCamera {
    pub(super) fn new(rig: Rig) -> Self {
        Self { rig }
    }
}

impl Camera for SimulatedCamera {
    type Error = SimulatedError;

    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<(), SimulatedError> {
        if exposure_s > 0.0 && exposure_s <= MAX_EXPOSURE_S {
            self.rig.lock().state.exposure_s = exposure_s;
            Ok(())
        } else {
            Err(SimulatedError::Exposure { exposure_s, most_s: MAX_EXPOSURE_S })
        }
    }

    fn frame(&mut self) -> Result<Frame, SimulatedError> {
        let taken_at = Instant::now();
        let mut world = self.rig.lock();
        let gray = world.expose();
        let options = &world.state.options;
        let (width_px, height_px) = (options.frame_width_px, options.frame_height_px);
        Frame::new(width_px, height_px, gray, taken_at)
            .map_err(|error| SimulatedError::State { reason: error.to_string() })
    }
}
