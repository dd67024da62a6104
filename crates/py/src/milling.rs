//! Depth milling.

use std::ops::ControlFlow;

use lasergym_milling::{
    BeamPath, DepthMap, GradientMemory, HeightFormat, HeightMap, HeightScale, JobOptions,
    MillingError, MillingJob, Profile, SolveOptions, SolveProgress, SolveStage, TrackingError,
    calibrate, read_trenches,
};
use lasergym_toolpath::{PassGcodeOptions, write_passes_csv, write_passes_gcode};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::{batch_error, exception, option_error, toolpath_error};

/// y (µm), dwell (s/mm), both of shape (passes, points), and beam on, shape (passes, points − 1).
type Controls<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<bool>>);

/// Error, largest error (µm) and root mean square (µm) of a surface.
type Errors = (f64, f64, f64);

/// Controls, surface, errors, pixel-by-pixel and straight error (%), convergence as rows of
/// (free, objective, error), and whether it was stopped.
type SolutionParts<'py> =
    (Controls<'py>, Bound<'py, PyArray2<f64>>, Errors, f64, f64, Vec<(bool, f64, f64)>, bool);

/// How passes are optimised.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SolveSettings {
    iterations: i64,
    switching_rounds: i64,
    free_iterations: i64,
    free_range: f64,
    least_fall: f64,
}

impl SolveSettings {
    fn options(&self) -> PyResult<SolveOptions> {
        let count = |name: &str, value: i64| {
            usize::try_from(value).map_err(|_| option_error(name, value, "at least 0"))
        };
        Ok(SolveOptions {
            iterations: count("iterations", self.iterations)?,
            switching_rounds: count("switching_rounds", self.switching_rounds)?,
            free_iterations: count("free_iterations", self.free_iterations)?,
            free_range: self.free_range,
            least_fall: self.least_fall,
        })
    }
}

/// Passes as Python hands them over.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct GivenPasses<'py> {
    first_x_um: f64,
    spacing_um: f64,
    y_um: PyReadonlyArray2<'py, f64>,
    dwell_s_mm: PyReadonlyArray2<'py, f64>,
    beam_on: PyReadonlyArray2<'py, bool>,
}

impl GivenPasses<'_> {
    fn path(&self) -> BeamPath {
        BeamPath {
            first_x_um: self.first_x_um,
            spacing_um: self.spacing_um,
            points: self.y_um.shape()[1],
            y_um: self.y_um.as_array().iter().copied().collect(),
            dwell_s_mm: self.dwell_s_mm.as_array().iter().copied().collect(),
            beam_on: self.beam_on.as_array().iter().copied().collect(),
        }
    }
}

/// Objective, µm⁴; its derivatives with respect to dwell and to y, shape (passes, points).
type GradientParts<'py> = (f64, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// A target, a process and the raster that covers it.
#[pyclass(name = "MillingJob", module = "lasergym._native", frozen)]
pub(crate) struct NativeMillingJob {
    job: MillingJob,
}

#[pymethods]
impl NativeMillingJob {
    /// `depth_um` has shape (rows, columns); `profile` is the text of a TOML profile.
    #[new]
    fn new(
        depth_um: PyReadonlyArray2<'_, f64>,
        pixel_um: f64,
        profile: &str,
        layers: Option<i64>,
        measured_um: Option<PyReadonlyArray2<'_, f64>>,
    ) -> PyResult<Self> {
        let map = |depths: &PyReadonlyArray2<'_, f64>, pixel_um: f64| {
            let shape = depths.shape();
            let values = depths.as_array().iter().copied().collect();
            DepthMap::new(shape[0], shape[1], pixel_um, values).map_err(milling_error)
        };
        let target = map(&depth_um, pixel_um)?;
        let profile = Profile::from_toml(profile).map_err(milling_error)?;
        let layers = layers
            .map(|layers| {
                usize::try_from(layers).map_err(|_| option_error("layers", layers, "at least 1"))
            })
            .transpose()?;
        let options = JobOptions { layers };
        let job = match measured_um {
            None => MillingJob::new(&target, profile, options),
            Some(measured_um) => {
                // The surface covers the target, whatever the size of its pixels.
                let width_um = pixel_um * depth_um.shape()[1] as f64;
                let measured = map(&measured_um, width_um / measured_um.shape()[1] as f64)?;
                MillingJob::continued(&target, &measured, profile, options)
            }
        };
        Ok(Self { job: job.map_err(milling_error)? })
    }

    /// (layers, first x µm, spacing µm, pixel µm, passes of a layer).
    fn layout(&self) -> (usize, f64, f64, f64, usize) {
        let layout = self.job.layout();
        let pixel_um = self.job.grid().cell_um;
        (self.job.layers(), layout.first_x_um, layout.spacing_um, pixel_um, layout.passes)
    }

    /// (slowest, fastest) speed, mm/s.
    fn speeds_mm_s(&self) -> (f64, f64) {
        (self.job.profile().slowest_mm_s, self.job.profile().fastest_mm_s)
    }

    /// The target, µm, with the pixels of the simulation.
    fn target_um<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.field(py, self.job.target().depth_um().to_vec())
    }

    /// The pixel-by-pixel passes.
    fn pixel_by_pixel<'py>(&self, py: Python<'py>) -> PyResult<Controls<'py>> {
        let (start, layers) = (self.job.start_um(), self.job.layers());
        let path = self.job.pixel_by_pixel(start, layers).map_err(milling_error)?;
        controls(py, &path)
    }

    /// The surface that passes leave, µm, and its errors.
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        passes: GivenPasses<'_>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Errors)> {
        let path = passes.path();
        let mut depth_um = self.job.start_um().to_vec();
        py.detach(|| self.job.simulator().mill(&path, &mut depth_um)).map_err(milling_error)?;
        let error = self.job.objective().tracking_error(&depth_um).map_err(milling_error)?;
        Ok((self.on_target(py, &depth_um)?, errors(&error)))
    }

    /// Finds the passes; `progress` is called with (fraction, error %), and stops the solver when it
    /// returns a true value.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        settings: SolveSettings,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<SolutionParts<'py>> {
        let options = settings.options()?;
        let mut failure = None;
        let mut report = |now: &SolveProgress| {
            match Python::attach(|py| stop_wanted(py, progress.as_ref(), now)) {
                Ok(false) => return ControlFlow::Continue(()),
                Ok(true) => {}
                Err(error) => failure = Some(error),
            }
            ControlFlow::Break(())
        };
        let solution =
            py.detach(|| self.job.solve(&options, &mut report)).map_err(milling_error)?;
        if let Some(error) = failure {
            return Err(error);
        }
        let convergence = solution
            .convergence
            .iter()
            .map(|at| (at.stage == SolveStage::Free, at.objective, at.error_percent))
            .collect();
        Ok((
            controls(py, &solution.path)?,
            self.on_target(py, &solution.depth_um)?,
            errors(&solution.error),
            solution.pixel_by_pixel.percent,
            solution.straight.percent,
            convergence,
            solution.partial,
        ))
    }

    /// The objective of the surface that passes leave, µm⁴, and its derivatives with respect to dwell
    /// and y of each point, shape (passes, points).
    fn gradient<'py>(
        &self,
        py: Python<'py>,
        passes: GivenPasses<'_>,
    ) -> PyResult<GradientParts<'py>> {
        let path = passes.path();
        let found = py
            .detach(|| {
                let memory = &mut GradientMemory::default();
                let (start_um, objective) = (self.job.start_um(), self.job.objective());
                self.job.simulator().gradient(&path, start_um, objective, memory)
            })
            .map_err(milling_error)?;
        let (dwell, y) = (found.dwell, found.y);
        Ok((found.objective, array(py, path.points, dwell)?, array(py, path.points, y)?))
    }

    /// (machining time, exposure), s.
    #[staticmethod]
    fn times_s(passes: GivenPasses<'_>) -> PyResult<(f64, f64)> {
        let path = passes.path();
        path.validate().map_err(milling_error)?;
        Ok((path.machining_time_s(), path.exposure_s()))
    }

    /// The passes as CSV and as a GRBL program.
    fn programs(
        &self,
        passes: GivenPasses<'_>,
        power_s: f64,
        origin_mm: (f64, f64),
    ) -> PyResult<(String, String)> {
        let path = passes.path();
        path.validate().map_err(milling_error)?;
        let passes = path.machine_passes();
        let grid = self.job.target().grid();
        let options = PassGcodeOptions {
            origin_x_mm: origin_mm.0,
            origin_y_mm: origin_mm.1,
            height_mm: grid.rows as f64 * grid.cell_um / 1e3,
            power_s,
            ..PassGcodeOptions::default()
        };
        let csv = write_passes_csv(&passes).map_err(toolpath_error)?;
        let gcode = write_passes_gcode(&passes, &options).map_err(toolpath_error)?;
        Ok((csv, gcode))
    }
}

impl NativeMillingJob {
    fn on_target<'py>(
        &self,
        py: Python<'py>,
        field: &[f64],
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.field(py, self.job.on_target(field).map_err(milling_error)?)
    }

    fn field<'py>(&self, py: Python<'py>, values: Vec<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let grid = self.job.target().grid();
        array(py, grid.columns, values)
    }
}

/// Name and TOML text of each shipped profile.
#[pyfunction]
pub(crate) fn shipped_profiles() -> Vec<(&'static str, &'static str)> {
    Profile::shipped_texts().to_vec()
}

/// Heights in a file, shape (rows, columns); µm for STL.
#[pyfunction]
pub(crate) fn read_heights<'py>(
    py: Python<'py>,
    name: &str,
    content: &[u8],
    pixel_um: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let format = HeightFormat::of_name(name).map_err(milling_error)?;
    let map = py.detach(|| HeightMap::read(content, format, pixel_um)).map_err(milling_error)?;
    array(py, map.columns, map.heights)
}

/// Depths of heights: `scale` is "depths", "high-stays" or "high-sinks".
#[pyfunction]
pub(crate) fn depths_of_heights<'py>(
    py: Python<'py>,
    heights: PyReadonlyArray2<'_, f64>,
    scale: &str,
    depth_um: f64,
    base_um: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let scale = match scale {
        "depths" => HeightScale::Depths,
        "high-stays" => HeightScale::HighStays { depth_um, base_um },
        "high-sinks" => HeightScale::HighSinks { depth_um, base_um },
        other => {
            let accepted = "\"depths\", \"high-stays\" or \"high-sinks\"";
            return Err(option_error("scale", format!("{other:?}"), accepted));
        }
    };
    let (rows, columns) = (heights.shape()[0], heights.shape()[1]);
    let heights = heights.as_array().iter().copied().collect();
    let map = HeightMap { rows, columns, heights };
    let depths = map.to_depths(scale, 1.0).map_err(milling_error)?;
    array(py, columns, depths.depth_um().to_vec())
}

/// A fitted parameter: name, value and half-width of its 95 % interval.
type Fitted = (&'static str, f64, f64);

/// Parameters fitted to trenches, and the root mean square of what is left, µm.
#[pyfunction]
pub(crate) fn calibrate_trenches(
    py: Python<'_>,
    trenches: &str,
    profile: &str,
) -> PyResult<(Vec<Fitted>, f64)> {
    let start = Profile::from_toml(profile).map_err(milling_error)?;
    let trenches = read_trenches(trenches).map_err(milling_error)?;
    let found = py.detach(|| calibrate(&start.process, &trenches)).map_err(milling_error)?;
    let parameters = found.parameters.iter().map(|p| (p.name, p.value, p.confidence_95)).collect();
    Ok((parameters, found.rms_um))
}

/// Whether the caller or Ctrl-C asks the solver to stop.
fn stop_wanted(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    now: &SolveProgress,
) -> PyResult<bool> {
    if py.check_signals().is_err() {
        return Ok(true);
    }
    let Some(progress) = progress else { return Ok(false) };
    progress.bind(py).call1((now.fraction, now.error_percent))?.is_truthy()
}

fn controls<'py>(py: Python<'py>, path: &BeamPath) -> PyResult<Controls<'py>> {
    let beam_on = Array2::from_shape_vec((path.passes(), path.points - 1), path.beam_on.clone())
        .map_err(|error| exception("ShapeError", error.to_string()))?;
    Ok((
        array(py, path.points, path.y_um.clone())?,
        array(py, path.points, path.dwell_s_mm.clone())?,
        beam_on.into_pyarray(py),
    ))
}

fn array(py: Python<'_>, columns: usize, values: Vec<f64>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let rows = values.len() / columns.max(1);
    Ok(Array2::from_shape_vec((rows, columns), values)
        .map_err(|error| exception("ShapeError", error.to_string()))?
        .into_pyarray(py))
}

fn errors(error: &TrackingError) -> Errors {
    (error.percent, error.max_um, error.rms_um)
}

/// The exception of a [`MillingError`].
pub(crate) fn milling_error(error: MillingError) -> PyErr {
    if let MillingError::Batch(error) = error {
        return batch_error(error);
    }
    let class = match &error {
        MillingError::InvalidOption { .. } | MillingError::UnknownProfile { .. } => "OptionError",
        MillingError::EmptyTarget => "EmptyTargetError",
        MillingError::ActionNotFinite { .. } => "ActionNotFiniteError",
        MillingError::TargetValue { .. }
        | MillingError::MeasuredSize { .. }
        | MillingError::TooDeep { .. }
        | MillingError::TooShallow { .. }
        | MillingError::HeightFormat { .. }
        | MillingError::HeightFile { .. }
        | MillingError::HeightValue { .. } => "DepthMapError",
        _ => "MillingError",
    };
    exception(class, error.to_string())
}
