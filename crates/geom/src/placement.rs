//! Laying a drawing on the workpiece.

use crate::{Point, WORKPIECE_SIZE_PX};

/// An axis-parallel rectangle in the units of a drawing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Bounds {
    /// Smallest (x, y).
    pub(crate) min: [f64; 2],
    /// Largest (x, y).
    pub(crate) max: [f64; 2],
}

impl Bounds {
    /// Width and height.
    pub(crate) fn size(&self) -> [f64; 2] {
        [self.max[0] - self.min[0], self.max[1] - self.min[1]]
    }

    /// The smallest rectangle with all `points`; none when there is no point.
    pub(crate) fn of(points: impl IntoIterator<Item = [f64; 2]>) -> Option<Self> {
        points.into_iter().fold(None, |bounds, point| {
            let Self { min, max } = bounds.unwrap_or(Self { min: point, max: point });
            Some(Self {
                min: [min[0].min(point[0]), min[1].min(point[1])],
                max: [max[0].max(point[0]), max[1].max(point[1])],
            })
        })
    }
}

/// Maps drawing units to workpiece pixels: `scale × position + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placement {
    /// Workpiece pixels per drawing unit.
    pub(crate) scale: f64,
    /// Position (x, y) of the drawing's origin, px.
    pub(crate) offset: [f64; 2],
}

impl Placement {
    /// One drawing unit is one pixel, origin on origin.
    pub(crate) const EXACT: Self = Self { scale: 1.0, offset: [0.0, 0.0] };

    /// Centres `bounds` and scales it to the workpiece without `margin_px` on each side.
    /// None when `bounds` has no area to speak of.
    pub(crate) fn centred(bounds: &Bounds, margin_px: f64) -> Option<Self> {
        let workpiece = WORKPIECE_SIZE_PX as f64;
        let [width, height] = bounds.size();
        let scale = (workpiece - 2.0 * margin_px) / width.max(height);
        let offset = [0, 1].map(|axis| {
            let centre = f64::midpoint(bounds.min[axis], bounds.max[axis]);
            workpiece / 2.0 - scale * centre
        });
        let usable = scale > 0.0 && scale.is_finite() && offset.iter().all(|o| o.is_finite());
        usable.then_some(Self { scale, offset })
    }

    /// The place of a position (x, y) of the drawing on the workpiece.
    pub(crate) fn apply(&self, position: [f64; 2]) -> Point {
        Point::new(
            self.scale * position[0] + self.offset[0],
            self.scale * position[1] + self.offset[1],
        )
    }

    /// The drawing units from `start` to `end` px along `axis`.
    pub(crate) fn interval(&self, axis: usize, start: f64, end: f64) -> [f64; 2] {
        [start, end].map(|position| (position - self.offset[axis]) / self.scale)
    }
}
