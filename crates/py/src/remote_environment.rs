//! Environments of remote tasks.

use lasergym_remote::{
    DIRECTIONS, RandomLayout, ScanAutoreset, ScanBatch, ScanEnvironment, ScanProgress, ScanRecord,
};
use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::batch_arrays::{EpisodeArrays, gather_records, into_buffer, into_buffers};
use crate::errors::{exception, option_error};
use crate::remote::remote_error;
use crate::settings::count;

/// Cycle time of the joint choice and of the greedy one, s, and the actions that follow the lines of
/// the joint choice.
type PlanParts = (f64, f64, Vec<(usize, usize)>);

/// Rewards, terminated, truncated.
type OutcomeArrays<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>);

/// (subtasks done, lines, cycle time s).
type Progress = (usize, usize, f64);

/// Progress of every environment as arrays of shape (n,).
type ProgressArrays<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>);

/// Keyword arguments of the environments.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct LayoutSettings {
    subtasks: i64,
    area_mm2: f64,
    welded: f64,
}

impl LayoutSettings {
    fn layout(&self) -> PyResult<RandomLayout> {
        let subtasks = count("subtasks", self.subtasks)? as usize;
        Ok(RandomLayout { subtasks, area_mm2: self.area_mm2, welded: self.welded })
    }
}

/// One environment.
#[pyclass(name = "RemoteEnvironment", module = "lasergym._native")]
#[derive(Clone)]
pub(crate) struct NativeRemoteEnvironment {
    environment: ScanEnvironment,
}

#[pymethods]
impl NativeRemoteEnvironment {
    #[new]
    fn new(settings: LayoutSettings) -> PyResult<Self> {
        let environment = ScanEnvironment::new(settings.layout()?).map_err(remote_error)?;
        Ok(Self { environment })
    }

    /// Begins an episode.
    #[pyo3(signature = (seed=None))]
    fn reset(&mut self, seed: Option<u64>) -> PyResult<()> {
        self.environment.reset(seed).map_err(remote_error)
    }

    /// Chooses (subtask, direction); returns (reward, terminated).
    fn step(&mut self, subtask: i64, direction: i64) -> PyResult<(f64, bool)> {
        let action = self.environment.action([subtask, direction]).map_err(remote_error)?;
        let step = self.environment.step(action).map_err(remote_error)?;
        Ok((step.reward, step.terminated))
    }

    /// A new observation, float32.
    fn observation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let mut observation = vec![0.0; self.environment.observation_len()];
        self.environment.observe(&mut observation).map_err(remote_error)?;
        Ok(observation.into_pyarray(py))
    }

    /// (subtasks done, lines, cycle time s).
    fn progress(&self) -> Progress {
        parts(&self.environment.progress())
    }

    /// Whether every subtask is done.
    fn is_success(&self) -> bool {
        self.environment.progress().is_success
    }

    /// Side of the sheet, mm; (x, y, radius) of each subtask; which are done; (from, to) of each line.
    #[allow(clippy::type_complexity)] // A picture's parts, named where they are unpacked.
    fn picture(&self) -> (f64, Vec<(f64, f64, f64)>, Vec<bool>, Vec<((f64, f64), (f64, f64))>) {
        let environment = &self.environment;
        let subtasks = environment.task().subtasks.iter().map(|subtask| {
            let circle = lasergym_remote::Circle::enclosing(&subtask.path);
            (circle.center.x, circle.center.y, circle.radius_mm)
        });
        let lines = environment
            .lines()
            .map(|line| ((line.from_mm[0], line.from_mm[1]), (line.to_mm[0], line.to_mm[1])));
        (
            environment.layout().side_mm(),
            subtasks.collect(),
            environment.done().to_vec(),
            lines.collect(),
        )
    }

    /// The plan for the task of this episode.
    fn planned(&self, py: Python<'_>) -> PyResult<PlanParts> {
        use lasergym_remote::{LineChoice, PlanOptions, RemotePlan};
        let task = self.environment.task();
        py.detach(|| {
            let plan =
                |choice| RemotePlan::new(task, &PlanOptions { choice, ..PlanOptions::default() });
            let (joint, greedy) = (plan(LineChoice::Joint)?, plan(LineChoice::Greedy)?);
            let turn = 360.0 / DIRECTIONS as f64;
            let actions = joint.lines.iter().flat_map(|line| {
                let degrees = line.routed.line.direction_rad.to_degrees();
                let nearest = (degrees / turn).round().rem_euclid(DIRECTIONS as f64) as usize + 1;
                line.stops()
                    .enumerate()
                    .map(move |(k, stop)| (stop, if k == 0 { nearest } else { 0 }))
            });
            let actions = actions.map(|(stop, direction)| (joint.stops[stop].subtask, direction));
            Ok((joint.cycle_time_s, greedy.cycle_time_s, actions.collect()))
        })
        .map_err(remote_error)
    }

    /// An independent copy, the random stream included.
    fn copy(&self) -> Self {
        self.clone()
    }
}

/// Environments that step together.
#[pyclass(name = "RemoteBatch", module = "lasergym._native")]
pub(crate) struct NativeRemoteBatch {
    batch: ScanBatch,
}

#[pymethods]
impl NativeRemoteBatch {
    #[new]
    fn new(
        settings: LayoutSettings,
        num_envs: usize,
        autoreset_mode: &str,
        max_episode_steps: Option<i64>,
    ) -> PyResult<Self> {
        let autoreset = match autoreset_mode {
            "NextStep" => ScanAutoreset::NextStep,
            "SameStep" => ScanAutoreset::SameStep,
            "Disabled" => ScanAutoreset::Disabled,
            other => {
                let accepted = "\"NextStep\", \"SameStep\" or \"Disabled\"";
                return Err(option_error("autoreset_mode", format!("{other:?}"), accepted));
            }
        };
        if num_envs == 0 {
            return Err(option_error("num_envs", num_envs, "at least 1"));
        }
        let limit = max_episode_steps.map(|steps| count("max_episode_steps", steps)).transpose()?;
        let batch =
            ScanBatch::new(settings.layout()?, num_envs, autoreset, limit).map_err(remote_error)?;
        Ok(Self { batch })
    }

    /// Begins episodes where `mask` says so and writes their observations.
    fn reset(
        &mut self,
        seeds: Vec<Option<u64>>,
        mask: Option<Vec<bool>>,
        observations: &Bound<'_, PyArray2<f32>>,
    ) -> PyResult<()> {
        into_buffer(observations, |observations| {
            self.batch.reset(&seeds, mask.as_deref(), observations).map_err(remote_error)
        })
    }

    /// Steps every environment and writes observations.
    #[pyo3(signature = (actions, observations, final_observations=None))]
    fn step(
        &mut self,
        py: Python<'_>,
        actions: PyReadonlyArray2<'_, i64>,
        observations: &Bound<'_, PyArray2<f32>>,
        final_observations: Option<&Bound<'_, PyArray2<f32>>>,
    ) -> PyResult<()> {
        if actions.shape()[1] != 2 {
            return Err(exception("ActionShapeError", "actions must have shape (n, 2)".into()));
        }
        let actions: Vec<[i64; 2]> =
            actions.as_array().rows().into_iter().map(|row| [row[0], row[1]]).collect();
        let batch = &mut self.batch;
        into_buffers(observations, final_observations, |observations, last| {
            py.detach(|| batch.step(&actions, observations, last)).map_err(remote_error)
        })
    }

    /// (rewards, terminated, truncated) of the last step, shape (n,) each.
    fn outcome<'py>(&self, py: Python<'py>) -> OutcomeArrays<'py> {
        (
            self.gather(py, |record| record.reward),
            self.gather(py, |record| record.terminated),
            self.gather(py, |record| record.truncated),
        )
    }

    /// Progress of the episodes that the observations show.
    fn progress<'py>(&self, py: Python<'py>) -> ProgressArrays<'py> {
        self.progress_of(py, |record| Some(record.progress))
    }

    /// Progress of the episodes that the last step finished; 0 elsewhere.
    fn final_progress<'py>(&self, py: Python<'py>) -> ProgressArrays<'py> {
        self.progress_of(py, |record| record.finished.map(|finished| finished.0))
    }

    /// Episodes that the last step finished: (finished, success, return, length), 0 elsewhere.
    fn finished<'py>(&self, py: Python<'py>) -> EpisodeArrays<'py> {
        (
            self.gather(py, |record| record.finished.is_some()),
            self.gather(py, |record| record.finished.is_some_and(|f| f.0.is_success)),
            self.gather(py, |record| record.finished.map_or(0.0, |f| f.1)),
            self.gather(py, |record| record.finished.map_or(0, |f| i64::from(f.2))),
        )
    }
}

impl NativeRemoteBatch {
    fn progress_of<'py>(
        &self,
        py: Python<'py>,
        progress: impl Fn(&ScanRecord) -> Option<ScanProgress>,
    ) -> ProgressArrays<'py> {
        let count = |value: usize| value.cast_signed() as i64;
        (
            self.gather(py, |record| progress(record).map_or(0, |p| count(p.done))),
            self.gather(py, |record| progress(record).map_or(0, |p| count(p.lines))),
            self.gather(py, |record| progress(record).map_or(0.0, |p| p.cycle_time_s)),
        )
    }

    /// One value of every record, shape (n,).
    fn gather<'py, T: Element>(
        &self,
        py: Python<'py>,
        value: impl Fn(&ScanRecord) -> T,
    ) -> Bound<'py, PyArray1<T>> {
        gather_records(py, self.batch.records().iter(), value)
    }
}

fn parts(progress: &ScanProgress) -> Progress {
    (progress.done, progress.lines, progress.cycle_time_s)
}
