//! Pulses in firing order, the time a stage takes for them, and the files and pictures made from
//! them.
//!
//! Positions are workpiece pixels as in [`lasergym_geom`]: x right, y down. Files carry µm (CSV) or
//! mm (G-code); [`WorkpieceFrame`] says where the workpiece lies on the machine.
//!
//! Sources: Xie et al. 2022, "Motion control for laser machining via reinforcement learning" (the
//! pulse-by-pulse process and the trajectory picture); the GRBL 1.1 dialect of G-code.

mod apt_reader;
mod bitmap_outline;
mod color_ramp;
mod csv;
mod disc_union;
mod dwell_passes;
mod error;
mod gcode_dialect;
mod gcode_motion;
mod gcode_reader;
mod gcode_words;
mod gcode_writer;
mod line_source;
mod overlay;
mod pulse_path;
mod shortest_order;
mod stage_dynamics;
mod vector_step;
mod vector_table;
mod workpiece_frame;

pub use apt_reader::AptReader;
pub use csv::{CSV_HEADER, read_csv, write_csv};
pub use dwell_passes::{
    DwellPass, DwellPoint, PASSES_CSV_HEADER, PassGcodeOptions, write_passes_csv,
    write_passes_gcode,
};
pub use error::ToolpathError;
pub use gcode_dialect::{GcodeDialect, VectorGcode};
pub use gcode_motion::{GcodeMotion, GcodeMotionReader, NOTE_PREFIX};
pub use gcode_reader::read_gcode;
pub use gcode_writer::{GcodeOptions, TravelMove, write_gcode};
pub use line_source::{LineSource, MAX_LINE_BYTES};
pub use overlay::{OverlayOptions, Pulse, Trajectory, trajectory_svg};
pub use pulse_path::{MAX_POSITION_PX, MAX_PULSE_RADIUS_PX, MAX_PULSES, PulsePath};
pub use shortest_order::{shortest_order, tour_length};
pub use stage_dynamics::{StageDynamics, Travel, travel};
pub use vector_step::{MAX_VECTOR_UM, VectorStep, arc_chords};
pub use vector_table::VectorTableReader;
pub use workpiece_frame::{WorkpieceFrame, YAxis};

/// Longest text the readers accept, bytes: room for [`MAX_PULSES`] pulses of any writer.
pub const MAX_TEXT_BYTES: usize = 256 << 20;
