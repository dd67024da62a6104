//! Scan heads: how their mirrors follow a command, and how to command them so that lines come out
//! as long as drawn and pulses equally far apart.
//!
//! Sources: Penchev et al., "A software solution for beam deflector dynamics: adaptive
//! postprocessor" (the compensation by offsets and delays); SCANLAB's RTC manuals (delays, sky
//! writing, tracking error).
//!
//! Positions are µm, x right and y up; times µs; speeds m/s, which are µm/µs.

mod any_program;
mod approach;
mod axis;
mod calibration;
mod compensation;
mod controller;
mod correction;
mod delays;
mod energy_map;
mod error;
mod field;
mod head_command;
mod identification;
mod judge;
mod laser;
mod least_squares;
mod limited_servo;
mod line_set;
mod line_task;
mod line_trial;
mod micro_vector_list;
mod micro_vector_reader;
mod player;
mod postprocessor;
mod program;
mod program_file;
mod rtc_list;
mod scan_head;
mod servo;
mod settings_note;
mod simulate;
mod step_response;
mod student_t;
mod table;
mod test_line;
mod watched_head;

pub use any_program::AnyProgram;
pub use axis::{AxisModel, Follower};
pub use calibration::{
    Axis, Calibration, HeadCalibration, MeasuredLength, Regression, TEST_LINE_HEADER,
    TEST_LINE_OPTIONAL, TestLine, read_test_lines,
};
pub use compensation::{
    Compensation, DEFAULT_PITCH_TOLERANCE, HeadKnowledge, KnownAxes, Method, StraightStroke,
};
pub use controller::ProgramRun;
pub use correction::{CORRECTION_VALUES, Correction, SpeedCorrection};
pub use delays::{Delays, SkyWriting, SkyWritingMode};
pub use energy_map::{EnergyMap, MAX_MAP_CELLS};
pub use error::GalvoError;
pub use field::Field;
pub use head_command::{CommandSink, HeadCommand, StrokeEnd};
pub use identification::{
    Identification, MAX_TRAJECTORY_SAMPLES, ModelFamily, TRAJECTORY_HEADER, TrajectorySample,
    identify, identify_best, read_trajectory,
};
pub use judge::{Judge, Report, StrokeMeasure};
pub use laser::{Laser, PulseTrain};
pub use limited_servo::LimitedServo;
pub use line_set::{LineKind, LineSet};
pub use line_task::{LINE_ACTION, LINE_OBSERVATION, LineOptions, LineTask};
pub use line_trial::{LineOutcome, LineScales, LineTrial, PulseFit};
pub use micro_vector_list::{MICRO_VECTOR_HEADER, MicroVectorList};
pub use micro_vector_reader::MicroVectorReader;
pub use player::{Player, PulseLanding, Purpose, TimeSplit};
pub use postprocessor::{LaserControl, PostOptions, Postprocessor, PulseGrid};
pub use program::{ProgramSettings, ProgramStep};
pub use program_file::{JobReader, ProgramFormat, ProgramReader, ProgramWriter};
pub use rtc_list::RTC_LIST_HEADER;
pub use scan_head::{Controller, PENCHEV_LAG_US, ScanHead};
pub use servo::{MirrorState, ServoPoles};
pub use simulate::{Unobserved, postprocess, postprocess_text, simulate, simulate_steps};
pub use step_response::{MAX_STEP_SAMPLES, STEP_RESPONSE_HEADER, StepResponse};
pub use test_line::{AccelerationEnd, measure_line, test_pattern};
pub use watched_head::{MAX_PROGRAM_PULSES, Observer, WatchedHead};
