//! Layers that only move values, and the two orders of values.
//!
//! Inside a network values lie pixel by pixel, channels next to one another; outside, channel by
//! channel as in `PyTorch`.

use crate::PolicyError;
use crate::shape::Shape;

/// A layer that only moves the values of one input.
#[derive(Debug)]
pub(crate) struct Rearrangement {
    kind: Kind,
    input: Shape,
    output: Shape,
}

#[derive(Debug)]
enum Kind {
    /// Channel by channel into a vector.
    Flatten,
    /// Channels to pixels by a factor.
    Shuffle(usize),
    /// Pixels to channels by a factor.
    Unshuffle(usize),
    /// A part that begins at (row, column).
    Crop(usize, usize),
}

impl Rearrangement {
    /// All values as one vector.
    pub(crate) fn flatten(input: Shape) -> Self {
        Self { kind: Kind::Flatten, input, output: Shape::vector(input.values()) }
    }

    /// (C·f², H, W) to (C, H·f, W·f).
    pub(crate) fn shuffle(layer: &str, input: Shape, factor: usize) -> Result<Self, PolicyError> {
        let square = factor.saturating_mul(factor);
        if square == 0 || !input.channels.is_multiple_of(square) {
            return Err(factor_error(
                layer,
                input,
                factor,
                "a square root of a divisor of the channels",
            ));
        }
        let output =
            Shape::new(input.channels / square, input.height * factor, input.width * factor);
        Ok(Self { kind: Kind::Shuffle(factor), input, output })
    }

    /// (C, H·f, W·f) to (C·f², H, W).
    pub(crate) fn unshuffle(layer: &str, input: Shape, factor: usize) -> Result<Self, PolicyError> {
        if factor == 0
            || !input.height.is_multiple_of(factor)
            || !input.width.is_multiple_of(factor)
        {
            return Err(factor_error(layer, input, factor, "a common divisor of height and width"));
        }
        let output = Shape::new(
            input.channels * factor * factor,
            input.height / factor,
            input.width / factor,
        );
        Ok(Self { kind: Kind::Unshuffle(factor), input, output })
    }

    /// The input without rows at `top` and `bottom` and columns at `left` and `right`.
    pub(crate) fn crop(
        layer: &str,
        input: Shape,
        [top, bottom, left, right]: [usize; 4],
    ) -> Result<Self, PolicyError> {
        let rest = |length: usize, a: usize, b: usize| {
            length.checked_sub(a)?.checked_sub(b).filter(|&rest| rest > 0)
        };
        let (Some(height), Some(width)) =
            (rest(input.height, top, bottom), rest(input.width, left, right))
        else {
            return Err(PolicyError::LayerInput {
                layer: layer.to_owned(),
                found: input,
                expected: format!(
                    "more than {top} + {bottom} rows and {left} + {right} columns, which it cuts off"
                ),
            });
        };
        let output = Shape::new(input.channels, height, width);
        Ok(Self { kind: Kind::Crop(top, left), input, output })
    }

    /// Shape of the result.
    pub(crate) fn output(&self) -> Shape {
        self.output
    }

    /// Moves the values.
    pub(crate) fn run(&self, input: &[f32], output: &mut [f32]) {
        let Shape { channels, width, .. } = self.input;
        match self.kind {
            Kind::Flatten => pixels_to_planes(self.input, input, output),
            Kind::Crop(top, left) => {
                let length = self.output.width * channels;
                for (row, target) in output.chunks_exact_mut(length).enumerate() {
                    let start = ((top + row) * width + left) * channels;
                    target.copy_from_slice(&input[start..][..length]);
                }
            }
            Kind::Shuffle(factor) => {
                for (index, pixel) in input.chunks_exact(channels).enumerate() {
                    let (row, column) = (index / width, index % width);
                    for (channel, values) in pixel.chunks_exact(factor * factor).enumerate() {
                        for (part, &value) in values.iter().enumerate() {
                            let row = row * factor + part / factor;
                            let column = column * factor + part % factor;
                            let pixel = row * self.output.width + column;
                            output[pixel * self.output.channels + channel] = value;
                        }
                    }
                }
            }
            Kind::Unshuffle(factor) => {
                for (index, pixel) in output.chunks_exact_mut(self.output.channels).enumerate() {
                    let (row, column) = (index / self.output.width, index % self.output.width);
                    for part in 0..factor * factor {
                        let row = row * factor + part / factor;
                        let column = column * factor + part % factor;
                        let values = &input[(row * width + column) * channels..][..channels];
                        let parts = pixel.iter_mut().skip(part).step_by(factor * factor);
                        for (target, &value) in parts.zip(values) {
                            *target = value;
                        }
                    }
                }
            }
        }
    }
}

fn factor_error(layer: &str, input: Shape, factor: usize, expected: &str) -> PolicyError {
    PolicyError::InvalidSetting {
        owner: layer.to_owned(),
        name: "factor",
        value: factor.to_string(),
        expected: format!("{expected} of {input}"),
    }
}

/// Writes values that lie pixel by pixel in the order channel by channel.
pub(crate) fn pixels_to_planes(shape: Shape, input: &[f32], output: &mut [f32]) {
    if shape.channels == 1 || shape.is_vector() {
        output.copy_from_slice(input);
        return;
    }
    for (channel, plane) in output.chunks_exact_mut(shape.pixels()).enumerate() {
        for (target, pixel) in plane.iter_mut().zip(input.chunks_exact(shape.channels)) {
            *target = pixel[channel];
        }
    }
}

/// Puts the channels of several inputs, given with their numbers of channels, behind one another.
pub(crate) fn concatenate<'a>(
    inputs: impl Iterator<Item = (usize, &'a [f32])>,
    channels: usize,
    output: &mut [f32],
) {
    let mut first = 0;
    for (count, values) in inputs {
        for (target, pixel) in output.chunks_exact_mut(channels).zip(values.chunks_exact(count)) {
            target[first..first + count].copy_from_slice(pixel);
        }
        first += count;
    }
}
