//! Least squares of a few parameters, by Levenberg and Marquardt's method.

use nalgebra::{DMatrix, DVector};

/// What a fit found.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub(crate) values: DVector<f64>,
    /// Standard errors of the values.
    pub(crate) errors: DVector<f64>,
    /// Root mean square of the residuals.
    pub(crate) rms: f64,
}

/// Step of a difference, in units of a parameter.
const STEP: f64 = 1e-5;

/// The values nearest to `start` at which the residuals are least; none when they do not determine
/// all values, or `residuals` has none for them.
pub(crate) fn least_squares(
    start: &[f64],
    residuals: impl Fn(&[f64]) -> Option<Vec<f64>>,
) -> Option<Fit> {
    let evaluate = |values: &DVector<f64>| residuals(values.as_slice()).map(DVector::from_vec);
    let mut values = DVector::from_column_slice(start);
    let mut residual = evaluate(&values)?;
    let mut damping = 1e-3;
    for _ in 0..100 {
        let jacobian = jacobian(&values, &residual, &evaluate)?;
        let mut normal = jacobian.transpose() * &jacobian;
        for k in 0..start.len() {
            normal[(k, k)] *= 1.0 + damping;
        }
        let step = normal.lu().solve(&(jacobian.transpose() * &residual))?;
        let trial = &values - step;
        match evaluate(&trial) {
            Some(next) if next.norm_squared() < residual.norm_squared() => {
                let fall = 1.0 - next.norm_squared() / residual.norm_squared();
                (values, residual) = (trial, next);
                damping = (damping * 0.2_f64).max(1e-12);
                if fall < 1e-12 {
                    break;
                }
            }
            _ => {
                damping *= 10.0;
                if damping > 1e12 {
                    break;
                }
            }
        }
    }
    let jacobian = jacobian(&values, &residual, &evaluate)?;
    let inverse = (jacobian.transpose() * &jacobian).try_inverse()?;
    let freedom = residual.len().checked_sub(start.len()).filter(|&freedom| freedom > 0)?;
    let variance = residual.norm_squared() / freedom as f64;
    Some(Fit {
        errors: inverse.diagonal().map(|entry| (variance * entry).max(0.0).sqrt()),
        rms: (residual.norm_squared() / residual.len() as f64).sqrt(),
        values,
    })
}

fn jacobian(
    values: &DVector<f64>,
    residual: &DVector<f64>,
    evaluate: &impl Fn(&DVector<f64>) -> Option<DVector<f64>>,
) -> Option<DMatrix<f64>> {
    let columns: Vec<DVector<f64>> = (0..values.len())
        .map(|k| {
            let mut moved = values.clone();
            moved[k] += STEP;
            Some((evaluate(&moved)? - residual) / STEP)
        })
        .collect::<Option<_>>()?;
    Some(DMatrix::from_columns(&columns))
}
