//! From an observation to the input of the first layer.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use pulp::Simd;

use crate::PolicyError;
use crate::instructions::Kernel;
use crate::manifest::Observation;
use crate::shape::Shape;
use crate::tensors::Tensors;

/// Name of the observation in error messages.
const OWNER: &str = "observation";

/// Scaling of an observation, in the order of the observation: channel by channel.
#[derive(Debug)]
pub(crate) struct Scaling {
    divide_by: f32,
    running: Option<Running>,
}

#[derive(Debug)]
struct Running {
    mean: Vec<f32>,
    deviation: Vec<f32>,
    clip: f32,
}

impl Scaling {
    /// The scaling that a manifest asks for.
    pub(crate) fn new(
        observation: &Observation,
        input: Shape,
        tensors: &Tensors<'_>,
    ) -> Result<Self, PolicyError> {
        let invalid = |name, value: String, expected: &str| PolicyError::InvalidSetting {
            owner: OWNER.to_owned(),
            name,
            value,
            expected: expected.to_owned(),
        };
        let divide_by = observation.divide_by;
        if !divide_by.is_finite() || divide_by == 0.0 {
            let expected = "finite and different from 0";
            return Err(invalid("divide_by", divide_by.to_string(), expected));
        }
        let Some(normalise) = &observation.normalise else {
            return Ok(Self { divide_by, running: None });
        };
        if !(normalise.epsilon.is_finite() && normalise.epsilon >= 0.0) {
            let value = normalise.epsilon.to_string();
            return Err(invalid("epsilon", value, "finite and at least 0"));
        }
        if !(normalise.clip.is_finite() && normalise.clip > 0.0) {
            return Err(invalid("clip", normalise.clip.to_string(), "finite and above 0"));
        }
        let mean = tensors.read(OWNER, &normalise.mean, 0)?;
        let variance = tensors.read(OWNER, &normalise.variance, 0)?;
        for tensor in [&mean, &variance] {
            if tensor.values.len() != input.values() {
                let expected = format!("of {} values, one a value of {input}", input.values());
                return Err(tensor.shape_error(OWNER, expected));
            }
        }
        let mut deviation = Vec::with_capacity(variance.values.len());
        for &value in &variance.values {
            let root = (f64::from(value) + normalise.epsilon).sqrt() as f32;
            if !(root > 0.0 && root.is_finite()) {
                let expected = "above 0 and finite together with epsilon";
                return Err(invalid("variance", value.to_string(), expected));
            }
            deviation.push(root);
        }
        let running = Running { mean: mean.values, deviation, clip: normalise.clip };
        Ok(Self { divide_by, running: Some(running) })
    }
}

/// Writes an observation (channel by channel) scaled and pixel by pixel.
pub(crate) struct ScalingKernel<'a, T> {
    /// The scaling.
    pub(crate) scaling: &'a Scaling,
    /// Shape of the observation.
    pub(crate) shape: Shape,
    /// The observation.
    pub(crate) observation: &'a [T],
    /// Where to write.
    pub(crate) output: &'a mut [f32],
}

impl<T: Copy + Into<f32>> Kernel for ScalingKernel<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const FUSED: bool>(self, _: S) {
        let Self { scaling, shape, observation, output } = self;
        let divide_by = scaling.divide_by;
        if let Some(Running { mean, deviation, clip }) = &scaling.running {
            interleave(shape, output, |index| {
                let value: f32 = observation[index].into();
                let normalised = (value - mean[index]) / deviation[index];
                normalised.clamp(-clip, *clip) / divide_by
            });
        } else {
            interleave(shape, output, |index| {
                let value: f32 = observation[index].into();
                value / divide_by
            });
        }
    }
}

/// Writes value `channel · pixels + pixel` of the source at `pixel · channels + channel`.
#[inline(always)]
fn interleave(shape: Shape, output: &mut [f32], source: impl Fn(usize) -> f32) {
    let pixels = shape.pixels();
    for channel in 0..shape.channels {
        let targets = output[channel..].iter_mut().step_by(shape.channels);
        for (index, target) in targets.enumerate() {
            *target = source(channel * pixels + index);
        }
    }
}

/// Whether every value is finite.
pub(crate) struct AllFinite<'a>(pub(crate) &'a [f32]);

impl Kernel for AllFinite<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd, const FUSED: bool>(self, _: S) -> bool {
        self.0.iter().fold(true, |all, value| all & value.is_finite())
    }
}
