//! The forward run that records, and the backward run that differentiates.

use std::ops::Range;

use crate::beam_path::BeamStep;
use crate::beam_window::Scratch;
use crate::flat_step::StepGradient;
use crate::{MillingError, Objective, Simulator};

/// Most recorded values that a gradient keeps: 256 MB.
pub const MAX_TAPE_VALUES: usize = 32 << 20;

/// Memory of [`Simulator::gradient`], to be used again.
#[derive(Debug, Clone, Default)]
pub struct GradientMemory {
    values: Vec<f64>,
}

impl GradientMemory {
    fn range(&mut self, start: usize, length: usize) -> &mut [f64] {
        let end = start + length;
        if self.values.len() < end {
            self.values.resize(end, 0.0);
        }
        &mut self.values[start..end]
    }
}

/// What the backward run needs of a pass.
enum Kept {
    /// Where its tape begins.
    Tape(usize),
    /// The cells that it touches, and their depths before it.
    Band(Range<usize>, Vec<f64>),
}

/// The surface after all passes.
pub(crate) struct End {
    /// The objective, µm⁴.
    pub(crate) objective: f64,
    pub(crate) depth_um: Vec<f64>,
}

/// A run over the steps of several passes and back.
pub(crate) struct AdjointRun<'a> {
    pub(crate) simulator: &'a Simulator,
    pub(crate) start_um: &'a [f64],
    pub(crate) objective: &'a Objective,
    pub(crate) memory: &'a mut GradientMemory,
}

impl AdjointRun<'_> {
    /// Mills the steps that `steps_of` writes for each pass, and visits the passes backwards with
    /// their steps and what a change of each does to the objective.
    pub(crate) fn run(
        self,
        passes: usize,
        steps_of: impl Fn(usize, &mut Vec<BeamStep>),
        mut visit: impl FnMut(usize, &[BeamStep], &[StepGradient]),
    ) -> Result<End, MillingError> {
        let Self { simulator, start_um, objective, memory } = self;
        let kernel = &simulator.kernel;
        simulator.grid().check_len("target_um", objective.target_um())?;
        let mut depth_um = start_um.to_vec();
        let mut scratch = Scratch::new(kernel.window.side);
        let (mut steps, mut by_step) = (Vec::new(), Vec::new());
        let mut kept: Vec<Kept> = Vec::with_capacity(passes);
        let mut used = 0;
        for pass in 0..passes {
            steps_of(pass, &mut steps);
            let length = kernel.tape_len(steps.len());
            let all_taped = matches!(kept.last(), None | Some(Kept::Tape(_)));
            if all_taped && used + length <= MAX_TAPE_VALUES {
                let tape = memory.range(used, length);
                kernel.apply_taped(&steps, &mut depth_um, tape, &mut scratch);
                kept.push(Kept::Tape(used));
                used += length;
            } else {
                let cells = simulator.cells_touched(&steps);
                kept.push(Kept::Band(cells.clone(), depth_um[cells].to_vec()));
                kernel.apply(&steps, &mut depth_um, &mut scratch);
            }
        }
        let end = End { objective: objective.value_of(&depth_um), depth_um: depth_um.clone() };
        let mut adjoint = objective.derivative(&depth_um);
        for (pass, kept) in kept.into_iter().enumerate().rev() {
            steps_of(pass, &mut steps);
            let length = kernel.tape_len(steps.len());
            let (tape, band) = match kept {
                Kept::Tape(start) => (memory.range(start, length), None),
                Kept::Band(cells, band) => {
                    let tape = memory.range(used, length);
                    depth_um[cells.clone()].copy_from_slice(&band);
                    kernel.apply_taped(&steps, &mut depth_um, tape, &mut scratch);
                    (tape, Some((cells, band)))
                }
            };
            let (depth_um, adjoint) = (&mut depth_um, &mut adjoint);
            kernel.apply_transpose(&steps, tape, depth_um, adjoint, &mut by_step, &mut scratch);
            if let Some((cells, band)) = band {
                depth_um[cells].copy_from_slice(&band);
            }
            visit(pass, &steps, &by_step);
        }
        Ok(end)
    }
}

impl Simulator {
    /// The cells of the rows that the steps change.
    fn cells_touched(&self, steps: &[BeamStep]) -> Range<usize> {
        let rows = steps.iter().map(|step| self.kernel.window.corner(step).0);
        let (low, high) =
            rows.fold((usize::MAX, 0), |(low, high), row| (low.min(row), high.max(row)));
        if low == usize::MAX {
            return 0..0;
        }
        let columns = self.grid().columns;
        low * columns..(high + self.kernel.window.side) * columns
    }
}
