//! The CMA-ES optimiser.

use lasergym_plan::{Bounds, CmaEs, CmaEsError, CmaEsOptions};
use numpy::ndarray::ArrayView2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, ToPyArray};
use pyo3::prelude::*;

use crate::errors::{exception, option_error};

/// An optimiser that asks for costs of candidates.
#[pyclass(name = "CmaEs", module = "lasergym._native")]
pub(crate) struct NativeCmaEs {
    optimiser: CmaEs,
}

#[pymethods]
impl NativeCmaEs {
    #[new]
    #[pyo3(signature = (mean, sigma, population_size, seed, bounds, max_evaluations))]
    fn new(
        mean: PyReadonlyArray1<'_, f64>,
        sigma: f64,
        population_size: Option<i64>,
        seed: u64,
        bounds: Option<(Vec<f64>, Vec<f64>)>,
        max_evaluations: Option<i64>,
    ) -> PyResult<Self> {
        let size = |name: &str, value: Option<i64>| {
            value
                .map(|value| {
                    usize::try_from(value).map_err(|_| option_error(name, value, "at least 1"))
                })
                .transpose()
        };
        let options = CmaEsOptions {
            population_size: size("population_size", population_size)?,
            seed,
            bounds: bounds
                .map(|(lower, upper)| Bounds::new(lower, upper))
                .transpose()
                .map_err(cma_es_error)?,
            max_evaluations: size("max_evaluations", max_evaluations)?,
            ..CmaEsOptions::default()
        };
        let mean = mean.as_array().to_vec();
        Ok(Self { optimiser: CmaEs::new(&mean, sigma, options).map_err(cma_es_error)? })
    }

    /// The candidates of the next generation, shape (population, n).
    fn ask<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let shape = (self.optimiser.population_size(), self.optimiser.dimension());
        let candidates = ArrayView2::from_shape(shape, self.optimiser.ask())
            .map_err(|error| exception("ShapeError", error.to_string()))?;
        Ok(candidates.to_pyarray(py))
    }

    /// Takes the costs of the candidates, shape (population,); lower is better.
    fn tell(&mut self, costs: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        self.optimiser.tell(&costs.as_array().to_vec()).map_err(cma_es_error)
    }

    /// The best candidate so far and its cost; None before the first costs.
    fn best<'py>(&self, py: Python<'py>) -> Option<(Bound<'py, PyArray1<f64>>, f64)> {
        self.optimiser.best().map(|best| (best.x.to_pyarray(py), best.cost))
    }

    /// (evaluations, generations, step size).
    fn progress(&self) -> (usize, usize, f64) {
        (self.optimiser.evaluations(), self.optimiser.generation(), self.optimiser.sigma())
    }

    /// The mean of the distribution, shape (n,).
    fn mean<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.optimiser.mean().to_vec().into_pyarray(py)
    }

    /// Why the run has ended, (name, sentence); None while it goes on.
    fn termination(&self) -> Option<(&'static str, String)> {
        self.optimiser.termination().map(|reason| (reason.name(), reason.to_string()))
    }
}

/// The exception of a [`CmaEsError`].
fn cma_es_error(error: CmaEsError) -> PyErr {
    exception("OptimiserError", error.to_string())
}
