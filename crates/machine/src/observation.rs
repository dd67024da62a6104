//! What a pair of frames says about a pulse.

use lasergym_geom::Point;

use crate::Frame;

/// A disc that a pulse has machined, on the workpiece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// Centre, px of the pattern (1 px = 1 µm).
    pub center_px: Point,
    /// Radius, px.
    pub radius_px: f64,
    /// How sure the observer is, in [0, 1].
    pub confidence: f64,
}

/// How an observation is to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// The marks are there.
    Seen,
    /// Nothing has changed.
    Nothing,
    /// Something has changed, but it cannot be said for sure what: look again. The marks are the
    /// best guess.
    Uncertain,
}

/// What happened between two frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// How it is to be taken.
    pub verdict: Verdict,
    /// New marks, the surest first; usually one, two after a double fire, none where
    /// [`Verdict::Nothing`] is.
    pub marks: Vec<Mark>,
    /// How far the workpiece has moved in the view since the reference frame, px of the pattern.
    pub shift_px: Point,
}

/// Finds out what happened between two frames.
pub trait Observer: Send {
    /// Compares a frame before a pulse with one after it. `aimed_px` is where the pulse was aimed,
    /// px of the pattern; it may have landed anywhere.
    ///
    /// # Errors
    /// The frames cannot be compared: other sides than the calibration's, or a workpiece that cannot
    /// be found in them.
    fn observe(
        &mut self,
        before: &Frame,
        after: &Frame,
        aimed_px: Point,
    ) -> Result<Observation, ObserverError>;
}

/// Frames that cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ObserverError {
    /// A frame has other sides than expected.
    #[error(
        "a frame is {width_px} × {height_px} px, but the calibration is for {expected_width_px} × \
         {expected_height_px} px: calibrate again, or set the camera as it was"
    )]
    FrameSize {
        /// Columns, px.
        width_px: usize,
        /// Rows, px.
        height_px: usize,
        /// Columns of the calibration, px.
        expected_width_px: usize,
        /// Rows of the calibration, px.
        expected_height_px: usize,
    },
    /// The frames do not show the same ground.
    #[error("the frames cannot be registered: {reason}; check focus, lamp and imaging position")]
    Registration {
        /// What does not fit.
        reason: String,
    },
    /// A setting of an observer lies outside its range.
    #[error("{name} is {value}, but must be {expected}")]
    InvalidOption {
        /// Name of the setting.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
}
