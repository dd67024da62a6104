//! Machine programs out and in.

use lasergym_toolpath::{
    GcodeOptions, PulsePath, StageDynamics, TravelMove, WorkpieceFrame, YAxis, travel as time_path,
};
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::bitmaps::{points_of, positions_of};
use crate::errors::{option_error, toolpath_error};

/// Where the workpiece lies on the machine.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Frame {
    origin_x_mm: f64,
    origin_y_mm: f64,
    y_axis: String,
    pixel_um: f64,
}

impl Frame {
    fn frame(&self) -> PyResult<WorkpieceFrame> {
        let y_axis = match self.y_axis.as_str() {
            "up" => YAxis::Up,
            "down" => YAxis::Down,
            other => {
                return Err(option_error("y_axis", format!("{other:?}"), "\"up\" or \"down\""));
            }
        };
        let Self { origin_x_mm, origin_y_mm, pixel_um, .. } = *self;
        Ok(WorkpieceFrame { origin_x_mm, origin_y_mm, y_axis, pixel_um })
    }
}

fn path_of(xy_px: &PyReadonlyArray2<'_, f64>, pulse_radius_px: f64) -> PyResult<PulsePath> {
    PulsePath::new(points_of(xy_px)?, pulse_radius_px).map_err(toolpath_error)
}

/// Pulses as a GRBL program.
#[pyfunction]
pub(crate) fn write_gcode(
    xy_px: PyReadonlyArray2<'_, f64>,
    pulse_radius_px: f64,
    frame: Frame,
    power_s: f64,
    dwell_s: f64,
    settling_s: f64,
    feed_mm_min: Option<f64>,
) -> PyResult<String> {
    let travel =
        feed_mm_min.map_or(TravelMove::Rapid, |feed_mm_min| TravelMove::Feed { feed_mm_min });
    let options = GcodeOptions { frame: frame.frame()?, power_s, dwell_s, settling_s, travel };
    let path = path_of(&xy_px, pulse_radius_px)?;
    lasergym_toolpath::write_gcode(&path, &options).map_err(toolpath_error)
}

/// The pulses of a GRBL program, shape (n, 2), px.
#[pyfunction]
pub(crate) fn read_gcode<'py>(
    py: Python<'py>,
    text: &str,
    pulse_radius_px: f64,
    frame: Frame,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let path = lasergym_toolpath::read_gcode(text, &frame.frame()?, pulse_radius_px)
        .map_err(toolpath_error)?;
    Ok(positions_of(py, path.positions_px()))
}

/// Pulses as CSV, µm.
#[pyfunction]
pub(crate) fn write_csv(
    xy_px: PyReadonlyArray2<'_, f64>,
    pulse_radius_px: f64,
) -> PyResult<String> {
    Ok(lasergym_toolpath::write_csv(&path_of(&xy_px, pulse_radius_px)?))
}

/// The pulses of a CSV file, shape (n, 2), px.
#[pyfunction]
pub(crate) fn read_csv<'py>(
    py: Python<'py>,
    text: &str,
    pulse_radius_px: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let path = lasergym_toolpath::read_csv(text, pulse_radius_px).map_err(toolpath_error)?;
    Ok(positions_of(py, path.positions_px()))
}

/// (length µm, time s, moving s, settling s, firing s) of a stage firing the pulses in order.
#[pyfunction]
pub(crate) fn travel(
    xy_px: PyReadonlyArray2<'_, f64>,
    max_speed_um_s: f64,
    acceleration_um_s2: f64,
    settling_s: f64,
    pulse_s: f64,
) -> PyResult<(f64, f64, f64, f64, f64)> {
    let dynamics = StageDynamics { max_speed_um_s, acceleration_um_s2, settling_s, pulse_s };
    // The radius of the marks plays no part in the travel.
    let path = path_of(&xy_px, 1.0)?;
    let travel = time_path(&path, &dynamics).map_err(toolpath_error)?;
    Ok((travel.length_um, travel.time_s, travel.moving_s, travel.settling_s, travel.firing_s))
}
