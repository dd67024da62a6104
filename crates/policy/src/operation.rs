//! What a layer may do, with the names and meanings of `PyTorch`.

use serde::{Deserialize, Serialize};

/// What a layer does. Pairs are (along rows, along columns), as in `PyTorch`: `[vertical, horizontal]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Operation {
    /// Cross-correlation, `torch.nn.Conv2d`.
    Conv2d {
        /// Tensor of shape (outputs, inputs / groups, kernel height, kernel width).
        weight: String,
        /// Tensor of shape (outputs).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        bias: Option<String>,
        /// Step between outputs.
        #[serde(default = "ones")]
        stride: [usize; 2],
        /// Zeros added at both ends.
        #[serde(default)]
        padding: [usize; 2],
        /// Step between the taps of the kernel.
        #[serde(default = "ones")]
        dilation: [usize; 2],
        /// Number of independent groups of channels.
        #[serde(default = "one")]
        groups: usize,
    },
    /// The transpose of a convolution, `torch.nn.ConvTranspose2d`. Run as a convolution over an
    /// input with stride − 1 zeros between its values.
    ConvTranspose2d {
        /// Tensor of shape (inputs, outputs, kernel height, kernel width).
        weight: String,
        /// Tensor of shape (outputs).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        bias: Option<String>,
        /// Step between inputs in the output.
        #[serde(default = "ones")]
        stride: [usize; 2],
        /// Rows and columns cut off at both ends of the output.
        #[serde(default)]
        padding: [usize; 2],
        /// Rows and columns added at the far end of the output, less than the stride.
        #[serde(default)]
        output_padding: [usize; 2],
        /// Step between the taps of the kernel.
        #[serde(default = "ones")]
        dilation: [usize; 2],
    },
    /// weight · x + bias, `torch.nn.Linear`.
    Linear {
        /// Tensor of shape (outputs, inputs).
        weight: String,
        /// Tensor of shape (outputs).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        bias: Option<String>,
    },
    /// All values as one vector: channel by channel, row by row.
    Flatten,
    /// max(x, 0).
    Relu,
    /// x where positive, slope · x elsewhere.
    LeakyRelu {
        /// Slope of the negative side.
        slope: f32,
    },
    /// x where positive, alpha (eˣ − 1) elsewhere.
    Elu {
        /// Limit of the negative side, negated.
        alpha: f32,
    },
    /// x Φ(x) with the normal distribution function Φ.
    Gelu {
        /// How Φ is evaluated.
        #[serde(default)]
        approximation: GeluApproximation,
    },
    /// x / (1 + e⁻ˣ).
    Silu,
    /// Hyperbolic tangent.
    Tanh,
    /// 1 / (1 + e⁻ˣ).
    Sigmoid,
    /// Greatest value in a window, `torch.nn.MaxPool2d`; padding never wins.
    MaxPool {
        /// Size of the window.
        kernel: [usize; 2],
        /// Step between windows.
        stride: [usize; 2],
        /// Rows and columns added at both ends, at most half the window.
        #[serde(default)]
        padding: [usize; 2],
    },
    /// Mean of a window, `torch.nn.AvgPool2d`.
    AvgPool {
        /// Size of the window.
        kernel: [usize; 2],
        /// Step between windows.
        stride: [usize; 2],
        /// Rows and columns of zeros added at both ends, at most half the window.
        #[serde(default)]
        padding: [usize; 2],
        /// Whether the zeros of the padding count in the mean.
        #[serde(default = "yes")]
        count_padding: bool,
    },
    /// Mean over all pixels; gives a vector of one value a channel.
    GlobalAveragePool,
    /// (C·f², H, W) to (C, H·f, W·f), `torch.nn.PixelShuffle`.
    PixelShuffle {
        /// The factor f.
        factor: usize,
    },
    /// (C, H·f, W·f) to (C·f², H, W), `torch.nn.PixelUnshuffle`.
    PixelUnshuffle {
        /// The factor f.
        factor: usize,
    },
    /// Sum of two or more inputs of one shape.
    Add,
    /// Channels of two or more inputs behind one another.
    Concat,
    /// (x − mean) / deviation.
    Normalise {
        /// Tensor of one value a channel, or one value a value in order (C, H, W).
        mean: String,
        /// Tensor of as many values, none of them 0.
        deviation: String,
    },
    /// Cuts rows and columns off the border.
    Crop {
        /// Rows cut off at the top.
        top: usize,
        /// Rows cut off at the bottom.
        bottom: usize,
        /// Columns cut off at the left.
        left: usize,
        /// Columns cut off at the right.
        right: usize,
    },
}

/// How GELU evaluates the normal distribution function.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GeluApproximation {
    /// By the error function, `approximate="none"` of `PyTorch`.
    #[default]
    None,
    /// By (1 + tanh(√(2/π) (x + 0.044715 x³))) / 2.
    Tanh,
}

fn one() -> usize {
    1
}

fn ones() -> [usize; 2] {
    [1, 1]
}

fn yes() -> bool {
    true
}
