//! Spots: places where the beam stands for a while.

use crate::adjoint_run::AdjointRun;
use crate::beam_path::BeamStep;
use crate::beam_window::Scratch;
use crate::{GradientMemory, MillingError, Objective, Simulator};

/// Spots that the backward run of [`Simulator::spots_gradient`] repeats together, where their records
/// do not fit the memory.
const SPOTS_OF_A_RUN: usize = 64;

/// A place where the beam stands, and how long.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// x of the beam, µm.
    pub x_um: f64,
    /// y of the beam, µm.
    pub y_um: f64,
    /// How long it stands there, s, at least 0. It removes E(r) f a second; f is 1 for the feed-speed
    /// law, which says nothing of a beam at rest.
    pub dwell_s: f64,
}

/// An objective and its derivatives with respect to the controls of spots.
#[derive(Debug, Clone, PartialEq)]
pub struct SpotsGradient {
    /// The objective, µm⁴.
    pub objective: f64,
    /// ∂J/∂ dwell of each spot, µm⁴/s.
    pub dwell: Vec<f64>,
    /// ∂J/∂y of each spot, µm³.
    pub y: Vec<f64>,
    /// The surface after the spots, µm.
    pub depth_um: Vec<f64>,
}

/// What milling a spot needs, to be used again.
#[derive(Debug, Clone)]
pub struct SpotRoom {
    scratch: Scratch,
    steps: Vec<BeamStep>,
}

impl Simulator {
    /// Mills spot by spot; `depth_um` is the surface, before and after. A spot is as many equal steps
    /// as the simulator has substeps.
    ///
    /// # Errors
    /// [`MillingError::WrongLength`] unless there is a depth for each cell, [`MillingError::Spot`] for
    /// a spot that is not usable or too near to the edge of the grid, [`MillingError::Unstable`] for
    /// too few substeps.
    pub fn mill_spots(&self, spots: &[Spot], depth_um: &mut [f64]) -> Result<(), MillingError> {
        self.check_spots(spots, depth_um)?;
        let mut room = self.spot_room();
        for spot in spots {
            self.mill_spot(spot, depth_um, &mut room);
        }
        Ok(())
    }

    /// The objective of the surface that `spots` make of `start_um`, and its gradient by the discrete
    /// adjoint; see [`Simulator::gradient`].
    ///
    /// # Errors
    /// As [`Simulator::mill_spots`]; [`MillingError::WrongLength`] for an objective on another grid.
    pub fn spots_gradient(
        &self,
        spots: &[Spot],
        start_um: &[f64],
        objective: &Objective,
        memory: &mut GradientMemory,
    ) -> Result<SpotsGradient, MillingError> {
        self.check_spots(spots, start_um)?;
        let (mut dwell, mut y) = (vec![0.0; spots.len()], vec![0.0; spots.len()]);
        let part = 1.0 / self.substeps as f64;
        let steps_of = |run: usize, steps: &mut Vec<BeamStep>| {
            steps.clear();
            let first = run * SPOTS_OF_A_RUN;
            let last = (first + SPOTS_OF_A_RUN).min(spots.len());
            for (index, spot) in spots.iter().enumerate().take(last).skip(first) {
                self.push_steps(index, spot, steps);
            }
        };
        let run = AdjointRun { simulator: self, start_um, objective, memory };
        let end =
            run.run(spots.len().div_ceil(SPOTS_OF_A_RUN), steps_of, |_, steps, by_step| {
                for (step, by_step) in steps.iter().zip(by_step) {
                    dwell[step.point] += part * by_step.dose;
                    y[step.point] += by_step.y;
                }
            })?;
        Ok(SpotsGradient { objective: end.objective, dwell, y, depth_um: end.depth_um })
    }

    /// Room for [`Simulator::mill_spot`].
    pub(crate) fn spot_room(&self) -> SpotRoom {
        SpotRoom { scratch: Scratch::new(self.kernel.window.side), steps: Vec::new() }
    }

    /// Mills one spot that [`Simulator::check_spots`] accepts, and returns the window of cells that it
    /// may have changed: first row, first column and side.
    pub(crate) fn mill_spot(
        &self,
        spot: &Spot,
        depth_um: &mut [f64],
        room: &mut SpotRoom,
    ) -> [usize; 3] {
        room.steps.clear();
        self.push_steps(0, spot, &mut room.steps);
        self.kernel.apply(&room.steps, depth_um, &mut room.scratch);
        self.window_of(spot)
    }

    /// The cells that a spot may change: first row, first column and side.
    pub(crate) fn window_of(&self, spot: &Spot) -> [usize; 3] {
        let (row, column) = self.kernel.window.corner(&self.step_of(0, spot));
        [row, column, self.kernel.window.side]
    }

    fn push_steps(&self, index: usize, spot: &Spot, steps: &mut Vec<BeamStep>) {
        steps.extend(std::iter::repeat_n(self.step_of(index, spot), self.substeps));
    }

    fn step_of(&self, index: usize, spot: &Spot) -> BeamStep {
        BeamStep {
            point: index,
            fraction: 0.0,
            x_um: spot.x_um,
            y_um: spot.y_um,
            dose_s: spot.dwell_s / self.substeps as f64,
            dose_per_dwell_mm: 0.0,
            dose_per_rise_s_um: 0.0,
        }
    }

    fn check_spots(&self, spots: &[Spot], depth_um: &[f64]) -> Result<(), MillingError> {
        self.grid().check_len("depth_um", depth_um)?;
        for (index, spot) in spots.iter().enumerate() {
            let Spot { x_um, y_um, dwell_s } = *spot;
            if !(0.0..=1e9).contains(&dwell_s) {
                let expected = "from 0 to 1e9 s";
                return Err(MillingError::Spot {
                    index,
                    name: "dwell_s",
                    value: dwell_s,
                    expected,
                });
            }
            for (name, value, inside) in [
                ("x_um", x_um, self.kernel.window.contains(x_um, self.middle_y_um())),
                ("y_um", y_um, self.kernel.window.contains(self.middle_x_um(), y_um)),
            ] {
                if !inside {
                    let expected = "on the grid, with a margin for the footprint";
                    return Err(MillingError::Spot { index, name, value, expected });
                }
            }
        }
        self.check_courant(spots.iter().map(|spot| spot.dwell_s).fold(0.0, f64::max))
    }

    fn middle_x_um(&self) -> f64 {
        self.grid().origin_x_um + self.grid().columns as f64 * self.grid().cell_um / 2.0
    }

    fn middle_y_um(&self) -> f64 {
        self.grid().origin_y_um + self.grid().rows as f64 * self.grid().cell_um / 2.0
    }
}
