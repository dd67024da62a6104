//! Greatest values and means of windows.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use std::ops::Range;

use pulp::Simd;

use crate::PolicyError;
use crate::instructions::Kernel;
use crate::limits::MAX_DIMENSION;
use crate::shape::Shape;

/// What is taken from a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pool {
    /// The greatest value.
    Greatest,
    /// The mean of the values on the activation.
    Mean,
    /// The mean of all values, those of the padding being 0.
    MeanWithPadding,
}

/// Pooling over windows of a fixed size.
#[derive(Debug)]
pub(crate) struct Pooling {
    pool: Pool,
    input: Shape,
    output: Shape,
    kernel: [usize; 2],
    stride: [usize; 2],
    padding: [usize; 2],
}

impl Pooling {
    /// Pooling of `input` for `layer`.
    pub(crate) fn new(
        layer: &str,
        input: Shape,
        pool: Pool,
        kernel: [usize; 2],
        stride: [usize; 2],
        padding: [usize; 2],
    ) -> Result<Self, PolicyError> {
        let error = |name, value: [usize; 2], expected: String| PolicyError::InvalidSetting {
            owner: layer.to_owned(),
            name,
            value: format!("{value:?}"),
            expected,
        };
        for (name, pair) in [("kernel", kernel), ("stride", stride)] {
            if pair.iter().any(|&side| side == 0 || side > MAX_DIMENSION) {
                return Err(error(name, pair, format!("1 to {MAX_DIMENSION}")));
            }
        }
        if padding[0] > kernel[0] / 2 || padding[1] > kernel[1] / 2 {
            return Err(error("padding", padding, format!("at most half the kernel {kernel:?}")));
        }
        let side = |axis: usize, length: usize| {
            let padded = length + 2 * padding[axis];
            padded.checked_sub(kernel[axis]).map(|rest| rest / stride[axis] + 1)
        };
        let (Some(height), Some(width)) = (side(0, input.height), side(1, input.width)) else {
            return Err(PolicyError::LayerInput {
                layer: layer.to_owned(),
                found: input,
                expected: format!("at least {} × {} pixels with padding", kernel[0], kernel[1]),
            });
        };
        let output = Shape::new(input.channels, height, width);
        output.check(layer)?;
        Ok(Self { pool, input, output, kernel, stride, padding })
    }

    /// The mean over all pixels of `input`.
    pub(crate) fn global(layer: &str, input: Shape) -> Result<Self, PolicyError> {
        let kernel = [input.height, input.width];
        Self::new(layer, input, Pool::Mean, kernel, [1, 1], [0, 0])
    }

    /// Shape of the result.
    pub(crate) fn output(&self) -> Shape {
        self.output
    }

    /// Values read in one run.
    pub(crate) fn reads(&self) -> u64 {
        let window = self.kernel[0].min(self.input.height) * self.kernel[1].min(self.input.width);
        (self.output.values() as u64).saturating_mul(window as u64)
    }

    /// Part of the window of output `index` that lies on the activation.
    fn window(&self, axis: usize, index: usize, length: usize) -> Range<usize> {
        let start = index * self.stride[axis];
        let end = (start + self.kernel[axis]).saturating_sub(self.padding[axis]).min(length);
        start.saturating_sub(self.padding[axis])..end
    }
}

/// Runs a pooling; input and output lie pixel by pixel.
pub(crate) struct PoolingKernel<'a> {
    /// What to do.
    pub(crate) pooling: &'a Pooling,
    /// What to read.
    pub(crate) input: &'a [f32],
    /// Where to write.
    pub(crate) output: &'a mut [f32],
}

impl Kernel for PoolingKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const FUSED: bool>(self, _: S) {
        let Self { pooling, input, output } = self;
        let Shape { channels, height, width } = pooling.input;
        for (index, pixel) in output.chunks_exact_mut(channels).enumerate() {
            let (row, column) = (index / pooling.output.width, index % pooling.output.width);
            let rows = pooling.window(0, row, height);
            let columns = pooling.window(1, column, width);
            let count = match pooling.pool {
                Pool::MeanWithPadding => pooling.kernel[0] * pooling.kernel[1],
                _ => rows.len() * columns.len(),
            };
            let greatest = pooling.pool == Pool::Greatest;
            pixel.fill(if greatest { f32::NEG_INFINITY } else { 0.0 });
            for row in rows {
                let values = &input[(row * width + columns.start) * channels..];
                for values in values[..columns.len() * channels].chunks_exact(channels) {
                    if greatest {
                        for (best, &value) in pixel.iter_mut().zip(values) {
                            *best = if value > *best { value } else { *best };
                        }
                    } else {
                        for (sum, &value) in pixel.iter_mut().zip(values) {
                            *sum += value;
                        }
                    }
                }
            }
            if !greatest {
                let share = 1.0 / count as f32;
                for sum in pixel {
                    *sum *= share;
                }
            }
        }
    }
}
