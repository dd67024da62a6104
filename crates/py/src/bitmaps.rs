//! Bitmaps as Boolean arrays of shape (100, 100), and positions as arrays of shape (n, 2).

use lasergym_geom::{Bitmap, Point, WORKPIECE_SIZE_PX};
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::exception;

/// (remaining, forbidden) as Boolean arrays of shape (100, 100).
pub(crate) type LayerArrays<'py> = (Bound<'py, PyArray2<bool>>, Bound<'py, PyArray2<bool>>);

/// The bitmap of a Boolean array of shape (100, 100).
pub(crate) fn bitmap_of(array: &PyReadonlyArray2<'_, bool>) -> PyResult<Bitmap> {
    let shape = array.shape();
    if shape != [WORKPIECE_SIZE_PX, WORKPIECE_SIZE_PX] {
        return Err(exception(
            "TargetShapeError",
            format!(
                "the target has shape {shape:?}, but must be a Boolean array of shape \
                 ({WORKPIECE_SIZE_PX}, {WORKPIECE_SIZE_PX})"
            ),
        ));
    }
    let pixels = array.as_array();
    Ok(Bitmap::from_fn(|row, column| pixels[[row, column]]))
}

/// The Boolean array of a bitmap, shape (100, 100).
pub(crate) fn array_of<'py>(py: Python<'py>, bitmap: &Bitmap) -> Bound<'py, PyArray2<bool>> {
    let mut array = numpy::ndarray::Array2::default((WORKPIECE_SIZE_PX, WORKPIECE_SIZE_PX));
    for (mut pixels, &row) in array.rows_mut().into_iter().zip(bitmap.rows()) {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            *pixel = (row >> column) & 1 == 1;
        }
    }
    array.into_pyarray(py)
}

/// The points of an array of shape (n, 2).
pub(crate) fn points_of(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Point>> {
    let shape = array.shape();
    if shape[1] != 2 {
        return Err(exception(
            "PositionError",
            format!("the positions have shape {shape:?}, but must have shape (pulses, 2), px"),
        ));
    }
    Ok(array.as_array().rows().into_iter().map(|row| Point::new(row[0], row[1])).collect())
}

/// The array of shape (n, 2) of points.
pub(crate) fn positions_of<'py>(py: Python<'py>, points: &[Point]) -> Bound<'py, PyArray2<f64>> {
    numpy::ndarray::Array2::from_shape_fn((points.len(), 2), |(index, axis)| {
        if axis == 0 { points[index].x } else { points[index].y }
    })
    .into_pyarray(py)
}
