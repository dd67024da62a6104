//! Arrays of batches: buffers that a step writes, and a value of every environment.

use numpy::ndarray::{Array1, Dimension};
use numpy::{Element, IntoPyArray, PyArray, PyArray1, PyArrayMethods};
use pyo3::prelude::*;

use crate::errors::exception;

/// Episodes that a step finished, as arrays of shape (n,): (finished, success, return, length).
pub(crate) type EpisodeArrays<'py> = (
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
);

/// One value of every record, shape (n,).
pub(crate) fn gather_records<R, T: Element>(
    py: Python<'_>,
    records: impl Iterator<Item = R>,
    value: impl Fn(R) -> T,
) -> Bound<'_, PyArray1<T>> {
    records.map(value).collect::<Array1<T>>().into_pyarray(py)
}

/// Lets `write` fill the buffer of the observations.
pub(crate) fn into_buffer<T: Element, D: Dimension>(
    observations: &Bound<'_, PyArray<T, D>>,
    write: impl FnOnce(&mut [T]) -> PyResult<()>,
) -> PyResult<()> {
    let mut observations = observations.try_readwrite().map_err(borrowed)?;
    write(observations.as_slice_mut()?)
}

/// Lets `write` fill the buffers of the observations and of the last ones of episodes, which is
/// empty where none is given.
pub(crate) fn into_buffers<T: Element, D: Dimension>(
    observations: &Bound<'_, PyArray<T, D>>,
    final_observations: Option<&Bound<'_, PyArray<T, D>>>,
    write: impl FnOnce(&mut [T], &mut [T]) -> PyResult<()>,
) -> PyResult<()> {
    into_buffer(observations, |observations| match final_observations {
        Some(last) => into_buffer(last, |last| write(observations, last)),
        None => write(observations, &mut []),
    })
}

/// The error of a buffer that something else is writing to.
fn borrowed(error: numpy::BorrowError) -> PyErr {
    exception("ShapeError", format!("the observation buffer cannot be written: {error}"))
}
