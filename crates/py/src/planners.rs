//! Planners.

use std::ops::ControlFlow;

use lasergym_ablation::Workpiece;
use lasergym_plan::{Greedy, Job, PlanProgress, Planner, PlannerKind, Raster, RasterPitch};
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::bitmaps::{bitmap_of, positions_of};
use crate::errors::{ablation_error, option_error, plan_error};

/// A plan: positions, shape (n, 2), px; reward; machined fraction; off-target fraction; whether it
/// is partial.
type PlanParts<'py> = (Bound<'py, PyArray2<f64>>, f64, f64, f64, bool);

/// Keyword arguments of a plan.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PlanSettings {
    planner: String,
    pulse_radius_px: f64,
    max_pulses: i64,
}

impl PlanSettings {
    fn planner(&self) -> PyResult<Box<dyn Planner>> {
        let kind: PlannerKind = self.planner.parse().map_err(plan_error)?;
        Ok(match kind {
            PlannerKind::Raster => Box::new(Raster { pitch: RasterPitch::Root2Radius }),
            PlannerKind::RasterFine => Box::new(Raster { pitch: RasterPitch::Radius }),
            PlannerKind::Greedy => Box::new(Greedy::default()),
            other => return Err(option_error("planner", other, "one that is available")),
        })
    }
}

/// Plans pulses for a target; with `forbidden`, for a workpiece that is partly machined. `progress`
/// is called as (fraction done, best reward) and stops the planner by returning True; so does Ctrl-C.
#[pyfunction]
pub(crate) fn plan<'py>(
    py: Python<'py>,
    remaining: PyReadonlyArray2<'_, bool>,
    forbidden: Option<PyReadonlyArray2<'_, bool>>,
    settings: PlanSettings,
    progress: Option<Py<PyAny>>,
) -> PyResult<PlanParts<'py>> {
    let remaining = bitmap_of(&remaining)?;
    let workpiece = match forbidden {
        Some(forbidden) => Workpiece::partly_machined(&remaining, &bitmap_of(&forbidden)?),
        None => Workpiece::new(&remaining).map_err(ablation_error)?,
    };
    let max_pulses = usize::try_from(settings.max_pulses)
        .map_err(|_| option_error("max_pulses", settings.max_pulses, "at least 1"))?;
    let job = Job::new(workpiece, settings.pulse_radius_px, max_pulses).map_err(plan_error)?;
    let planner = settings.planner()?;
    let mut failure = None;
    let mut report = |now: &PlanProgress<'_>| {
        Python::attach(|py| match stop_wanted(py, progress.as_ref(), now) {
            Ok(false) => ControlFlow::Continue(()),
            Ok(true) => ControlFlow::Break(()),
            Err(error) => {
                failure = Some(error);
                ControlFlow::Break(())
            }
        })
    };
    let plan = py.detach(|| planner.plan(&job, &mut report)).map_err(plan_error)?;
    if let Some(error) = failure {
        return Err(error);
    }
    let score = plan.score;
    Ok((
        positions_of(py, &plan.positions),
        score.reward,
        score.machined_fraction,
        score.off_target_fraction,
        plan.partial,
    ))
}

/// Whether the caller or Ctrl-C asks the planner to stop.
fn stop_wanted(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    now: &PlanProgress<'_>,
) -> PyResult<bool> {
    if py.check_signals().is_err() {
        return Ok(true);
    }
    let Some(progress) = progress else { return Ok(false) };
    progress.bind(py).call1((now.fraction, now.best_reward))?.is_truthy()
}
