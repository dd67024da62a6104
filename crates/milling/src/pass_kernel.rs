//! The loops over the steps of one pass, compiled for the instructions that the processor has.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use pulp::{Arch, Simd, WithSimd};

use crate::beam_path::BeamStep;
use crate::beam_window::{BeamWindow, Scratch};
use crate::flat_step::{self, StepDirection, StepGradient};
use crate::footprint::{Footprint, Radial};
use crate::sloped_step::{self, SlopeKernel};

/// What the passes of a simulation have in common.
#[derive(Debug, Clone)]
pub(crate) struct PassKernel {
    pub(crate) window: BeamWindow,
    pub(crate) footprint: Footprint,
    /// The slope law, where slopes matter.
    pub(crate) slope: Option<SlopeKernel>,
}

impl PassKernel {
    /// Removes what the steps remove.
    pub(crate) fn apply(&self, steps: &[BeamStep], depth: &mut [f64], scratch: &mut Scratch) {
        let PassKernel { window, slope, .. } = self;
        self.run(Apply { window, slope, steps, depth, scratch });
    }

    /// Values that the tape of so many steps holds: none where slopes do not matter.
    pub(crate) fn tape_len(&self, steps: usize) -> usize {
        if self.slope.is_some() { steps * self.window.side.pow(2) } else { 0 }
    }

    /// Removes what the steps remove and fills their tape, which has
    /// [`PassKernel::tape_len`] values.
    pub(crate) fn apply_taped(
        &self,
        steps: &[BeamStep],
        depth: &mut [f64],
        tape: &mut [f64],
        scratch: &mut Scratch,
    ) {
        let PassKernel { window, slope, .. } = self;
        self.run(ApplyTaped { window, slope, steps, depth, tape, scratch });
    }

    /// Turns the adjoint field after the steps into the one before, and writes the gradient of each
    /// step. `tape` is that of [`PassKernel::apply_taped`]. Where slopes matter, `depth` is the
    /// surface after the steps and becomes the one before them, but for rounding; else neither is
    /// used.
    pub(crate) fn apply_transpose(
        &self,
        steps: &[BeamStep],
        tape: &[f64],
        depth: &mut [f64],
        adjoint: &mut [f64],
        gradients: &mut Vec<StepGradient>,
        scratch: &mut Scratch,
    ) {
        gradients.clear();
        gradients.resize(steps.len(), StepGradient::default());
        let PassKernel { window, slope, .. } = self;
        self.run(Transpose { window, slope, steps, tape, depth, adjoint, gradients, scratch });
    }

    /// Turns small changes before the steps into changes after them.
    pub(crate) fn apply_tangent(
        &self,
        steps: &[BeamStep],
        directions: &[StepDirection],
        depth: &mut [f64],
        tangent: &mut [f64],
        scratch: &mut Scratch,
    ) {
        let PassKernel { window, slope, .. } = self;
        self.run(Tangent { window, slope, steps, directions, depth, change: tangent, scratch });
    }

    fn run(&self, work: impl PassWork) {
        let arch = Arch::new();
        match &self.footprint {
            Footprint::Gaussian(g) => arch.dispatch(Work { radial: g.prepared(), work }),
            Footprint::Compact(compact) => arch.dispatch(Work { radial: *compact, work }),
            Footprint::Table(table) => arch.dispatch(Work { radial: table, work }),
        }
    }
}

/// Something to do with a pass, for any footprint.
trait PassWork {
    /// Does it. Must be `#[inline(always)]`, as everything that it calls.
    fn run<R: Radial>(self, radial: R);
}

struct Work<R, W> {
    radial: R,
    work: W,
}

impl<R: Radial, W: PassWork> WithSimd for Work<R, W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        self.work.run(self.radial);
    }
}

struct Apply<'a> {
    window: &'a BeamWindow,
    slope: &'a Option<SlopeKernel>,
    steps: &'a [BeamStep],
    depth: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl PassWork for Apply<'_> {
    #[inline(always)]
    fn run<R: Radial>(self, radial: R) {
        let Self { window, slope, steps, depth, scratch } = self;
        for step in steps {
            match slope {
                None => flat_step::apply(window, radial, step, depth, scratch),
                Some(law) => sloped_step::apply(window, radial, law, step, depth, scratch),
            }
        }
    }
}

struct ApplyTaped<'a> {
    window: &'a BeamWindow,
    slope: &'a Option<SlopeKernel>,
    steps: &'a [BeamStep],
    depth: &'a mut [f64],
    tape: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl PassWork for ApplyTaped<'_> {
    #[inline(always)]
    fn run<R: Radial>(self, radial: R) {
        let Self { window, slope, steps, depth, tape, scratch } = self;
        let Some(law) = slope else {
            return Apply { window, slope, steps, depth, scratch }.run(radial);
        };
        let side = window.side;
        for (step, factors) in steps.iter().zip(tape.chunks_exact_mut(side * side)) {
            sloped_step::apply_taped(window, radial, law, step, depth, scratch, factors);
        }
    }
}

struct Transpose<'a> {
    window: &'a BeamWindow,
    slope: &'a Option<SlopeKernel>,
    steps: &'a [BeamStep],
    tape: &'a [f64],
    depth: &'a mut [f64],
    adjoint: &'a mut [f64],
    gradients: &'a mut [StepGradient],
    scratch: &'a mut Scratch,
}

impl PassWork for Transpose<'_> {
    #[inline(always)]
    fn run<R: Radial>(self, radial: R) {
        let Self { window, slope, steps, tape, depth, adjoint, gradients, scratch } = self;
        let Some(law) = slope else {
            for (step, gradient) in steps.iter().zip(gradients) {
                *gradient = flat_step::apply_transpose(window, radial, step, adjoint, scratch);
            }
            return;
        };
        let taped = tape.chunks_exact(window.side.pow(2));
        for ((step, factors), gradient) in steps.iter().zip(taped).zip(gradients).rev() {
            *gradient = sloped_step::apply_transpose(
                window, radial, law, step, factors, depth, adjoint, scratch,
            );
        }
    }
}

struct Tangent<'a> {
    window: &'a BeamWindow,
    slope: &'a Option<SlopeKernel>,
    steps: &'a [BeamStep],
    directions: &'a [StepDirection],
    depth: &'a mut [f64],
    change: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl PassWork for Tangent<'_> {
    #[inline(always)]
    fn run<R: Radial>(self, radial: R) {
        let Self { window, slope, steps, directions, depth, change, scratch } = self;
        for (step, &direction) in steps.iter().zip(directions) {
            match slope {
                None => {
                    flat_step::apply_tangent(window, radial, step, direction, change, scratch);
                }
                Some(law) => {
                    sloped_step::apply_tangent(
                        window, radial, law, step, direction, depth, change, scratch,
                    );
                    sloped_step::apply(window, radial, law, step, depth, scratch);
                }
            }
        }
    }
}
