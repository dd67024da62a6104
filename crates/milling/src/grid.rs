//! The grid on which the surface is known.

use crate::MillingError;
use crate::error::check_option;

/// Most cells of a grid: 16 million, 128 MB as depths.
pub const MAX_GRID_CELLS: usize = 1 << 24;

/// A grid of square cells, stored row by row: the cell of row j and column i is entry
/// j × `columns` + i and has its centre at (`origin_x_um` + (i + ½) `cell_um`, `origin_y_um` +
/// (j + ½) `cell_um`); x points right, y down, depths downwards into the workpiece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Side of a cell, µm.
    pub cell_um: f64,
    /// x of the outer corner of the first cell, µm.
    pub origin_x_um: f64,
    /// y of the outer corner of the first cell, µm.
    pub origin_y_um: f64,
}

impl Grid {
    /// A grid whose corner lies at (0, 0).
    ///
    /// # Errors
    /// [`MillingError::GridSize`] for no cell or more than [`MAX_GRID_CELLS`],
    /// [`MillingError::InvalidOption`] for a cell that is not above 0.
    pub fn new(rows: usize, columns: usize, cell_um: f64) -> Result<Self, MillingError> {
        let cells = rows.saturating_mul(columns);
        if cells == 0 || cells > MAX_GRID_CELLS {
            return Err(MillingError::GridSize { rows, columns, limit: MAX_GRID_CELLS });
        }
        let ok = cell_um > 0.0 && cell_um <= 1e9;
        check_option("cell_um", cell_um, ok, "above 0 and at most 1e9 µm")?;
        Ok(Self { rows, columns, cell_um, origin_x_um: 0.0, origin_y_um: 0.0 })
    }

    /// This grid with `margin` more cells on every side, at the same place.
    ///
    /// # Errors
    /// [`MillingError::GridSize`] when that is too large.
    pub fn with_margin(&self, margin: usize) -> Result<Self, MillingError> {
        let twice = margin.saturating_mul(2);
        let (rows, columns) = (self.rows.saturating_add(twice), self.columns.saturating_add(twice));
        let shift_um = margin as f64 * self.cell_um;
        Ok(Self {
            origin_x_um: self.origin_x_um - shift_um,
            origin_y_um: self.origin_y_um - shift_um,
            ..Self::new(rows, columns, self.cell_um)?
        })
    }

    /// Number of cells.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows * self.columns
    }

    /// Whether there is no cell; never, for a grid made by [`Grid::new`].
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// x of the centre of a column, µm.
    #[must_use]
    pub fn x_um(&self, column: usize) -> f64 {
        self.origin_x_um + (column as f64 + 0.5) * self.cell_um
    }

    /// y of the centre of a row, µm.
    #[must_use]
    pub fn y_um(&self, row: usize) -> f64 {
        self.origin_y_um + (row as f64 + 0.5) * self.cell_um
    }

    /// Area of a cell, µm².
    #[must_use]
    pub fn cell_area_um2(&self) -> f64 {
        self.cell_um * self.cell_um
    }

    /// Checks that `values` has an entry for each cell.
    pub(crate) fn check_len(&self, name: &'static str, values: &[f64]) -> Result<(), MillingError> {
        if values.len() == self.len() {
            return Ok(());
        }
        Err(MillingError::WrongLength { name, actual: values.len(), expected: self.len() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_margin_leaves_the_cells_where_they_are() {
        let grid = Grid::new(3, 4, 2.0).unwrap();
        let wide = grid.with_margin(5).unwrap();
        assert_eq!((wide.rows, wide.columns), (13, 14));
        assert!((wide.x_um(5) - grid.x_um(0)).abs() < 1e-12);
        assert!((wide.y_um(7) - grid.y_um(2)).abs() < 1e-12);
    }

    #[test]
    fn bad_grids_are_refused() {
        assert!(matches!(Grid::new(0, 3, 1.0), Err(MillingError::GridSize { rows: 0, .. })));
        assert!(matches!(Grid::new(1 << 20, 1 << 20, 1.0), Err(MillingError::GridSize { .. })));
        assert!(matches!(Grid::new(3, 3, 0.0), Err(MillingError::InvalidOption { .. })));
        assert!(Grid::new(3, 3, 1.0).unwrap().with_margin(usize::MAX).is_err());
    }
}
