//! Trained policies.

use std::sync::Arc;

use lasergym_ablation::{DEFAULT_PULSE_RADIUS_PX, Workpiece};
use lasergym_geom::{Bitmap, WORKPIECE_SIZE_PX};
use lasergym_plan::{Decision, Job, PolicyAgent, Pretrained};
use numpy::ndarray::{Array1, ArrayView2, Axis};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::{exception, plan_error};

/// A trained policy.
#[pyclass(name = "Policy", module = "lasergym._native", frozen)]
pub(crate) struct NativePolicy {
    agent: Arc<PolicyAgent>,
}

impl NativePolicy {
    pub(crate) fn agent(&self) -> Arc<PolicyAgent> {
        Arc::clone(&self.agent)
    }
}

/// The file of a shipped policy.
#[pyfunction]
pub(crate) fn shipped_policy<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyBytes>> {
    let policy: Pretrained = name.parse().map_err(plan_error)?;
    Ok(PyBytes::new(py, policy.file()))
}

#[pymethods]
impl NativePolicy {
    /// Loads a policy from the bytes of a file.
    #[staticmethod]
    fn from_bytes(content: &[u8]) -> PyResult<Self> {
        let agent = PolicyAgent::from_bytes(content).map_err(plan_error)?;
        Ok(Self { agent: Arc::new(agent) })
    }

    /// What the file says about itself, as JSON.
    fn manifest(&self) -> PyResult<String> {
        serde_json::to_string(self.agent.network().manifest())
            .map_err(|error| exception("PolicyError", error.to_string()))
    }

    /// Weights and biases.
    fn parameters(&self) -> u64 {
        self.agent.network().parameters()
    }

    /// Outputs of the network, shape (n, outputs), on inputs of shape (n, values).
    fn run<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'_, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let network = self.agent.network();
        let mut scratch = network.scratch();
        let mut outputs =
            numpy::ndarray::Array2::zeros((inputs.shape()[0], network.output().values()));
        for (input, mut output) in inputs.as_array().rows().into_iter().zip(outputs.rows_mut()) {
            let values = network
                .run(&input.to_vec(), &mut scratch)
                .map_err(|error| plan_error(error.into()))?;
            output.assign(&numpy::ndarray::ArrayView1::from(values));
        }
        Ok(outputs.into_pyarray(py))
    }

    /// The action on an observation, uint8 of shape (channels, 100, 100), in an episode of at most
    /// `max_pulses`.
    fn act<'py>(
        &self,
        py: Python<'py>,
        observation: PyReadonlyArray3<'_, u8>,
        max_pulses: u32,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let action = self.action(&observation, max_pulses)?;
        Ok(Array1::from_vec(action).into_pyarray(py))
    }
}

impl NativePolicy {
    fn action(
        &self,
        observation: &PyReadonlyArray3<'_, u8>,
        max_pulses: u32,
    ) -> PyResult<Vec<f32>> {
        let channels = match self.agent.decision() {
            Decision::Direct { .. } => self.agent.network().input().channels,
            Decision::Spatial(_) => 3,
        };
        let shape = observation.shape();
        if shape != [channels, WORKPIECE_SIZE_PX, WORKPIECE_SIZE_PX] {
            return Err(exception(
                "ShapeError",
                format!(
                    "the observation has shape {shape:?}, but this policy reads shape \
                     ({channels}, {WORKPIECE_SIZE_PX}, {WORKPIECE_SIZE_PX})"
                ),
            ));
        }
        let pixels = observation.as_array();
        if let Decision::Direct { .. } = self.agent.decision() {
            let values: Vec<u8> = pixels.iter().copied().collect();
            let mut memory = self.agent.memory();
            return self.agent.act_on(&values, &mut memory).map(Vec::from).map_err(plan_error);
        }
        let bitmap = |channel: ArrayView2<'_, u8>| {
            Bitmap::from_fn(|row, column| channel[[row, column]] > 127)
        };
        let [remaining, forbidden] = [0, 1].map(|k| bitmap(pixels.index_axis(Axis(0), k)));
        if remaining.is_empty() {
            // Nothing is left to decide about: the middle of the workpiece is as good as any place.
            return Ok(vec![0.0, 0.0]);
        }
        let level = f64::from(pixels[[2, 0, 0]]);
        let pulses_left = (level * f64::from(max_pulses) / 255.0).round().max(1.0) as usize;
        let workpiece = Workpiece::partly_machined(&remaining, &forbidden);
        let job = Job::new(workpiece, DEFAULT_PULSE_RADIUS_PX, pulses_left).map_err(plan_error)?;
        let state = self.agent.start(&job);
        let position = self.agent.decide(&state, &mut self.agent.memory()).map_err(plan_error)?;
        let half = WORKPIECE_SIZE_PX as f64 / 2.0;
        Ok([position.x, position.y].map(|value| (value / half - 1.0) as f32).to_vec())
    }
}
