//! Why a drawing cannot become a target.

use std::path::PathBuf;

use crate::DrawingFormat;

/// Reasons for which a drawing is refused; the message says what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DrawingError {
    /// There is no file at the path.
    #[error("no such file: {}; check the path", path.display())]
    NotFound {
        /// The path asked for.
        path: PathBuf,
    },
    /// The file exists and cannot be read (a folder, or missing rights).
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The path asked for.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Unwritable {
        /// The path asked for.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// Neither content nor extension names a format that is read.
    #[error(
        "the format of {} is not known; give a PNG, JPEG, SVG or ASCII DXF drawing",
        path.display()
    )]
    UnknownFormat {
        /// The path asked for.
        path: PathBuf,
    },
    /// The bytes do not begin like the image format asked for.
    #[error("this is not a {format} image: its first bytes are another format's; export it again")]
    NotAnImage {
        /// The format asked for.
        format: DrawingFormat,
    },
    /// The file ends before its content does.
    #[error("the {format} file ends too early; copy or export it again")]
    Truncated {
        /// The format of the file.
        format: DrawingFormat,
    },
    /// The content breaks the rules of its format.
    #[error("the {format} file is damaged: {reason}; export it again")]
    Malformed {
        /// The format of the file.
        format: DrawingFormat,
        /// What is wrong, where known with its place.
        reason: String,
    },
    /// The drawing is larger than what is read.
    #[error("the drawing has {found} {unit}, the limit is {limit}; simplify or shrink it")]
    TooLarge {
        /// What was counted: `pixels`, `bytes`, `elements`, …
        unit: &'static str,
        /// The number found, or the first number over the limit.
        found: u64,
        /// The largest number that is read.
        limit: u64,
    },
    /// With [`Fit::Exact`](crate::Fit::Exact), the drawing is not of the workpiece's size.
    #[error(
        "the drawing is {width} × {height} px, an exact fit needs 100 × 100 px; \
         resize it or fit it by scale"
    )]
    WrongSize {
        /// Width found, px.
        width: f64,
        /// Height found, px.
        height: f64,
    },
    /// The document has nothing to draw.
    #[error("the {format} drawing has no shapes; draw at least one filled or closed shape")]
    NoShapes {
        /// The format of the file.
        format: DrawingFormat,
    },
    /// The drawing has content that is not read.
    #[error(
        "the {format} drawing has {}, which is not read; supported: {supported}",
        kinds.join(", ")
    )]
    UnknownEntities {
        /// The format of the file.
        format: DrawingFormat,
        /// The kinds of content that are not read, each once, sorted.
        kinds: Vec<String>,
        /// What can be used in their place.
        supported: &'static str,
    },
    /// A contour does not close.
    #[error(
        "a contour is open: between ({:.4}, {:.4}) and ({:.4}, {:.4}) there is a gap of {gap:.4} \
         drawing units, {tolerance:.4} are joined; close the contour",
        from[0], from[1], to[0], to[1]
    )]
    OpenContour {
        /// One end of the gap (x, y), drawing units.
        from: [f64; 2],
        /// The other end of the gap (x, y), drawing units.
        to: [f64; 2],
        /// Distance between the two ends, drawing units.
        gap: f64,
        /// Largest distance that is joined, drawing units.
        tolerance: f64,
    },
    /// No font of this machine can set the text of the drawing.
    #[error("no font is found for {text}; install one or convert the text to paths")]
    NoFont {
        /// The font family or the character that is missing.
        text: String,
    },
    /// No pixel of the target is set.
    #[error(
        "nothing of the drawing is ink; darken it, choose what counts as ink (luminance, alpha), \
         lower the threshold or invert it"
    )]
    EmptyTarget,
    /// Every pixel of the workpiece is set.
    #[error("all of the workpiece is ink; raise the threshold, invert the drawing or use a margin")]
    FullTarget,
    /// An option is out of its range.
    #[error("{name} is {value}; it must be {expected}")]
    InvalidOption {
        /// The name of the option.
        name: &'static str,
        /// The value given.
        value: f64,
        /// The values allowed.
        expected: &'static str,
    },
    /// No thread can be started to read the drawing.
    #[error("cannot start a thread to read the drawing: {source}")]
    NoThread {
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// A picture cannot be written as PNG.
    #[error("the picture cannot be encoded as PNG: {reason}")]
    NotEncoded {
        /// The encoder's reason.
        reason: String,
    },
}
