//! Milling environments, single and together, and plans for them.

use std::ops::ControlFlow;

use lasergym_batch::Stream;
use lasergym_milling::{
    Batch, BatchOptions, Environment, EnvironmentOptions, ObservationMode, Profile, Progress,
    SIZE_PX, SpotPlanner, StepRecord, random_relief as draw_relief,
};
use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArray4, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::batch::gather;
use crate::batch_arrays::{EpisodeArrays, into_buffer, into_buffers};
use crate::errors::{exception, option_error};
use crate::milling::milling_error;
use crate::settings::{autoreset_of, count};

/// Keyword arguments of a milling environment.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct MillingSettings<'py> {
    /// Text of the TOML profile.
    profile: String,
    target: Option<PyReadonlyArray2<'py, f64>>,
    observation: String,
    pixel_um: Option<f64>,
    depth_um: Option<f64>,
    longest_dwell_s: Option<f64>,
    max_spots: i64,
    tolerance_percent: f64,
    pointing_error_um: f64,
    dwell_error: f64,
}

impl MillingSettings<'_> {
    fn environment(&self) -> PyResult<Environment> {
        let options = EnvironmentOptions {
            profile: Profile::from_toml(&self.profile).map_err(milling_error)?,
            pixel_um: self.pixel_um,
            depth_um: self.depth_um,
            longest_dwell_s: self.longest_dwell_s,
            max_spots: count("max_spots", self.max_spots)?,
            tolerance_percent: self.tolerance_percent,
            pointing_error_um: self.pointing_error_um,
            dwell_error: self.dwell_error,
            target_um: self.target.as_ref().map(depths_of),
        };
        Environment::new(options).map_err(milling_error)
    }

    fn observation(&self) -> PyResult<ObservationMode> {
        match self.observation.as_str() {
            "residual" => Ok(ObservationMode::Residual),
            "layers" => Ok(ObservationMode::Layers),
            other => {
                let expected = "\"residual\" or \"layers\"";
                Err(option_error("observation", format!("{other:?}"), expected))
            }
        }
    }
}

fn depths_of(target: &PyReadonlyArray2<'_, f64>) -> Vec<f64> {
    target.as_array().iter().copied().collect()
}

fn square(py: Python<'_>, values: Vec<f64>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    Ok(Array2::from_shape_vec((SIZE_PX, SIZE_PX), values)
        .map_err(|error| exception("ShapeError", error.to_string()))?
        .into_pyarray(py))
}

/// Actions, shape (spots, 3); (tracking error %, machined fraction, off-target fraction, spots);
/// return; whether it is partial.
type PlanParts<'py> = (Bound<'py, PyArray2<f32>>, ProgressParts, f64, bool);

/// Tracking error, %; machined fraction; off-target fraction; spots.
type ProgressParts = (f64, f64, f64, u32);

/// Reward; terminated; x µm, y µm and dwell s of the spot as it was milled.
type StepParts = (f64, bool, f64, f64, f64);

fn parts(progress: Progress) -> ProgressParts {
    let Progress { tracking_error_percent, machined_fraction, off_target_fraction, spots } =
        progress;
    (tracking_error_percent, machined_fraction, off_target_fraction, spots)
}

/// One milling environment.
#[pyclass(name = "MillingEnvironment", module = "lasergym._native")]
#[derive(Clone)]
pub(crate) struct NativeMillingEnvironment {
    environment: Environment,
    observation: ObservationMode,
}

#[pymethods]
impl NativeMillingEnvironment {
    #[new]
    fn new(settings: MillingSettings<'_>) -> PyResult<Self> {
        Ok(Self { environment: settings.environment()?, observation: settings.observation()? })
    }

    /// Begins an episode.
    #[pyo3(signature = (seed=None))]
    fn reset(&mut self, seed: Option<u64>) {
        self.environment.reset(seed);
    }

    /// Begins an episode with the given target.
    fn reset_to(&mut self, target: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        self.environment.reset_to(&depths_of(&target)).map_err(milling_error)
    }

    /// Mills one spot; returns (reward, terminated, x µm, y µm, dwell s).
    fn step(&mut self, x: f32, y: f32, dwell: f32) -> PyResult<StepParts> {
        let step = self.environment.step([x, y, dwell]).map_err(milling_error)?;
        let spot = step.spot;
        Ok((step.reward, step.terminated, spot.x_um, spot.y_um, spot.dwell_s))
    }

    /// A new observation, uint8 of shape (channels, 100, 100).
    fn observation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<u8>> {
        let mut observation = Array3::zeros((self.observation.channels(), SIZE_PX, SIZE_PX));
        if let Some(bytes) = observation.as_slice_mut() {
            self.observation.write(&self.environment, bytes);
        }
        observation.into_pyarray(py)
    }

    /// (tracking error %, machined fraction, off-target fraction, spots).
    fn progress(&self) -> ProgressParts {
        parts(self.environment.progress())
    }

    /// Whether the tracking error is within the tolerance.
    fn is_success(&self) -> bool {
        self.environment.is_success()
    }

    /// Depths and target, µm, float64 of shape (100, 100).
    #[allow(clippy::type_complexity, reason = "two arrays")]
    fn surfaces<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
        let target = self.environment.target_um().to_vec();
        Ok((square(py, self.environment.depth_um())?, square(py, target)?))
    }

    /// (side of the workpiece µm, full scale µm, longest dwell s).
    fn scales(&self) -> (f64, f64, f64) {
        let environment = &self.environment;
        (environment.side_um(), environment.full_scale_um(), environment.longest_dwell_s())
    }

    /// Plans the rest of the episode, "pixel-by-pixel" or "adjoint"; `progress` is called with the
    /// fraction done and stops the planner by returning True; so does Ctrl-C.
    fn plan<'py>(
        &self,
        py: Python<'py>,
        planner: &str,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<PlanParts<'py>> {
        let planner = match planner {
            "pixel-by-pixel" => SpotPlanner::PixelByPixel,
            "adjoint" => SpotPlanner::Adjoint,
            other => {
                let expected = "\"pixel-by-pixel\" or \"adjoint\"";
                return Err(option_error("planner", format!("{other:?}"), expected));
            }
        };
        let mut failure = None;
        let mut report = |fraction: f64| {
            let wanted = Python::attach(|py| {
                if py.check_signals().is_err() {
                    return Ok(true);
                }
                let Some(progress) = &progress else { return Ok(false) };
                progress.bind(py).call1((fraction,))?.is_truthy()
            });
            match wanted {
                Ok(false) => return ControlFlow::Continue(()),
                Ok(true) => {}
                Err(error) => failure = Some(error),
            }
            ControlFlow::Break(())
        };
        let plan =
            py.detach(|| planner.plan(&self.environment, &mut report)).map_err(milling_error)?;
        if let Some(error) = failure {
            return Err(error);
        }
        let mut actions = Array2::zeros((plan.actions.len(), 3));
        for (mut row, action) in actions.rows_mut().into_iter().zip(&plan.actions) {
            row.assign(&numpy::ndarray::ArrayView1::from(action));
        }
        let progress = parts(plan.progress);
        Ok((actions.into_pyarray(py), progress, plan.episode_return, plan.partial))
    }

    /// An independent copy, the random stream included.
    fn copy(&self) -> Self {
        self.clone()
    }
}

/// Milling environments that step together.
#[pyclass(name = "MillingBatch", module = "lasergym._native")]
pub(crate) struct NativeMillingBatch {
    batch: Batch,
}

/// Progress of every environment as arrays of shape (n,):
/// (tracking error %, machined fraction, off-target fraction, spots).
type ProgressArrays<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
);

#[pymethods]
impl NativeMillingBatch {
    #[new]
    fn new(
        settings: MillingSettings<'_>,
        num_envs: usize,
        autoreset_mode: &str,
        max_episode_steps: Option<i64>,
        threads: i64,
    ) -> PyResult<Self> {
        let options = BatchOptions {
            environments: num_envs,
            autoreset: autoreset_of(autoreset_mode)?,
            observation: settings.observation()?,
            max_episode_steps: max_episode_steps
                .map(|steps| count("max_episode_steps", steps))
                .transpose()?,
            threads: usize::try_from(threads)
                .map_err(|_| option_error("threads", threads, "at least 1"))?,
        };
        let batch = Batch::new(settings.environment()?, options).map_err(milling_error)?;
        Ok(Self { batch })
    }

    /// Begins episodes where `mask` says so and writes their observations.
    #[pyo3(signature = (seeds, mask, observations))]
    fn reset(
        &mut self,
        py: Python<'_>,
        seeds: Vec<Option<u64>>,
        mask: Option<Vec<bool>>,
        observations: &Bound<'_, PyArray4<u8>>,
    ) -> PyResult<()> {
        let batch = &mut self.batch;
        into_buffer(observations, |observations| {
            py.detach(|| batch.reset(&seeds, mask.as_deref(), observations)).map_err(milling_error)
        })
    }

    /// Begins an episode with the given target in one environment and writes its observation.
    fn reset_to(
        &mut self,
        index: usize,
        target: PyReadonlyArray2<'_, f64>,
        observations: &Bound<'_, PyArray4<u8>>,
    ) -> PyResult<()> {
        into_buffer(observations, |observations| {
            self.batch.reset_to(index, &depths_of(&target), observations).map_err(milling_error)
        })
    }

    /// Mills one spot in every environment and writes what changed.
    #[pyo3(signature = (actions, observations, final_observations=None))]
    fn step(
        &mut self,
        py: Python<'_>,
        actions: PyReadonlyArray2<'_, f32>,
        observations: &Bound<'_, PyArray4<u8>>,
        final_observations: Option<&Bound<'_, PyArray4<u8>>>,
    ) -> PyResult<()> {
        let actions: Vec<[f32; 3]> =
            actions.as_array().rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect();
        let batch = &mut self.batch;
        into_buffers(observations, final_observations, |observations, last| {
            py.detach(|| batch.step(&actions, observations, last)).map_err(milling_error)
        })
    }

    /// Rewards of the last step, shape (n,).
    fn rewards<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        gather(py, &self.batch, |record| record.reward)
    }

    /// Terminations of the last step, shape (n,).
    fn terminated<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        gather(py, &self.batch, |record| record.terminated)
    }

    /// Truncations of the last step, shape (n,).
    fn truncated<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        gather(py, &self.batch, |record| record.truncated)
    }

    /// Progress of the episodes that the observations show.
    fn progress<'py>(&self, py: Python<'py>) -> ProgressArrays<'py> {
        self.progress_of(py, |record| Some(record.progress))
    }

    /// Progress of the episodes that the last step finished; 0 elsewhere.
    fn final_progress<'py>(&self, py: Python<'py>) -> ProgressArrays<'py> {
        self.progress_of(py, |record| record.finished.map(|episode| episode.progress))
    }

    /// Episodes that the last step finished, as arrays of shape (n,), 0 elsewhere:
    /// (finished, success, return, length).
    fn finished<'py>(&self, py: Python<'py>) -> EpisodeArrays<'py> {
        crate::batch::finished(py, &self.batch)
    }

    /// Depths and target of one environment, µm, float64 of shape (100, 100).
    #[allow(clippy::type_complexity, reason = "two arrays")]
    fn surfaces<'py>(
        &self,
        py: Python<'py>,
        index: usize,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
        let environment = self
            .batch
            .environment(index)
            .ok_or_else(|| option_error("index", index, "below the number of environments"))?;
        let target = environment.target_um().to_vec();
        Ok((square(py, environment.depth_um())?, square(py, target)?))
    }

    /// Full scale of the observations, µm.
    fn full_scale_um(&self) -> f64 {
        self.batch.environment(0).map_or(0.0, Environment::full_scale_um)
    }
}

impl NativeMillingBatch {
    fn progress_of<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&StepRecord) -> Option<Progress>,
    ) -> ProgressArrays<'py> {
        (
            gather(py, &self.batch, |r| of(r).map_or(0.0, |p| p.tracking_error_percent)),
            gather(py, &self.batch, |r| of(r).map_or(0.0, |p| p.machined_fraction)),
            gather(py, &self.batch, |r| of(r).map_or(0.0, |p| p.off_target_fraction)),
            gather(py, &self.batch, |r| of(r).map_or(0, |p| i64::from(p.spots))),
        )
    }
}

/// The random relief of `seed`, float64 of shape (100, 100), µm.
#[pyfunction]
pub(crate) fn random_relief(
    py: Python<'_>,
    seed: u64,
    depth_um: f64,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    square(py, draw_relief(&mut Stream::from_seed(seed), SIZE_PX, depth_um))
}
