//! The forward model and its derivatives.

use crate::adjoint_run::AdjointRun;
use crate::beam_path::BeamStep;
use crate::beam_window::{BeamWindow, Scratch};
use crate::error::check_option;
use crate::flat_step::{StepDirection, StepGradient};
use crate::pass_kernel::PassKernel;
use crate::sloped_step::SlopeKernel;
use crate::{BeamPath, Footprint, GradientMemory, Grid, MillingError, Objective, RemovalLaw};

/// Largest Courant number W max(E |f'|)/Δ of a step: beyond it surfaces ripple.
pub const MAX_COURANT: f64 = 0.35;

/// Longest step, as a part of the diameter of the footprint.
const MAX_STEP: f64 = 0.1;

/// Most substeps between two points.
const MAX_SUBSTEPS: usize = 1000;

/// Largest cell, as a part of the diameter of the footprint.
const MAX_CELL: f64 = 0.1;

/// What the beam does to the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Process {
    /// How fast it removes material at a distance from its centre.
    pub footprint: Footprint,
    /// What else the rate depends on.
    pub law: RemovalLaw,
}

/// The forward model ∂Z/∂t = −E(r) f on a grid, by explicit Euler steps along the path (4.5).
#[derive(Debug, Clone)]
pub struct Simulator {
    grid: Grid,
    law: RemovalLaw,
    pub(crate) substeps: usize,
    pub(crate) kernel: PassKernel,
}

/// An objective and its derivatives with respect to the controls of a path.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradient {
    /// The objective, µm⁴.
    pub objective: f64,
    /// ∂J/∂D of each point, µm⁴ mm/s; shape (passes, points).
    pub dwell: Vec<f64>,
    /// ∂J/∂Y of each point, µm³; shape (passes, points).
    pub y: Vec<f64>,
    /// The surface after the path, µm.
    pub depth_um: Vec<f64>,
}

/// A small change of the controls of a path.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// Change of the dwell of each point, s/mm; shape (passes, points).
    pub dwell_s_mm: Vec<f64>,
    /// Change of the y of each point, µm; shape (passes, points).
    pub y_um: Vec<f64>,
}

/// First and second derivative of the objective with respect to the dose of a stretch, times the
/// dose and its square, µm⁴.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct StretchEffect {
    pub(crate) first: f64,
    pub(crate) second: f64,
}

impl Simulator {
    /// The model of `process` on `grid` with `substeps` steps between two points of a path.
    ///
    /// # Errors
    /// [`MillingError::GridTooCoarse`] for cells above a tenth of the footprint's diameter,
    /// [`MillingError::WindowTooLarge`] for cells far below it, [`MillingError::InvalidOption`] for
    /// a law out of range or a number of substeps that is not from 1 to 1000.
    pub fn new(grid: Grid, process: &Process, substeps: usize) -> Result<Self, MillingError> {
        process.law.validate()?;
        let ok = (1..=MAX_SUBSTEPS).contains(&substeps);
        check_option("substeps", substeps as f64, ok, "from 1 to 1000")?;
        let diameter_um = 2.0 * process.footprint.reach_um();
        let largest_um = MAX_CELL * diameter_um;
        if grid.cell_um > largest_um * (1.0 + 1e-9) {
            let cell_um = grid.cell_um;
            return Err(MillingError::GridTooCoarse { cell_um, diameter_um, largest_um });
        }
        let window = BeamWindow::new(grid, process.footprint.reach_um())?;
        let slope = match &process.law {
            RemovalLaw::Slope(law) => Some(SlopeKernel::new(law, grid.cell_um)),
            RemovalLaw::Linear | RemovalLaw::FeedSpeed(_) => None,
        };
        let kernel = PassKernel { window, footprint: process.footprint.clone(), slope };
        Ok(Self { grid, law: process.law, substeps, kernel })
    }

    /// The smallest number of substeps that keeps steps stable between points `spacing_um` apart
    /// with dwells up to `longest_dwell_s_mm`: steps of at most a tenth of the footprint's diameter
    /// and a Courant number of at most [`MAX_COURANT`].
    #[must_use]
    pub fn stable_substeps(
        process: &Process,
        cell_um: f64,
        spacing_um: f64,
        longest_dwell_s_mm: f64,
    ) -> usize {
        let by_length = spacing_um / (MAX_STEP * 2.0 * process.footprint.reach_um());
        let dose_s = spacing_um * 1e-3 * process.law.dose_s_mm(longest_dwell_s_mm);
        let courant = courant_per_s(&process.footprint, &process.law, cell_um) * dose_s;
        substeps_for(by_length.max(courant / MAX_COURANT))
    }

    /// Refuses paths whose steps would be unstable. A stretch that rises is longer than the spacing,
    /// and so are its steps.
    ///
    /// # Errors
    /// [`MillingError::Unstable`] says how many substeps are needed.
    pub fn check_stability(&self, path: &BeamPath) -> Result<(), MillingError> {
        if self.kernel.slope.is_none() {
            return Ok(());
        }
        self.check_courant(path.largest_dose_s(&self.law))
    }

    /// Refuses a dose, s, that the substeps do not divide into stable steps.
    pub(crate) fn check_courant(&self, dose_s: f64) -> Result<(), MillingError> {
        let whole = self.courant_per_s() * dose_s;
        let courant = whole / self.substeps as f64;
        if courant <= MAX_COURANT * (1.0 + 1e-9) {
            return Ok(());
        }
        let substeps = substeps_for(whole / MAX_COURANT);
        Err(MillingError::Unstable { courant, limit: MAX_COURANT, substeps })
    }

    /// Courant number of a step for each second of its dose.
    pub(crate) fn courant_per_s(&self) -> f64 {
        courant_per_s(&self.kernel.footprint, &self.law, self.grid.cell_um)
    }

    /// The grid.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Steps between two points of a path.
    #[must_use]
    pub fn substeps(&self) -> usize {
        self.substeps
    }

    /// Margin that a path must keep from the edge of the grid, µm.
    #[must_use]
    pub fn margin_um(&self) -> f64 {
        self.kernel.window.margin_um()
    }

    /// Mills along `path`; `depth_um` is the surface, before and after.
    ///
    /// # Errors
    /// [`MillingError::WrongLength`] unless there is a depth for each cell,
    /// [`MillingError::Control`] for a path that is not usable, [`MillingError::BeamLeavesGrid`] for
    /// one that comes too near to the edge, [`MillingError::Unstable`] for too few substeps.
    pub fn mill(&self, path: &BeamPath, depth_um: &mut [f64]) -> Result<(), MillingError> {
        self.check(path, depth_um)?;
        let mut scratch = Scratch::new(self.kernel.window.side);
        let mut steps = Vec::new();
        for pass in 0..path.passes() {
            path.steps(pass, self.substeps, &self.law, &mut steps);
            self.kernel.apply(&steps, depth_um, &mut scratch);
        }
        Ok(())
    }

    /// The objective of the surface that `path` makes of `start_um`, and its gradient by the
    /// discrete adjoint.
    ///
    /// Where slopes matter, the first passes record the factor f of each cell and step, as far as
    /// [`crate::MAX_TAPE_VALUES`] go; of the others the rows that they touch are kept from before, so
    /// that the backward run can repeat them. Memory grows as passes × rows under the beam × columns,
    /// not with the number of steps. `memory` may be used again and saves making it.
    ///
    /// # Errors
    /// As [`Simulator::mill`]; [`MillingError::WrongLength`] for an objective on another grid.
    pub fn gradient(
        &self,
        path: &BeamPath,
        start_um: &[f64],
        objective: &Objective,
        memory: &mut GradientMemory,
    ) -> Result<Gradient, MillingError> {
        self.check(path, start_um)?;
        let mut gradient = Gradient {
            objective: 0.0,
            dwell: vec![0.0; path.y_um.len()],
            y: vec![0.0; path.y_um.len()],
            depth_um: Vec::new(),
        };
        let run = AdjointRun { simulator: self, start_um, objective, memory };
        let steps_of = |pass: usize, steps: &mut Vec<BeamStep>| {
            path.steps(pass, self.substeps, &self.law, steps);
        };
        let end = run.run(path.passes(), steps_of, |pass, steps, by_step| {
            Self::add_to_controls(path, pass, steps, by_step, &mut gradient);
        })?;
        Ok(Gradient { objective: end.objective, depth_um: end.depth_um, ..gradient })
    }

    /// How the surface after `path` changes with a small change of the controls: the derivative in
    /// forward mode, µm.
    ///
    /// # Errors
    /// As [`Simulator::mill`]; [`MillingError::WrongLength`] for a direction of another shape.
    pub fn tangent(
        &self,
        path: &BeamPath,
        start_um: &[f64],
        direction: &Direction,
    ) -> Result<Vec<f64>, MillingError> {
        self.check(path, start_um)?;
        let expected = path.y_um.len();
        for (name, values) in [("dwell_s_mm", &direction.dwell_s_mm), ("y_um", &direction.y_um)] {
            if values.len() != expected {
                let actual = values.len();
                return Err(MillingError::WrongLength { name, actual, expected });
            }
        }
        let mut depth_um = start_um.to_vec();
        let mut tangent = vec![0.0; self.grid.len()];
        let mut scratch = Scratch::new(self.kernel.window.side);
        let mut steps = Vec::new();
        for pass in 0..path.passes() {
            path.steps(pass, self.substeps, &self.law, &mut steps);
            let first = pass * path.points;
            let directions: Vec<StepDirection> = steps
                .iter()
                .map(|step| {
                    let here = first + step.point;
                    let mean = |values: &[f64]| {
                        (1.0 - step.fraction) * values[here] + step.fraction * values[here + 1]
                    };
                    let rise = direction.y_um[here + 1] - direction.y_um[here];
                    StepDirection {
                        dose_s: step.dose_per_dwell_mm * mean(&direction.dwell_s_mm)
                            + step.dose_per_rise_s_um * rise,
                        y_um: mean(&direction.y_um),
                    }
                })
                .collect();
            self.kernel.apply_tangent(
                &steps,
                &directions,
                &mut depth_um,
                &mut tangent,
                &mut scratch,
            );
        }
        Ok(tangent)
    }

    /// What the dose of each stretch between two points does to the objective of the surface
    /// `depth_um`, for laws without slopes; shape (passes, points − 1).
    pub(crate) fn stretch_effects(
        &self,
        path: &BeamPath,
        depth_um: &[f64],
        objective: &Objective,
    ) -> Result<Vec<StretchEffect>, MillingError> {
        self.check(path, depth_um)?;
        let mut adjoint = objective.derivative(depth_um);
        let mut scratch = Scratch::new(self.kernel.window.side);
        let (mut steps, mut by_step) = (Vec::new(), Vec::new());
        let segments = path.points - 1;
        let mut effects = vec![StretchEffect::default(); path.passes() * segments];
        let mut doses = vec![0.0; effects.len()];
        for pass in 0..path.passes() {
            path.steps(pass, self.substeps, &self.law, &mut steps);
            let (adjoint, by_step) = (&mut adjoint, &mut by_step);
            self.kernel.apply_transpose(&steps, &[], &mut [], adjoint, by_step, &mut scratch);
            for (step, by_step) in steps.iter().zip(by_step) {
                let stretch = pass * segments + step.point;
                effects[stretch].first += step.dose_s * by_step.dose;
                doses[stretch] += step.dose_s;
            }
        }
        // A stretch is short beside the footprint, so its steps remove from the same cells.
        let squared = self.kernel.footprint.squared_rate_um4_s2();
        for (effect, dose_s) in effects.iter_mut().zip(doses) {
            effect.second = dose_s * dose_s * squared;
        }
        Ok(effects)
    }

    /// The chain rule from the steps of a pass to its points.
    fn add_to_controls(
        path: &BeamPath,
        pass: usize,
        steps: &[BeamStep],
        by_step: &[StepGradient],
        gradient: &mut Gradient,
    ) {
        let first = pass * path.points;
        for (step, by_step) in steps.iter().zip(by_step) {
            let here = first + step.point;
            let dwell = by_step.dose * step.dose_per_dwell_mm;
            gradient.dwell[here] += (1.0 - step.fraction) * dwell;
            gradient.dwell[here + 1] += step.fraction * dwell;
            let rise = by_step.dose * step.dose_per_rise_s_um;
            gradient.y[here] += (1.0 - step.fraction) * by_step.y - rise;
            gradient.y[here + 1] += step.fraction * by_step.y + rise;
        }
    }

    fn check(&self, path: &BeamPath, depth_um: &[f64]) -> Result<(), MillingError> {
        self.grid.check_len("depth_um", depth_um)?;
        path.validate()?;
        self.check_stability(path)?;
        let ends = [path.x_um(0), path.x_um(path.points - 1)];
        for (index, &y_um) in path.y_um.iter().enumerate() {
            for x_um in ends {
                if !self.kernel.window.contains(x_um, y_um) {
                    let (pass, margin_um) = (index / path.points, self.margin_um());
                    return Err(MillingError::BeamLeavesGrid { pass, x_um, y_um, margin_um });
                }
            }
        }
        Ok(())
    }
}

/// Courant number of a step for each second of its dose.
pub(crate) fn courant_per_s(footprint: &Footprint, law: &RemovalLaw, cell_um: f64) -> f64 {
    footprint.peak_um_s() * law.steepest_per_slope() / cell_um
}

/// The least number of substeps, at least 1. Rounding must not turn an exact fit into one more.
pub(crate) fn substeps_for(least: f64) -> usize {
    ((least * (1.0 - 1e-9)).ceil() as usize).max(1)
}
