//! Targets, and the score of pulses fired at them.

use lasergym_ablation::{
    Stream, random_shape as draw_random_shape, score as judge, star as draw_star,
};
use numpy::ndarray::Array1;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::bitmaps::{array_of, bitmap_of, points_of};
use crate::errors::ablation_error;

/// The star turned clockwise by `angle_deg`.
#[pyfunction]
pub(crate) fn star(py: Python<'_>, angle_deg: f64) -> Bound<'_, PyArray2<bool>> {
    array_of(py, &draw_star(angle_deg))
}

/// The random shape of `seed`.
#[pyfunction]
pub(crate) fn random_shape(py: Python<'_>, seed: u64) -> Bound<'_, PyArray2<bool>> {
    array_of(py, &draw_random_shape(&mut Stream::from_seed(seed)).target)
}

/// Areas of the random shapes of `count` seeds from `first_seed` on, px, shape (count,).
#[pyfunction]
pub(crate) fn random_shape_areas(
    py: Python<'_>,
    first_seed: u64,
    count: usize,
) -> Bound<'_, PyArray1<i64>> {
    let area_px = |k: usize| {
        let mut stream = Stream::from_seed(first_seed.wrapping_add(k as u64));
        i64::from(draw_random_shape(&mut stream).target.area_px())
    };
    let areas: Array1<i64> = py.detach(|| (0..count).map(area_px).collect());
    areas.into_pyarray(py)
}

/// (reward, machined fraction, off-target fraction, pulses) of pulses fired at a target.
#[pyfunction]
pub(crate) fn score(
    target: PyReadonlyArray2<'_, bool>,
    xy_px: PyReadonlyArray2<'_, f64>,
    pulse_radius_px: f64,
) -> PyResult<(f64, f64, f64, usize)> {
    let score = judge(&bitmap_of(&target)?, &points_of(&xy_px)?, pulse_radius_px)
        .map_err(ablation_error)?;
    Ok((score.reward, score.machined_fraction, score.off_target_fraction, score.pulses))
}
