//! A simulated laser with energy noise, misfires and double fires.

use super::{Rig, SimulatedError};
use crate::Laser;

/// The laser of a [`Rig`].
#[derive(Debug, Clone)]
pub struct SimulatedLaser {
    rig: Rig,
}

impl SimulatedLaser {
    pub(super) fn new(rig: Rig) -> Self {
        Self { rig }
    }
}

impl Laser for SimulatedLaser {
    type Error = SimulatedError;

    fn arm(&mut self) -> Result<(), SimulatedError> {
        self.rig.lock().state.armed = true;
        Ok(())
    }

    /// Misfires and double fires answer like any pulse.
    fn fire(&mut self) -> Result<(), SimulatedError> {
        let mut world = self.rig.lock();
        if !world.state.armed {
            return Err(SimulatedError::NotArmed);
        }
        world.fire();
        Ok(())
    }

    fn disarm(&mut self) -> Result<(), SimulatedError> {
        self.rig.lock().state.armed = false;
        Ok(())
    }
}
