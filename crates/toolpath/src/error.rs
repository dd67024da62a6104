//! What can be wrong with a toolpath, its options or a file.

use thiserror::Error;

use crate::{MAX_POSITION_PX, MAX_PULSE_RADIUS_PX, MAX_PULSES, MAX_TEXT_BYTES};

/// What can be wrong with a toolpath, its options or a file. Lines and pulses count from 1.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ToolpathError {
    /// A position is not finite or out of range.
    #[error(
        "pulse {pulse} lies at ({x_px}, {y_px}) px: positions must be finite and within \
         ±{MAX_POSITION_PX} px"
    )]
    Position {
        /// Number of the pulse.
        pulse: usize,
        /// Its x, px.
        x_px: f64,
        /// Its y, px.
        y_px: f64,
    },

    /// A radius is not finite, not positive or too large.
    #[error(
        "a pulse radius of {radius_px} px: give one above 0 and up to {MAX_PULSE_RADIUS_PX} px"
    )]
    PulseRadius {
        /// The radius, px.
        radius_px: f64,
    },

    /// A place to be visited is not a finite point. Places count from 0; the start, where one is
    /// given, is the last.
    #[error("stop {stop} lies at ({x}, {y}): a tour needs finite positions")]
    StopNotFinite {
        /// Index of the place.
        stop: usize,
        /// Its x.
        x: f64,
        /// Its y.
        y: f64,
    },

    /// There are more pulses than a path may have.
    #[error("more than {limit} pulses: split the path")]
    TooManyPulses {
        /// Largest number accepted: [`MAX_PULSES`], or less where a picture is drawn.
        limit: usize,
    },

    /// An option is out of range.
    #[error("{name} = {value}: give {accepted}")]
    OptionValue {
        /// Name of the option, unit included.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is accepted.
        accepted: &'static str,
    },

    /// A text is too long to be read.
    #[error("the text has {bytes} bytes, more than {MAX_TEXT_BYTES}: split the file")]
    TextTooLong {
        /// Its length.
        bytes: usize,
    },

    /// A CSV file does not start with the header.
    #[error("line 1: the header is {found:?}, not {expected:?}", expected = crate::CSV_HEADER)]
    CsvHeader {
        /// The first line, shortened.
        found: String,
    },

    /// A CSV line does not have three fields.
    #[error("line {line}: {found} fields instead of the 3 of {header:?}", header = crate::CSV_HEADER)]
    CsvFieldCount {
        /// Number of the line.
        line: usize,
        /// Number of fields in it.
        found: usize,
    },

    /// A CSV field is not a number.
    #[error("line {line}: {column} is {found:?}, not a number")]
    CsvNumber {
        /// Number of the line.
        line: usize,
        /// Name of the column.
        column: &'static str,
        /// The field, shortened.
        found: String,
    },

    /// The pulses of a CSV file are not numbered 1, 2, 3, …
    #[error(
        "line {line}: pulse is {found:?} where {expected} is due: number the pulses 1, 2, 3, … in \
         firing order"
    )]
    CsvPulseNumber {
        /// Number of the line.
        line: usize,
        /// The number that is due.
        expected: usize,
        /// The field, shortened.
        found: String,
    },

    /// A position read from a file is out of range.
    #[error(
        "line {line}: the position ({x_px}, {y_px}) px must be within ±{MAX_POSITION_PX} px: check \
         units and origin"
    )]
    PositionInLine {
        /// Number of the line.
        line: usize,
        /// x, px.
        x_px: f64,
        /// y, px.
        y_px: f64,
    },

    /// A G-code line holds something that is no word.
    #[error(
        "line {line}: {found:?} is no G-code word: a letter and a decimal number are, such as X1.5"
    )]
    GcodeWord {
        /// Number of the line.
        line: usize,
        /// The text from there, shortened.
        found: String,
    },

    /// A G-code word is well-formed but has no meaning here.
    #[error("line {line}: {word} is not supported: {accepted} are")]
    GcodeUnsupported {
        /// Number of the line.
        line: usize,
        /// The word.
        word: String,
        /// The words that are.
        accepted: &'static str,
    },

    /// A word has a value out of its range.
    #[error("line {line}: {word}: {accepted}")]
    GcodeValue {
        /// Number of the line.
        line: usize,
        /// The word.
        word: String,
        /// What is accepted.
        accepted: &'static str,
    },

    /// Two words of one line exclude each other, or one is given twice.
    #[error("line {line}: {word} repeats or contradicts a word before it: put it in its own line")]
    GcodeConflict {
        /// Number of the line.
        line: usize,
        /// The later word.
        word: String,
    },

    /// A comment `(` has no `)` in its line.
    #[error("line {line}: the comment has no \")\": close it in the same line")]
    GcodeOpenComment {
        /// Number of the line.
        line: usize,
    },

    /// G4 has no P, or P has no G4.
    #[error("line {line}: G4 and P belong together: write G4 P<seconds>")]
    GcodeDwell {
        /// Number of the line.
        line: usize,
    },

    /// The laser fires, or a relative move starts, before X and Y are known.
    #[error("line {line}: the position is not known yet: move to an absolute X and Y (G90) first")]
    GcodeUnknownPosition {
        /// Number of the line.
        line: usize,
    },

    /// An axis moves while the laser is on.
    #[error("line {line}: a move with the laser on is no pulse: switch it off (M5) before moving")]
    GcodeLaserOnWhileMoving {
        /// Number of the line.
        line: usize,
    },

    /// The laser was switched on and off again without a dwell, so that no exposure is known.
    #[error("line {line}: the laser goes off without having dwelt: put G4 P<seconds> before it")]
    GcodeLaserWithoutDwell {
        /// Number of the line that switches it off.
        line: usize,
    },

    /// The program ends with the laser on.
    #[error("line {line}: the laser, on since here, is still on at the end: add M5")]
    GcodeLaserLeftOn {
        /// Number of the line that switched it on.
        line: usize,
    },

    /// A line of a file that is read as a stream is too long.
    #[error("line {line}, column 1: longer than {} bytes: break it", crate::MAX_LINE_BYTES)]
    LineTooLong {
        /// Number of the line.
        line: usize,
    },

    /// A file that is read as a stream cannot be read on.
    #[error("line {line}, column 1: the file cannot be read: {reason}")]
    Unreadable {
        /// Number of the line.
        line: usize,
        /// What the system says.
        reason: String,
    },

    /// A cutter-location statement is not as the grammar has it.
    #[error("line {line}, column {column}: {found:?} where {expected} is due")]
    AptSyntax {
        /// Number of the line.
        line: usize,
        /// Number of the character in the line.
        column: usize,
        /// The text there, shortened.
        found: String,
        /// What is accepted.
        expected: &'static str,
    },

    /// A cutter-location word that is not known.
    #[error("line {line}, column {column}: {word} is not supported: {accepted} are")]
    AptUnsupported {
        /// Number of the line.
        line: usize,
        /// Number of the character in the line.
        column: usize,
        /// The word, shortened.
        word: String,
        /// The words that are.
        accepted: &'static str,
    },

    /// A G-code program that is read as vectors has something without meaning.
    #[error("line {line}, column {column}: {found}: {expected}")]
    GcodeVector {
        /// Number of the line.
        line: usize,
        /// Number of the character in the line.
        column: usize,
        /// The word or text there, shortened.
        found: String,
        /// What is accepted.
        expected: &'static str,
    },

    /// A table that is read as vectors has something else than is due.
    #[error("line {line}, column {column}: {found:?} where {expected} is due")]
    TableField {
        /// Number of the line.
        line: usize,
        /// Number of the character in the line.
        column: usize,
        /// The field, shortened.
        found: String,
        /// What is accepted.
        expected: &'static str,
    },

    /// Words follow the end of the program (M2 or M30).
    #[error(
        "line {line}: the program has ended (M2 or M30) and yet goes on: remove one or the other"
    )]
    GcodeAfterEnd {
        /// Number of the line.
        line: usize,
    },
}

/// The start of `text`, short enough to be shown in a message.
pub(crate) fn shortened(text: &str) -> String {
    const LONGEST: usize = 24;
    let mut characters = text.chars();
    let mut shown: String = characters.by_ref().take(LONGEST).collect();
    if characters.next().is_some() {
        shown.push('…');
    }
    shown
}

/// Accepts `value` when `valid`, or says what is accepted.
pub(crate) fn check_option(
    name: &'static str,
    value: f64,
    valid: bool,
    accepted: &'static str,
) -> Result<(), ToolpathError> {
    if valid { Ok(()) } else { Err(ToolpathError::OptionValue { name, value, accepted }) }
}

/// Accepts a text that is not too long.
pub(crate) fn check_text_length(text: &str) -> Result<(), ToolpathError> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(ToolpathError::TextTooLong { bytes: text.len() });
    }
    Ok(())
}

/// Accepts one more pulse after `pulses`.
pub(crate) fn check_pulse_count(pulses: usize) -> Result<(), ToolpathError> {
    if pulses > MAX_PULSES {
        return Err(ToolpathError::TooManyPulses { limit: MAX_PULSES });
    }
    Ok(())
}
