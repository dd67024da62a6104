//! What can go wrong with a remote task, its plan and its programs.

use std::path::PathBuf;

use lasergym_geom::DrawingError;
use lasergym_toolpath::ToolpathError;

/// Every error of this crate. Subtasks are named as in the task; lines of files count from 1.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RemoteError {
    /// A setting lies outside its range.
    #[error("{name} is {value}, but must be {expected}")]
    InvalidOption {
        /// Name of the setting, unit included, with its owner where it has one.
        name: String,
        /// The value given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A task without anything to do.
    #[error("the task has no subtask: add a [[subtask]] or a [[drawing]]")]
    NoSubtasks,
    /// More subtasks, or pieces of them, than are planned at once.
    #[error("the task has more than {limit} subtasks: plan it in parts")]
    TooManySubtasks {
        /// Most that are planned.
        limit: usize,
    },
    /// A beam path that is not one.
    #[error("the path of {subtask} {problem}")]
    Path {
        /// The subtask.
        subtask: String,
        /// What is wrong and what is accepted.
        problem: String,
    },
    /// A name that nothing has.
    #[error("{owner} names the {kind} {name:?}, which there is not: there are {known}")]
    UnknownName {
        /// Who names it.
        owner: String,
        /// What is named: a plane or a process.
        kind: &'static str,
        /// The name.
        name: String,
        /// The names there are.
        known: String,
    },
    /// A subtask that the scanner cannot reach from one place.
    #[error(
        "{subtask} needs a circle of {enclosing_mm:.1} mm radius, but the working field has {field_mm:.1} mm: \
         allow `split`, or enlarge the field or the inclination limit"
    )]
    TooLarge {
        /// The subtask.
        subtask: String,
        /// Radius of its smallest enclosing circle, mm.
        enclosing_mm: f64,
        /// Radius of the field that its process may use, mm.
        field_mm: f64,
    },
    /// A subtask that takes longer than the slowest robot stays in reach.
    #[error(
        "{subtask} takes {time_s:.3} s, but at {slowest_mm_s} mm/s the robot leaves its scan circle of \
         {radius_mm:.2} mm radius after {reach_s:.3} s: allow min_speed_mm_s down to {needed_mm_s:.3}, \
         use at most {exposures} exposures, or split it"
    )]
    TooSlow {
        /// The subtask.
        subtask: String,
        /// Time of the process, s.
        time_s: f64,
        /// Lowest speed of the robot, mm/s.
        slowest_mm_s: f64,
        /// Radius of the scan circle, mm.
        radius_mm: f64,
        /// Longest time within it, s.
        reach_s: f64,
        /// Speed that would do, mm/s.
        needed_mm_s: f64,
        /// Exposures that would do.
        exposures: u32,
    },
    /// A subtask for which no line is found.
    #[error(
        "no line is found for {subtask}, which is at the limit of what is possible: lower \
         min_speed_mm_s or its exposures"
    )]
    NoLine {
        /// The subtask.
        subtask: String,
    },
    /// A path whose corners the scanner's clock cannot meet at constant speed.
    #[error(
        "a stretch of {length_mm:.3} mm of {subtask} takes {cycles:.1} scanner cycles at {speed_mm_s} mm/s, \
         and whole cycles change the speed by {change_percent:.1} %: set speed_mm_s to \
         {better_mm_s:.1}, round the corners, or raise clock_tolerance"
    )]
    OffClock {
        /// The subtask.
        subtask: String,
        /// Length of the stretch between corners, mm.
        length_mm: f64,
        /// Cycles that it takes.
        cycles: f64,
        /// Speed asked for, mm/s.
        speed_mm_s: f64,
        /// Change of speed by whole cycles, %.
        change_percent: f64,
        /// A speed that fits this stretch, mm/s.
        better_mm_s: f64,
    },
    /// A task file that cannot be read.
    #[error("the task cannot be read: {reason}")]
    TaskFile {
        /// What is wrong, with line and column where known.
        reason: String,
    },
    /// A drawing that a task names and that cannot be used.
    #[error("the drawing {} cannot be used: {source}", path.display())]
    Drawing {
        /// Its file.
        path: PathBuf,
        /// Why not.
        source: DrawingError,
    },
    /// A program that cannot be read back.
    #[error("line {line} of the {program} program: {reason}")]
    Program {
        /// Which program: robot or scanner.
        program: &'static str,
        /// Number of the line.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// An action of the environment that names no subtask or no direction.
    #[error(
        "action {action:?}: give a subtask below {subtasks} and a direction up to {directions}"
    )]
    Action {
        /// The action.
        action: [i64; 2],
        /// Number of subtasks.
        subtasks: usize,
        /// Number of directions; 0 goes on with the line.
        directions: usize,
    },
    /// A step before the first reset or after the end of an episode.
    #[error("the episode of environment {environment} is over: reset it first")]
    EpisodeOver {
        /// Index of the environment.
        environment: usize,
    },
    /// An array that does not fit a batch of environments.
    #[error("{name} has {actual} entries, but {expected} are needed")]
    WrongLength {
        /// Name of the array.
        name: &'static str,
        /// Entries given.
        actual: usize,
        /// Entries needed.
        expected: usize,
    },
    /// No tour through the subtasks.
    #[error(transparent)]
    Tour(#[from] ToolpathError),
}

/// Checks `value` of the setting `name`.
pub(crate) fn check_option(
    name: impl Into<String>,
    value: f64,
    ok: bool,
    expected: &'static str,
) -> Result<(), RemoteError> {
    if ok { Ok(()) } else { Err(RemoteError::InvalidOption { name: name.into(), value, expected }) }
}
