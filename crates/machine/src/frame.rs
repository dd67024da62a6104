//! Frames of a camera.

use std::time::Instant;

/// Largest width and height of a frame, px.
const MAX_SIDE_PX: usize = 8192;

/// A grey frame of a camera, and when its exposure began.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    width_px: usize,
    gray: Vec<u8>,
    taken_at: Instant,
}

/// Pixels that are no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{pixels} pixels are no frame of {width_px} × {height_px}: give width × height pixels, each \
     side from 1 to {MAX_SIDE_PX} px"
)]
pub struct FrameError {
    /// Columns, px.
    pub width_px: usize,
    /// Rows, px.
    pub height_px: usize,
    /// Number of pixels given.
    pub pixels: usize,
}

impl Frame {
    /// A frame of `gray` pixels, row by row from the top, whose exposure began at `taken_at`.
    ///
    /// # Errors
    /// [`FrameError`] for another number of pixels, no pixels, or too many.
    pub fn new(
        width_px: usize,
        height_px: usize,
        gray: Vec<u8>,
        taken_at: Instant,
    ) -> Result<Self, FrameError> {
        let pixels = gray.len();
        if Self::check_sides(width_px, height_px).is_err() || pixels != width_px * height_px {
            return Err(FrameError { width_px, height_px, pixels });
        }
        Ok(Self { width_px, gray, taken_at })
    }

    /// Whether a frame may have these sides.
    pub(crate) fn check_sides(width_px: usize, height_px: usize) -> Result<(), FrameError> {
        let sides = 1..=MAX_SIDE_PX;
        if sides.contains(&width_px) && sides.contains(&height_px) {
            return Ok(());
        }
        Err(FrameError { width_px, height_px, pixels: 0 })
    }

    /// Columns, px.
    #[must_use]
    pub fn width_px(&self) -> usize {
        self.width_px
    }

    /// Rows, px.
    #[must_use]
    pub fn height_px(&self) -> usize {
        self.gray.len() / self.width_px
    }

    /// All pixels, row by row from the top.
    #[must_use]
    pub fn gray(&self) -> &[u8] {
        &self.gray
    }

    /// When the exposure began.
    #[must_use]
    pub fn taken_at(&self) -> Instant {
        self.taken_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_the_sides_it_was_given() {
        let frame = Frame::new(3, 2, vec![0, 1, 2, 3, 4, 5], Instant::now()).unwrap();
        assert_eq!((frame.width_px(), frame.height_px(), frame.gray().len()), (3, 2, 6));
    }

    #[test]
    fn pixels_that_do_not_fit_are_refused() {
        for (width_px, height_px, pixels) in [(3, 2, 5), (0, 0, 0), (10_000, 1, 10_000)] {
            let error = Frame::new(width_px, height_px, vec![0; pixels], Instant::now());
            assert_eq!(error.unwrap_err(), FrameError { width_px, height_px, pixels });
        }
    }
}
