//! Layers ready to run.

use crate::PolicyError;
use crate::activation::{Activation, ActivationKernel};
use crate::convolution::{Convolution, Geometry};
use crate::instructions::Instructions;
use crate::normalisation::Normalisation;
use crate::operation::Operation;
use crate::pooling::{Pool, Pooling, PoolingKernel};
use crate::rearrangement::{Rearrangement, concatenate};
use crate::shape::Shape;
use crate::tensors::Tensors;

/// A layer with its weights laid out.
#[derive(Debug)]
pub(crate) enum Step {
    /// Convolution, transposed convolution or linear layer.
    Convolution(Box<Convolution>),
    /// Greatest values or means of windows.
    Pooling(Pooling),
    /// Values moved.
    Rearrangement(Rearrangement),
    /// An activation function, in place.
    Activation(Activation),
    /// A normalisation, in place.
    Normalisation(Normalisation),
    /// Sum of inputs.
    Add,
    /// Channels behind one another.
    Concat,
}

impl Step {
    /// Prepares `operation` of `layer` for inputs of the given shapes; gives the shape of the
    /// result with it.
    pub(crate) fn new(
        layer: &str,
        operation: &Operation,
        inputs: &[Shape],
        tensors: &Tensors<'_>,
        instructions: Instructions,
    ) -> Result<(Self, Shape), PolicyError> {
        let input = first_input(layer, operation, inputs)?;
        let weights = |weight: &str, bias: Option<&str>, output_axis| {
            let weight = tensors.read(layer, weight, output_axis)?;
            let bias = bias.map(|bias| tensors.read(layer, bias, 0)).transpose()?;
            Ok((weight, bias))
        };
        let made = |convolution: Convolution| {
            let shape = convolution.output();
            (Self::Convolution(Box::new(convolution)), shape)
        };
        let pooling = |pooling: Pooling| {
            let shape = pooling.output();
            (Self::Pooling(pooling), shape)
        };
        let moved = |rearrangement: Rearrangement| {
            let shape = rearrangement.output();
            (Self::Rearrangement(rearrangement), shape)
        };
        let activation = |activation| (Self::Activation(activation), input);
        let (step, shape) = match operation {
            &Operation::Conv2d { ref weight, ref bias, stride, padding, dilation, groups } => {
                let (weight, bias) = weights(weight, bias.as_deref(), 0)?;
                let geometry = Geometry { stride, padding, dilation, groups };
                let bias = bias.as_ref();
                made(Convolution::new(layer, input, &weight, bias, geometry, instructions)?)
            }
            &Operation::ConvTranspose2d {
                ref weight,
                ref bias,
                stride,
                padding,
                output_padding: added,
                dilation,
            } => {
                let (weight, bias) = weights(weight, bias.as_deref(), 1)?;
                let shape = Geometry { stride, padding, dilation, groups: 1 };
                let weights = (&weight, bias.as_ref());
                made(Convolution::transposed(layer, input, weights, shape, added, instructions)?)
            }
            Operation::Linear { weight, bias } => {
                let (weight, bias) = weights(weight, bias.as_deref(), 0)?;
                made(Convolution::linear(layer, input, weight, bias.as_ref(), instructions)?)
            }
            Operation::Flatten => moved(Rearrangement::flatten(input)),
            Operation::PixelShuffle { factor } => {
                moved(Rearrangement::shuffle(layer, input, *factor)?)
            }
            Operation::PixelUnshuffle { factor } => {
                moved(Rearrangement::unshuffle(layer, input, *factor)?)
            }
            Operation::Crop { top, bottom, left, right } => {
                moved(Rearrangement::crop(layer, input, [*top, *bottom, *left, *right])?)
            }
            Operation::Relu => activation(Activation::Relu),
            Operation::LeakyRelu { slope } => {
                check_finite(layer, "slope", *slope)?;
                activation(Activation::LeakyRelu(*slope))
            }
            Operation::Elu { alpha } => {
                check_finite(layer, "alpha", *alpha)?;
                activation(Activation::Elu(*alpha))
            }
            Operation::Gelu { approximation } => activation(Activation::Gelu(*approximation)),
            Operation::Silu => activation(Activation::Silu),
            Operation::Tanh => activation(Activation::Tanh),
            Operation::Sigmoid => activation(Activation::Sigmoid),
            Operation::MaxPool { kernel, stride, padding } => {
                pooling(Pooling::new(layer, input, Pool::Greatest, *kernel, *stride, *padding)?)
            }
            Operation::AvgPool { kernel, stride, padding, count_padding } => {
                let pool = if *count_padding { Pool::MeanWithPadding } else { Pool::Mean };
                pooling(Pooling::new(layer, input, pool, *kernel, *stride, *padding)?)
            }
            Operation::GlobalAveragePool => pooling(Pooling::global(layer, input)?),
            Operation::Normalise { mean, deviation } => {
                let mean = tensors.read(layer, mean, 0)?;
                let deviation = tensors.read(layer, deviation, 0)?;
                (Self::Normalisation(Normalisation::new(layer, input, mean, deviation)?), input)
            }
            Operation::Add => {
                check_inputs(layer, inputs, |other| other == input, &input.to_string())?;
                (Self::Add, input)
            }
            Operation::Concat => {
                let Shape { height, width, .. } = input;
                let same = |other: Shape| other.height == height && other.width == width;
                check_inputs(layer, inputs, same, &format!("{height} × {width} pixels"))?;
                let channels = inputs.iter().map(|shape| shape.channels).sum();
                (Self::Concat, Shape::new(channels, height, width))
            }
        };
        shape.check(layer)?;
        Ok((step, shape))
    }

    /// Whether the result may take the place of the first input.
    pub(crate) fn is_in_place(&self) -> bool {
        matches!(self, Self::Activation(_) | Self::Normalisation(_) | Self::Add)
    }

    /// Weights, biases and the like as laid out.
    pub(crate) fn parameters(&self) -> u64 {
        match self {
            Self::Convolution(convolution) => convolution.parameters(),
            Self::Normalisation(normalisation) => normalisation.parameters(),
            _ => 0,
        }
    }

    /// Multiplications of one run, or values touched where nothing is multiplied.
    pub(crate) fn multiplications(&self, inputs: usize, output: Shape) -> u64 {
        match self {
            Self::Convolution(convolution) => convolution.multiplications(),
            Self::Pooling(pooling) => pooling.reads(),
            _ => (inputs as u64).saturating_mul(output.values() as u64),
        }
    }

    /// Values of padding that a run needs.
    pub(crate) fn padded_values(&self) -> usize {
        match self {
            Self::Convolution(convolution) => convolution.padded_values(),
            _ => 0,
        }
    }

    /// Runs a step that is not in place; `inputs` gives each input with its channels.
    pub(crate) fn run<'a>(
        &self,
        instructions: Instructions,
        mut inputs: impl Iterator<Item = (usize, &'a [f32])>,
        channels: usize,
        padded: &mut [f32],
        output: &mut [f32],
    ) {
        match self {
            Self::Concat => concatenate(inputs, channels, output),
            Self::Convolution(convolution) => {
                if let Some((_, input)) = inputs.next() {
                    convolution.run(instructions, input, padded, output);
                }
            }
            Self::Pooling(pooling) => {
                if let Some((_, input)) = inputs.next() {
                    instructions.dispatch(PoolingKernel { pooling, input, output });
                }
            }
            Self::Rearrangement(rearrangement) => {
                if let Some((_, input)) = inputs.next() {
                    rearrangement.run(input, output);
                }
            }
            Self::Activation(_) | Self::Normalisation(_) | Self::Add => {
                if let Some((_, input)) = inputs.next() {
                    output.copy_from_slice(input);
                    self.run_in_place(instructions, inputs, output);
                }
            }
        }
    }

    /// Runs a step on `values`, its first input; `others` are the rest.
    pub(crate) fn run_in_place<'a>(
        &self,
        instructions: Instructions,
        others: impl Iterator<Item = (usize, &'a [f32])>,
        values: &mut [f32],
    ) {
        match self {
            Self::Activation(activation) => {
                instructions.dispatch(ActivationKernel { activation: *activation, values });
            }
            Self::Normalisation(normalisation) => normalisation.run(values),
            _ => {
                for (_, other) in others {
                    for (sum, value) in values.iter_mut().zip(other) {
                        *sum += value;
                    }
                }
            }
        }
    }
}

/// The first input, after a check of how many there are.
fn first_input(layer: &str, operation: &Operation, inputs: &[Shape]) -> Result<Shape, PolicyError> {
    let several = matches!(operation, Operation::Add | Operation::Concat);
    let fits = if several { inputs.len() >= 2 } else { inputs.len() == 1 };
    inputs.first().copied().filter(|_| fits).ok_or_else(|| PolicyError::InputCount {
        layer: layer.to_owned(),
        found: inputs.len(),
        expected: if several { "two or more" } else { "one" },
    })
}

fn check_finite(layer: &str, name: &'static str, value: f32) -> Result<(), PolicyError> {
    if value.is_finite() {
        return Ok(());
    }
    Err(PolicyError::InvalidSetting {
        owner: layer.to_owned(),
        name,
        value: value.to_string(),
        expected: "finite".to_owned(),
    })
}

fn check_inputs(
    layer: &str,
    inputs: &[Shape],
    fits: impl Fn(Shape) -> bool,
    expected: &str,
) -> Result<(), PolicyError> {
    match inputs.iter().find(|&&shape| !fits(shape)) {
        None => Ok(()),
        Some(&found) => Err(PolicyError::LayerInput {
            layer: layer.to_owned(),
            found,
            expected: format!("{expected}, as its first input"),
        }),
    }
}
