//! Depth maps: what a workpiece should look like.

use crate::objective::check_depths;
use crate::{Grid, MillingError};

/// The depth to reach in each pixel. Row j, column i has its centre at ((i + ½) pixel, (j + ½)
/// pixel), x right, y down; depths point into the workpiece.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    grid: Grid,
    depth_um: Vec<f64>,
}

impl DepthMap {
    /// A map of `rows` × `columns` depths, row by row.
    ///
    /// # Errors
    /// [`MillingError::GridSize`] and [`MillingError::InvalidOption`] as [`Grid::new`],
    /// [`MillingError::WrongLength`] unless there is a depth for each pixel,
    /// [`MillingError::TargetValue`] for one that is not from 0 to 10⁶ µm.
    pub fn new(
        rows: usize,
        columns: usize,
        pixel_um: f64,
        depth_um: Vec<f64>,
    ) -> Result<Self, MillingError> {
        let grid = Grid::new(rows, columns, pixel_um)?;
        grid.check_len("depth_um", &depth_um)?;
        check_depths(&depth_um, columns)?;
        Ok(Self { grid, depth_um })
    }

    /// The grid of the pixels.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The depths, row by row, µm.
    #[must_use]
    pub fn depth_um(&self) -> &[f64] {
        &self.depth_um
    }

    /// Depth at a place, µm: linear between the centres of pixels and constant beyond the last.
    #[must_use]
    pub fn at_um(&self, x_um: f64, y_um: f64) -> f64 {
        let place = |value_um: f64, count: usize| {
            let place = (value_um / self.grid.cell_um - 0.5).clamp(0.0, (count - 1) as f64);
            let index = (place as usize).min(count.saturating_sub(2));
            (index, (index + 1).min(count - 1), place - index as f64)
        };
        let (left, right, u) = place(x_um, self.grid.columns);
        let (above, below, v) = place(y_um, self.grid.rows);
        let depth = |row: usize, column: usize| self.depth_um[row * self.grid.columns + column];
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        mix(
            mix(depth(above, left), depth(above, right), u),
            mix(depth(below, left), depth(below, right), u),
            v,
        )
    }

    /// The map with each pixel divided into `factor` × `factor`.
    ///
    /// # Errors
    /// [`MillingError::GridSize`] for a factor of 0 or too many pixels.
    pub fn refined(&self, factor: usize) -> Result<Self, MillingError> {
        let (rows, columns) =
            (self.grid.rows.saturating_mul(factor), self.grid.columns.saturating_mul(factor));
        let grid = Grid::new(rows, columns, self.grid.cell_um / factor.max(1) as f64)?;
        let depth_um = (0..grid.len())
            .map(|k| self.at_um(grid.x_um(k % columns), grid.y_um(k / columns)))
            .collect();
        Ok(Self { grid, depth_um })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_between_the_centres() {
        let depths = (0..20).map(|k| f64::from(k % 5) + 2.0 * f64::from(k / 5)).collect();
        let map = DepthMap::new(4, 5, 3.0, depths).unwrap();
        for (x, y) in [(1.5, 1.5), (2.0, 7.1), (13.4, 10.4)] {
            let expected = (x / 3.0 - 0.5) + 2.0 * (y / 3.0 - 0.5);
            assert!((map.at_um(x, y) - expected).abs() < 1e-12);
        }
        assert!((map.at_um(-50.0, 0.0)).abs() < 1e-12);
        let fine = map.refined(3).unwrap();
        assert_eq!((fine.grid().rows, fine.grid().columns), (12, 15));
        let middle = fine.depth_um()[4 * 15 + 7];
        assert!((middle - 4.0).abs() < 1e-12);
    }

    #[test]
    fn one_pixel_is_a_map() {
        let map = DepthMap::new(1, 1, 3.0, vec![7.0]).unwrap();
        assert!((map.at_um(100.0, -3.0) - 7.0).abs() < 1e-12);
    }

    #[test]
    fn bad_maps_are_refused() {
        assert!(matches!(DepthMap::new(0, 2, 1.0, vec![]), Err(MillingError::GridSize { .. })));
        assert!(matches!(
            DepthMap::new(2, 2, 1.0, vec![1.0; 3]),
            Err(MillingError::WrongLength { .. })
        ));
        assert!(matches!(
            DepthMap::new(1, 2, 1.0, vec![1.0, -0.5]),
            Err(MillingError::TargetValue { row: 0, column: 1, .. })
        ));
        let map = DepthMap::new(1, 2, 1.0, vec![1.0; 2]).unwrap();
        assert!(map.refined(0).is_err());
    }
}
