//! A step of the beam on a surface whose slope matters (equation 4.5) and its adjoint (4.22).
//!
//! d' = d + W E(r) F(p, q), with the depth d, the dose W, the footprint E and the slopes p = ∂d/∂x,
//! q = ∂d/∂y by central differences. In the paper's signs the depth is −Z and the adjoint field
//! λ = ∂J/∂d is the multiplier H.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use crate::SlopeLaw;
use crate::arctan::arctan;
use crate::beam_path::BeamStep;
use crate::beam_window::{BeamWindow, Scratch};
use crate::flat_step::{StepDirection, StepGradient};
use crate::footprint::Radial;

/// The slope law as the loops use it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlopeKernel {
    /// Coefficients of θ and θ², sign included.
    first: f64,
    second: f64,
    /// 1 or −1, the sign of both.
    sign: f64,
    smoothing_square: f64,
    /// arctan ε.
    flat_rad: f64,
    /// 1/(2 × side of a cell), 1/µm.
    half_per_cell: f64,
}

impl SlopeKernel {
    pub(crate) fn new(law: &SlopeLaw, cell_um: f64) -> Self {
        let sign = law.sign.factor();
        Self {
            first: sign * law.first_per_rad,
            second: sign * law.second_per_rad2,
            sign,
            smoothing_square: law.smoothing * law.smoothing,
            flat_rad: arctan(law.smoothing),
            half_per_cell: 0.5 / cell_um,
        }
    }

    /// F(p, q).
    #[inline(always)]
    fn factor(&self, p: f64, q: f64) -> f64 {
        let steepness = (p * p + q * q + self.smoothing_square).sqrt();
        let angle = arctan(steepness) - self.flat_rad;
        let factor = 1.0 + angle * (self.first + angle * self.second);
        if factor > 0.0 { factor } else { 0.0 }
    }

    /// F and G, where ∂F/∂p = G p and ∂F/∂q = G q.
    #[inline(always)]
    fn factor_and_slope(&self, p: f64, q: f64) -> (f64, f64) {
        let square = p * p + q * q + self.smoothing_square;
        let steepness = square.sqrt();
        let angle = arctan(steepness) - self.flat_rad;
        let factor = 1.0 + angle * (self.first + angle * self.second);
        let slope = (self.first + 2.0 * angle * self.second) / (steepness * (1.0 + square));
        if factor > 0.0 { (factor, slope) } else { (0.0, 0.0) }
    }

    /// G of the slopes p and q, where F = `factor` is known: the derivative of F with respect to the
    /// angle is ± √(a₁² ∓ 4 a₂ (1 − F)), so that no arctangent is needed.
    #[inline(always)]
    fn slope_of_factor(&self, factor: f64, p: f64, q: f64) -> f64 {
        let square = p * p + q * q + self.smoothing_square;
        let steepest = self.first * self.first - 4.0 * self.second * (1.0 - factor);
        let steepest = if steepest > 0.0 { steepest } else { 0.0 };
        let slope = self.sign * (steepest / square).sqrt() / (1.0 + square);
        if factor > 0.0 { slope } else { 0.0 }
    }
}

/// Rows above, of and below a row of the window; the middle one with a neighbour on each side.
#[inline(always)]
fn neighbours<'a>(
    field: &'a [f64],
    window: &BeamWindow,
    row: usize,
    column: usize,
) -> (&'a [f64], &'a [f64], &'a [f64]) {
    let columns = window.grid.columns;
    (
        &field[(row - 1) * columns + column..][..window.side],
        &field[row * columns + column - 1..][..window.side + 2],
        &field[(row + 1) * columns + column..][..window.side],
    )
}

/// Adds what the step removes to `depth`.
#[inline(always)]
pub(crate) fn apply<R: Radial>(
    window: &BeamWindow,
    radial: R,
    law: &SlopeKernel,
    step: &BeamStep,
    depth: &mut [f64],
    scratch: &mut Scratch,
) {
    let (row, column) = window.corner(step);
    window.fill_columns(radial, step, column, scratch);
    let side = window.side;
    for k in 0..side {
        let across = window.row(radial, step, row + k);
        let (above, middle, below) = neighbours(depth, window, row + k, column);
        let (squares, axes) = (&scratch.squares_um2[..side], &scratch.axes[..side]);
        let removed = &mut scratch.first[k * side..][..side];
        for i in 0..side {
            let p = (middle[i + 2] - middle[i]) * law.half_per_cell;
            let q = (below[i] - above[i]) * law.half_per_cell;
            let rate = radial.rate(across.square_um2 + squares[i], axes[i], across.axis);
            removed[i] = step.dose_s * rate * law.factor(p, q);
        }
    }
    add_window(window, row, column, &scratch.first, depth);
}

/// As [`apply`], writing F over the window to `factors`: all that [`apply_transpose`] needs.
#[inline(always)]
pub(crate) fn apply_taped<R: Radial>(
    window: &BeamWindow,
    radial: R,
    law: &SlopeKernel,
    step: &BeamStep,
    depth: &mut [f64],
    scratch: &mut Scratch,
    factors: &mut [f64],
) {
    let (row, column) = window.corner(step);
    window.fill_columns(radial, step, column, scratch);
    let side = window.side;
    for k in 0..side {
        let across = window.row(radial, step, row + k);
        let (above, middle, below) = neighbours(depth, window, row + k, column);
        let (squares, axes) = (&scratch.squares_um2[..side], &scratch.axes[..side]);
        let removed = &mut scratch.first[k * side..][..side];
        let factors = &mut factors[k * side..][..side];
        for i in 0..side {
            let p = (middle[i + 2] - middle[i]) * law.half_per_cell;
            let q = (below[i] - above[i]) * law.half_per_cell;
            let rate = radial.rate(across.square_um2 + squares[i], axes[i], across.axis);
            let factor = law.factor(p, q);
            removed[i] = step.dose_s * rate * factor;
            factors[i] = factor;
        }
    }
    add_window(window, row, column, &scratch.first, depth);
}

/// The transpose of [`apply_tangent`]: turns the adjoint field after the step into the one before,
/// and returns what a change of the step does to the objective. `factors` are those that
/// [`apply_taped`] wrote; `depth` is the surface after the step, and becomes the one before it, but
/// for rounding.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "a step, its record, and the fields of both")]
pub(crate) fn apply_transpose<R: Radial>(
    window: &BeamWindow,
    radial: R,
    law: &SlopeKernel,
    step: &BeamStep,
    factors: &[f64],
    depth: &mut [f64],
    adjoint: &mut [f64],
    scratch: &mut Scratch,
) -> StepGradient {
    let (row, column) = window.corner(step);
    window.fill_columns(radial, step, column, scratch);
    scratch.dose_sums.fill(0.0);
    scratch.y_sums.fill(0.0);
    let (side, columns) = (window.side, window.grid.columns);
    for k in 0..side {
        let across = window.row(radial, step, row + k);
        let start = (row + k) * columns + column;
        let (cells, surface) = (&adjoint[start..][..side], &mut depth[start..][..side]);
        let (squares, axes) = (&scratch.squares_um2[..side], &scratch.axes[..side]);
        let (dose, y) = (&mut scratch.dose_sums[..side], &mut scratch.y_sums[..side]);
        let factors = &factors[k * side..][..side];
        let effects = &mut scratch.first[k * side..][..side];
        for i in 0..side {
            let (rate, slope) =
                radial.rate_and_slope(across.square_um2 + squares[i], axes[i], across.axis);
            let weighted = cells[i] * factors[i];
            dose[i] += weighted * rate;
            y[i] += weighted * slope * across.distance_um;
            surface[i] -= step.dose_s * rate * factors[i];
            effects[i] = cells[i] * (step.dose_s * rate * law.half_per_cell);
        }
    }
    for k in 0..side {
        let (above, middle, below) = neighbours(depth, window, row + k, column);
        let factors = &factors[k * side..][..side];
        let first = &mut scratch.first[k * side..][..side];
        let second = &mut scratch.second[k * side..][..side];
        for i in 0..side {
            let p = (middle[i + 2] - middle[i]) * law.half_per_cell;
            let q = (below[i] - above[i]) * law.half_per_cell;
            let effect = first[i] * law.slope_of_factor(factors[i], p, q);
            first[i] = effect * p;
            second[i] = effect * q;
        }
    }
    for k in 0..side {
        let first = &scratch.first[k * side..][..side];
        let second = &scratch.second[k * side..][..side];
        let start = (row + k) * columns + column;
        add(&mut adjoint[start + 1..][..side], first);
        subtract(&mut adjoint[start - 1..][..side], first);
        add(&mut adjoint[start + columns..][..side], second);
        subtract(&mut adjoint[start - columns..][..side], second);
    }
    StepGradient {
        dose: scratch.dose_sums.iter().sum(),
        y: -2.0 * step.dose_s * scratch.y_sums.iter().sum::<f64>(),
    }
}

/// Turns a small change of the depth before the step, and of the step, into the change after it.
/// `depth` is the depth before the step.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "a step, its change, and the fields of both")]
pub(crate) fn apply_tangent<R: Radial>(
    window: &BeamWindow,
    radial: R,
    law: &SlopeKernel,
    step: &BeamStep,
    direction: StepDirection,
    depth: &[f64],
    tangent: &mut [f64],
    scratch: &mut Scratch,
) {
    let (row, column) = window.corner(step);
    window.fill_columns(radial, step, column, scratch);
    let side = window.side;
    for k in 0..side {
        let across = window.row(radial, step, row + k);
        let (above, middle, below) = neighbours(depth, window, row + k, column);
        let (over, along, under) = neighbours(tangent, window, row + k, column);
        let change = &mut scratch.first[k * side..][..side];
        for i in 0..side {
            let p = (middle[i + 2] - middle[i]) * law.half_per_cell;
            let q = (below[i] - above[i]) * law.half_per_cell;
            let dp = (along[i + 2] - along[i]) * law.half_per_cell;
            let dq = (under[i] - over[i]) * law.half_per_cell;
            let (rate, rate_slope) = radial.rate_and_slope(
                across.square_um2 + scratch.squares_um2[i],
                scratch.axes[i],
                across.axis,
            );
            let (factor, slope) = law.factor_and_slope(p, q);
            change[i] = step.dose_s * rate * slope * (p * dp + q * dq)
                + direction.dose_s * rate * factor
                - 2.0 * step.dose_s * direction.y_um * factor * rate_slope * across.distance_um;
        }
    }
    add_window(window, row, column, &scratch.first, tangent);
}

#[inline(always)]
fn add_window(window: &BeamWindow, row: usize, column: usize, change: &[f64], field: &mut [f64]) {
    for k in 0..window.side {
        let cells = &mut field[(row + k) * window.grid.columns + column..][..window.side];
        add(cells, &change[k * window.side..][..window.side]);
    }
}

#[inline(always)]
fn add(cells: &mut [f64], change: &[f64]) {
    for (cell, change) in cells.iter_mut().zip(change) {
        *cell += change;
    }
}

#[inline(always)]
fn subtract(cells: &mut [f64], change: &[f64]) {
    for (cell, change) in cells.iter_mut().zip(change) {
        *cell -= change;
    }
}
