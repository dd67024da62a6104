//! Robot and scanner.

use std::path::PathBuf;

use lasergym_geom::Point;
use lasergym_remote::{
    DirectionSearch, KrlOptions, LineChoice, PlanOptions, RemoteError, RemotePlan, RemoteTask,
    RobotLine, RobotProgram, ScanCircle, ScannerProgram, SpeedRange, simulate, write_krl,
};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::{drawing_error, exception, option_error};

/// (subtask, name, plane, centre x, y, radius of the smallest circle, radius of the scan circle,
/// time s).
type StopParts = (usize, String, usize, f64, f64, f64, f64, f64);

/// (plane, direction °, speed, start (x, y), end (x, y), sections as (start, end) along the line from
/// its start, first stop, time s with lead-in, lead-out and restart, time of the way before, s).
type LineParts = (usize, f64, f64, (f64, f64), (f64, f64), Vec<(f64, f64)>, usize, f64, f64);

/// (total s, laser s, largest seam error mm, largest speed error, largest distance from the centre of
/// the field mm, highest speed of the robot mm/s), problems, and states as rows of (time s, robot x,
/// y, z, beam x, y, z, field x, y, laser).
type SimulationParts<'py> = (Extremes, Vec<String>, Bound<'py, PyArray2<f64>>);
type Extremes = (f64, f64, f64, f64, f64, f64);

/// (Direction °, offset, speed, start, end) and sections along the direction.
type BestLineParts = ((f64, f64, f64, f64, f64), Vec<(f64, f64)>);

/// Points of a subtask's path that a picture is drawn from.
const MOST_POINTS: usize = 2000;

/// A task and its plan.
#[pyclass(name = "RemoteJob", module = "lasergym._native", frozen)]
pub(crate) struct NativeRemoteJob {
    task: RemoteTask,
    plan: RemotePlan,
}

#[pymethods]
impl NativeRemoteJob {
    /// `task` is the text of a TOML task; drawings are looked for in `folder`.
    #[new]
    fn new(
        py: Python<'_>,
        task: &str,
        folder: Option<PathBuf>,
        choice: &str,
        directions: i64,
        keep_order: bool,
    ) -> PyResult<Self> {
        let choice = match choice {
            "initial" => LineChoice::Initial,
            "greedy" => LineChoice::Greedy,
            "greedy-any-direction" => LineChoice::GreedyAnyDirection,
            "joint" => LineChoice::Joint,
            other => {
                let accepted = "\"initial\", \"greedy\", \"greedy-any-direction\" or \"joint\"";
                return Err(option_error("choice", format!("{other:?}"), accepted));
            }
        };
        let samples = u32::try_from(directions)
            .ok()
            .filter(|samples| (4..=36_000).contains(samples))
            .ok_or_else(|| option_error("directions", directions, "from 4 to 36000"))?;
        let directions = DirectionSearch { samples, most: samples, ..DirectionSearch::default() };
        let options = PlanOptions { choice, directions, keep_order, ..PlanOptions::default() };
        let made = py.detach(|| {
            let task = RemoteTask::from_toml(task, folder.as_deref())?;
            let plan = RemotePlan::new(&task, &options)?;
            Ok::<_, RemoteError>(Self { task, plan })
        });
        made.map_err(remote_error)
    }

    /// (name, field radius mm, cycle time s, tour mm, laser s, line s).
    fn figures(&self) -> (&str, f64, f64, f64, f64, f64) {
        let plan = &self.plan;
        (
            &self.task.name,
            self.task.scanner.field_radius_mm,
            plan.cycle_time_s,
            plan.tour_mm,
            plan.laser_s(),
            plan.line_s(),
        )
    }

    /// Name, origin mm and angles ° of each plane.
    fn planes(&self) -> Vec<(String, [f64; 3], [f64; 3])> {
        let planes = self.task.planes.iter();
        planes.map(|plane| (plane.name.clone(), plane.origin_mm, plane.abc_deg)).collect()
    }

    /// The stops in the order in which they are processed.
    fn stops(&self) -> Vec<StopParts> {
        let stops = self.plan.stops.iter();
        stops
            .map(|stop| {
                (
                    stop.subtask,
                    stop.name.clone(),
                    self.task.subtasks[stop.subtask].plane,
                    stop.scan_circle.center.x,
                    stop.scan_circle.center.y,
                    stop.enclosing.radius_mm,
                    stop.scan_circle.radius_mm,
                    stop.scan_circle.time_s,
                )
            })
            .collect()
    }

    /// Points along the path of a stop, mm, shape (n, 2).
    fn path<'py>(&self, py: Python<'py>, stop: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let stop = self
            .plan
            .stops
            .get(stop)
            .ok_or_else(|| option_error("stop", stop, "below the number of stops"))?;
        let pieces = stop.path.pieces();
        let parts = (MOST_POINTS / pieces.len()).clamp(1, 90);
        let points = pieces.iter().flat_map(|piece| {
            let parts = match piece {
                lasergym_remote::PathPiece::Line { .. } => 1,
                lasergym_remote::PathPiece::Arc { .. } => parts,
            };
            (0..=parts).map(move |k| piece.at(k as f64 / parts as f64))
        });
        array(py, 2, points.flat_map(|p| [p.x, p.y]).collect())
    }

    /// The lines in order.
    fn lines(&self) -> Vec<LineParts> {
        let lines = self.plan.lines.iter();
        lines
            .map(|planned| {
                let line = &planned.routed.line;
                let place = |y_mm: f64| {
                    let place = line.place(y_mm);
                    (place.x, place.y)
                };
                let sections = line.sections_mm.iter();
                (
                    planned.routed.plane,
                    line.direction_rad.to_degrees(),
                    line.speed_mm_s,
                    place(line.start_mm),
                    place(line.end_mm),
                    sections.map(|s| (s.0 - line.start_mm, s.1 - line.start_mm)).collect(),
                    planned.first_stop,
                    planned.routed.time_s,
                    planned.approach_s,
                )
            })
            .collect()
    }

    /// Plays the programs; states are sampled every `sample_s`.
    fn simulate<'py>(&self, py: Python<'py>, sample_s: f64) -> PyResult<SimulationParts<'py>> {
        let report = py
            .detach(|| {
                let robot = RobotProgram::from_csv(&self.robot_program().to_csv())?;
                let scanner = ScannerProgram::from_csv(&self.scanner_program().to_csv())?;
                simulate(&self.task, &robot, &scanner, sample_s)
            })
            .map_err(remote_error)?;
        let rows = report.samples.iter().flat_map(|sample| {
            let [x, y, z] = sample.robot_mm;
            let [u, v, w] = sample.beam_mm;
            let Point { x: a, y: b } = sample.field_mm;
            [sample.time_s, x, y, z, u, v, w, a, b, f64::from(u8::from(sample.laser))]
        });
        let samples = array(py, 10, rows.collect())?;
        let figures = (
            report.total_s,
            report.laser_s,
            report.max_seam_error_mm,
            report.max_speed_error,
            report.max_field_mm,
            report.max_robot_speed_mm_s,
        );
        Ok((figures, report.problems, samples))
    }

    /// KRL source and data list, robot CSV, scanner CSV and RTC list.
    fn programs(&self) -> (String, String, String, String, String) {
        let (robot, scanner) = (self.robot_program(), self.scanner_program());
        let module = write_krl(&self.task.name, &robot, &KrlOptions::default());
        let rtc = scanner.to_rtc(&self.task.scanner);
        (module.src, module.dat, robot.to_csv(), scanner.to_csv(), rtc)
    }
}

impl NativeRemoteJob {
    fn robot_program(&self) -> RobotProgram {
        RobotProgram::of(&self.task, &self.plan)
    }

    fn scanner_program(&self) -> ScannerProgram {
        ScannerProgram::of(&self.task, &self.plan)
    }
}

/// The best line for scan circles given as rows of (x, y, radius, time s), in this order; none where
/// there is no line.
#[pyfunction]
pub(crate) fn best_robot_line(
    py: Python<'_>,
    circles: PyReadonlyArray2<'_, f64>,
    direction_deg: Option<f64>,
    speeds_mm_s: (f64, f64),
    jump_s: f64,
) -> PyResult<Option<BestLineParts>> {
    if circles.shape()[1] != 4 || circles.shape()[0] == 0 {
        return Err(exception(
            "ShapeError",
            "circles must have shape (n, 4) with n above 0".into(),
        ));
    }
    if !circles.as_array().iter().all(|value| value.is_finite()) {
        return Err(option_error("circles", "not finite", "finite"));
    }
    let (slowest_mm_s, fastest_mm_s) = speeds_mm_s;
    if !(slowest_mm_s > 0.0 && fastest_mm_s >= slowest_mm_s && fastest_mm_s.is_finite()) {
        let given = format!("({slowest_mm_s}, {fastest_mm_s})");
        return Err(option_error("speeds_mm_s", given, "above 0 and in ascending order"));
    }
    let circle = |row: numpy::ndarray::ArrayView1<'_, f64>| ScanCircle {
        center: Point::new(row[0], row[1]),
        radius_mm: row[2],
        time_s: row[3],
        max_speed_mm_s: fastest_mm_s,
    };
    let stops: Vec<ScanCircle> = circles.as_array().rows().into_iter().map(circle).collect();
    let speeds = SpeedRange { slowest_mm_s, fastest_mm_s };
    let line = py.detach(|| match direction_deg {
        Some(degrees) => RobotLine::along(&stops, degrees.to_radians(), speeds, jump_s),
        None => RobotLine::best(&stops, speeds, jump_s, DirectionSearch::default()),
    });
    Ok(line.map(|line| {
        let direction_deg = line.direction_rad.to_degrees();
        let figures = (direction_deg, line.offset_mm, line.speed_mm_s, line.start_mm, line.end_mm);
        (figures, line.sections_mm)
    }))
}

fn array(py: Python<'_>, columns: usize, values: Vec<f64>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let rows = values.len() / columns;
    Ok(Array2::from_shape_vec((rows, columns), values)
        .map_err(|error| exception("ShapeError", error.to_string()))?
        .into_pyarray(py))
}

/// The exception of a [`RemoteError`].
pub(crate) fn remote_error(error: RemoteError) -> PyErr {
    let class = match &error {
        RemoteError::InvalidOption { .. } => "OptionError",
        RemoteError::TooLarge { .. }
        | RemoteError::TooSlow { .. }
        | RemoteError::NoLine { .. }
        | RemoteError::OffClock { .. } => "InfeasibleTaskError",
        RemoteError::Action { .. } => "ActionError",
        RemoteError::EpisodeOver { .. } => "EpisodeOverError",
        RemoteError::WrongLength { .. } => "ShapeError",
        _ => "RemoteError",
    };
    match error {
        // As the drawing's own exception.
        RemoteError::Drawing { source, .. } => drawing_error(source),
        other => exception(class, other.to_string()),
    }
}
