//! What a surface is compared with, and where.

use std::ops::Range;

use crate::{Grid, MillingError};

/// The objective J = ½ A Σ (d − d*)² over the target window (equation 4.6): d the depth, d* the
/// target, A the area of a cell; µm⁴.
#[derive(Debug, Clone, PartialEq)]
pub struct Objective {
    grid: Grid,
    target_um: Vec<f64>,
    rows: Range<usize>,
    columns: Range<usize>,
}

/// How far a surface is from the target, over the target window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingError {
    /// 100 Σ|d − d*| / Σ d*, %.
    pub percent: f64,
    /// 100 mean|d − d*| / max d*, %.
    pub percent_of_depth: f64,
    /// Largest |d − d*|, µm.
    pub max_um: f64,
    /// √ mean (d − d*)², µm.
    pub rms_um: f64,
}

impl Objective {
    /// Compares with `target_um`, a depth for each cell of `grid`, in the given rows and columns.
    ///
    /// # Errors
    /// [`MillingError::WrongLength`] for a target of another size or a window that is empty or
    /// leaves the grid, [`MillingError::TargetValue`] for a value that is no depth,
    /// [`MillingError::EmptyTarget`] where nothing is to be removed in the window.
    pub fn new(
        grid: Grid,
        target_um: Vec<f64>,
        rows: Range<usize>,
        columns: Range<usize>,
    ) -> Result<Self, MillingError> {
        grid.check_len("target_um", &target_um)?;
        for (name, range, length) in [
            ("rows of the window", &rows, grid.rows),
            ("columns of the window", &columns, grid.columns),
        ] {
            if range.is_empty() || range.end > length {
                let actual = range.end;
                return Err(MillingError::WrongLength { name, actual, expected: length });
            }
        }
        check_depths(&target_um, grid.columns)?;
        let objective = Self { grid, target_um, rows, columns };
        if objective.pairs(&objective.target_um).all(|(_, target)| target <= 0.0) {
            return Err(MillingError::EmptyTarget);
        }
        Ok(objective)
    }

    /// The grid of the target.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The target, µm, one depth for each cell.
    #[must_use]
    pub fn target_um(&self) -> &[f64] {
        &self.target_um
    }

    /// Rows of the target window.
    #[must_use]
    pub fn rows(&self) -> Range<usize> {
        self.rows.clone()
    }

    /// Columns of the target window.
    #[must_use]
    pub fn columns(&self) -> Range<usize> {
        self.columns.clone()
    }

    /// J of the surface `depth_um`, µm⁴.
    ///
    /// # Errors
    /// [`MillingError::WrongLength`] unless there is a depth for each cell.
    pub fn value(&self, depth_um: &[f64]) -> Result<f64, MillingError> {
        self.grid.check_len("depth_um", depth_um)?;
        Ok(self.value_of(depth_um))
    }

    pub(crate) fn value_of(&self, depth_um: &[f64]) -> f64 {
        let sum: f64 = self.pairs(depth_um).map(|(depth, target)| (depth - target).powi(2)).sum();
        0.5 * self.grid.cell_area_um2() * sum
    }

    /// ∂J/∂d for each cell (equation 4.21), µm³.
    pub(crate) fn derivative(&self, depth_um: &[f64]) -> Vec<f64> {
        let mut derivative = vec![0.0; self.grid.len()];
        let area = self.grid.cell_area_um2();
        for row in self.rows.clone() {
            let start = row * self.grid.columns;
            for k in start + self.columns.start..start + self.columns.end {
                derivative[k] = area * (depth_um[k] - self.target_um[k]);
            }
        }
        derivative
    }

    /// How far the surface `depth_um` is from the target.
    ///
    /// # Errors
    /// As [`Objective::value`].
    pub fn tracking_error(&self, depth_um: &[f64]) -> Result<TrackingError, MillingError> {
        self.grid.check_len("depth_um", depth_um)?;
        let (mut sum, mut squares, mut max, mut total, mut deepest) =
            (0.0, 0.0, 0.0_f64, 0.0, 0.0_f64);
        for (depth, target) in self.pairs(depth_um) {
            let error = (depth - target).abs();
            sum += error;
            squares += error * error;
            max = max.max(error);
            total += target;
            deepest = deepest.max(target);
        }
        let cells = (self.rows.len() * self.columns.len()) as f64;
        Ok(TrackingError {
            percent: 100.0 * sum / total,
            percent_of_depth: 100.0 * sum / cells / deepest,
            max_um: max,
            rms_um: (squares / cells).sqrt(),
        })
    }

    /// (depth, target) of each cell of the window.
    fn pairs<'a>(&'a self, depth_um: &'a [f64]) -> impl Iterator<Item = (f64, f64)> + 'a {
        self.rows.clone().flat_map(move |row| {
            let cells = row * self.grid.columns + self.columns.start
                ..row * self.grid.columns + self.columns.end;
            depth_um[cells.clone()].iter().copied().zip(self.target_um[cells].iter().copied())
        })
    }
}

/// Refuses the first value that is no depth.
pub(crate) fn check_depths(depths_um: &[f64], columns: usize) -> Result<(), MillingError> {
    match depths_um.iter().position(|depth| !(0.0..=1e6).contains(depth)) {
        None => Ok(()),
        Some(k) => Err(MillingError::TargetValue {
            row: k / columns,
            column: k % columns,
            value: depths_um[k],
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid::new(4, 5, 2.0).unwrap()
    }

    #[test]
    fn only_the_window_counts() {
        let objective = Objective::new(grid(), vec![1.0; 20], 1..3, 1..4).unwrap();
        let mut depth = vec![1.0; 20];
        depth[0] = 9.0;
        assert!(objective.value(&depth).unwrap().abs() < 1e-15);
        depth[6] = 1.5;
        assert!((objective.value(&depth).unwrap() - 0.5).abs() < 1e-15);
        let error = objective.tracking_error(&depth).unwrap();
        assert!((error.percent - 100.0 * 0.5 / 6.0).abs() < 1e-12);
        assert!((error.max_um - 0.5).abs() < 1e-15);
    }

    #[test]
    fn bad_targets_are_refused() {
        let new = |target: Vec<f64>, rows| Objective::new(grid(), target, rows, 0..5);
        assert!(matches!(new(vec![1.0; 19], 0..4), Err(MillingError::WrongLength { .. })));
        assert!(matches!(new(vec![1.0; 20], 0..5), Err(MillingError::WrongLength { .. })));
        assert!(matches!(new(vec![1.0; 20], 2..2), Err(MillingError::WrongLength { .. })));
        assert_eq!(new(vec![0.0; 20], 0..4), Err(MillingError::EmptyTarget));
        for value in [f64::NAN, f64::INFINITY, -1.0] {
            let mut target = vec![1.0; 20];
            target[7] = value;
            assert!(matches!(
                new(target, 0..4),
                Err(MillingError::TargetValue { row: 1, column: 2, .. })
            ));
        }
    }
}
