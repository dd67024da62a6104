//! Errors of the crates as exceptions of `lasergym.errors`.

use lasergym_ablation::AblationError;
use lasergym_batch::BatchError;
use lasergym_geom::DrawingError;
use lasergym_machine::{CalibrationError, JobError};
use lasergym_plan::PlanError;
use lasergym_toolpath::ToolpathError;
use pyo3::PyErr;
use pyo3::prelude::*;

/// The exception `class` of `lasergym.errors` with `message`.
pub(crate) fn exception(class: &str, message: String) -> PyErr {
    Python::attach(|py| {
        let instance = py
            .import("lasergym.errors")
            .and_then(|module| module.getattr(class))
            .and_then(|class| class.call1((message,)));
        match instance {
            Ok(instance) => PyErr::from_value(instance),
            Err(error) => error,
        }
    })
}

/// An option whose value is outside its range.
pub(crate) fn option_error(name: &str, value: impl std::fmt::Display, expected: &str) -> PyErr {
    exception("OptionError", format!("{name} is {value}, but must be {expected}"))
}

/// The exception of an [`AblationError`].
pub(crate) fn ablation_error(error: AblationError) -> PyErr {
    let class = match &error {
        AblationError::InvalidOption { .. } => "OptionError",
        AblationError::EmptyTarget => "EmptyTargetError",
        AblationError::FullTarget => "FullTargetError",
        AblationError::ActionNotFinite { .. } => "ActionNotFiniteError",
        AblationError::PositionNotFinite { .. } => "PositionError",
        AblationError::EpisodeOver { .. } => "EpisodeOverError",
        AblationError::WrongLength { .. } => "ShapeError",
        AblationError::Threads { .. } => "ThreadsError",
    };
    exception(class, error.to_string())
}

/// The exception of a [`BatchError`].
pub(crate) fn batch_error(error: BatchError) -> PyErr {
    ablation_error(error.into())
}

/// The exception of a [`DrawingError`].
pub(crate) fn drawing_error(error: DrawingError) -> PyErr {
    let class = match &error {
        DrawingError::NotFound { .. } => "DrawingNotFoundError",
        DrawingError::Unreadable { .. } | DrawingError::Unwritable { .. } => {
            "DrawingUnreadableError"
        }
        DrawingError::UnknownFormat { .. } => "UnknownDrawingFormatError",
        DrawingError::NotAnImage { .. }
        | DrawingError::Truncated { .. }
        | DrawingError::Malformed { .. } => "BrokenDrawingError",
        DrawingError::TooLarge { .. } | DrawingError::WrongSize { .. } => "DrawingSizeError",
        DrawingError::NoShapes { .. } => "NoShapesError",
        DrawingError::UnknownEntities { .. } => "UnknownEntitiesError",
        DrawingError::OpenContour { .. } => "OpenContourError",
        DrawingError::NoFont { .. } => "MissingFontError",
        DrawingError::EmptyTarget => "EmptyTargetError",
        DrawingError::FullTarget => "FullTargetError",
        DrawingError::InvalidOption { .. } => "OptionError",
        DrawingError::NoThread { .. } => "ThreadsError",
        _ => "DrawingError",
    };
    exception(class, error.to_string())
}

/// The exception of a [`ToolpathError`].
pub(crate) fn toolpath_error(error: ToolpathError) -> PyErr {
    let class = match &error {
        ToolpathError::OptionValue { .. } | ToolpathError::PulseRadius { .. } => "OptionError",
        ToolpathError::Position { .. } => "PositionError",
        _ => "ProgramError",
    };
    exception(class, error.to_string())
}

/// The exception of a [`PlanError`].
pub(crate) fn plan_error(error: PlanError) -> PyErr {
    let class = match &error {
        PlanError::InvalidOption { .. }
        | PlanError::Disturbance { .. }
        | PlanError::NoPulses
        | PlanError::TooManyPulses { .. }
        | PlanError::PulseRadius { .. }
        | PlanError::TooManyVariables { .. }
        | PlanError::UnknownPlanner { .. } => "OptionError",
        PlanError::NothingRemains => "EmptyTargetError",
        PlanError::PositionNotFinite { .. } => "PositionError",
        PlanError::Threads { .. } => "ThreadsError",
        PlanError::Policy(_)
        | PlanError::UnknownPolicy { .. }
        | PlanError::PolicyDecision { .. } => "PolicyError",
        _ => "PlanError",
    };
    exception(class, error.to_string())
}

/// The exception of a [`JobError`].
pub(crate) fn job_error(error: JobError) -> PyErr {
    let class = match &error {
        JobError::InvalidOption { .. } => "OptionError",
        JobError::Storage { .. }
        | JobError::JournalFull { .. }
        | JobError::Record { .. }
        | JobError::Thread { .. } => "JobFailedError",
        JobError::Journal { .. } => "JournalError",
        _ => "JobError",
    };
    match error {
        JobError::Plan(error) => plan_error(error),
        other => exception(class, other.to_string()),
    }
}

/// The exception of a [`CalibrationError`].
pub(crate) fn calibration_error(error: CalibrationError) -> PyErr {
    let class = match &error {
        CalibrationError::InvalidOption { .. } => "OptionError",
        _ => "CalibrationError",
    };
    exception(class, error.to_string())
}
