//! A step of the beam where slopes do not matter: the linear and the feed-speed law.
//!
//! d' = d + W E(r), with the depth d, the dose W and the footprint E. The adjoint field λ = ∂J/∂d
//! does not change from step to step.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use crate::beam_path::BeamStep;
use crate::beam_window::{BeamWindow, Scratch};
use crate::footprint::Radial;

/// The derivative of the objective with respect to dose and y of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct StepGradient {
    /// ∂J/∂W, per s.
    pub(crate) dose: f64,
    /// ∂J/∂Y at the same W, per µm.
    pub(crate) y: f64,
}

/// Small changes of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct StepDirection {
    /// δW, s.
    pub(crate) dose_s: f64,
    /// δY, µm.
    pub(crate) y_um: f64,
}

/// Adds what the step removes to `depth`.
#[inline(always)]
pub(crate) fn apply<R: Radial>(
    window: &BeamWindow,
    radial: R,
    step: &BeamStep,
    depth: &mut [f64],
    scratch: &mut Scratch,
) {
    let (row, column) = window.corner(step);
    window.fill_columns(radial, step, column, scratch);
    for k in row..row + window.side {
        let across = window.row(radial, step, k);
        let cells = &mut depth[k * window.grid.columns + column..][..window.side];
        for ((cell, square), axis) in cells.iter_mut().zip(&scratch.squares_um2).zip(&scratch.axes)
        {
            *cell += step.dose_s * radial.rate(across.square_um2 + square, *axis, across.axis);
        }
    }
}

/// The transpose of [`apply_tangent`]: what a change of the step does to the objective.
#[inline(always)]
pub(crate) fn apply_transpose<R: Radial>(
    window: &BeamWindow,
    radial: R,
    step: &BeamStep,
    adjoint: &[f64],
    scratch: &mut Scratch,
) -> StepGradient {
    let (row, column) = window.corner(step);
    window.fill_columns(radial, step, column, scratch);
    scratch.dose_sums.fill(0.0);
    scratch.y_sums.fill(0.0);
    for k in row..row + window.side {
        let across = window.row(radial, step, k);
        let cells = &adjoint[k * window.grid.columns + column..][..window.side];
        for ((((cell, square), axis), dose), y) in cells
            .iter()
            .zip(&scratch.squares_um2)
            .zip(&scratch.axes)
            .zip(&mut scratch.dose_sums)
            .zip(&mut scratch.y_sums)
        {
            let (rate, slope) =
                radial.rate_and_slope(across.square_um2 + square, *axis, across.axis);
            *dose += cell * rate;
            *y += cell * slope * across.distance_um;
        }
    }
    StepGradient {
        dose: scratch.dose_sums.iter().sum(),
        y: -2.0 * step.dose_s * scratch.y_sums.iter().sum::<f64>(),
    }
}

/// Adds what a change of the step does to the depth to `tangent`.
#[inline(always)]
pub(crate) fn apply_tangent<R: Radial>(
    window: &BeamWindow,
    radial: R,
    step: &BeamStep,
    direction: StepDirection,
    tangent: &mut [f64],
    scratch: &mut Scratch,
) {
    let (row, column) = window.corner(step);
    window.fill_columns(radial, step, column, scratch);
    for k in row..row + window.side {
        let across = window.row(radial, step, k);
        let cells = &mut tangent[k * window.grid.columns + column..][..window.side];
        for ((cell, square), axis) in cells.iter_mut().zip(&scratch.squares_um2).zip(&scratch.axes)
        {
            let (rate, slope) =
                radial.rate_and_slope(across.square_um2 + square, *axis, across.axis);
            *cell += direction.dose_s * rate
                - 2.0 * step.dose_s * direction.y_um * slope * across.distance_um;
        }
    }
}
