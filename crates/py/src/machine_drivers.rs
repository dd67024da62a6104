//! Python objects as the drivers of a machine.

use std::time::{Duration, Instant};

use lasergym_geom::Point;
use lasergym_machine::{
    Camera, DriverError, FaultKind, Frame, FrameError, Laser, Stage, StageLimits,
};
use numpy::PyReadonlyArray2;
use pyo3::exceptions::{PyConnectionError, PyTimeoutError};
use pyo3::prelude::*;

/// How far ahead of the clock a frame's time may be, s: clocks are read one after the other.
const CLOCK_SLACK_S: f64 = 1e-3;

/// An exception of a driver.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub(crate) struct PyDriverError {
    kind: FaultKind,
    message: String,
}

impl DriverError for PyDriverError {
    fn kind(&self) -> FaultKind {
        self.kind
    }
}

impl PyDriverError {
    fn protocol(message: String) -> Self {
        Self { kind: FaultKind::Protocol, message }
    }

    /// The fault that an exception is: what its `kind` says, or what its class means.
    fn of(py: Python<'_>, error: &PyErr) -> Self {
        let named = error.value(py).getattr("kind").and_then(|kind| kind.extract::<String>());
        let kind = match named.as_deref() {
            Ok("timeout") => FaultKind::Timeout,
            Ok("out_of_limits") => FaultKind::OutOfLimits,
            Ok("interlock") => FaultKind::Interlock,
            Ok("disconnected") => FaultKind::Disconnected,
            Ok("protocol") => FaultKind::Protocol,
            _ if error.is_instance_of::<PyTimeoutError>(py) => FaultKind::Timeout,
            _ if error.is_instance_of::<PyConnectionError>(py) => FaultKind::Disconnected,
            _ => FaultKind::Other,
        };
        Self { kind, message: error.to_string() }
    }
}

/// Calls into Python; an exception becomes a fault.
fn call<T>(body: impl for<'py> FnOnce(Python<'py>) -> PyResult<T>) -> Result<T, PyDriverError> {
    Python::attach(|py| body(py).map_err(|error| PyDriverError::of(py, &error)))
}

/// A stage written in Python.
pub(crate) struct PyStage {
    object: Py<PyAny>,
    limits: StageLimits,
}

impl PyStage {
    /// Asks the stage for its limits.
    pub(crate) fn new(stage: &Bound<'_, PyAny>) -> PyResult<Self> {
        let limits = stage.call_method0("limits_um")?;
        let corner = |name: &str| -> PyResult<Point> {
            let (x, y) = limits.getattr(name)?.extract()?;
            Ok(Point::new(x, y))
        };
        let limits = StageLimits { least_um: corner("least_um")?, most_um: corner("most_um")? };
        Ok(Self { object: stage.clone().unbind(), limits })
    }
}

impl Stage for PyStage {
    type Error = PyDriverError;

    fn limits_um(&self) -> StageLimits {
        self.limits
    }

    fn move_to(&mut self, position_um: Point) -> Result<(), PyDriverError> {
        let Point { x, y } = position_um;
        call(|py| self.object.bind(py).call_method1("move_to", (x, y)).map(drop))
    }

    fn position_um(&mut self) -> Result<Point, PyDriverError> {
        let (x, y) = call(|py| self.object.bind(py).call_method0("position_um")?.extract())?;
        Ok(Point::new(x, y))
    }

    fn home(&mut self) -> Result<(), PyDriverError> {
        call(|py| self.object.bind(py).call_method0("home").map(drop))
    }

    fn stop(&mut self) -> Result<(), PyDriverError> {
        call(|py| self.object.bind(py).call_method0("stop").map(drop))
    }
}

/// A laser written in Python.
pub(crate) struct PyLaser {
    pub(crate) object: Py<PyAny>,
}

impl Laser for PyLaser {
    type Error = PyDriverError;

    fn arm(&mut self) -> Result<(), PyDriverError> {
        call(|py| self.object.bind(py).call_method0("arm").map(drop))
    }

    fn fire(&mut self) -> Result<(), PyDriverError> {
        call(|py| self.object.bind(py).call_method0("fire").map(drop))
    }

    fn disarm(&mut self) -> Result<(), PyDriverError> {
        call(|py| self.object.bind(py).call_method0("disarm").map(drop))
    }
}

/// A camera written in Python.
pub(crate) struct PyCamera {
    pub(crate) object: Py<PyAny>,
}

impl Camera for PyCamera {
    type Error = PyDriverError;

    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<(), PyDriverError> {
        call(|py| self.object.bind(py).call_method1("set_exposure_s", (exposure_s,)).map(drop))
    }

    fn frame(&mut self) -> Result<Frame, PyDriverError> {
        let (gray, width_px, height_px, age_s): (Vec<u8>, usize, usize, f64) = call(|py| {
            let frame = self.object.bind(py).call_method0("frame")?;
            let gray = frame.getattr("gray")?;
            let gray: PyReadonlyArray2<'_, u8> = gray.extract()?;
            let taken_at_s: f64 = frame.getattr("taken_at_s")?.extract()?;
            let now_s: f64 = py.import("time")?.call_method0("monotonic")?.extract()?;
            let pixels = gray.as_array();
            let (height_px, width_px) = pixels.dim();
            Ok((pixels.iter().copied().collect(), width_px, height_px, now_s - taken_at_s))
        })?;
        // A time that is not a number is no time of the past either.
        let taken_at = (age_s >= -CLOCK_SLACK_S)
            .then(|| Duration::try_from_secs_f64(age_s.max(0.0)).ok())
            .flatten()
            .and_then(|age| Instant::now().checked_sub(age))
            .ok_or_else(|| {
                PyDriverError::protocol(format!(
                    "the frame is {age_s} s old: give the time at which its exposure began by \
                     time.monotonic()"
                ))
            })?;
        Frame::new(width_px, height_px, gray, taken_at)
            .map_err(|error: FrameError| PyDriverError::protocol(error.to_string()))
    }
}
