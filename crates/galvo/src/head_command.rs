//! What a controller tells a head, its laser and whoever watches.

use lasergym_geom::Point;

use crate::GalvoError;
use crate::player::Purpose;

/// One end of a stroke as it was drawn, without run-in and run-out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrokeEnd {
    /// Number of the stroke, from 0.
    pub stroke: u64,
    /// Where it was drawn, µm.
    pub at_um: Point,
    /// Direction of the stroke there, of length 1.
    pub direction: Point,
    /// Speed there, m/s.
    pub speed_m_s: f64,
    /// Crater diameter by which the stroke was shortened, µm.
    pub beam_um: f64,
}

/// One command. Time goes on with moves only: now is the end of the last one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HeadCommand {
    /// The head rests at a place; only before it has moved.
    Rest {
        /// The place, µm.
        at_um: Point,
    },
    /// Straight to a place at constant speed; where it is the same, the head stands still.
    Move {
        /// The place, µm.
        to_um: Point,
        /// How long it takes, µs; nothing happens at 0.
        duration_us: f64,
        /// What the time is for.
        purpose: Purpose,
    },
    /// The laser is switched on.
    LaserOn {
        /// How long after now, µs; before now where negative.
        after_us: f64,
        /// Pulses per second, Hz.
        pulse_rate_hz: f64,
        /// The stroke to which its pulses belong.
        stroke: u64,
    },
    /// The laser is switched off.
    LaserOff {
        /// How long after now, µs; before now where negative.
        after_us: f64,
    },
    /// A stroke begins.
    StrokeBegins(StrokeEnd),
    /// A stroke will have a corner.
    Corner {
        /// Number of the stroke.
        stroke: u64,
        /// Where, µm.
        at_um: Point,
        /// Within which distance a lagging beam rounds it off, about, µm.
        reach_um: f64,
    },
    /// The commands of a stroke have ended; its last pulses may still come.
    StrokeEnds(StrokeEnd),
    /// The workpiece goes to another height.
    Layer {
        /// The height, µm.
        z_um: f64,
    },
}

/// Takes the commands of a controller.
pub trait CommandSink {
    /// Takes the next command.
    ///
    /// # Errors
    /// What the sink cannot do.
    fn take(&mut self, command: &HeadCommand) -> Result<(), GalvoError>;

    /// From now on the laser is switched at most `hold_us` before the command has come so far.
    fn hold_at_least(&mut self, hold_us: f64);
}
