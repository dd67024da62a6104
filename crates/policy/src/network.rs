//! Networks that run.

use std::fs;
use std::io::Read;
use std::path::Path;

use safetensors::SafeTensors;

use crate::PolicyError;
use crate::action;
use crate::instructions::Instructions;
use crate::limits::MAX_FILE_BYTES;
use crate::manifest::{MANIFEST_KEY, Manifest};
use crate::observation::{AllFinite, Scaling, ScalingKernel};
use crate::program::Program;
use crate::rearrangement::pixels_to_planes;
use crate::scratch::Scratch;
use crate::shape::Shape;
use crate::tensors::Tensors;

/// A trained network, checked and ready to run.
///
/// Every check of the file is done when it is loaded; a run fails only on an observation of the
/// wrong length or with values that are not finite. A network is immutable: threads share it, each
/// with a [`Scratch`] of its own.
#[derive(Debug)]
pub struct Network {
    manifest: Manifest,
    instructions: Instructions,
    scaling: Scaling,
    program: Program,
}

impl Network {
    /// Loads a policy file.
    ///
    /// # Errors
    /// [`PolicyError`] when the file cannot be read, is too large or is not a sound policy.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, PolicyError> {
        let path = path.as_ref();
        let unreadable = |error: std::io::Error| PolicyError::Unreadable {
            path: path.display().to_string(),
            reason: error.to_string(),
        };
        let file = fs::File::open(path).map_err(unreadable)?;
        let mut bytes = Vec::new();
        file.take(MAX_FILE_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        Self::from_bytes(&bytes)
    }

    /// Loads a policy from the bytes of a file.
    ///
    /// # Errors
    /// [`PolicyError`] when the bytes are too many or not a sound policy.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PolicyError> {
        Self::with_instructions(bytes, Instructions::default())
    }

    /// Loads a policy from the bytes of a file, to be run with the given vector instructions.
    ///
    /// # Errors
    /// [`PolicyError`] when the bytes are too many or not a sound policy.
    pub fn with_instructions(
        bytes: &[u8],
        instructions: Instructions,
    ) -> Result<Self, PolicyError> {
        if bytes.len() > MAX_FILE_BYTES {
            let bytes = bytes.len() as u64;
            return Err(PolicyError::FileTooLarge { bytes, limit: MAX_FILE_BYTES });
        }
        let broken = |error: safetensors::SafeTensorError| PolicyError::NotSafetensors {
            reason: error.to_string(),
        };
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(broken)?;
        let manifest = header
            .metadata()
            .as_ref()
            .and_then(|entries| entries.get(MANIFEST_KEY))
            .ok_or(PolicyError::NoManifest)?;
        let manifest = Manifest::from_json(manifest)?;
        let tensors = Tensors::new(SafeTensors::deserialize(bytes).map_err(broken)?)?;
        let program = Program::new(&manifest, &tensors, instructions)?;
        let scaling = Scaling::new(&manifest.observation, manifest.input, &tensors)?;
        action::check(&manifest.actions, program.output.shape.values())?;
        Ok(Self { manifest, instructions, scaling, program })
    }

    /// What the file says about itself.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Shape of the observation.
    #[must_use]
    pub fn input(&self) -> Shape {
        self.manifest.input
    }

    /// Shape of the output.
    #[must_use]
    pub fn output(&self) -> Shape {
        self.program.output.shape
    }

    /// Weights and biases as they lie in memory, those that fill up vectors included.
    #[must_use]
    pub fn parameters(&self) -> u64 {
        self.program.parameters
    }

    /// Multiplications of one run, those that fill up vectors included.
    #[must_use]
    pub fn multiplications(&self) -> u64 {
        self.program.multiplications
    }

    /// Memory for runs of this network.
    #[must_use]
    pub fn scratch(&self) -> Scratch {
        let mut scratch = Scratch::default();
        scratch.fit(&self.program);
        scratch
    }

    /// Runs the network on one observation, in the order channel by channel, row by row, and before
    /// any scaling. Gives the output in that order.
    ///
    /// Allocates nothing, except where `scratch` has not been used with this network before and
    /// does not come from [`Self::scratch`].
    ///
    /// # Errors
    /// [`PolicyError`] when the observation has the wrong length or values that are not finite, or
    /// when the output is not finite.
    pub fn run<'a>(
        &self,
        observation: &[f32],
        scratch: &'a mut Scratch,
    ) -> Result<&'a [f32], PolicyError> {
        if !self.instructions.dispatch(AllFinite(observation))
            && let Some((index, &value)) =
                observation.iter().enumerate().find(|(_, value)| !value.is_finite())
        {
            return Err(PolicyError::ObservationNotFinite { index, value });
        }
        self.forward(observation, scratch).map(|output| &*output)
    }

    /// As [`Self::run`] on an observation of bytes, for instance an image.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_bytes<'a>(
        &self,
        observation: &[u8],
        scratch: &'a mut Scratch,
    ) -> Result<&'a [f32], PolicyError> {
        self.forward(observation, scratch).map(|output| &*output)
    }

    /// Turns an output of [`Self::run`] into an action in place, as the manifest says. Values
    /// beyond the outputs of the network stay as they are.
    pub fn to_action(&self, output: &mut [f32]) {
        action::apply(&self.manifest.actions, output);
    }

    /// The action on one observation: [`Self::run`], then [`Self::to_action`].
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn act<'a>(
        &self,
        observation: &[f32],
        scratch: &'a mut Scratch,
    ) -> Result<&'a [f32], PolicyError> {
        self.run(observation, scratch)?;
        Ok(self.mapped(scratch))
    }

    /// As [`Self::act`] on an observation of bytes.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn act_bytes<'a>(
        &self,
        observation: &[u8],
        scratch: &'a mut Scratch,
    ) -> Result<&'a [f32], PolicyError> {
        self.forward(observation, scratch)?;
        Ok(self.mapped(scratch))
    }

    fn mapped<'a>(&self, scratch: &'a mut Scratch) -> &'a [f32] {
        let output = &mut scratch.output[..self.output().values()];
        self.to_action(output);
        output
    }

    fn forward<'a, T: Copy + Into<f32>>(
        &self,
        observation: &[T],
        scratch: &'a mut Scratch,
    ) -> Result<&'a mut [f32], PolicyError> {
        let expected = self.manifest.input.values();
        if observation.len() != expected {
            return Err(PolicyError::ObservationLength { found: observation.len(), expected });
        }
        let Program { steps, input, output, .. } = &self.program;
        scratch.fit(&self.program);
        let Scratch { buffers, padded, output: outputs } = scratch;
        self.instructions.dispatch(ScalingKernel {
            scaling: &self.scaling,
            shape: input.shape,
            observation,
            output: &mut buffers[input.buffer][..expected],
        });
        for step in steps {
            // Taken out, so that the step can write it while it reads the others.
            let mut target = std::mem::take(&mut buffers[step.output.buffer]);
            let values = &mut target[..step.output.shape.values()];
            let mut sources = step.inputs.iter().map(|place| {
                (place.shape.channels, buffers[place.buffer].get(..place.shape.values()))
            });
            if step.inputs[0].buffer == step.output.buffer {
                sources.next();
                let others = sources.filter_map(|(channels, values)| Some((channels, values?)));
                step.step.run_in_place(self.instructions, others, values);
            } else {
                let inputs = sources.filter_map(|(channels, values)| Some((channels, values?)));
                let channels = step.output.shape.channels;
                step.step.run(self.instructions, inputs, channels, padded, values);
            }
            buffers[step.output.buffer] = target;
        }
        let outputs = &mut outputs[..output.shape.values()];
        pixels_to_planes(output.shape, &buffers[output.buffer][..output.shape.values()], outputs);
        if let Some((index, &value)) =
            outputs.iter().enumerate().find(|(_, value)| !value.is_finite())
        {
            return Err(PolicyError::OutputNotFinite { index, value });
        }
        Ok(outputs)
    }
}
