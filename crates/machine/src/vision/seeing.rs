//! Vision: what a pulse has done, from the frames before and after it.

use lasergym_geom::Point;

use super::VisionOptions;
use super::cells::Grid;
use super::change::Change;
use super::disc_fit::{DiscFit, Expected, Patch};
use super::disc_search::DiscSearch;
use super::registration::{Reference, Registered};
use crate::{CameraCalibration, Frame, Mark, Observation, Observer, ObserverError, Verdict};

/// Marks of this confidence are seen.
const SEEN_FROM: f32 = 0.61;

/// Marks of this confidence may be there.
const UNCERTAIN_FROM: f32 = 0.25;

/// Confidence that a second mark of a pulse needs.
const SECOND_FROM: f32 = 0.6;

/// Area that a second mark has newly machined at least, px of the pattern squared.
const LEAST_SECOND_PX: f32 = 15.0;

/// Part of its rim that is seen of a second mark.
const LEAST_SECOND_RIM: f32 = 0.3;

/// Finds marks in frames of one camera.
#[derive(Debug)]
pub struct Vision {
    calibration: CameraCalibration,
    options: VisionOptions,
    grid: Grid,
    reference: Reference,
    patch: Patch,
    /// The frame that was seen last and where the workpiece is in it.
    last: Option<(Frame, Registered)>,
}

impl Vision {
    /// Vision for frames like `reference`, which shows the workpiece before the job; the pattern's
    /// coordinates are those of this frame.
    ///
    /// # Errors
    /// [`ObserverError::InvalidOption`], [`ObserverError::FrameSize`], or
    /// [`ObserverError::Registration`] for a reference frame that is dark.
    pub fn new(
        calibration: CameraCalibration,
        reference: &Frame,
        options: VisionOptions,
    ) -> Result<Self, ObserverError> {
        options.validate()?;
        check_size(&calibration, reference)?;
        let scale = calibration.scale_frame_px_per_um();
        // Marks of 9 cells, as far as the camera has so many pixels.
        let cell = (scale * options.radius_px / 9.0).round().clamp(1.0, 64.0) as usize;
        let grid = Grid::new(cell, reference.width_px(), reference.height_px());
        if grid.width < 16 || grid.height < 16 {
            return Err(ObserverError::Registration {
                reason: format!("the frame has only {} × {} cells", grid.width, grid.height),
            });
        }
        let reference = Reference::new(reference, grid, scale, &options)?;
        Ok(Self { calibration, options, grid, reference, patch: Patch::default(), last: None })
    }

    /// The calibration that positions come from.
    #[must_use]
    pub fn calibration(&self) -> &CameraCalibration {
        &self.calibration
    }

    /// What it expects to see.
    #[must_use]
    pub fn options(&self) -> &VisionOptions {
        &self.options
    }

    /// `frame` in the coordinates of the reference frame.
    fn registered(&mut self, frame: &Frame) -> Result<Registered, ObserverError> {
        check_size(&self.calibration, frame)?;
        match &self.last {
            Some((last, registered)) if last == frame => Ok(registered.clone()),
            _ => self.reference.register(frame),
        }
    }
}

/// How sure it is that a disc is a mark, in [0, 1].
fn confidence(fit: &DiscFit) -> f32 {
    // A centre that is known to 1 px only halves it.
    let sharp = 1.0 / (1.0 + fit.center_error_px * fit.center_error_px);
    if fit.contrast <= 0.0 {
        return 0.0;
    }
    (fit.explained * sharp).clamp(0.0, 1.0)
}

fn check_size(calibration: &CameraCalibration, frame: &Frame) -> Result<(), ObserverError> {
    let (width_px, height_px) = (frame.width_px(), frame.height_px());
    let (expected_width_px, expected_height_px) = (calibration.width_px(), calibration.height_px());
    if (width_px, height_px) == (expected_width_px, expected_height_px) {
        Ok(())
    } else {
        Err(ObserverError::FrameSize { width_px, height_px, expected_width_px, expected_height_px })
    }
}

impl Observer for Vision {
    fn observe(
        &mut self,
        before: &Frame,
        after: &Frame,
        aimed_px: Point,
    ) -> Result<Observation, ObserverError> {
        let before = self.registered(before)?;
        let registered = self.registered(after)?;
        let change = Change::between(self.grid, &before, &registered);
        let [x, y] = registered.shift.map(f64::from);
        let shift_px = self.calibration.pattern_vector(Point::new(x, y));
        self.last = Some((after.clone(), registered));
        let options = &self.options;
        let aimed = aimed_px.x.is_finite() && aimed_px.y.is_finite();
        let mut search = DiscSearch {
            change: &change,
            calibration: &self.calibration,
            expected: Expected {
                radius_px: options.radius_px as f32,
                radius_range_px: options.radius_range_px as f32,
                radius_spread_px: options.radius_spread_px as f32,
                least_contrast: options.least_contrast as f32,
                aimed_px: aimed.then_some((aimed_px.x as f32, aimed_px.y as f32)),
                aim_spread_px: options.aim_spread_px as f32,
            },
            patch: &mut self.patch,
        };
        let (verdict, found) = judge(&mut search);
        let marks = found
            .iter()
            .map(|fit| Mark {
                center_px: Point::new(fit.x_px.into(), fit.y_px.into()),
                radius_px: fit.radius_px.into(),
                confidence: confidence(fit).into(),
            })
            .collect();
        Ok(Observation { verdict, marks, shift_px })
    }
}

/// What the change shows.
fn judge(search: &mut DiscSearch<'_>) -> (Verdict, Vec<DiscFit>) {
    let Some(first) = search.next(&[]) else { return (Verdict::Nothing, Vec::new()) };
    let confidence = confidence(&first);
    if confidence < UNCERTAIN_FROM {
        return (Verdict::Nothing, Vec::new());
    }
    if confidence < SEEN_FROM {
        return (Verdict::Uncertain, vec![first]);
    }
    if search.unexplained_px(&first) > LEAST_SECOND_PX
        && let Some(second) = search.next(&[first]).filter(is_second)
    {
        // The first was fitted as if all had been its own.
        let again = search.fit((first.x_px, first.y_px), &[second]).unwrap_or(first);
        return (Verdict::Seen, vec![again, second]);
    }
    (Verdict::Seen, vec![first])
}

/// Whether a disc beside the first is a mark: fragments are smaller and have other rims.
fn is_second(fit: &DiscFit) -> bool {
    confidence(fit) >= SECOND_FROM
        && fit.new_area_px > LEAST_SECOND_PX
        && fit.visible_rim >= LEAST_SECOND_RIM
}
