//! Pictures of targets and pulses.

use std::time::Duration;

use lasergym_geom::{DrawingError, Picture, Point, animation_gif, svg_to_rgba};
use lasergym_toolpath::{OverlayOptions, Pulse, Trajectory, trajectory_svg};
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3, PyReadonlyArray2, PyReadonlyArray4, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::bitmaps::bitmap_of;
use crate::errors::{drawing_error, exception, job_error, option_error, toolpath_error};

/// A frame of a job as (JPEG, columns, rows), from the bytes of its PNG `file`.
#[pyfunction]
pub(crate) fn frame_preview<'py>(
    py: Python<'py>,
    content: &[u8],
    file: &str,
) -> PyResult<(Bound<'py, PyBytes>, usize, usize)> {
    let preview =
        py.detach(|| lasergym_machine::frame_preview(content, file)).map_err(job_error)?;
    Ok((PyBytes::new(py, &preview.jpeg), preview.width_px, preview.height_px))
}

/// A target with pulses in firing order, and how it is drawn.
#[pyclass(name = "TrajectoryPicture", module = "lasergym._native", frozen)]
pub(crate) struct NativeTrajectoryPicture {
    trajectory: Trajectory,
    options: OverlayOptions,
}

#[pymethods]
impl NativeTrajectoryPicture {
    /// `pulses` has shape (n, 3): x, y and radius of each pulse, px.
    #[new]
    fn new(
        target: PyReadonlyArray2<'_, bool>,
        pulses: PyReadonlyArray2<'_, f64>,
        width_px: u32,
        legend: bool,
        order_numbers: bool,
        caption: Option<String>,
    ) -> PyResult<Self> {
        let shape = pulses.shape();
        if shape[1] != 3 {
            return Err(exception(
                "PositionError",
                format!(
                    "the pulses have shape {shape:?}, but must have shape (n, 3): x, y, radius"
                ),
            ));
        }
        let pulses = pulses
            .as_array()
            .rows()
            .into_iter()
            .map(|row| Pulse { position_px: Point::new(row[0], row[1]), radius_px: row[2] })
            .collect();
        let trajectory = Trajectory::new(bitmap_of(&target)?, pulses).map_err(toolpath_error)?;
        let options = OverlayOptions {
            width_px,
            order_numbers,
            legend,
            labels: legend || order_numbers || caption.is_some(),
            caption,
        };
        Ok(Self { trajectory, options })
    }

    /// The picture as an SVG document.
    fn svg(&self) -> String {
        trajectory_svg(&self.trajectory, &self.options)
    }

    /// The picture as the bytes of a PNG file.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let png = self.picture(py)?.to_png().map_err(drawing_error)?;
        Ok(PyBytes::new(py, &png))
    }

    /// The picture as an array, uint8 of shape (height, width, 3).
    fn rgb_array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let picture = self.picture(py)?;
        let (height, width) = (picture.height_px as usize, picture.width_px as usize);
        let rgb: Vec<u8> =
            picture.rgba.chunks_exact(4).flat_map(|rgba| [rgba[0], rgba[1], rgba[2]]).collect();
        let array = Array3::from_shape_vec((height, width, 3), rgb)
            .map_err(|error| exception("ShapeError", error.to_string()))?;
        Ok(array.into_pyarray(py))
    }
}

impl NativeTrajectoryPicture {
    /// Renders the picture; without its words where no font is installed.
    fn picture(&self, py: Python<'_>) -> PyResult<Picture> {
        let render = |options: &OverlayOptions| {
            svg_to_rgba(&trajectory_svg(&self.trajectory, options), options.width_px)
        };
        py.detach(|| match render(&self.options) {
            Err(DrawingError::NoFont { .. }) => {
                render(&OverlayOptions { labels: false, ..self.options.clone() })
            }
            other => other,
        })
        .map_err(drawing_error)
    }
}

/// Pictures, uint8 of shape (pictures, height, width, 3), as the bytes of a GIF file that shows each
/// for `delay_s`.
#[pyfunction]
pub(crate) fn gif<'py>(
    py: Python<'py>,
    pictures: PyReadonlyArray4<'_, u8>,
    delay_s: f64,
) -> PyResult<Bound<'py, PyBytes>> {
    let &[_, height, width, 3] = pictures.shape() else {
        let shape = pictures.shape();
        let expected = "(pictures, height, width, 3)";
        let message = format!("the pictures have shape {shape:?}, but must have shape {expected}");
        return Err(exception("ShapeError", message));
    };
    let delay = Duration::try_from_secs_f64(delay_s)
        .map_err(|_| option_error("delay_s", delay_s, "at least 0, in seconds"))?;
    let side =
        |px: usize| u32::try_from(px).map_err(|error| exception("ShapeError", error.to_string()));
    let (width_px, height_px) = (side(width)?, side(height)?);
    let pictures: Vec<Picture> = pictures
        .as_array()
        .outer_iter()
        .map(|picture| {
            let opaque = |rgb: numpy::ndarray::ArrayView1<'_, u8>| [rgb[0], rgb[1], rgb[2], 255];
            let rgba = picture.rows().into_iter().flat_map(opaque).collect();
            Picture { width_px, height_px, rgba }
        })
        .collect();
    let bytes = py.detach(|| animation_gif(&pictures, delay)).map_err(drawing_error)?;
    Ok(PyBytes::new(py, &bytes))
}
