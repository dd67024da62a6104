//! A simulated stage with backlash, drift and settling errors.

use lasergym_geom::{Point, WORKPIECE_SIZE_PX};

use super::{Rig, SimulatedError};
use crate::{Stage, StageLimits};

/// The stage of a [`Rig`].
#[derive(Debug, Clone)]
pub struct SimulatedStage {
    rig: Rig,
}

impl SimulatedStage {
    pub(super) fn new(rig: Rig) -> Self {
        Self { rig }
    }
}

impl Stage for SimulatedStage {
    type Error = SimulatedError;

    fn limits_um(&self) -> StageLimits {
        let margin = self.rig.lock().state.options.stage_margin_um;
        let most = WORKPIECE_SIZE_PX as f64 + margin;
        StageLimits { least_um: Point::new(-margin, -margin), most_um: Point::new(most, most) }
    }

    fn move_to(&mut self, position_um: Point) -> Result<(), SimulatedError> {
        let limits = self.limits_um();
        if !limits.contains(position_um) {
            return Err(SimulatedError::OutOfLimits {
                x_um: position_um.x,
                y_um: position_um.y,
                least_um: limits.least_um.x,
                most_um: limits.most_um.x,
            });
        }
        self.rig.lock().travel(position_um);
        Ok(())
    }

    /// Where the screw stands: backlash, drift and vibration stay unseen.
    fn position_um(&mut self) -> Result<Point, SimulatedError> {
        let [x, y] = self.rig.lock().state.screw_um;
        Ok(Point::new(x, y))
    }

    /// Goes to the upper left corner of the pattern.
    fn home(&mut self) -> Result<(), SimulatedError> {
        self.move_to(Point::default())
    }

    fn stop(&mut self) -> Result<(), SimulatedError> {
        Ok(())
    }
}
