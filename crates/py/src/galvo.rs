//! Scan heads.

use std::fs::File;
use std::io::{BufReader, BufWriter};

use lasergym_galvo::{
    AccelerationEnd, AnyProgram, CORRECTION_VALUES, Calibration, Compensation, Correction,
    EnergyMap, GalvoError, HeadCalibration, HeadKnowledge, JobReader, LINE_ACTION,
    LINE_OBSERVATION, LaserControl, LineKind, LineOptions, LineOutcome, LineScales, LineSet,
    LineTask, Method, ModelFamily, PostOptions, ProgramFormat, ProgramWriter, PulseGrid,
    Regression, Report, ScanHead, StraightStroke, identify, identify_best, measure_line,
    postprocess, read_test_lines, read_trajectory, simulate, test_pattern,
};
use lasergym_geom::Point;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::{drawing_error, exception, option_error};

/// Named figures of a report.
type Figures = Vec<(&'static str, f64)>;

/// Figures, strokes (rows of 9 figures), the box of the marks (µm), energy and picture of the map.
type Judgement<'py> = (
    Figures,
    Bound<'py, PyArray2<f64>>,
    Option<(f64, f64, f64, f64)>,
    Option<(Bound<'py, PyArray2<f32>>, Bound<'py, PyBytes>)>,
);

/// Family, TOML, (parameter, value, 95 % half-width) of each, and the root mean square, µm.
type Identified = (&'static str, String, Vec<(&'static str, f64, f64)>, f64);

/// How a job becomes a program.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PostSettings {
    method: String,
    speed_m_s: Option<f64>,
    beam_um: f64,
    pitch_um: Option<f64>,
    tolerance: f64,
    corner_deg: f64,
    control: String,
    grid: String,
    delay_step_us: f64,
    jump_delay_us: Option<f64>,
    mark_delay_us: Option<f64>,
    fixed: Option<(f64, f64, f64, f64)>,
    origin_um: (f64, f64),
    /// Of micro-vectors.
    step_us: u32,
}

impl PostSettings {
    fn options(&self) -> PyResult<PostOptions> {
        Ok(PostOptions {
            method: method_of(&self.method)?,
            speed_m_s: self.speed_m_s,
            beam_um: self.beam_um,
            pitch_um: self.pitch_um,
            tolerance: self.tolerance,
            corner_deg: self.corner_deg,
            control: match self.control.as_str() {
                "delays" => LaserControl::Delays,
                "inline" => LaserControl::Inline,
                other => return Err(choice("control", other, "\"delays\" or \"inline\"")),
            },
            grid: match self.grid.as_str() {
                "fit" => PulseGrid::Fit,
                "keep" => PulseGrid::Keep,
                other => return Err(choice("grid", other, "\"fit\" or \"keep\"")),
            },
            delay_step_us: self.delay_step_us,
            jump_delay_us: self.jump_delay_us,
            mark_delay_us: self.mark_delay_us,
            fixed: self.fixed.map(|(run_in_um, run_out_um, on_us, off_us)| Compensation {
                run_in_um,
                run_out_um,
                on_us,
                off_us,
                ..Compensation::default()
            }),
            origin_um: Point::new(self.origin_um.0, self.origin_um.1),
        })
    }
}

fn method_of(name: &str) -> PyResult<Method> {
    match name {
        "none" => Ok(Method::None),
        "delays" => Ok(Method::DelaysOnly),
        "adaptive" => Ok(Method::Adaptive),
        other => Err(choice("method", other, "\"adaptive\", \"delays\" or \"none\"")),
    }
}

fn choice(name: &str, value: &str, accepted: &str) -> PyErr {
    option_error(name, format!("{value:?}"), accepted)
}

/// Name and TOML text of each shipped head.
#[pyfunction]
pub(crate) fn galvo_heads() -> Vec<(&'static str, &'static str)> {
    ScanHead::shipped_texts().to_vec()
}

/// Checks the TOML text of a head; (lag of x µs, lag of y µs, whether it has a calibration).
#[pyfunction]
pub(crate) fn galvo_head(head: &str) -> PyResult<(f64, f64, bool)> {
    let head = ScanHead::from_toml(head).map_err(galvo_error)?;
    Ok((head.x.lag_us(), head.y.lag_us(), head.calibration.is_some()))
}

/// Turns a job file into a program file; returns the number of vectors.
#[pyfunction]
pub(crate) fn galvo_postprocess(
    py: Python<'_>,
    head: &str,
    job: &str,
    program: &str,
    settings: PostSettings,
    dialect: &str,
    power: f64,
) -> PyResult<u64> {
    let options = settings.options()?;
    let head = ScanHead::from_toml(head).map_err(galvo_error)?;
    let format =
        ProgramFormat::of_name(dialect).map_err(galvo_error)?.with_step_us(settings.step_us);
    let input = BufReader::with_capacity(1 << 16, File::open(job)?);
    let mut reader = JobReader::of_name(job, input).map_err(galvo_error)?;
    let knowledge = HeadKnowledge::of_head(&head);
    let output = BufWriter::new(File::create(program)?);
    py.detach(|| {
        let writer = ProgramWriter::begin(output, format, power, &head)?;
        let (writer, vectors) = postprocess(&head, &knowledge, &options, &mut reader, writer)?;
        writer.finish()?;
        Ok(vectors)
    })
    .map_err(galvo_error)
}

fn program_of(path: &str, head: &ScanHead) -> PyResult<AnyProgram<BufReader<File>>> {
    let file = BufReader::with_capacity(1 << 16, File::open(path)?);
    AnyProgram::of_name(path, file, head).map_err(galvo_error)
}

/// Runs a program file on a head and judges it; with `map_px` also maps the energy on that many cells
/// along the longer side of what is marked.
#[pyfunction]
pub(crate) fn galvo_simulate<'py>(
    py: Python<'py>,
    head: &str,
    program: &str,
    map_px: Option<u32>,
) -> PyResult<Judgement<'py>> {
    let head = ScanHead::from_toml(head).map_err(galvo_error)?;
    let played = program_of(program, &head)?;
    let mut area = None;
    let mut map = None;
    if let Some(cells) = map_px {
        let measured = program_of(program, &head)?;
        area = py.detach(|| measured.marked_box()).map_err(galvo_error)?;
        if let Some((low, high)) = area {
            let spot_um = head.laser.spot_um;
            let margin = Point::new(spot_um + 1.0, spot_um + 1.0);
            let (low, high) = (low - margin, high + margin);
            let size = high - low;
            let cell_um = size.x.max(size.y) / f64::from(cells.clamp(16, 4000));
            map = Some(EnergyMap::new(low, high, cell_um, spot_um).map_err(galvo_error)?);
        }
    }
    let mut strokes = Vec::new();
    let (report, map) = py
        .detach(|| {
            simulate(&head, played, map, |stroke| {
                strokes.extend([
                    stroke.stroke as f64,
                    stroke.pulses as f64,
                    stroke.speed_m_s,
                    stroke.start_error_um,
                    stroke.end_error_um,
                    stroke.length_error_um,
                    stroke.pitch_min,
                    stroke.pitch_max,
                    stroke.lateral_error_um,
                ]);
            })
        })
        .map_err(galvo_error)?;
    let map = map
        .map(|map| {
            let png = map.picture().to_png().map_err(drawing_error)?;
            let energy = Array2::from_shape_vec(map.shape(), map.energy().to_vec())
                .map_err(|error| exception("ShapeError", error.to_string()))?;
            Ok::<_, PyErr>((energy.into_pyarray(py), PyBytes::new(py, &png)))
        })
        .transpose()?;
    let strokes = Array2::from_shape_vec((strokes.len() / 9, 9), strokes)
        .map_err(|error| exception("ShapeError", error.to_string()))?;
    let area = area.map(|(low, high)| (low.x, low.y, high.x, high.y));
    Ok((figures(&report), strokes.into_pyarray(py), area, map))
}

fn figures(report: &Report) -> Figures {
    vec![
        ("strokes", report.strokes as f64),
        ("empty_strokes", report.empty_strokes as f64),
        ("pulses", report.pulses as f64),
        ("length_error_um_max", report.length_error_um_max),
        ("length_error_um_mean", report.length_error_um_mean),
        ("length_error_um_deviation", report.length_error_um_deviation),
        ("edge_error_um_max", report.edge_error_um_max),
        ("lateral_error_um_max", report.lateral_error_um_max),
        ("pitch_min", report.pitch_min),
        ("pitch_max", report.pitch_max),
        ("pitch_deviation", report.pitch_deviation),
        ("overburn_max", report.overburn_max),
        ("corner_overburn_max", report.corner_overburn_max),
        ("mark_s", report.time.mark_s),
        ("jump_s", report.time.jump_s),
        ("delay_s", report.time.delay_s),
        ("run_in_s", report.time.run_in_s),
        ("total_s", report.time.total_s()),
    ]
}

/// Intercept, slope, their 95 % half-widths and the root mean square; (speed, length, 95 % half-width)
/// of the means where these are used.
type RegressionRow = ([f64; 5], Vec<(f64, f64, Option<f64>)>);

/// Lag, acceleration length and, where it was measured, lead of an axis.
type AxisRows = (RegressionRow, RegressionRow, Option<RegressionRow>);

fn regression_row(of: &Regression) -> RegressionRow {
    let means = of.points.iter();
    (
        [
            of.intercept_um,
            of.slope_us,
            of.intercept_confidence_95,
            of.slope_confidence_95,
            of.rms_um,
        ],
        means.map(|mean| (mean.speed_m_s, mean.length_um, mean.confidence_95_um)).collect(),
    )
}

/// Fits lag, acceleration length and, where it was measured, lead to measured lines: TOML, and the
/// three of x and of y.
#[pyfunction]
pub(crate) fn galvo_calibrate(lines: &str) -> PyResult<(String, Vec<AxisRows>)> {
    let lines = read_test_lines(lines).map_err(galvo_error)?;
    let found = HeadCalibration::fit(&lines).map_err(galvo_error)?;
    let rows = |of: &Calibration| {
        let lead = of.lead.as_ref().map(regression_row);
        (regression_row(&of.lag), regression_row(&of.acceleration), lead)
    };
    Ok((found.to_toml(), vec![rows(&found.x), rows(&found.y)]))
}

/// Fits a model to a recorded trajectory: family, TOML, (parameter, value, 95 % half-width) of each, and
/// the root mean square, µm. `family` is the name of one or "best".
#[pyfunction]
pub(crate) fn galvo_identify(
    py: Python<'_>,
    trajectory: &str,
    family: &str,
) -> PyResult<Identified> {
    let samples = read_trajectory(trajectory).map_err(galvo_error)?;
    let asked = ModelFamily::ALL.into_iter().find(|one| one.name() == family);
    let found = match (asked, family) {
        (Some(family), _) => py.detach(|| identify(&samples, family)),
        (None, "best") => py.detach(|| identify_best(&samples)),
        _ => {
            let accepted = "\"best\", \"bessel\", \"second-order\" or \"acceleration-time\"";
            return Err(choice("family", family, accepted));
        }
    }
    .map_err(galvo_error)?;
    let names = found.family.parameters().iter();
    let parameters = names
        .zip(found.values.iter().zip(&found.confidence_95))
        .map(|(name, (value, width))| (*name, *value, *width))
        .collect();
    Ok((found.family.name(), found.to_toml(), parameters, found.rms_um))
}

/// A cutter-location file of test lines.
#[pyfunction]
pub(crate) fn galvo_test_pattern(
    speeds_m_s: Vec<f64>,
    length_um: f64,
    repeats: u32,
    spacing_um: f64,
) -> PyResult<String> {
    test_pattern(&speeds_m_s, length_um, repeats, spacing_um).map_err(galvo_error)
}

/// Machines a line without compensation and measures it: (measured µm, acceleration length µm,
/// acceleration time µs).
#[pyfunction]
pub(crate) fn galvo_measure_line(
    py: Python<'_>,
    head: &str,
    speed_m_s: f64,
    length_um: f64,
    angle_rad: f64,
    tolerance: f64,
) -> PyResult<(f64, f64, f64)> {
    let head = ScanHead::from_toml(head).map_err(galvo_error)?;
    let end = AccelerationEnd::StaysWithin(tolerance);
    let line = py
        .detach(|| measure_line(&head, speed_m_s, length_um, angle_rad, end))
        .map_err(galvo_error)?;
    let time_us = line.acceleration_time_us.unwrap_or(f64::NAN);
    Ok((line.measured_um, line.acceleration_um, time_us))
}

/// Offsets and delays at a speed: run-in µm, run-out µm, on µs, off µs, lag µs, settling µs, lateral
/// µm.
#[pyfunction]
pub(crate) fn galvo_compensation(
    head: &str,
    method: &str,
    line: (f64, f64, Option<f64>),
    beam_um: f64,
    tolerance: f64,
) -> PyResult<[f64; 7]> {
    let head = ScanHead::from_toml(head).map_err(galvo_error)?;
    let knowledge = HeadKnowledge::of_head(&head);
    let (speed_m_s, angle_rad, length_um) = line;
    let direction = Point::new(angle_rad.cos(), angle_rad.sin());
    let stroke = StraightStroke { speed_m_s, direction, length_um };
    let found = knowledge
        .compensation(method_of(method)?, &stroke, beam_um, tolerance)
        .map_err(galvo_error)?;
    Ok([
        found.run_in_um,
        found.run_out_um,
        found.on_us,
        found.off_us,
        found.lag_us,
        found.settling_us,
        found.lateral_um,
    ])
}

/// Lines at one speed on which corrections of the formulas are tuned.
#[pyclass(name = "GalvoLineSet", module = "lasergym._native")]
pub(crate) struct NativeGalvoLineSet {
    set: LineSet,
}

#[pymethods]
impl NativeGalvoLineSet {
    /// Lines of (length µm, angle rad) on `head`, of which `known` is known; `kind` is speed m/s, beam
    /// µm, pitch µm and tolerance, `scales` what costs 1: edges µm, pitch, time µs.
    #[new]
    fn new(
        head: &str,
        known: &str,
        method: &str,
        kind: [f64; 4],
        scales: [f64; 3],
        lines: Vec<(f64, f64)>,
    ) -> PyResult<Self> {
        let head = ScanHead::from_toml(head).map_err(galvo_error)?;
        let known = ScanHead::from_toml(known).map_err(galvo_error)?;
        let [speed_m_s, beam_um, pitch_um, tolerance] = kind;
        let scales = LineScales { edge_um: scales[0], pitch: scales[1], time_us: scales[2] };
        let method = method_of(method)?;
        let kind = LineKind { method, speed_m_s, beam_um, pitch_um, tolerance, scales };
        let set = LineSet::new(&head, &known, &kind, &lines).map_err(galvo_error)?;
        Ok(Self { set })
    }

    /// Mean cost of the lines with each correction: rows of 5 times, µs.
    fn costs(&self, py: Python<'_>, rows: Vec<[f64; CORRECTION_VALUES]>) -> Vec<f64> {
        py.detach(|| self.set.costs(&rows))
    }

    /// What each line comes out as with a correction: cost, start and end error µm, distance beside the
    /// line µm, deviation of the pitch, time µs.
    fn outcomes(
        &self,
        py: Python<'_>,
        correction: [f64; CORRECTION_VALUES],
    ) -> PyResult<Vec<[f64; 6]>> {
        let correction = Correction::of_values(correction);
        let outcomes = py.detach(|| self.set.outcomes(&correction)).map_err(galvo_error)?;
        Ok(outcomes
            .iter()
            .map(|made| {
                let [start_um, end_um] = made.edge_errors_um;
                let (beside_um, pitch) = (made.lateral_error_um, made.pitch_deviation);
                [made.cost, start_um, end_um, beside_um, pitch, made.time_us]
            })
            .collect())
    }
}

/// Rewards, start and end errors (µm), deviations of the pitch and times (µs), each of shape (n,).
type Outcomes<'py> = [Bound<'py, PyArray1<f64>>; 5];

/// Lines to machine, one of each environment.
#[pyclass(name = "GalvoLines", module = "lasergym._native")]
pub(crate) struct NativeGalvoLines {
    tasks: Vec<LineTask>,
}

#[pymethods]
impl NativeGalvoLines {
    #[new]
    fn new(
        environments: usize,
        noise_um: f64,
        edge_scale_um: f64,
        pitch_scale: f64,
        time_scale_us: f64,
    ) -> PyResult<Self> {
        let scales =
            LineScales { edge_um: edge_scale_um, pitch: pitch_scale, time_us: time_scale_us };
        let options = LineOptions { noise_um, scales };
        let task = LineTask::new(options, 0).map_err(galvo_error)?;
        Ok(Self { tasks: vec![task; environments] })
    }

    /// Draws new lines where `mask` is True; seeds start streams anew.
    fn reset(
        &mut self,
        py: Python<'_>,
        seeds: Vec<Option<u64>>,
        mask: Option<Vec<bool>>,
    ) -> PyResult<()> {
        py.detach(|| {
            for (k, task) in self.tasks.iter_mut().enumerate() {
                if mask.as_ref().is_none_or(|mask| mask.get(k) == Some(&true)) {
                    task.reset(seeds.get(k).copied().flatten())?;
                }
            }
            Ok(())
        })
        .map_err(galvo_error)
    }

    /// What the agents know, shape (n, 6).
    fn observations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let values = self.tasks.iter().flat_map(LineTask::observation).collect();
        rows(py, LINE_OBSERVATION, values)
    }

    /// The actions of the postprocessor, shape (n, 4).
    fn baselines<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let mut values = Vec::with_capacity(LINE_ACTION * self.tasks.len());
        for task in &self.tasks {
            values.extend(task.baseline().map_err(galvo_error)?);
        }
        rows(py, LINE_ACTION, values)
    }

    /// Machines every line with its action, shape (n, 4).
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: PyReadonlyArray2<'_, f32>,
    ) -> PyResult<Outcomes<'py>> {
        let actions: Vec<[f32; LINE_ACTION]> = actions
            .as_array()
            .rows()
            .into_iter()
            .map(|row| std::array::from_fn(|k| row.get(k).copied().unwrap_or(f32::NAN)))
            .collect();
        if actions.len() != self.tasks.len() {
            let (found, expected) = (actions.len(), self.tasks.len());
            let message = format!("{found} actions are given for {expected} environments");
            return Err(exception("ActionShapeError", message));
        }
        let outcomes: Vec<LineOutcome> = py
            .detach(|| {
                let made = self.tasks.iter().zip(actions);
                made.map(|(task, action)| task.step(action)).collect::<Result<_, _>>()
            })
            .map_err(|error| exception("ActionNotFiniteError", error.to_string()))?;
        let column = |value: fn(&LineOutcome) -> f64| {
            outcomes.iter().map(value).collect::<Vec<f64>>().to_pyarray(py)
        };
        Ok([
            column(|made| -made.cost),
            column(|made| made.edge_errors_um[0]),
            column(|made| made.edge_errors_um[1]),
            column(|made| made.pitch_deviation),
            column(|made| made.time_us),
        ])
    }
}

fn rows(py: Python<'_>, columns: usize, values: Vec<f32>) -> PyResult<Bound<'_, PyArray2<f32>>> {
    Ok(Array2::from_shape_vec((values.len() / columns, columns), values)
        .map_err(|error| exception("ShapeError", error.to_string()))?
        .into_pyarray(py))
}

/// The exception of a [`GalvoError`].
pub(crate) fn galvo_error(error: GalvoError) -> PyErr {
    let class = match &error {
        GalvoError::InvalidOption { .. } | GalvoError::UnknownName { .. } => "OptionError",
        GalvoError::Toolpath(_) | GalvoError::Program { .. } => "ProgramError",
        _ => "GalvoError",
    };
    exception(class, error.to_string())
}
