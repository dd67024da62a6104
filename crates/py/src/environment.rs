//! One environment.

use lasergym_ablation::{Environment, ObservationMode};
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::bitmaps::{LayerArrays, array_of, bitmap_of};
use crate::errors::ablation_error;
use crate::settings::Settings;

/// One environment of the pulse-ablation process.
#[pyclass(name = "Environment", module = "lasergym._native")]
#[derive(Clone)]
pub(crate) struct NativeEnvironment {
    environment: Environment,
    observation: ObservationMode,
}

#[pymethods]
impl NativeEnvironment {
    #[new]
    fn new(settings: Settings<'_>) -> PyResult<Self> {
        let environment =
            Environment::new(settings.task()?, settings.options()?).map_err(ablation_error)?;
        Ok(Self { environment, observation: settings.observation()? })
    }

    /// Begins an episode.
    #[pyo3(signature = (seed=None))]
    fn reset(&mut self, seed: Option<u64>) {
        self.environment.reset(seed);
    }

    /// Begins an episode with the given target.
    fn reset_to(&mut self, target: PyReadonlyArray2<'_, bool>) -> PyResult<()> {
        self.environment.reset_to(&bitmap_of(&target)?).map_err(ablation_error)
    }

    /// Fires one pulse; returns (reward, terminated, x px, y px, radius px).
    fn step(&mut self, x: f32, y: f32) -> PyResult<(f64, bool, f64, f64, f64)> {
        let step = self.environment.step([x, y]).map_err(ablation_error)?;
        let position = step.pulse.position;
        Ok((step.reward, step.terminated, position.x, position.y, step.pulse.radius_px))
    }

    /// A new observation, uint8 of shape (channels, 100, 100).
    fn observation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<u8>> {
        let size = lasergym_geom::WORKPIECE_SIZE_PX;
        let mut observation = Array3::zeros((self.observation.channels(), size, size));
        if let Some(bytes) = observation.as_slice_mut() {
            self.observation.write(&self.environment, bytes);
        }
        observation.into_pyarray(py)
    }

    /// (machined fraction, off-target fraction, pulses).
    fn progress(&self) -> (f64, f64, u32) {
        let progress = self.environment.progress();
        (progress.machined_fraction, progress.off_target_fraction, progress.pulses)
    }

    /// Whether the target is completed.
    fn is_success(&self) -> bool {
        self.environment.is_success()
    }

    /// (remaining, forbidden), Boolean arrays of shape (100, 100).
    fn layers<'py>(&self, py: Python<'py>) -> LayerArrays<'py> {
        let workpiece = self.environment.workpiece();
        (array_of(py, workpiece.remaining()), array_of(py, workpiece.forbidden()))
    }

    /// An independent copy, the random stream included.
    fn copy(&self) -> Self {
        self.clone()
    }
}
