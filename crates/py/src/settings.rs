//! Task and settings from keyword arguments.

use lasergym_ablation::{Autoreset, ObservationMode, Options, Task};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::bitmaps::bitmap_of;
use crate::errors::option_error;

/// Keyword arguments of an environment.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Settings<'py> {
    task: String,
    target: Option<PyReadonlyArray2<'py, bool>>,
    observation: String,
    pulse_radius_px: f64,
    max_pulses: i64,
    completion: f64,
    pointing_error_px: f64,
    radius_error: f64,
    stop_on_miss: bool,
}

impl Settings<'_> {
    /// The task that is named.
    pub(crate) fn task(&self) -> PyResult<Task> {
        match (self.task.as_str(), &self.target) {
            ("star", _) => Ok(Task::Star),
            ("rotated-star", _) => Ok(Task::RotatedStar),
            ("random-shape", _) => Ok(Task::RandomShape),
            ("pattern", Some(target)) => Ok(Task::Pattern(Box::new(bitmap_of(target)?))),
            ("pattern", None) => Err(option_error("target", "missing", "a pattern to machine")),
            (other, _) => Err(option_error(
                "task",
                format!("{other:?}"),
                "one of \"star\", \"rotated-star\", \"random-shape\", \"pattern\"",
            )),
        }
    }

    /// The observation mode that is named.
    pub(crate) fn observation(&self) -> PyResult<ObservationMode> {
        match self.observation.as_str() {
            "remaining" => Ok(ObservationMode::Remaining),
            "layers" => Ok(ObservationMode::Layers),
            other => Err(option_error(
                "observation",
                format!("{other:?}"),
                "\"remaining\" or \"layers\"",
            )),
        }
    }

    /// The settings of the process.
    pub(crate) fn options(&self) -> PyResult<Options> {
        Ok(Options {
            pulse_radius_px: self.pulse_radius_px,
            max_pulses: count("max_pulses", self.max_pulses)?,
            completion: self.completion,
            pointing_error_px: self.pointing_error_px,
            radius_error: self.radius_error,
            stop_on_miss: self.stop_on_miss,
        })
    }
}

/// A count that fits 32 bits; its lower end is checked where it is used.
pub(crate) fn count(name: &str, value: i64) -> PyResult<u32> {
    u32::try_from(value).map_err(|_| option_error(name, value, "in 1 … 4 294 967 295"))
}

/// The autoreset mode named as in `gymnasium.vector.AutoresetMode`.
pub(crate) fn autoreset_of(name: &str) -> PyResult<Autoreset> {
    match name {
        "NextStep" => Ok(Autoreset::NextStep),
        "SameStep" => Ok(Autoreset::SameStep),
        "Disabled" => Ok(Autoreset::Disabled),
        other => Err(option_error(
            "autoreset_mode",
            format!("{other:?}"),
            "\"NextStep\", \"SameStep\" or \"Disabled\"",
        )),
    }
}
