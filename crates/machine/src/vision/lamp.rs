//! The light of the lamp: how bright pristine ground is across the frame.

use nalgebra::{SMatrix, SVector};

use super::cells::{Grid, Inside};

/// Highest power of x and y together.
const DEGREE: usize = 4;

/// Terms of a polynomial of that degree in two variables.
const TERMS: usize = (DEGREE + 1) * (DEGREE + 2) / 2;

/// Rounds of leaving out what does not fit: dust and marks.
const ROUNDS: usize = 4;

/// Brightness of pristine ground over the frame, a polynomial in x and y from −1 to 1.
#[derive(Debug, Clone)]
pub(super) struct Lamp {
    width_px: f32,
    height_px: f32,
    /// Coefficients, grey levels: by power of y, then of x.
    coefficients: [[f32; DEGREE + 1]; DEGREE + 1],
}

impl Lamp {
    /// The light in a frame whose cells have the grey levels `means`; nothing where it is dark or
    /// no polynomial fits.
    pub(super) fn fit(
        grid: Grid,
        means: &[f32],
        least_contrast: f32,
        (width_px, height_px): (usize, usize),
    ) -> Option<Self> {
        let mut lamp = Self {
            width_px: width_px as f32,
            height_px: height_px as f32,
            coefficients: [[0.0; DEGREE + 1]; DEGREE + 1],
        };
        let mut levels: Vec<f32> = Vec::with_capacity(grid.width * grid.height);
        for row in means.chunks_exact(grid.stride()) {
            levels.extend_from_slice(&row[..grid.width]);
        }
        let median = levels.len() / 2;
        lamp.coefficients[0][0] = *levels.select_nth_unstable_by(median, f32::total_cmp).1;
        let mut tolerance = 0.6;
        for _ in 0..ROUNDS {
            lamp = lamp.refined(grid, means, tolerance)?;
            tolerance = (0.5 * tolerance).max(0.5 * least_contrast);
        }
        Some(lamp)
    }

    /// Fitted anew to the cells that are off by less than the fraction `tolerance`.
    fn refined(&self, grid: Grid, means: &[f32], tolerance: f32) -> Option<Self> {
        let mut normal = SMatrix::<f64, TERMS, TERMS>::zeros();
        let mut right = SVector::<f64, TERMS>::zeros();
        let mut expected = vec![0.0; grid.stride()];
        for j in 0..grid.height {
            self.row(grid, [0, 0], j, &mut expected);
            let y = self.y(grid, 0, j);
            for (i, &expected) in expected[..grid.width].iter().enumerate() {
                let mean = means[j * grid.stride() + i];
                if expected > 1.0 && (mean / expected - 1.0).abs() < tolerance {
                    let terms = terms(self.x(grid, 0, i), y);
                    normal.ger(1.0, &terms, &terms, 1.0);
                    right.axpy(f64::from(mean), &terms, 1.0);
                }
            }
        }
        let found = normal.cholesky()?.solve(&right);
        let mut lamp = self.clone();
        let mut values = found.iter();
        for (power_y, row) in lamp.coefficients.iter_mut().enumerate() {
            for coefficient in &mut row[..=DEGREE - power_y] {
                *coefficient = *values.next()? as f32;
            }
        }
        Some(lamp)
    }

    /// Divides the cells of a grid moved by `offset` frame px by the light. Outside it stays 0.
    pub(super) fn divide(&self, grid: Grid, offset: [isize; 2], inside: Inside, means: &mut [f32]) {
        let mut light = vec![0.0; grid.stride()];
        for (j, means) in means.chunks_exact_mut(grid.stride()).enumerate() {
            if !(inside.rows.0..inside.rows.1).contains(&j) {
                means.fill(0.0);
                continue;
            }
            self.row(grid, offset, j, &mut light);
            for (mean, light) in means.iter_mut().zip(&light) {
                *mean /= light.max(1.0);
            }
            means[..inside.columns.0].fill(0.0);
            means[inside.columns.1..].fill(0.0);
        }
    }

    /// Light in row `j` of a grid moved by `offset` frame px.
    fn row(&self, grid: Grid, offset: [isize; 2], j: usize, light: &mut [f32]) {
        let y = self.y(grid, offset[1], j);
        let mut by_x = [0.0; DEGREE + 1];
        for row in self.coefficients.iter().rev() {
            for (sum, coefficient) in by_x.iter_mut().zip(row) {
                *sum = *sum * y + coefficient;
            }
        }
        let (first, step) = (self.x(grid, offset[0], 0), 2.0 * grid.cell as f32 / self.width_px);
        for (i, light) in light.iter_mut().enumerate() {
            let x = first + step * i as f32;
            *light = by_x.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient);
        }
    }

    fn x(&self, grid: Grid, offset: isize, i: usize) -> f32 {
        ((i as f32 + 0.5) * grid.cell as f32 + offset as f32) * 2.0 / self.width_px - 1.0
    }

    fn y(&self, grid: Grid, offset: isize, j: usize) -> f32 {
        ((j as f32 + 0.5) * grid.cell as f32 + offset as f32) * 2.0 / self.height_px - 1.0
    }
}

/// The terms of the polynomial: by power of y, then of x.
fn terms(x: f32, y: f32) -> SVector<f64, TERMS> {
    let (x, y) = (f64::from(x), f64::from(y));
    let mut terms = SVector::zeros();
    let (mut k, mut by_y) = (0, 1.0);
    for power_y in 0..=DEGREE {
        let mut term = by_y;
        for _ in 0..=DEGREE - power_y {
            terms[k] = term;
            term *= x;
            k += 1;
        }
        by_y *= y;
    }
    terms
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lamp_is_found_behind_marks() {
        let grid = Grid::new(4, 640, 480);
        let light = |i: usize, j: usize| {
            let (x, y) = (i as f32 / 80.0 - 1.0, j as f32 / 60.0 - 1.0);
            150.0 - 20.0 * (x * x + y * y) + 5.0 * x * y + 4.0 * x
        };
        let mut means = grid.picture();
        for j in 0..120 {
            for i in 0..160 {
                let dark = (i % 40) < 15 && (j % 40) < 15;
                means[j * 160 + i] = light(i, j) * if dark { 0.65 } else { 1.0 };
            }
        }
        let lamp = Lamp::fit(grid, &means, 0.12, (640, 480)).unwrap();
        let inside = grid.inside([0, 0], 640, 480);
        lamp.divide(grid, [0, 0], inside, &mut means);
        for j in 0..120 {
            for i in 0..160 {
                let dark = (i % 40) < 15 && (j % 40) < 15;
                let expected = if dark { 0.65 } else { 1.0 };
                assert!((means[j * 160 + i] - expected).abs() < 0.002);
            }
        }
    }
}
