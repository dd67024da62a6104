//! Vision: what a pulse has done, from the frames before and after it.

use lasergym_geom::Point;

use super::VisionOptions;
use super::cells::Grid;
use super::change::Change;
use super::disc_fit::{DiscFit, Expected, Patch};
use super::hough::candidates;
use super::registration::{Reference, Registered};
use crate::{CameraCalibration, Frame, Mark, Observation, Observer, ObserverError, Verdict};

/// Most circles that are looked at closely.
const MAX_CANDIDATES: usize = 4;

/// Most marks of one pulse.
const MAX_MARKS: usize = 2;

/// A guess this near to a disc that has been fitted leads to the same one, px.
const SAME_START_PX: f32 = 1.5;

/// The rim of a disc reaches this far out, cells.
const RIM_CELLS: f32 = 1.5;

/// Discs that darken less than this many standard deviations on average are nothing.
const LEAST_DARKENING: f32 = 5.0;

/// Marks of this confidence are seen.
const SEEN_FROM: f32 = 0.45;

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

    /// Side of a cell on the pattern, px.
    fn cell_px(&self) -> f32 {
        (self.grid.cell as f64 / self.calibration.scale_frame_px_per_um()) as f32
    }

    /// The best disc that has darkened outside of the `found` ones.
    fn next_disc(
        &mut self,
        change: &Change,
        aimed_px: Point,
        found: &[DiscFit],
    ) -> Option<DiscFit> {
        let cell_px = self.cell_px();
        let VisionOptions { radius_px, radius_range_px, radius_spread_px, .. } = self.options;
        let expected = Expected {
            radius_px: radius_px as f32,
            radius_range_px: radius_range_px as f32,
            radius_spread_px: radius_spread_px as f32,
        };
        let calibration = &self.calibration;
        let cell = self.grid.cell as f64;
        let position = |x: f32, y: f32| {
            let frame = Point::new(f64::from(x) * cell, f64::from(y) * cell);
            let position = calibration.pattern_px(frame);
            (position.x as f32, position.y as f32)
        };
        let explained = |x: f32, y: f32| {
            found.iter().any(|disc| disc.distance_px((x, y)) < disc.radius_px + RIM_CELLS * cell_px)
        };
        let least = (radius_px - radius_range_px) as f32 / cell_px;
        let most = (radius_px + radius_range_px) as f32 / cell_px;
        let places = candidates(change, least, most, MAX_CANDIDATES, |j, i| {
            !found.is_empty() && {
                let (x, y) = position(i as f32 + 0.5, j as f32 + 0.5);
                explained(x, y)
            }
        });
        let reach_px = expected.radius_px + expected.radius_range_px + 5.0 * cell_px;
        let mut starts: Vec<(f32, f32)> =
            places.iter().map(|place| position(place.x, place.y)).collect();
        if aimed_px.x.is_finite() && aimed_px.y.is_finite() && found.is_empty() {
            starts.push((aimed_px.x as f32, aimed_px.y as f32));
        }
        let mut best: Option<DiscFit> = None;
        for start in starts {
            let near = |disc: &DiscFit| disc.distance_px(start) < SAME_START_PX;
            if best.as_ref().is_some_and(near) {
                continue;
            }
            self.patch.take(change, calibration, start, reach_px, explained);
            let fit = self.patch.fit(start, change.noise, cell_px, expected);
            best = match (best, fit) {
                (Some(best), Some(fit)) if fit.gain <= best.gain => Some(best),
                (best, None) => best,
                (_, fit) => fit,
            };
        }
        best
    }

    /// Area outside of `disc` that has darkened as machined ground does, px of the pattern squared.
    fn unexplained_px(&self, change: &Change, disc: &DiscFit) -> f32 {
        let cell_px = self.cell_px();
        let dark = -(0.4 * disc.contrast).max(5.0 * change.noise).max(0.05);
        let cell = self.grid.cell as f64;
        let stride = self.grid.stride();
        let mut count = 0;
        for (j, row) in change.difference.chunks_exact(stride).enumerate() {
            for (i, _) in row.iter().enumerate().filter(|(_, value)| **value < dark) {
                let frame = Point::new((i as f64 + 0.5) * cell, (j as f64 + 0.5) * cell);
                let position = self.calibration.pattern_px(frame);
                let distance = disc.distance_px((position.x as f32, position.y as f32));
                count += u32::from(distance > disc.radius_px + RIM_CELLS * cell_px);
            }
        }
        count as f32 * cell_px * cell_px
    }
}

/// How sure it is that a disc is a mark, in [0, 1].
fn confidence(fit: &DiscFit) -> f32 {
    // A centre that is known to 1 px only halves it.
    let sharp = 1.0 / (1.0 + fit.center_error_px * fit.center_error_px);
    if fit.contrast <= 0.0 || fit.darkening < LEAST_DARKENING {
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
        let mut found = Vec::with_capacity(MAX_MARKS);
        let mut verdict = Verdict::Nothing;
        if let Some(first) = self.next_disc(&change, aimed_px, &found) {
            let confidence = confidence(&first);
            if confidence >= SEEN_FROM {
                verdict = Verdict::Seen;
                found.push(first);
                if self.unexplained_px(&change, &first) > LEAST_SECOND_PX {
                    found.extend(self.next_disc(&change, aimed_px, &found).filter(is_second));
                }
            } else if confidence >= UNCERTAIN_FROM {
                verdict = Verdict::Uncertain;
                found.push(first);
            }
        }
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

/// Whether a disc beside the first is a mark: fragments are smaller and have other rims.
fn is_second(fit: &DiscFit) -> bool {
    confidence(fit) >= SECOND_FROM
        && fit.new_area_px > LEAST_SECOND_PX
        && fit.visible_rim >= LEAST_SECOND_RIM
}
