//! Drawings in, PNG out.

use std::path::PathBuf;

use lasergym_geom::{DrawingOptions, Fit, Ink, load_drawing as load, target_to_png};
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::bitmaps::{array_of, bitmap_of};
use crate::errors::{drawing_error, option_error};

/// A drawing as a target.
#[pyfunction]
pub(crate) fn load_drawing<'py>(
    py: Python<'py>,
    path: PathBuf,
    margin_px: f64,
    threshold: f64,
    ink: &str,
    invert: bool,
    fit: &str,
) -> PyResult<Bound<'py, PyArray2<bool>>> {
    let ink = match ink {
        "auto" => Ink::Auto,
        "luminance" => Ink::Luminance,
        "alpha" => Ink::Alpha,
        other => {
            let expected = "one of \"auto\", \"luminance\", \"alpha\"";
            return Err(option_error("ink", format!("{other:?}"), expected));
        }
    };
    let fit = match fit {
        "scale" => Fit::Scale,
        "exact" => Fit::Exact,
        other => {
            return Err(option_error("fit", format!("{other:?}"), "\"scale\" or \"exact\""));
        }
    };
    let options = DrawingOptions { margin_px, threshold, ink, invert, fit };
    let target = py.detach(|| load(&path, &options)).map_err(drawing_error)?;
    Ok(array_of(py, &target))
}

/// A target as the bytes of a PNG file of 100 × 100 px, black where it is set.
#[pyfunction]
pub(crate) fn target_png<'py>(
    py: Python<'py>,
    target: PyReadonlyArray2<'_, bool>,
) -> PyResult<Bound<'py, PyBytes>> {
    let png = target_to_png(&bitmap_of(&target)?).map_err(drawing_error)?;
    Ok(PyBytes::new(py, &png))
}
