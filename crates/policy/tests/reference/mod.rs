//! Layers by their definitions, in f64, values channel by channel.

/// An activation.
#[derive(Clone, Debug)]
pub(crate) struct Planes {
    pub(crate) shape: [usize; 3],
    pub(crate) values: Vec<f64>,
}

/// Steps, paddings and groups.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Geometry {
    pub(crate) stride: [usize; 2],
    pub(crate) padding: [usize; 2],
    pub(crate) dilation: [usize; 2],
    pub(crate) groups: usize,
}

impl Planes {
    pub(crate) fn new(shape: [usize; 3], values: &[f32]) -> Self {
        Self { shape, values: values.iter().map(|&value| f64::from(value)).collect() }
    }

    pub(crate) fn zeros(shape: [usize; 3]) -> Self {
        Self { shape, values: vec![0.0; shape.iter().product()] }
    }

    /// The value at a position that may lie outside, where there is none.
    pub(crate) fn get(&self, channel: usize, row: isize, column: isize) -> Option<f64> {
        let row = usize::try_from(row).ok().filter(|&row| row < self.shape[1])?;
        let column = usize::try_from(column).ok().filter(|&column| column < self.shape[2])?;
        Some(self.values[(channel * self.shape[1] + row) * self.shape[2] + column])
    }

    pub(crate) fn set(&mut self, channel: usize, row: usize, column: usize, value: f64) {
        self.values[(channel * self.shape[1] + row) * self.shape[2] + column] = value;
    }

    /// Every position with its value from `value(channel, row, column)`.
    pub(crate) fn from_fn(shape: [usize; 3], value: impl Fn(usize, usize, usize) -> f64) -> Self {
        let mut planes = Self::zeros(shape);
        for channel in 0..shape[0] {
            for row in 0..shape[1] {
                for column in 0..shape[2] {
                    planes.set(channel, row, column, value(channel, row, column));
                }
            }
        }
        planes
    }
}

/// Cross-correlation; weights (outputs, inputs / groups, rows, columns).
pub(crate) fn convolve(
    input: &Planes,
    weights: &[f32],
    shape: [usize; 4],
    bias: Option<&[f32]>,
    geometry: Geometry,
) -> Planes {
    let [outputs, group_inputs, rows, columns] = shape;
    let Geometry { stride, padding, dilation, groups } = geometry;
    let side = |axis: usize, kernel: usize| {
        (input.shape[1 + axis] + 2 * padding[axis] - dilation[axis] * (kernel - 1) - 1)
            / stride[axis]
            + 1
    };
    Planes::from_fn([outputs, side(0, rows), side(1, columns)], |output, y, x| {
        let group = output / (outputs / groups);
        let mut sum = bias.map_or(0.0, |bias| f64::from(bias[output]));
        for within in 0..group_inputs {
            for row in 0..rows {
                for column in 0..columns {
                    let tap = ((output * group_inputs + within) * rows + row) * columns + column;
                    let y = (y * stride[0] + row * dilation[0]).cast_signed()
                        - padding[0].cast_signed();
                    let x = (x * stride[1] + column * dilation[1]).cast_signed()
                        - padding[1].cast_signed();
                    let value = input.get(group * group_inputs + within, y, x).unwrap_or(0.0);
                    sum += f64::from(weights[tap]) * value;
                }
            }
        }
        sum
    })
}

/// The transpose: every input value is spread over the output. Weights (inputs, outputs, rows,
/// columns).
pub(crate) fn convolve_transposed(
    input: &Planes,
    weights: &[f32],
    shape: [usize; 4],
    bias: &[f32],
    geometry: Geometry,
    output_padding: [usize; 2],
) -> Planes {
    let [inputs, outputs, rows, columns] = shape;
    let Geometry { stride, padding, dilation, .. } = geometry;
    let side = |axis: usize, kernel: usize| {
        (input.shape[1 + axis] - 1) * stride[axis]
            + dilation[axis] * (kernel - 1)
            + 1
            + output_padding[axis]
            - 2 * padding[axis]
    };
    let (height, width) = (side(0, rows), side(1, columns));
    let mut result =
        Planes::from_fn([outputs, height, width], |output, _, _| f64::from(bias[output]));
    for channel in 0..inputs {
        for y in 0..input.shape[1] {
            for x in 0..input.shape[2] {
                let value = input.values[(channel * input.shape[1] + y) * input.shape[2] + x];
                for tap in 0..outputs * rows * columns {
                    let (output, place) = (tap / (rows * columns), tap % (rows * columns));
                    let (row, column) = (place / columns, place % columns);
                    let row = (y * stride[0] + row * dilation[0]).checked_sub(padding[0]);
                    let column = (x * stride[1] + column * dilation[1]).checked_sub(padding[1]);
                    if let (Some(row), Some(column)) = (row, column)
                        && row < height
                        && column < width
                    {
                        let weight = weights[channel * outputs * rows * columns + tap];
                        result.values[(output * height + row) * width + column] +=
                            f64::from(weight) * value;
                    }
                }
            }
        }
    }
    result
}

/// What is taken from a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Pool {
    Greatest,
    Mean,
    MeanWithPadding,
}

/// Greatest values or means of windows.
pub(crate) fn pool(
    input: &Planes,
    pool: Pool,
    kernel: [usize; 2],
    stride: [usize; 2],
    padding: [usize; 2],
) -> Planes {
    let side =
        |axis: usize| (input.shape[1 + axis] + 2 * padding[axis] - kernel[axis]) / stride[axis] + 1;
    Planes::from_fn([input.shape[0], side(0), side(1)], |channel, y, x| {
        let mut values = Vec::new();
        for row in 0..kernel[0] {
            for column in 0..kernel[1] {
                let y = (y * stride[0] + row).cast_signed() - padding[0].cast_signed();
                let x = (x * stride[1] + column).cast_signed() - padding[1].cast_signed();
                values.extend(input.get(channel, y, x));
            }
        }
        let sum: f64 = values.iter().sum();
        match pool {
            Pool::Greatest => values.into_iter().fold(f64::NEG_INFINITY, f64::max),
            Pool::Mean => sum / values.len() as f64,
            Pool::MeanWithPadding => sum / (kernel[0] * kernel[1]) as f64,
        }
    })
}
