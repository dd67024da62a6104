//! Jobs whose pulses do not land where they are aimed.

use lasergym_ablation::Workpiece;
use lasergym_geom::Point;
use lasergym_plan::{Disturbance, Job, disturbed_job as do_disturbed};
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::bitmaps::{bitmap_of, positions_of};
use crate::errors::{ablation_error, plan_error};
use crate::machine::DeciderSettings;

/// Keyword arguments of a disturbance.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct DisturbanceSettings {
    displaced: Option<(usize, f64, f64)>,
    vibration_px: f64,
    backlash_px: f64,
    drift_px_per_pulse: f64,
    misfire_probability: f64,
}

/// Aims and landings, shape (n, 2), px; NaN where nothing landed; and the four figures of a score.
type DisturbedParts<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, (f64, f64, f64, usize));

/// Does a job under a disturbance, without a machine.
#[pyfunction]
pub(crate) fn disturbed_job<'py>(
    py: Python<'py>,
    target: PyReadonlyArray2<'_, bool>,
    pulse_radius_px: f64,
    max_pulses: usize,
    decider: DeciderSettings<'_>,
    disturbance: DisturbanceSettings,
    seed: u64,
) -> PyResult<DisturbedParts<'py>> {
    let workpiece = Workpiece::new(&bitmap_of(&target)?).map_err(ablation_error)?;
    let job = Job::new(workpiece, pulse_radius_px, max_pulses).map_err(plan_error)?;
    let mut decider = decider.decider()?;
    let disturbance = Disturbance {
        displaced: disturbance.displaced.map(|(number, x, y)| (number, Point::new(x, y))),
        vibration_px: disturbance.vibration_px,
        backlash_px: disturbance.backlash_px,
        drift_px_per_pulse: disturbance.drift_px_per_pulse,
        misfire_probability: disturbance.misfire_probability,
    };
    let made =
        py.detach(|| do_disturbed(&job, &mut *decider, &disturbance, seed)).map_err(plan_error)?;
    let nowhere = Point::new(f64::NAN, f64::NAN);
    let landed: Vec<Point> = made.landed.iter().map(|place| place.unwrap_or(nowhere)).collect();
    let score = made.score;
    Ok((
        positions_of(py, &made.aimed),
        positions_of(py, &landed),
        (score.reward, score.machined_fraction, score.off_target_fraction, score.pulses),
    ))
}
