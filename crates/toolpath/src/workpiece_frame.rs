//! Where the workpiece lies on the machine.

use lasergym_geom::{PIXEL_UM, Point, WORKPIECE_SIZE_PX};

use crate::ToolpathError;
use crate::error::check_option;

/// Sense of the machine's y axis, seen with the workpiece upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum YAxis {
    /// Machine y grows upwards, against the workpiece's y: the usual sense of a machine tool.
    #[default]
    Up,
    /// Machine y grows downwards, with the workpiece's y: some stages under a camera.
    Down,
}

/// Where the workpiece lies on the machine, and how large its pixels are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkpieceFrame {
    /// Machine x of the workpiece's left edge, mm, within ±1000. Default 0.
    pub origin_x_mm: f64,
    /// Machine y, mm, of the workpiece's edge of lowest machine y, within ±1000: the bottom edge with
    /// [`YAxis::Up`], the top edge with [`YAxis::Down`]. Default 0.
    pub origin_y_mm: f64,
    /// Sense of the machine's y axis. Default [`YAxis::Up`].
    pub y_axis: YAxis,
    /// Side of a pixel, µm, from 10⁻³ to 10³. Larger ones enlarge the pattern. Default [`PIXEL_UM`].
    pub pixel_um: f64,
}

impl Default for WorkpieceFrame {
    fn default() -> Self {
        Self { origin_x_mm: 0.0, origin_y_mm: 0.0, y_axis: YAxis::Up, pixel_um: PIXEL_UM }
    }
}

impl WorkpieceFrame {
    /// Accepts a finite frame within the ranges of its fields.
    ///
    /// # Errors
    /// [`ToolpathError::OptionValue`] naming the first field out of range.
    pub fn validate(&self) -> Result<(), ToolpathError> {
        let (x, y) = (self.origin_x_mm, self.origin_y_mm);
        check_option("origin_x_mm", x, x.abs() <= 1e3, "-1000 to 1000 mm")?;
        check_option("origin_y_mm", y, y.abs() <= 1e3, "-1000 to 1000 mm")?;
        let valid = (1e-3..=1e3).contains(&self.pixel_um);
        check_option("pixel_um", self.pixel_um, valid, "0.001 to 1000 µm")
    }

    /// Machine position (x, y) of a workpiece position, mm.
    #[must_use]
    pub fn machine_mm(&self, position_px: Point) -> (f64, f64) {
        let y_px = match self.y_axis {
            YAxis::Up => WORKPIECE_SIZE_PX as f64 - position_px.y,
            YAxis::Down => position_px.y,
        };
        (
            self.origin_x_mm + position_px.x * self.pixel_um / 1e3,
            self.origin_y_mm + y_px * self.pixel_um / 1e3,
        )
    }

    /// Workpiece position of a machine position (`x_mm`, `y_mm`): the inverse of
    /// [`WorkpieceFrame::machine_mm`].
    #[must_use]
    pub fn workpiece_px(&self, x_mm: f64, y_mm: f64) -> Point {
        let y_px = (y_mm - self.origin_y_mm) * 1e3 / self.pixel_um;
        Point::new(
            (x_mm - self.origin_x_mm) * 1e3 / self.pixel_um,
            match self.y_axis {
                YAxis::Up => WORKPIECE_SIZE_PX as f64 - y_px,
                YAxis::Down => y_px,
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_origin_is_the_corner_of_lowest_machine_coordinates() {
        let up =
            WorkpieceFrame { origin_x_mm: 3.0, origin_y_mm: -2.0, ..WorkpieceFrame::default() };
        assert_eq!(up.machine_mm(Point::new(0.0, 100.0)), (3.0, -2.0));
        let down = WorkpieceFrame { y_axis: YAxis::Down, ..up };
        assert_eq!(down.machine_mm(Point::new(0.0, 0.0)), (3.0, -2.0));
    }

    #[test]
    fn a_machine_y_axis_that_points_up_flips_the_picture() {
        let (_, top) = WorkpieceFrame::default().machine_mm(Point::new(50.0, 10.0));
        let (_, bottom) = WorkpieceFrame::default().machine_mm(Point::new(50.0, 90.0));
        assert!(top > bottom);
    }

    #[test]
    fn values_out_of_range_are_named() {
        let good = WorkpieceFrame::default();
        let broken = [
            ("origin_x_mm", WorkpieceFrame { origin_x_mm: f64::NAN, ..good }),
            ("origin_y_mm", WorkpieceFrame { origin_y_mm: 1e9, ..good }),
            ("pixel_um", WorkpieceFrame { pixel_um: 0.0, ..good }),
        ];
        for (field, frame) in broken {
            assert!(frame.validate().unwrap_err().to_string().starts_with(field));
        }
    }
}
