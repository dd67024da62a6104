//! Robot with laser scanner: the robot carries the scanner over the workpiece on straight lines
//! while the scanner guides the beam.
//!
//! Given kerfs and seams, find the lines from which the scanner reaches each of them for long
//! enough, in the least time, and the program of the scanner in its own frame. Sources: Hatwig,
//! Minnerup, Zaeh and Reinhart, "An automated path planning system for a robot with a laser scanner
//! for remote laser cutting and welding", 2012; equation numbers are those of the paper.
//!
//! Lengths are mm, speeds mm/s, times s. In a plane, x points right and y up.

mod beam_motion;
mod beam_path;
mod drawing_import;
mod enclosing_circle;
mod environment;
mod environment_batch;
mod error;
mod grouping;
mod krl;
mod line_functions;
mod machine;
mod placement;
mod plan;
mod plane;
mod random_layout;
mod robot_line;
mod robot_program;
mod robot_simulation;
mod route;
mod scan_circle;
mod scanner_program;
mod seam_gauge;
mod simulation;
mod task;
mod task_file;

pub use beam_motion::BeamMotion;
pub use beam_path::{BeamPath, MAX_COORDINATE_MM, MAX_PIECES, PathPiece};
pub use enclosing_circle::Circle;
pub use environment::{
    DIRECTIONS, REPEAT_PENALTY_S, ROBOT_FEATURES, SUBTASK_FEATURES, ScanAction, ScanEnvironment,
    ScanProgress, ScanStep,
};
pub use environment_batch::{ScanAutoreset, ScanBatch, ScanRecord};
pub use error::RemoteError;
pub use grouping::LineChoice;
pub use krl::{KrlModule, KrlOptions, write_krl};
pub use line_functions::{LineFunctions, SpeedRange};
pub use machine::{Robot, Scanner};
pub use plan::{PlanOptions, PlannedLine, RemotePlan};
pub use plane::Plane;
pub use random_layout::RandomLayout;
pub use robot_line::{DirectionSearch, RobotLine, common_speeds};
pub use robot_program::{Pose, ROBOT_CSV_HEADER, RobotMove, RobotProgram};
pub use route::RoutedLine;
pub use scan_circle::{ScanCircle, Stop, stops_of};
pub use scanner_program::{CHORD_MM, SCANNER_CSV_HEADER, ScanVector, ScannerList, ScannerProgram};
pub use simulation::{
    MAX_SEAM_ERROR_MM, MAX_SPEED_ERROR, MotionSample, SimulationReport, simulate,
};
pub use task::{MAX_SUBTASKS, Process, ProcessKind, RemoteTask, Subtask};
