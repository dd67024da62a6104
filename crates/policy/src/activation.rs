//! Activation functions, value by value.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use pulp::Simd;

use crate::instructions::Kernel;
use crate::operation::GeluApproximation;

/// An activation function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Activation {
    /// max(x, 0).
    Relu,
    /// x or slope · x.
    LeakyRelu(f32),
    /// x or alpha (eˣ − 1).
    Elu(f32),
    /// x Φ(x).
    Gelu(GeluApproximation),
    /// x σ(x).
    Silu,
    /// tanh x.
    Tanh,
    /// σ(x).
    Sigmoid,
}

/// Applies an activation function in place.
pub(crate) struct ActivationKernel<'a> {
    /// The function.
    pub(crate) activation: Activation,
    /// The values.
    pub(crate) values: &'a mut [f32],
}

impl Kernel for ActivationKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const FUSED: bool>(self, _: S) {
        let Self { activation, values } = self;
        match activation {
            Activation::Relu => each(values, |x| if x < 0.0 { 0.0 } else { x }),
            Activation::LeakyRelu(slope) => each(values, |x| if x < 0.0 { slope * x } else { x }),
            Activation::Elu(alpha) => {
                each(values, |x| {
                    let negative = alpha * (exponential(x) - 1.0);
                    if x < 0.0 { negative } else { x }
                });
            }
            Activation::Gelu(GeluApproximation::None) => each(values, gelu),
            Activation::Gelu(GeluApproximation::Tanh) => each(values, gelu_by_tanh),
            Activation::Silu => each(values, |x| x * sigmoid(x)),
            Activation::Tanh => each(values, tanh),
            Activation::Sigmoid => each(values, sigmoid),
        }
    }
}

/// Replaces every value; a loop without branches becomes vector code.
#[inline(always)]
fn each(values: &mut [f32], function: impl Fn(f32) -> f32) {
    for value in values {
        *value = function(*value);
    }
}

/// eˣ to two units in the last place, by the polynomial of Cephes' `expf` (Moshier 1992) on
/// [−ln 2 / 2, ln 2 / 2]. Arguments beyond ±87 are taken as ±87.
#[inline(always)]
fn exponential(x: f32) -> f32 {
    // Adding this leaves the rounded sum in the low bits of the mantissa.
    const ROUNDER: f32 = 12_582_912.0;
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87.0, 87.0);
    let shifted = x * std::f32::consts::LOG2_E + ROUNDER;
    let power = shifted - ROUNDER;
    let rest = x - power * LN_2_HIGH - power * LN_2_LOW;
    let mut series = 1.987_569_1e-4;
    for coefficient in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 0.166_666_65, 0.5] {
        series = series * rest + coefficient;
    }
    let mantissa = series * rest * rest + rest + 1.0;
    mantissa * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
}

#[inline(always)]
fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exponential(-x))
}

#[inline(always)]
fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (exponential(2.0 * x) + 1.0)
}

/// x Φ(x), with the error function of Abramowitz and Stegun (1964), 7.1.26, to 1.5e-7.
#[inline(always)]
fn gelu(x: f32) -> f32 {
    let argument = x.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * argument);
    let mut series = 1.061_405_4;
    for coefficient in [-1.453_152, 1.421_413_7, -0.284_496_74, 0.254_829_6] {
        series = series * t + coefficient;
    }
    let tail = 0.5 * series * t * exponential(-argument * argument);
    let share = if x < 0.0 { tail } else { 1.0 - tail };
    x * share
}

/// x (1 + tanh(√(2/π) (x + 0.044715 x³))) / 2.
#[inline(always)]
fn gelu_by_tanh(x: f32) -> f32 {
    const SQRT_2_OVER_PI: f32 = 0.797_884_6;
    x * sigmoid(2.0 * SQRT_2_OVER_PI * (x + 0.044_715 * x * x * x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instructions::Instructions;

    /// A function of one number.
    type Definition<'a> = &'a dyn Fn(f64) -> f64;

    fn apply(activation: Activation, instructions: Instructions) -> Vec<(f64, f64)> {
        let arguments: Vec<f32> = (-4000..=4000).map(|i| i as f32 * 0.005).collect();
        let mut values = arguments.clone();
        instructions.dispatch(ActivationKernel { activation, values: &mut values });
        arguments.into_iter().map(f64::from).zip(values.into_iter().map(f64::from)).collect()
    }

    /// The error function by its Maclaurin series up to 5, 1 beyond.
    fn error_function(x: f64) -> f64 {
        if x.abs() > 5.0 {
            return x.signum();
        }
        let (mut term, mut sum) = (x, x);
        for n in 1..200 {
            term *= -x * x / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        2.0 / std::f64::consts::PI.sqrt() * sum
    }

    #[test]
    fn activations_equal_their_definitions() {
        let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
        let by_tanh = |x: f64| {
            let inner = (2.0 / std::f64::consts::PI).sqrt() * (x + 0.044_715 * x.powi(3));
            0.5 * x * (1.0 + inner.tanh())
        };
        let by_error_function =
            |x: f64| 0.5 * x * (1.0 + error_function(x / std::f64::consts::SQRT_2));
        let definitions: [(Activation, Definition<'_>); 8] = [
            (Activation::Relu, &|x| x.max(0.0)),
            (Activation::LeakyRelu(0.1), &|x| if x < 0.0 { f64::from(0.1_f32) * x } else { x }),
            (Activation::Elu(1.5), &|x| if x < 0.0 { 1.5 * (x.exp() - 1.0) } else { x }),
            (Activation::Gelu(GeluApproximation::None), &by_error_function),
            (Activation::Gelu(GeluApproximation::Tanh), &by_tanh),
            (Activation::Silu, &|x| x * sigmoid(x)),
            (Activation::Tanh, &f64::tanh),
            (Activation::Sigmoid, &sigmoid),
        ];
        for instructions in [Instructions::Best, Instructions::Portable] {
            for (activation, definition) in definitions {
                for (x, y) in apply(activation, instructions) {
                    let expected = definition(x);
                    let tolerance = 1e-6 * expected.abs().max(1.0);
                    assert!((y - expected).abs() < tolerance, "{activation:?}({x}) = {y}");
                }
            }
        }
    }

    #[test]
    fn large_arguments_stay_finite() {
        for x in [-3e38, -1e4, 1e4, 3e38] {
            for function in [sigmoid, tanh, gelu] {
                assert!(function(x).is_finite());
            }
        }
    }
}
