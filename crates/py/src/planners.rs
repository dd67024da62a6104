//! Planners.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;

use lasergym_ablation::Workpiece;
use lasergym_geom::Point;
use lasergym_plan::{
    AgentPlanner, Anneal, AnnealBudget, AnnealOptions, CmaEsBudget, CmaEsPlanner, ForesightPlanner,
    Greedy, Job, PlanProgress, Planner, PlannerKind, PolicyAgent, Raster, RasterPitch, Thinking,
    shortest_order as order_by_travel,
};
use numpy::ndarray::Array1;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::bitmaps::{bitmap_of, points_of, positions_of};
use crate::errors::{ablation_error, option_error, plan_error};
use crate::policy::NativePolicy;

/// A plan: positions, shape (n, 2), px; reward; machined fraction; off-target fraction; whether it
/// is partial.
type PlanParts<'py> = (Bound<'py, PyArray2<f64>>, f64, f64, f64, bool);

/// Keyword arguments of a plan.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PlanSettings<'py> {
    planner: String,
    pulse_radius_px: f64,
    max_pulses: i64,
    seed: u64,
    budget_s: Option<f64>,
    iterations: Option<u64>,
    threads: i64,
    restarts: i64,
    start: Option<PyReadonlyArray2<'py, f64>>,
    policy: Option<Bound<'py, NativePolicy>>,
    pointing_error_px: f64,
}

impl PlanSettings<'_> {
    fn planner(&self) -> PyResult<Box<dyn Planner>> {
        let kind: PlannerKind = self.planner.parse().map_err(plan_error)?;
        Ok(match kind {
            PlannerKind::Raster => Box::new(Raster { pitch: RasterPitch::Root2Radius }),
            PlannerKind::RasterFine => Box::new(Raster { pitch: RasterPitch::Radius }),
            PlannerKind::Greedy => Box::new(Greedy::default()),
            PlannerKind::Anneal => Box::new(Anneal { options: self.anneal_options()? }),
            PlannerKind::CmaEs => Box::new(self.cma_es()?),
            PlannerKind::Policy => Box::new(AgentPlanner { agent: self.agent()? }),
            PlannerKind::AgentMpc => Box::new(ForesightPlanner {
                agent: self.agent()?,
                thinking: self.thinking()?,
                seed: self.seed,
                pointing_error_px: self.pointing_error_px,
            }),
            other => return Err(option_error("planner", other, "one of those above")),
        })
    }

    fn agent(&self) -> PyResult<Arc<PolicyAgent>> {
        match &self.policy {
            Some(policy) => Ok(policy.get().agent()),
            None => Err(option_error("policy", "missing", "given for this planner")),
        }
    }

    fn thinking(&self) -> PyResult<Thinking> {
        match (self.iterations, self.budget()?) {
            (Some(_), Some(_)) => Err(two_budgets()),
            (Some(moves), None) => Ok(Thinking::Moves(moves)),
            (None, Some(time)) => Ok(Thinking::Time(time)),
            (None, None) => Ok(Thinking::Time(Duration::from_millis(20))),
        }
    }

    fn cma_es(&self) -> PyResult<CmaEsPlanner> {
        let default = CmaEsPlanner::default();
        let budget = match (self.iterations, self.budget()?) {
            (Some(_), Some(_)) => return Err(two_budgets()),
            (Some(evaluations), None) => CmaEsBudget::Evaluations(
                usize::try_from(evaluations)
                    .map_err(|_| option_error("iterations", evaluations, "smaller"))?,
            ),
            (None, Some(time)) => CmaEsBudget::Time(time),
            (None, None) => default.budget,
        };
        let threads = size("threads", self.threads)?;
        Ok(CmaEsPlanner { budget, seed: self.seed, threads, ..default })
    }

    fn anneal_options(&self) -> PyResult<AnnealOptions> {
        let budget = match (self.iterations, self.budget()?) {
            (Some(_), Some(_)) => return Err(two_budgets()),
            (Some(iterations), None) => AnnealBudget::Iterations(iterations),
            (None, Some(time)) => AnnealBudget::Time(time),
            (None, None) => AnnealBudget::default(),
        };
        Ok(AnnealOptions {
            budget,
            seed: self.seed,
            restarts: size("restarts", self.restarts)?,
            threads: size("threads", self.threads)?,
            start: self.start.as_ref().map(points_of).transpose()?,
            ..AnnealOptions::default()
        })
    }

    /// The time budget, where one is given.
    fn budget(&self) -> PyResult<Option<Duration>> {
        self.budget_s
            .map(|seconds| {
                Duration::try_from_secs_f64(seconds)
                    .map_err(|_| option_error("budget_s", seconds, "above 0, in seconds"))
            })
            .transpose()
    }
}

/// The error of a plan with a time budget and a number of iterations.
fn two_budgets() -> PyErr {
    option_error("budget_s", "given", "left out where iterations are given")
}

/// A count whose lower end is checked where it is used.
fn size(name: &str, value: i64) -> PyResult<usize> {
    usize::try_from(value).map_err(|_| option_error(name, value, "at least 1"))
}

/// Plans pulses for a target; with `forbidden`, for a workpiece that is partly machined. `progress`
/// is called as (fraction done, best reward) and stops the planner by returning True; so does Ctrl-C.
#[pyfunction]
pub(crate) fn plan<'py>(
    py: Python<'py>,
    remaining: PyReadonlyArray2<'_, bool>,
    forbidden: Option<PyReadonlyArray2<'_, bool>>,
    settings: PlanSettings<'_>,
    progress: Option<Py<PyAny>>,
) -> PyResult<PlanParts<'py>> {
    let remaining = bitmap_of(&remaining)?;
    let workpiece = match forbidden {
        Some(forbidden) => Workpiece::partly_machined(&remaining, &bitmap_of(&forbidden)?),
        None => Workpiece::new(&remaining).map_err(ablation_error)?,
    };
    let max_pulses = size("max_pulses", settings.max_pulses)?;
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

/// The order in which firing `xy_px` takes the shortest travel: indices, shape (n,).
#[pyfunction]
pub(crate) fn shortest_order<'py>(
    py: Python<'py>,
    xy_px: PyReadonlyArray2<'_, f64>,
    start_px: Option<(f64, f64)>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let positions = points_of(&xy_px)?;
    let start = start_px.map(|(x, y)| Point::new(x, y));
    let order = py.detach(|| order_by_travel(&positions, start)).map_err(plan_error)?;
    Ok(order
        .into_iter()
        .map(|index| index.cast_signed() as i64)
        .collect::<Array1<i64>>()
        .into_pyarray(py))
}
