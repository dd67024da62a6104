//! What can go wrong with heads, programs and calibrations.

use lasergym_toolpath::ToolpathError;

/// Every error of this crate. Lines of files count from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GalvoError {
    /// An option lies outside its range.
    #[error("{name} is {value}, but must be {expected}")]
    InvalidOption {
        /// Name of the option, unit included.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A name that is none of those accepted.
    #[error("{name} is {value:?}, but must be one of {accepted}")]
    UnknownName {
        /// Name of the option.
        name: &'static str,
        /// The value given.
        value: String,
        /// What is accepted.
        accepted: &'static str,
    },
    /// A head, controller or calibration file cannot be read.
    #[error("the {what} file cannot be read: {reason}")]
    Settings {
        /// Which file it should be.
        what: &'static str,
        /// What is wrong, with line and column where known.
        reason: String,
    },
    /// A table cannot be read.
    #[error("line {line}, column {column}: {reason}")]
    Table {
        /// Number of the line.
        line: usize,
        /// Number of the character in the line.
        column: usize,
        /// What is wrong and what is accepted.
        reason: String,
    },
    /// A list of commands or micro-vectors, or a note in a program, cannot be read.
    #[error("line {line}, column {column}: {reason}")]
    Program {
        /// Number of the line.
        line: usize,
        /// Number of the character in the line.
        column: usize,
        /// What is wrong and what is accepted.
        reason: String,
    },
    /// A step response that no stable head has.
    #[error("the step response cannot be used ({reason}): record it from rest to rest")]
    StepResponse {
        /// What is wrong.
        reason: String,
    },
    /// Measurements that do not determine what is asked for.
    #[error("the measurements cannot be fitted ({reason}): measure more lines")]
    Calibration {
        /// What is missing.
        reason: String,
    },
    /// A speed that neither the job nor the options give.
    #[error("vector {vector} has no speed: give FEDRAT or F in the job, or a speed as an option")]
    SpeedUnknown {
        /// Number of the vector, from 1.
        vector: u64,
    },
    /// A command beyond the field of the head.
    #[error(
        "vector {vector} leads to ({x_um:.1}, {y_um:.1}) µm, outside the field of ±{half_um} µm: move the job, or leave room for the run-in"
    )]
    OutsideField {
        /// Number of the vector, from 1.
        vector: u64,
        /// x commanded, µm.
        x_um: f64,
        /// y commanded, µm.
        y_um: f64,
        /// Half the side of the field, µm.
        half_um: f64,
    },
    /// A program or job file cannot be read or written.
    #[error(transparent)]
    Toolpath(#[from] ToolpathError),
    /// A program that would fire more pulses than are accepted.
    #[error("the program fires more than {limit} pulses: split it or lower the pulse rate")]
    TooManyPulses {
        /// Largest number accepted.
        limit: u64,
    },
    /// Writing failed.
    #[error("the program cannot be written: {reason}")]
    Write {
        /// What the system says.
        reason: String,
    },
}

/// Accepts `value` when `ok`, or says what is expected.
pub(crate) fn check_option(
    name: &'static str,
    value: f64,
    ok: bool,
    expected: &'static str,
) -> Result<(), GalvoError> {
    if ok { Ok(()) } else { Err(GalvoError::InvalidOption { name, value, expected }) }
}

impl From<std::io::Error> for GalvoError {
    fn from(error: std::io::Error) -> Self {
        Self::Write { reason: error.to_string() }
    }
}
