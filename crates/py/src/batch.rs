//! Environments that step together.

use lasergym_ablation::{Action, Batch, BatchOptions, Environment, StepRecord};
use lasergym_batch::Batched;
use numpy::ndarray::Array2;
use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyArray4, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::batch_arrays::{EpisodeArrays, gather_records, into_buffer, into_buffers};
use crate::bitmaps::{LayerArrays, array_of, bitmap_of};
use crate::errors::{ablation_error, option_error};
use crate::settings::{Settings, autoreset_of, count};

/// Environments of one task that step together.
#[pyclass(name = "Batch", module = "lasergym._native")]
pub(crate) struct NativeBatch {
    batch: Batch,
}

/// Progress of every environment as arrays of shape (n,):
/// (machined fraction, off-target fraction, pulses).
type ProgressArrays<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);

#[pymethods]
impl NativeBatch {
    #[new]
    fn new(
        settings: Settings<'_>,
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
        let environment =
            Environment::new(settings.task()?, settings.options()?).map_err(ablation_error)?;
        let batch = Batch::new(environment, options).map_err(ablation_error)?;
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
            py.detach(|| batch.reset(&seeds, mask.as_deref(), observations)).map_err(ablation_error)
        })
    }

    /// Begins an episode with the given target in one environment and writes its observation.
    fn reset_to(
        &mut self,
        index: usize,
        target: PyReadonlyArray2<'_, bool>,
        observations: &Bound<'_, PyArray4<u8>>,
    ) -> PyResult<()> {
        let target = bitmap_of(&target)?;
        into_buffer(observations, |observations| {
            self.batch.reset_to(index, &target, observations).map_err(ablation_error)
        })
    }

    /// Fires one pulse in every environment and writes what changed.
    #[pyo3(signature = (actions, observations, final_observations=None))]
    fn step(
        &mut self,
        py: Python<'_>,
        actions: PyReadonlyArray2<'_, f32>,
        observations: &Bound<'_, PyArray4<u8>>,
        final_observations: Option<&Bound<'_, PyArray4<u8>>>,
    ) -> PyResult<()> {
        let actions: Vec<Action> =
            actions.as_array().rows().into_iter().map(|row| [row[0], row[1]]).collect();
        let batch = &mut self.batch;
        into_buffers(observations, final_observations, |observations, last| {
            py.detach(|| batch.step(&actions, observations, last)).map_err(ablation_error)
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
        (
            gather(py, &self.batch, |record| record.progress.machined_fraction),
            gather(py, &self.batch, |record| record.progress.off_target_fraction),
            gather(py, &self.batch, |record| i64::from(record.progress.pulses)),
        )
    }

    /// Progress of the episodes that the last step finished; 0 elsewhere.
    fn final_progress<'py>(&self, py: Python<'py>) -> ProgressArrays<'py> {
        let finished = |record: &StepRecord| record.finished.map(|episode| episode.progress);
        (
            gather(py, &self.batch, |record| finished(record).map_or(0.0, |p| p.machined_fraction)),
            gather(py, &self.batch, |record| {
                finished(record).map_or(0.0, |p| p.off_target_fraction)
            }),
            gather(py, &self.batch, |record| finished(record).map_or(0, |p| i64::from(p.pulses))),
        )
    }

    /// Episodes that the last step finished, as arrays of shape (n,), 0 elsewhere:
    /// (finished, success, return, length).
    fn finished<'py>(&self, py: Python<'py>) -> EpisodeArrays<'py> {
        finished(py, &self.batch)
    }

    /// The last pulse of every episode as it landed, shape (n, 3): x, y, radius, px; NaN before the
    /// first.
    fn last_pulses<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let pulses = (0..self.batch.len()).map(|index| {
            self.batch
                .environment(index)
                .and_then(Environment::last_pulse)
                .map_or([f64::NAN; 3], |pulse| {
                    [pulse.position.x, pulse.position.y, pulse.radius_px]
                })
        });
        let mut array = Array2::zeros((self.batch.len(), 3));
        for (mut row, pulse) in array.rows_mut().into_iter().zip(pulses) {
            row.assign(&numpy::ndarray::ArrayView1::from(&pulse));
        }
        array.into_pyarray(py)
    }

    /// (remaining, forbidden) of one environment, Boolean arrays of shape (100, 100).
    fn layers<'py>(&self, py: Python<'py>, index: usize) -> PyResult<LayerArrays<'py>> {
        let environment = self
            .batch
            .environment(index)
            .ok_or_else(|| option_error("index", index, "below the number of environments"))?;
        let workpiece = environment.workpiece();
        Ok((array_of(py, workpiece.remaining()), array_of(py, workpiece.forbidden())))
    }
}

/// One value of every record, shape (n,).
pub(crate) fn gather<'py, E: Batched, T: Element>(
    py: Python<'py>,
    batch: &lasergym_batch::Batch<E>,
    value: impl Fn(&lasergym_batch::StepRecord<E::Progress>) -> T,
) -> Bound<'py, PyArray1<T>> {
    gather_records(py, batch.records(), value)
}

/// Episodes that the last step finished, as arrays of shape (n,), 0 elsewhere:
/// (finished, success, return, length).
pub(crate) fn finished<'py, E: Batched>(
    py: Python<'py>,
    batch: &lasergym_batch::Batch<E>,
) -> EpisodeArrays<'py> {
    (
        gather(py, batch, |record| record.finished.is_some()),
        gather(py, batch, |record| record.finished.as_ref().is_some_and(|e| e.is_success)),
        gather(py, batch, |record| record.finished.as_ref().map_or(0.0, |e| e.episode_return)),
        gather(py, batch, |record| record.finished.as_ref().map_or(0, |e| i64::from(e.length))),
    )
}
