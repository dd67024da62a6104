//! Jobs from which a spatial policy learns.

use lasergym_ablation::Task;
use lasergym_plan::{
    CORRECTION_REACH_PX, PulseAllowance, Teacher, TeacherOptions, VIEW_CHANNELS, VIEW_LEN,
    VIEW_SIZE,
};
use numpy::ndarray::{Array1, Array2, Array4};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray4, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::{exception, option_error, plan_error};

/// Values of a view, shape (n, 18, 28, 28), and candidates, shape (n, 2).
type Observed<'py> = (Bound<'py, PyArray4<f32>>, Bound<'py, PyArray2<i64>>);

/// Jobs in progress and what candidates for their next pulses gain in the end.
#[pyclass(name = "Teacher", module = "lasergym._native")]
pub(crate) struct NativeTeacher {
    teacher: Teacher,
}

#[pymethods]
impl NativeTeacher {
    /// `pulses` is the range of the number of pulses, or None for area / 125 ± 10 %.
    #[new]
    fn new(
        py: Python<'_>,
        task: &str,
        jobs: usize,
        seed: u64,
        moves: u64,
        pulses: Option<(u32, u32)>,
    ) -> PyResult<Self> {
        let task = match task {
            "star" => Task::Star,
            "rotated_star" => Task::RotatedStar,
            "random_shape" => Task::RandomShape,
            other => {
                return Err(option_error("task", other, "star, rotated_star or random_shape"));
            }
        };
        let by_area = PulseAllowance::ByArea { area_per_pulse_px: 125.0, spread: 0.1 };
        let pulses = pulses.map_or(by_area, |(least, most)| PulseAllowance::Between(least, most));
        let options = TeacherOptions { task, pulses, jobs, seed, moves };
        let teacher = py.detach(|| Teacher::new(&options)).map_err(plan_error)?;
        Ok(Self { teacher })
    }

    /// Views, float32 of shape (jobs, 18, 28, 28), and candidates (row, column), shape (jobs, 2).
    fn observe<'py>(&self, py: Python<'py>) -> PyResult<Observed<'py>> {
        let jobs = self.teacher.jobs();
        let mut views = vec![0.0; jobs * VIEW_LEN];
        let candidates = py.detach(|| self.teacher.observe(&mut views));
        let views = Array4::from_shape_vec((jobs, VIEW_CHANNELS, VIEW_SIZE, VIEW_SIZE), views)
            .map_err(|error| exception("ShapeError", error.to_string()))?;
        Ok((views.into_pyarray(py), pixels_of(py, &candidates)))
    }

    /// The pixels (row, column) of the planned pulses nearest to the candidates, shape (jobs, 2).
    fn planned<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let pixels = py.detach(|| self.teacher.planned()).map_err(plan_error)?;
        Ok(pixels_of(py, &pixels))
    }

    /// What each job gains in the end, px, shape (jobs, k), for next pulses about `pixels` (row,
    /// column), shape (jobs, k, 2).
    fn values<'py>(
        &mut self,
        py: Python<'py>,
        pixels: PyReadonlyArray3<'_, i64>,
    ) -> PyResult<Bound<'py, PyArray2<i32>>> {
        let shape = pixels.shape();
        let (jobs, each) = (shape[0], shape[1]);
        if shape[2] != 2 || jobs != self.teacher.jobs() {
            return Err(exception(
                "ShapeError",
                format!("the pixels have shape {shape:?}, but must have shape (jobs, k, 2)"),
            ));
        }
        let coordinate = |value: i64| {
            usize::try_from(value).map_err(|_| option_error("pixel", value, "on the workpiece"))
        };
        let pixels: Vec<(usize, usize)> = pixels
            .as_array()
            .rows()
            .into_iter()
            .map(|pixel| Ok((coordinate(pixel[0])?, coordinate(pixel[1])?)))
            .collect::<PyResult<_>>()?;
        let values = py.detach(|| self.teacher.values_px(&pixels)).map_err(plan_error)?;
        let values = Array2::from_shape_vec((jobs, each), values)
            .map_err(|error| exception("ShapeError", error.to_string()))?;
        Ok(values.into_pyarray(py))
    }

    /// Fires in every job where `corrections`, shape (jobs, 17, 17), say; returns gain / area where
    /// a job ended and NaN elsewhere, shape (jobs,).
    fn fire<'py>(
        &mut self,
        py: Python<'py>,
        corrections: PyReadonlyArray3<'_, f32>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let width = 2 * CORRECTION_REACH_PX + 1;
        let shape = corrections.shape();
        if shape != [self.teacher.jobs(), width, width] {
            return Err(exception(
                "ShapeError",
                format!("the corrections have shape {shape:?}, but must have (jobs, 17, 17)"),
            ));
        }
        let corrections: Vec<f32> = corrections.as_array().iter().copied().collect();
        let ends = py.detach(|| self.teacher.fire(&corrections)).map_err(plan_error)?;
        let ends: Array1<f64> = ends.into_iter().map(|end| end.unwrap_or(f64::NAN)).collect();
        Ok(ends.into_pyarray(py))
    }
}

fn pixels_of<'py>(py: Python<'py>, pixels: &[(usize, usize)]) -> Bound<'py, PyArray2<i64>> {
    Array2::from_shape_fn((pixels.len(), 2), |(job, axis)| {
        let (row, column) = pixels[job];
        (if axis == 0 { row } else { column }).cast_signed() as i64
    })
    .into_pyarray(py)
}
