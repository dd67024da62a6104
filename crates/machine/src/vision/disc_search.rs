//! Looks for the discs that have darkened between two frames.

use lasergym_geom::Point;

use super::change::Change;
use super::disc_fit::{DiscFit, Expected, Patch};
use super::hough::candidates;
use crate::CameraCalibration;

/// Most circles that are looked at closely.
const MAX_CANDIDATES: usize = 4;

/// A guess this near to a disc that has been fitted leads to the same one, px.
const SAME_START_PX: f32 = 1.5;

/// The rim of a disc reaches this far out, cells.
const RIM_CELLS: f32 = 1.5;

/// A disc that explains so much of the change is looked no further for.
const CLEAR_EXPLAINED: f32 = 0.9;

/// Part of its rim that is seen of such a disc.
const CLEAR_RIM: f32 = 0.6;

/// A difference picture in which discs are looked for.
pub(super) struct DiscSearch<'a> {
    pub(super) change: &'a Change,
    pub(super) calibration: &'a CameraCalibration,
    pub(super) expected: Expected,
    pub(super) patch: &'a mut Patch,
}

impl DiscSearch<'_> {
    /// Side of a cell on the pattern, px.
    fn cell_px(&self) -> f32 {
        (self.change.grid.cell as f64 / self.calibration.scale_frame_px_per_um()) as f32
    }

    /// The best disc that has darkened outside of the `found` ones.
    pub(super) fn next(&mut self, found: &[DiscFit]) -> Option<DiscFit> {
        let cell_px = self.cell_px();
        let Expected { radius_px, radius_range_px, .. } = self.expected;
        let least = (radius_px - radius_range_px) / cell_px;
        let most = (radius_px + radius_range_px) / cell_px;
        let places = candidates(self.change, least, most, MAX_CANDIDATES, |j, i| {
            !found.is_empty() && covered(found, self.position(i as f32, j as f32), cell_px)
        });
        let mut starts: Vec<(f32, f32)> =
            places.iter().map(|place| self.position(place.x - 0.5, place.y - 0.5)).collect();
        if found.is_empty() {
            starts.extend(self.expected.aimed_px);
        }
        let mut best: Option<DiscFit> = None;
        for start in starts {
            if best.as_ref().is_some_and(|disc| disc.distance_px(start) < SAME_START_PX) {
                continue;
            }
            let fit = self.fit(start, found);
            best = match (best, fit) {
                (Some(best), Some(fit)) if fit.gain <= best.gain => Some(best),
                (best, None) => best,
                (_, fit) => fit,
            };
            let clear =
                |disc: &DiscFit| disc.explained > CLEAR_EXPLAINED && disc.visible_rim > CLEAR_RIM;
            if best.as_ref().is_some_and(clear) {
                break;
            }
        }
        best
    }

    /// The disc about `start` that fits best outside of the `other` ones.
    pub(super) fn fit(&mut self, start: (f32, f32), other: &[DiscFit]) -> Option<DiscFit> {
        let cell_px = self.cell_px();
        let reach_px = self.expected.radius_px + self.expected.radius_range_px + 5.0 * cell_px;
        self.patch.take(
            self.change,
            self.calibration,
            start,
            reach_px,
            self.expected.least_contrast,
            |x, y| covered(other, (x, y), cell_px),
        );
        self.patch.fit(start, self.change.noise, cell_px, self.expected)
    }

    /// Area outside of `disc` that has darkened as machined ground does, px of the pattern squared.
    pub(super) fn unexplained_px(&self, disc: &DiscFit) -> f32 {
        let cell_px = self.cell_px();
        let dark = -(0.4 * disc.contrast).max(5.0 * self.change.noise).max(0.05);
        let mut count = 0;
        let rows = self.change.difference.chunks_exact(self.change.grid.stride());
        for (j, row) in rows.enumerate() {
            for (i, _) in row.iter().enumerate().filter(|(_, value)| **value < dark) {
                let position = self.position(i as f32, j as f32);
                count += u32::from(!covered(std::slice::from_ref(disc), position, cell_px));
            }
        }
        count as f32 * cell_px * cell_px
    }

    /// Where the middle of the cell in column `i` and row `j` is on the pattern, px.
    fn position(&self, i: f32, j: f32) -> (f32, f32) {
        let cell = self.change.grid.cell as f64;
        let frame = Point::new((f64::from(i) + 0.5) * cell, (f64::from(j) + 0.5) * cell);
        let position = self.calibration.pattern_px(frame);
        (position.x as f32, position.y as f32)
    }
}

/// Whether a point of the pattern belongs to one of the discs or its rim.
fn covered(discs: &[DiscFit], position: (f32, f32), cell_px: f32) -> bool {
    discs.iter().any(|disc| disc.distance_px(position) < disc.radius_px + RIM_CELLS * cell_px)
}
