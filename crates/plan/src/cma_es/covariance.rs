//! The covariance matrix of the search distribution and its principal axes.

use nalgebra::{DMatrix, DMatrixView, DVector, Dyn};

use super::eigen::{NotDecomposed, SymmetricEigen};

/// Condition number the covariance matrix is held to, where double precision ends.
const MAX_CONDITION: f64 = 1e14;

/// Covariance matrix C = B D² Bᵀ of the search distribution; the factors are those of the last
/// [`Covariance::refresh`].
#[derive(Debug, Clone)]
pub(super) struct Covariance {
    matrix: DMatrix<f64>,
    eigen: SymmetricEigen,
    /// Square roots of the eigenvalues: the diagonal of D.
    axis_lengths: DVector<f64>,
    /// B D, shape (n, n): column k is principal axis k at one standard deviation.
    axes: DMatrix<f64>,
    /// Condition number found by the last refresh, before clamping.
    condition: f64,
    rotated: DVector<f64>,
}

impl Covariance {
    /// The n × n identity.
    pub(super) fn identity(n: usize) -> Self {
        Self {
            matrix: DMatrix::identity(n, n),
            eigen: SymmetricEigen::identity(n),
            axis_lengths: DVector::repeat(n, 1.0),
            axes: DMatrix::identity(n, n),
            condition: 1.0,
            rotated: DVector::zeros(n),
        }
    }

    /// The matrix C, shape (n, n).
    pub(super) fn matrix(&self) -> &DMatrix<f64> {
        &self.matrix
    }

    /// Largest variance of a coordinate, the largest diagonal element of C.
    pub(super) fn largest_variance(&self) -> f64 {
        (0..self.matrix.nrows()).fold(0.0, |largest, i| self.matrix[(i, i)].max(largest))
    }

    /// B D, shape (n, n).
    pub(super) fn axes(&self) -> &DMatrix<f64> {
        &self.axes
    }

    /// Ratio of the largest to the smallest eigenvalue; infinite when the smallest is ≤ 0.
    pub(super) fn condition(&self) -> f64 {
        self.condition
    }

    /// Standard deviation along the longest axis.
    pub(super) fn longest_axis(&self) -> f64 {
        self.axis_lengths.max()
    }

    /// The rank-one and rank-μ update of eq. (47):
    /// C ← `decay` C + `rate_one` p pᵀ + Σ w y yᵀ, where `weighted` holds w y and `steps` holds y
    /// in columns.
    pub(super) fn update(
        &mut self,
        decay: f64,
        rate_one: f64,
        path: &DVector<f64>,
        weighted: &DMatrix<f64>,
        steps: &DMatrix<f64>,
    ) {
        let (n, members) = steps.shape();
        let steps_transposed = DMatrixView::<f64, Dyn, Dyn>::from_slice_with_strides_generic(
            steps.as_slice(),
            Dyn(members),
            Dyn(n),
            Dyn(n),
            Dyn(1),
        );
        self.matrix.gemm(1.0, weighted, &steps_transposed, decay);
        self.matrix.ger(rate_one, path, path, 1.0);
        self.symmetrise();
    }

    fn symmetrise(&mut self) {
        let n = self.matrix.nrows();
        for column in 1..n {
            for row in 0..column {
                let mean = f64::midpoint(self.matrix[(row, column)], self.matrix[(column, row)]);
                self.matrix[(row, column)] = mean;
                self.matrix[(column, row)] = mean;
            }
        }
    }

    /// Recomputes the principal axes from the matrix. Eigenvalues that are not positive or
    /// exceed a condition of 1e14 are raised, and the matrix with them (Appendix B.3).
    ///
    /// On an error the axes are unspecified and the run must end.
    pub(super) fn refresh(&mut self) -> Result<(), NotDecomposed> {
        self.eigen.decompose(&self.matrix)?;
        let (smallest, largest) = (self.eigen.values.min(), self.eigen.values.max());
        if largest <= 0.0 {
            return Err(NotDecomposed);
        }
        self.condition = if smallest > 0.0 { largest / smallest } else { f64::INFINITY };
        if self.condition > MAX_CONDITION {
            let lift = largest / MAX_CONDITION - smallest;
            self.eigen.values.add_scalar_mut(lift);
            for i in 0..self.matrix.nrows() {
                self.matrix[(i, i)] += lift;
            }
        }
        self.axis_lengths.zip_apply(&self.eigen.values, |length, value| *length = value.sqrt());
        self.axes.copy_from(&self.eigen.vectors);
        for (mut column, &length) in self.axes.column_iter_mut().zip(&self.axis_lengths) {
            column *= length;
        }
        Ok(())
    }

    /// Writes C^(−1/2) `y` = B D⁻¹ Bᵀ `y` to `whitened`.
    pub(super) fn whiten(&mut self, y: &DVector<f64>, whitened: &mut DVector<f64>) {
        self.rotated.gemv_tr(1.0, &self.eigen.vectors, y, 0.0);
        self.rotated.component_div_assign(&self.axis_lengths);
        whitened.gemv(1.0, &self.eigen.vectors, &self.rotated, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_update_is_the_sum_of_outer_products(
            values in proptest::collection::vec(-1.0..1.0_f64, 15),
            path in proptest::collection::vec(-1.0..1.0_f64, 3),
            weights in proptest::collection::vec(-0.1..1.0_f64, 5),
        ) {
            let steps = DMatrix::from_vec(3, 5, values);
            let path = DVector::from_vec(path);
            let mut weighted = steps.clone();
            let mut expected = DMatrix::identity(3, 3) * 0.7 + &path * path.transpose() * 0.2;
            for (k, &w) in weights.iter().enumerate() {
                weighted.column_mut(k).scale_mut(w);
                expected += steps.column(k) * steps.column(k).transpose() * w;
            }
            let mut covariance = Covariance::identity(3);
            covariance.update(0.7, 0.2, &path, &weighted, &steps);
            prop_assert!((covariance.matrix() - expected).norm() < 1e-12);
        }

        #[test]
        fn whitening_undoes_stretching(values in proptest::collection::vec(-1.0..1.0_f64, 4)) {
            let mut covariance = Covariance::identity(4);
            let path = DVector::from_vec(values.clone());
            covariance.update(1.0, 0.5, &path, &DMatrix::zeros(4, 1), &DMatrix::zeros(4, 1));
            covariance.refresh().unwrap();
            let z = DVector::from_vec(values);
            let y = covariance.axes() * &z;
            let mut whitened = DVector::zeros(4);
            covariance.whiten(&y, &mut whitened);
            prop_assert!((whitened.norm() - z.norm()).abs() < 1e-12);
        }
    }

    #[test]
    fn negative_eigenvalues_are_raised() {
        let mut covariance = Covariance::identity(2);
        let path = DVector::from_vec(vec![1.0, 0.0]);
        covariance.update(1.0, -2.0, &path, &DMatrix::zeros(2, 1), &DMatrix::zeros(2, 1));
        covariance.refresh().unwrap();
        assert!(covariance.condition().is_infinite());
        assert!(covariance.matrix().symmetric_eigenvalues().min() > 0.0);
    }
}
