//! Pictures of targets and pulses.

use lasergym_geom::{DrawingError, Picture, Point, svg_to_rgba};
use lasergym_toolpath::{OverlayOptions, Pulse, Trajectory, trajectory_svg};
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::bitmaps::bitmap_of;
use crate::errors::{drawing_error, exception, toolpath_error};

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
