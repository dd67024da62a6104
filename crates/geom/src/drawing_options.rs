//! How a drawing becomes a target.

use crate::DrawingError;

/// What of a picture (PNG, JPEG or a rendered SVG) counts as ink. Each pixel has an amount of ink
/// from 0 to 1; DXF drawings have outlines only and take no notice of this.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ink {
    /// Dark is ink in a picture without transparency: the rule of [`Ink::Luminance`]. In a picture
    /// with transparency (a pixel whose alpha is below one half), whatever is painted and not white
    /// is ink: `alpha × min(1, 10 (1 − smallest of red, green, blue))`, so that a black, a yellow
    /// and a light grey shape are all ink, and a white one is a hole.
    #[default]
    Auto,
    /// Dark is ink: one minus the luminance of the pixel laid over white, with Rec. 709 weights on
    /// the stored (gamma-encoded) channels.
    Luminance,
    /// Opaque is ink, whatever its colour: the alpha channel.
    Alpha,
}

/// Where the drawing lies on the workpiece.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fit {
    /// The bounding box of the ink is scaled, with its aspect kept, to the largest size that leaves
    /// the margin free on each side, and centred.
    #[default]
    Scale,
    /// One pixel of the image, or one user unit of a vector drawing, is one pixel of the workpiece;
    /// the margin takes no part. Images and SVG pages (their view box) must be 100 × 100; a DXF
    /// drawing has its origin at the lower left corner of the workpiece and what leaves the
    /// workpiece is lost.
    Exact,
}

/// How a drawing becomes a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawingOptions {
    /// Free border of the workpiece on each side, px, in [0, 45]. The default of 5 px keeps about
    /// half a mark of 18 px between the drawing and the edge, so that pulses along the outline stay
    /// on the workpiece.
    pub margin_px: f64,
    /// A workpiece pixel is target when its mean amount of ink is at least this, in (0, 1]. The
    /// default of 0.5 keeps areas; less makes thin lines survive, more makes them go.
    /// DXF drawings go by pixel centres instead.
    pub threshold: f64,
    /// What counts as ink.
    pub ink: Ink,
    /// Whether what is not ink becomes the target: inside the image, the SVG page, or the bounding
    /// box of a DXF drawing (the workpiece with [`Fit::Exact`]).
    pub invert: bool,
    /// Where the drawing lies on the workpiece.
    pub fit: Fit,
}

impl Default for DrawingOptions {
    fn default() -> Self {
        Self {
            margin_px: 5.0,
            threshold: 0.5,
            ink: Ink::default(),
            invert: false,
            fit: Fit::default(),
        }
    }
}

impl DrawingOptions {
    /// Checks the ranges of the options.
    ///
    /// # Errors
    /// [`DrawingError::InvalidOption`] for the first option that is out of its range.
    pub fn validate(&self) -> Result<(), DrawingError> {
        let check = |name, value: f64, holds: bool, expected| {
            if holds { Ok(()) } else { Err(DrawingError::InvalidOption { name, value, expected }) }
        };
        let margin_fits = (0.0..=45.0).contains(&self.margin_px);
        check("margin_px", self.margin_px, margin_fits, "from 0 to 45")?;
        let threshold_fits = self.threshold > 0.0 && self.threshold <= 1.0;
        check("threshold", self.threshold, threshold_fits, "above 0 and at most 1")
    }
}
