//! A simulated machine: stage, laser and camera that share one workpiece, with every error that a
//! real rig has as a named option. Time is virtual: nothing sleeps.

mod camera;
mod error;
mod ground;
mod laser;
mod options;
mod preset;
mod rig;
mod saved_rig;
mod stage;
mod state;
mod surface;
mod view;

pub use camera::SimulatedCamera;
pub use error::SimulatedError;
pub use laser::SimulatedLaser;
pub use options::{MAX_FRAME_SIDE_PX, SimulatorOptions};
pub use preset::Preset;
pub use rig::Rig;
pub use saved_rig::{Saved, SavedRig, SavedRigError};
pub use stage::SimulatedStage;
pub use state::{PhaseTimes, RigState, Speck, TrueMark};

use lasergym_geom::Point;

/// Where the stage stands when frames are taken, µm: the centre of the pattern under the laser.
pub const IMAGING_POSITION_UM: Point = Point::new(50.0, 50.0);
