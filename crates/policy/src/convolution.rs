//! Convolutions, transposed convolutions and linear layers, prepared for the tile kernel.

use crate::PolicyError;
use crate::instructions::Instructions;
use crate::limits::{MAX_DIMENSION, MAX_PARAMETERS};
use crate::padding::Padding;
use crate::shape::Shape;
use crate::tensors::Tensor;
use crate::tile_kernel::{LINE, Line, TileKernel, TilePass};

/// Steps, paddings and groups of a convolution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Geometry {
    /// Step between outputs (between inputs, when transposed).
    pub(crate) stride: [usize; 2],
    /// Zeros at both ends.
    pub(crate) padding: [usize; 2],
    /// Step between taps.
    pub(crate) dilation: [usize; 2],
    /// Groups of channels.
    pub(crate) groups: usize,
}

impl Geometry {
    /// Steps of 1, no padding, one group.
    pub(crate) const PLAIN: Self =
        Self { stride: [1, 1], padding: [0, 0], dilation: [1, 1], groups: 1 };

    fn check(&self, layer: &str) -> Result<(), PolicyError> {
        let error = |name, value: String, least| PolicyError::InvalidSetting {
            owner: layer.to_owned(),
            name,
            value,
            expected: format!("{least} to {MAX_DIMENSION}"),
        };
        for (name, pair, least) in [
            ("stride", self.stride, 1),
            ("padding", self.padding, 0),
            ("dilation", self.dilation, 1),
        ] {
            if pair.iter().any(|&value| value < least || value > MAX_DIMENSION) {
                return Err(error(name, format!("{pair:?}"), least));
            }
        }
        if self.groups == 0 || self.groups > MAX_DIMENSION {
            return Err(error("groups", self.groups.to_string(), 1));
        }
        Ok(())
    }
}

/// A convolution with its weights laid out for the kernel.
#[derive(Debug)]
pub(crate) struct Convolution {
    padding: Padding,
    output: Shape,
    groups: usize,
    group_inputs: usize,
    group_outputs: usize,
    pixel_starts: Vec<usize>,
    run_starts: Vec<usize>,
    run_length: usize,
    /// Groups × blocks × taps × lines of a block.
    weights: Vec<Line>,
    /// Groups × blocks × channels of a block.
    bias: Vec<f32>,
    block_vectors: usize,
    /// Lower bound of the results: 0 when a `ReLU` follows, −∞ otherwise.
    least: f32,
}

impl Convolution {
    /// A convolution over `input` with weights (outputs, inputs / groups, rows, columns).
    pub(crate) fn new(
        layer: &str,
        input: Shape,
        weight: &Tensor,
        bias: Option<&Tensor>,
        geometry: Geometry,
        instructions: Instructions,
    ) -> Result<Self, PolicyError> {
        geometry.check(layer)?;
        let &[outputs, group_inputs, rows, columns] = weight.shape.as_slice() else {
            return Err(weight.shape_error(layer, "(outputs, inputs / groups, height, width)"));
        };
        let groups = geometry.groups;
        if !input.channels.is_multiple_of(groups)
            || group_inputs != input.channels / groups
            || outputs == 0
            || outputs % groups != 0
            || rows == 0
            || columns == 0
        {
            let expected = format!(
                "(a multiple of {groups}, {} / {groups}, height, width) to read {input}",
                input.channels
            );
            return Err(weight.shape_error(layer, expected));
        }
        let before = geometry.padding.map(usize::cast_signed);
        let padding = Padding::new(layer, input, [1, 1], before, before)?;
        let inputs = group_inputs;
        let taps = KernelTaps { weight, outputs, inputs, rows, columns, transposed: false };
        Self::prepare(layer, padding, &taps, bias, geometry, instructions)
    }

    /// A transposed convolution over `input` with weights (inputs, outputs, rows, columns): a plain
    /// one with mirrored weights over the input spread out by its stride.
    pub(crate) fn transposed(
        layer: &str,
        input: Shape,
        (weight, bias): (&Tensor, Option<&Tensor>),
        geometry: Geometry,
        output_padding: [usize; 2],
        instructions: Instructions,
    ) -> Result<Self, PolicyError> {
        geometry.check(layer)?;
        let &[inputs, outputs, rows, columns] = weight.shape.as_slice() else {
            return Err(weight.shape_error(layer, "(inputs, outputs, height, width)"));
        };
        if inputs != input.channels || outputs == 0 || rows == 0 || columns == 0 {
            let expected = format!("({}, outputs, height, width) to read {input}", input.channels);
            return Err(weight.shape_error(layer, expected));
        }
        if (0..2).any(|axis| output_padding[axis] >= geometry.stride[axis]) {
            return Err(PolicyError::InvalidSetting {
                owner: layer.to_owned(),
                name: "output_padding",
                value: format!("{output_padding:?}"),
                expected: format!("less than the stride {:?}", geometry.stride),
            });
        }
        let kernel = [rows, columns];
        let before = [0, 1].map(|axis| {
            (geometry.dilation[axis] * (kernel[axis] - 1)).cast_signed()
                - geometry.padding[axis].cast_signed()
        });
        let after = [0, 1].map(|axis| before[axis] + output_padding[axis].cast_signed());
        let padding = Padding::new(layer, input, geometry.stride, before, after)?;
        let taps = KernelTaps { weight, outputs, inputs, rows, columns, transposed: true };
        let plain = Geometry { stride: [1, 1], padding: [0, 0], groups: 1, ..geometry };
        Self::prepare(layer, padding, &taps, bias, plain, instructions)
    }

    /// A linear layer over a vector with weights (outputs, inputs).
    pub(crate) fn linear(
        layer: &str,
        input: Shape,
        mut weight: Tensor,
        bias: Option<&Tensor>,
        instructions: Instructions,
    ) -> Result<Self, PolicyError> {
        if !input.is_vector() {
            return Err(PolicyError::LayerInput {
                layer: layer.to_owned(),
                found: input,
                expected: "a vector: put a flatten layer before it".to_owned(),
            });
        }
        let &[_, inputs] = weight.shape.as_slice() else {
            return Err(weight.shape_error(layer, "(outputs, inputs)"));
        };
        if inputs != input.channels {
            return Err(weight.shape_error(layer, format!("(outputs, {})", input.channels)));
        }
        weight.shape.extend([1, 1]);
        Self::new(layer, input, &weight, bias, Geometry::PLAIN, instructions)
    }

    fn prepare(
        layer: &str,
        padding: Padding,
        taps: &KernelTaps<'_>,
        bias: Option<&Tensor>,
        geometry: Geometry,
        instructions: Instructions,
    ) -> Result<Self, PolicyError> {
        let outputs = taps.outputs;
        if let Some(bias) = bias
            && bias.shape != [outputs]
        {
            return Err(bias.shape_error(layer, format!("({outputs})")));
        }
        let padded = padding.padded();
        let Geometry { stride, dilation, groups, .. } = geometry;
        let side = |axis: usize, length: usize, kernel: usize| {
            let span = dilation[axis] * (kernel - 1) + 1;
            length.checked_sub(span).map(|rest| rest / stride[axis] + 1)
        };
        let (Some(height), Some(width)) =
            (side(0, padded.height, taps.rows), side(1, padded.width, taps.columns))
        else {
            return Err(PolicyError::LayerInput {
                layer: layer.to_owned(),
                found: padded,
                expected: format!(
                    "at least {} × {} pixels with padding, the span of its kernel",
                    dilation[0] * (taps.rows - 1) + 1,
                    dilation[1] * (taps.columns - 1) + 1
                ),
            });
        };
        let output = Shape::new(outputs, height, width);
        output.check(layer)?;

        let group_inputs = padded.channels / groups;
        let group_outputs = outputs / groups;
        let lanes = instructions.lanes();
        let block_vectors = block_vectors(group_outputs.div_ceil(lanes), output.pixels());
        let block = block_vectors * lanes;
        let blocks = group_outputs.div_ceil(block);
        let tap_count = taps.count();
        let lines = block.div_ceil(LINE);
        let packed = [groups, blocks, lines * LINE, tap_count + 1]
            .iter()
            .fold(1_u64, |product, &n| product.saturating_mul(n as u64));
        if packed > MAX_PARAMETERS {
            return Err(PolicyError::TooLarge {
                layer: layer.to_owned(),
                what: "weights",
                value: packed,
                limit: MAX_PARAMETERS,
            });
        }

        let mut weights = vec![Line::default(); groups * blocks * tap_count * lines];
        let mut packed_bias = vec![0.0; groups * blocks * block];
        for channel in 0..outputs {
            let (group, within) = (channel / group_outputs, channel % group_outputs);
            let block_index = group * blocks + within / block;
            let lane = within % block;
            if let Some(bias) = bias {
                packed_bias[block_index * block + lane] = bias.values[channel];
            }
            let target = &mut weights[block_index * tap_count * lines..][..tap_count * lines];
            for (tap, row) in target.chunks_exact_mut(lines).enumerate() {
                row[lane / LINE].0[lane % LINE] = taps.at(channel, tap);
            }
        }

        let (run_starts, run_length) = runs(padded, taps, dilation, groups);
        let pixel_starts = (0..output.pixels())
            .map(|pixel| {
                let (row, column) = (pixel / width * stride[0], pixel % width * stride[1]);
                (row * padded.width + column) * padded.channels
            })
            .collect();
        Ok(Self {
            padding,
            output,
            groups,
            group_inputs,
            group_outputs,
            pixel_starts,
            run_starts,
            run_length,
            weights,
            bias: packed_bias,
            block_vectors,
            least: f32::NEG_INFINITY,
        })
    }

    /// Shape of the result.
    pub(crate) fn output(&self) -> Shape {
        self.output
    }

    /// Weights and biases as laid out.
    pub(crate) fn parameters(&self) -> u64 {
        (self.weights.len() * LINE + self.bias.len()) as u64
    }

    /// Multiplications of one run, those with filled-up channels included.
    pub(crate) fn multiplications(&self) -> u64 {
        (self.weights.len() * LINE) as u64 * self.pixel_starts.len() as u64
    }

    /// Values of the padded input, 0 when none is needed.
    pub(crate) fn padded_values(&self) -> usize {
        if self.padding.is_needed() { self.padding.padded().values() } else { 0 }
    }

    /// Applies `ReLU` to every result from now on.
    pub(crate) fn rectify(&mut self) {
        self.least = 0.0;
    }

    /// Runs the convolution; `padded` holds at least [`Self::padded_values`].
    pub(crate) fn run(
        &self,
        instructions: Instructions,
        input: &[f32],
        padded: &mut [f32],
        output: &mut [f32],
    ) {
        let input = if self.padding.is_needed() {
            let padded = &mut padded[..self.padded_values()];
            self.padding.fill(input, padded);
            &*padded
        } else {
            input
        };
        let weights = self.weights.chunks_exact(self.weights.len() / self.groups);
        let bias = self.bias.chunks_exact(self.bias.len() / self.groups);
        for (group, (weights, bias)) in weights.zip(bias).enumerate() {
            let pass = TilePass {
                input: &input[group * self.group_inputs..],
                pixel_starts: &self.pixel_starts,
                run_starts: &self.run_starts,
                run_length: self.run_length,
                weights,
                bias,
                block_vectors: self.block_vectors,
                least: self.least,
                output_channels: self.output.channels,
                first_channel: group * self.group_outputs,
                channels: self.group_outputs,
            };
            instructions.dispatch(TileKernel { pass, output });
        }
    }
}

/// Weights of a kernel, addressed alike whether transposed or not.
struct KernelTaps<'a> {
    weight: &'a Tensor,
    outputs: usize,
    /// Inputs of one group.
    inputs: usize,
    rows: usize,
    columns: usize,
    transposed: bool,
}

impl KernelTaps<'_> {
    /// Taps of one output: rows × columns × inputs, inputs fastest.
    fn count(&self) -> usize {
        self.rows * self.columns * self.inputs
    }

    /// The weight of `output` at a tap.
    fn at(&self, output: usize, tap: usize) -> f32 {
        let (place, input) = (tap / self.inputs, tap % self.inputs);
        let places = self.rows * self.columns;
        let index = if self.transposed {
            (input * self.outputs + output) * places + (places - 1 - place)
        } else {
            (output * self.inputs + input) * places + place
        };
        self.weight.values[index]
    }
}

/// Where runs of consecutive taps begin in a window, and their length.
fn runs(
    padded: Shape,
    taps: &KernelTaps<'_>,
    dilation: [usize; 2],
    groups: usize,
) -> (Vec<usize>, usize) {
    let start = |row: usize, column: usize| {
        (row * dilation[0] * padded.width + column * dilation[1]) * padded.channels
    };
    if groups == 1 && dilation[1] == 1 {
        let starts = (0..taps.rows).map(|row| start(row, 0)).collect();
        return (starts, taps.columns * padded.channels);
    }
    let starts = (0..taps.rows * taps.columns)
        .map(|pixel| start(pixel / taps.columns, pixel % taps.columns))
        .collect();
    (starts, padded.channels / groups)
}

/// Vectors in a block for `vectors` vectors of output channels at `pixels` pixels.
fn block_vectors(vectors: usize, pixels: usize) -> usize {
    if pixels < 3 {
        // With one pixel at a time, eight sums hide the latency of the additions.
        return [1, 2, 4, 8].into_iter().find(|&block| block >= vectors).unwrap_or(8);
    }
    // Blocks of one vector load an eighth more often for the same work; blocks of four need
    // weights faster than the second-level cache gives them.
    [(2, 8), (3, 8), (4, 8), (1, 9)]
        .into_iter()
        .min_by_key(|&(block, cost)| vectors.div_ceil(block) * block * cost)
        .map_or(1, |(block, _)| block)
}
