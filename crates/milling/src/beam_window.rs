//! The cells under the beam, and the buffers that the steps need.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use crate::beam_path::BeamStep;
use crate::footprint::Radial;
use crate::{Grid, MillingError};

/// Most cells along a side of the window.
const MAX_WINDOW: usize = 512;

/// Square windows of cells around the beam: they hold every cell that it reaches.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BeamWindow {
    pub(crate) grid: Grid,
    /// Distance at which the footprint ends, µm.
    pub(crate) reach_um: f64,
    /// Cells along a side.
    pub(crate) side: usize,
}

/// What a step knows of the columns of its window, and room for its intermediate values.
#[derive(Debug, Clone)]
pub(crate) struct Scratch {
    /// (x − X)² of each column, µm².
    pub(crate) squares_um2: Vec<f64>,
    /// The footprint's factor of each column.
    pub(crate) axes: Vec<f64>,
    /// Sums by column, so that the loops over rows have no order to keep.
    pub(crate) dose_sums: Vec<f64>,
    pub(crate) y_sums: Vec<f64>,
    /// Two fields over the window.
    pub(crate) first: Vec<f64>,
    pub(crate) second: Vec<f64>,
}

/// What a step knows of a row of its window.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BeamRow {
    /// y − Y, µm.
    pub(crate) distance_um: f64,
    /// (y − Y)², µm².
    pub(crate) square_um2: f64,
    /// The footprint's factor of the row.
    pub(crate) axis: f64,
}

impl Scratch {
    pub(crate) fn new(side: usize) -> Self {
        let row = vec![0.0; side];
        let field = vec![0.0; side * side];
        Self {
            squares_um2: row.clone(),
            axes: row.clone(),
            dose_sums: row.clone(),
            y_sums: row,
            first: field.clone(),
            second: field,
        }
    }
}

impl BeamWindow {
    pub(crate) fn new(grid: Grid, reach_um: f64) -> Result<Self, MillingError> {
        let cells = (2.0 * reach_um / grid.cell_um).floor() + 1.0;
        if cells > MAX_WINDOW as f64 {
            return Err(MillingError::WindowTooLarge {
                cells: cells.min(1e15) as usize,
                limit: MAX_WINDOW,
            });
        }
        Ok(Self { grid, reach_um, side: cells as usize })
    }

    /// Row and column of the first cell of the window around a beam that
    /// [`BeamWindow::contains`].
    #[inline(always)]
    pub(crate) fn corner(&self, step: &BeamStep) -> (usize, usize) {
        let first = |place_um: f64, origin_um: f64| {
            ((place_um - origin_um - self.reach_um) / self.grid.cell_um - 0.5).ceil() as usize
        };
        (first(step.y_um, self.grid.origin_y_um), first(step.x_um, self.grid.origin_x_um))
    }

    /// Whether window and neighbours of a beam at (x, y) lie on the grid.
    pub(crate) fn contains(&self, x_um: f64, y_um: f64) -> bool {
        let margin_um = self.margin_um();
        let width_um = self.grid.columns as f64 * self.grid.cell_um;
        let height_um = self.grid.rows as f64 * self.grid.cell_um;
        let (x, y) = (x_um - self.grid.origin_x_um, y_um - self.grid.origin_y_um);
        x >= margin_um && x <= width_um - margin_um && y >= margin_um && y <= height_um - margin_um
    }

    /// Distance that the beam must keep from the edge of the grid, µm.
    pub(crate) fn margin_um(&self) -> f64 {
        self.reach_um + 2.0 * self.grid.cell_um
    }

    /// Fills the column buffers for the window that begins at `column`.
    #[inline(always)]
    pub(crate) fn fill_columns<R: Radial>(
        &self,
        radial: R,
        step: &BeamStep,
        column: usize,
        scratch: &mut Scratch,
    ) {
        for (k, (square, axis)) in scratch.squares_um2.iter_mut().zip(&mut scratch.axes).enumerate()
        {
            let distance_um = self.grid.x_um(column + k) - step.x_um;
            *square = distance_um * distance_um;
            *axis = radial.axis(distance_um);
        }
    }

    /// What a step knows of the row at `row` of the grid.
    #[inline(always)]
    pub(crate) fn row<R: Radial>(&self, radial: R, step: &BeamStep, row: usize) -> BeamRow {
        let distance_um = self.grid.y_um(row) - step.y_um;
        BeamRow {
            distance_um,
            square_um2: distance_um * distance_um,
            axis: radial.axis(distance_um),
        }
    }
}
