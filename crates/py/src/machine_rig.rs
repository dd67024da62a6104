//! A simulated machine.

use std::path::PathBuf;

use lasergym_geom::Point;
use lasergym_machine::simulator::{
    Preset, Rig, Saved, SavedRig, SavedRigError, SimulatedCamera, SimulatedError, SimulatedLaser,
    SimulatedStage, SimulatorOptions,
};
use lasergym_machine::{CalibrationRun, Camera, DriverError, FaultKind, Laser, Stage};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;

use crate::errors::{calibration_error, exception};

/// A simulated machine whose world is kept in a file.
#[pyclass(name = "Rig", module = "lasergym._native", frozen)]
pub(crate) struct NativeRig {
    rig: SavedRig,
}

impl NativeRig {
    /// Its devices.
    pub(crate) fn saved(
        &self,
    ) -> (Saved<SimulatedStage>, Saved<SimulatedLaser>, Saved<SimulatedCamera>) {
        (self.rig.stage(), self.rig.laser(), self.rig.camera())
    }
}

#[pymethods]
impl NativeRig {
    /// A fresh workpiece in a rig with `options`, JSON.
    #[staticmethod]
    fn create(path: PathBuf, options: &str, seed: u64) -> PyResult<Self> {
        Ok(Self { rig: SavedRig::create(path, options_of(options)?, seed).map_err(rig_error)? })
    }

    /// The rig in a file.
    #[staticmethod]
    fn open(path: PathBuf) -> PyResult<Self> {
        Ok(Self { rig: SavedRig::open(path).map_err(rig_error)? })
    }

    /// Options, marks and all else, JSON.
    fn state(&self) -> PyResult<String> {
        serde_json::to_string(&self.rig.rig().state())
            .map_err(|error| exception("JobError", error.to_string()))
    }

    /// What has really been machined: x, y and radius, px, shape (marks, 3).
    fn true_marks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let marks = self.rig.rig().true_marks();
        Array2::from_shape_fn((marks.len(), 3), |(k, column)| {
            [marks[k].x_px, marks[k].y_px, marks[k].radius_px][column]
        })
        .into_pyarray(py)
    }

    /// Lowest and highest position of the stage, µm.
    fn limits_um(&self) -> ((f64, f64), (f64, f64)) {
        let limits = self.rig.stage().limits_um();
        ((limits.least_um.x, limits.least_um.y), (limits.most_um.x, limits.most_um.y))
    }

    fn move_to(&self, x_um: f64, y_um: f64) -> PyResult<()> {
        self.rig.stage().move_to(Point::new(x_um, y_um)).map_err(rig_error)
    }

    fn position_um(&self) -> PyResult<(f64, f64)> {
        let Point { x, y } = self.rig.stage().position_um().map_err(rig_error)?;
        Ok((x, y))
    }

    fn home(&self) -> PyResult<()> {
        self.rig.stage().home().map_err(rig_error)
    }

    fn stop(&self) -> PyResult<()> {
        self.rig.stage().stop().map_err(rig_error)
    }

    fn arm(&self) -> PyResult<()> {
        self.rig.laser().arm().map_err(rig_error)
    }

    fn fire(&self) -> PyResult<()> {
        self.rig.laser().fire().map_err(rig_error)
    }

    fn disarm(&self) -> PyResult<()> {
        self.rig.laser().disarm().map_err(rig_error)
    }

    fn set_exposure_s(&self, exposure_s: f64) -> PyResult<()> {
        self.rig.camera().set_exposure_s(exposure_s).map_err(rig_error)
    }

    /// A frame, uint8 of shape (height, width).
    fn frame<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let frame = py.detach(|| self.rig.camera().frame()).map_err(rig_error)?;
        let shape = (frame.height_px(), frame.width_px());
        let gray = Array2::from_shape_vec(shape, frame.gray().to_vec())
            .map_err(|error| exception("ShapeError", error.to_string()))?;
        Ok(gray.into_pyarray(py))
    }
}

/// The options of a preset, JSON.
#[pyfunction]
pub(crate) fn simulator_options(preset: &str) -> PyResult<String> {
    let preset: Preset = preset
        .parse()
        .map_err(|error: SimulatedError| exception("OptionError", error.to_string()))?;
    serde_json::to_string(&preset.options())
        .map_err(|error| exception("OptionError", error.to_string()))
}

/// Calibrates a rig with `options`, JSON, on a workpiece that is thrown away: the calibration, JSON.
#[pyfunction]
pub(crate) fn calibrate_simulator(py: Python<'_>, options: &str, seed: u64) -> PyResult<String> {
    let options = options_of(options)?;
    let mut run = CalibrationRun::new(options.scale_frame_px_per_um);
    run.vision.radius_px = options.pulse_radius_px;
    let rig = Rig::new(options, !seed).map_err(|error| rig_error(error.into()))?;
    let calibration = py
        .detach(|| run.calibrate(&mut rig.stage(), &mut rig.laser(), &mut rig.camera()))
        .map_err(calibration_error)?;
    serde_json::to_string(&calibration)
        .map_err(|error| exception("CalibrationError", error.to_string()))
}

fn options_of(json: &str) -> PyResult<SimulatorOptions> {
    serde_json::from_str(json).map_err(|error| exception("OptionError", error.to_string()))
}

/// The exception of a rig's error.
fn rig_error(error: SavedRigError) -> PyErr {
    let class = match (&error, error.kind()) {
        (_, FaultKind::OutOfLimits) => "OutOfLimitsError",
        (_, FaultKind::Interlock) => "InterlockError",
        (SavedRigError::Simulated(SimulatedError::InvalidOption { .. }), _) => "OptionError",
        (SavedRigError::Content { .. }, _) => "JobError",
        _ => "DriverError",
    };
    exception(class, error.to_string())
}
