//! Eigendecomposition of a symmetric matrix in buffers that live as long as the optimiser.
//!
//! Householder tridiagonalisation and implicit QL with Wilkinson's shift (G. H. Golub, C. F. Van
//! Loan, *Matrix Computations*, §8.3). The rotations of one QL sweep are applied together to a
//! few rows of the eigenvectors at a time, which keeps those rows in registers.

use nalgebra::{DMatrix, DVector};

/// QL sweeps allowed per eigenvalue; two suffice on average.
const MAX_SWEEPS: usize = 60;

/// Partial sums of a scalar product.
const LANES: usize = 8;

/// The eigenvalues did not converge, or the matrix holds a value that is not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotDecomposed;

/// Eigenvalues and orthonormal eigenvectors of a symmetric n × n matrix.
#[derive(Debug, Clone)]
pub(super) struct SymmetricEigen {
    /// Eigenvalues, length n, in no particular order.
    pub(super) values: DVector<f64>,
    /// Eigenvector k in column k, shape (n, n).
    pub(super) vectors: DMatrix<f64>,
    /// The matrix being reduced; below its subdiagonal the Householder vectors.
    work: DMatrix<f64>,
    off_diagonal: Vec<f64>,
    scales: Vec<f64>,
    vector: Vec<f64>,
    product: Vec<f64>,
    /// (cosine, sine) of the rotation of columns i and i + 1.
    rotations: Vec<(f64, f64)>,
}

impl SymmetricEigen {
    /// The decomposition of the n × n identity.
    pub(super) fn identity(n: usize) -> Self {
        Self {
            values: DVector::repeat(n, 1.0),
            vectors: DMatrix::identity(n, n),
            work: DMatrix::zeros(n, n),
            off_diagonal: vec![0.0; n],
            scales: vec![0.0; n],
            vector: vec![0.0; n],
            product: vec![0.0; n],
            rotations: vec![(1.0, 0.0); n],
        }
    }

    /// Decomposes the symmetric `matrix`, of the shape given at construction. After an error the
    /// contents are unspecified.
    pub(super) fn decompose(&mut self, matrix: &DMatrix<f64>) -> Result<(), NotDecomposed> {
        let scale = matrix.iter().fold(0.0_f64, |largest, &a| largest.max(a.abs()));
        if !matrix.iter().all(|a| a.is_finite()) || scale == 0.0 {
            return Err(NotDecomposed);
        }
        self.work.copy_from(matrix);
        self.work /= scale;
        self.tridiagonalise();
        self.accumulate_reflectors();
        self.diagonalise()?;
        self.values *= scale;
        Ok(())
    }

    /// Reduces `work` to the diagonal `values` and the subdiagonal `off_diagonal`, leaving the
    /// Householder vectors (first component 1) below the subdiagonal and their factors in
    /// `scales`.
    fn tridiagonalise(&mut self) {
        let n = self.values.len();
        let a = self.work.as_mut_slice();
        for k in 0..n.saturating_sub(1) {
            self.values[k] = a[k * n + k];
            let m = n - k - 1;
            let v = &mut self.vector[..m];
            v.copy_from_slice(&a[k * n + k + 1..(k + 1) * n]);
            let tail = dot(&v[1..], &v[1..]);
            if tail == 0.0 {
                self.scales[k] = 0.0;
                self.off_diagonal[k] = v[0];
                continue;
            }
            let length = -(v[0] * v[0] + tail).sqrt().copysign(v[0]);
            let tau = (length - v[0]) / length;
            let pivot = v[0] - length;
            for v in v.iter_mut() {
                *v /= pivot;
            }
            v[0] = 1.0;
            self.scales[k] = tau;
            self.off_diagonal[k] = length;

            // A ← A − v wᵀ − w vᵀ with w = τ A v − (τ² vᵀAv / 2) v.
            let w = &mut self.product[..m];
            w.fill(0.0);
            for (column, &factor) in a[(k + 1) * n..].chunks_exact(n).zip(&*v) {
                add_scaled(w, tau * factor, &column[k + 1..]);
            }
            let half = -0.5 * tau * dot(v, w);
            add_scaled(w, half, v);
            for (j, column) in a[(k + 1) * n..].chunks_exact_mut(n).enumerate() {
                let (v_j, w_j) = (v[j], w[j]);
                for (a, (&v, &w)) in column[k + 1..].iter_mut().zip(v.iter().zip(&*w)) {
                    *a -= v * w_j + w * v_j;
                }
            }
            a[k * n + k + 1..(k + 1) * n].copy_from_slice(v);
        }
        self.values[n - 1] = a[n * n - 1];
        self.off_diagonal[n - 1] = 0.0;
    }

    /// Sets `vectors` to the product of the Householder reflectors.
    fn accumulate_reflectors(&mut self) {
        let n = self.values.len();
        self.vectors.fill_with_identity();
        let q = self.vectors.as_mut_slice();
        for k in (0..n.saturating_sub(1)).rev() {
            let tau = self.scales[k];
            if tau == 0.0 {
                continue;
            }
            let v = &self.work.as_slice()[k * n + k + 1..(k + 1) * n];
            for column in q[(k + 1) * n..].chunks_exact_mut(n) {
                let column = &mut column[k + 1..];
                let factor = -tau * dot(v, column);
                add_scaled(column, factor, v);
            }
        }
    }

    /// Implicit QL on the tridiagonal matrix, rotating `vectors` along.
    fn diagonalise(&mut self) -> Result<(), NotDecomposed> {
        let n = self.values.len();
        let (d, e) = (self.values.as_mut_slice(), &mut self.off_diagonal);
        for l in 0..n {
            let mut sweeps = 0;
            loop {
                let m = (l..n - 1)
                    .find(|&m| e[m].abs() <= f64::EPSILON * (d[m].abs() + d[m + 1].abs()))
                    .unwrap_or(n - 1);
                if m == l {
                    break;
                }
                sweeps += 1;
                if sweeps > MAX_SWEEPS {
                    return Err(NotDecomposed);
                }
                let first = sweep(d, e, &mut self.rotations, l, m);
                rotate_columns(self.vectors.as_mut_slice(), n, &self.rotations[..m], first);
            }
        }
        Ok(())
    }
}

/// One QL sweep over the unreduced block `l..=m` of the tridiagonal matrix (`d`, `e`). Records
/// the rotations of columns (i, i + 1) for `first` ≤ i < m and returns `first`.
fn sweep(d: &mut [f64], e: &mut [f64], rotations: &mut [(f64, f64)], l: usize, m: usize) -> usize {
    let slope = (d[l + 1] - d[l]) / (2.0 * e[l]);
    let root = slope.hypot(1.0).copysign(slope);
    let mut g = d[m] - d[l] + e[l] / (slope + root);
    let (mut cosine, mut sine, mut shift) = (1.0, 1.0, 0.0);
    for i in (l..m).rev() {
        let f = sine * e[i];
        let b = cosine * e[i];
        let r = (f * f + g * g).sqrt();
        e[i + 1] = r;
        if r == 0.0 {
            // The block splits at i + 1; the next sweep goes on with the two parts.
            d[i + 1] -= shift;
            e[m] = 0.0;
            return i + 1;
        }
        let inverse = r.recip();
        sine = f * inverse;
        cosine = g * inverse;
        let h = d[i + 1] - shift;
        let t = (d[i] - h) * sine + 2.0 * cosine * b;
        shift = sine * t;
        d[i + 1] = h + shift;
        g = cosine * t - b;
        rotations[i] = (cosine, sine);
    }
    d[l] -= shift;
    e[l] = g;
    e[m] = 0.0;
    l
}

/// Applies the rotations `first..` to the columns of the column-major matrix `q` with `n` rows,
/// the last rotation first.
fn rotate_columns(q: &mut [f64], n: usize, rotations: &[(f64, f64)], first: usize) {
    let columns = &mut q[first * n..(rotations.len() + 1) * n];
    let rotations = &rotations[first..];
    let mut row = 0;
    while row < n {
        row += match n - row {
            24.. => rotate_rows::<24>(columns, n, row, rotations),
            8.. => rotate_rows::<8>(columns, n, row, rotations),
            2.. => rotate_rows::<2>(columns, n, row, rotations),
            _ => rotate_rows::<1>(columns, n, row, rotations),
        };
    }
}

/// [`rotate_columns`] for `WIDTH` rows from `row`, in registers; returns `WIDTH`.
fn rotate_rows<const WIDTH: usize>(
    columns: &mut [f64],
    n: usize,
    row: usize,
    rotations: &[(f64, f64)],
) -> usize {
    let mut columns = columns.chunks_exact_mut(n).rev().map(|column| &mut column[row..row + WIDTH]);
    let Some(mut right) = columns.next() else { return WIDTH };
    let mut carried = [0.0; WIDTH];
    carried.copy_from_slice(right);
    for (left, &(cosine, sine)) in columns.zip(rotations.iter().rev()) {
        for lane in 0..WIDTH {
            right[lane] = sine * left[lane] + cosine * carried[lane];
            carried[lane] = cosine * left[lane] - sine * carried[lane];
        }
        right = left;
    }
    right.copy_from_slice(&carried);
    WIDTH
}

/// `y += factor · x`.
fn add_scaled(y: &mut [f64], factor: f64, x: &[f64]) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y += factor * x;
    }
}

/// Scalar product, in `LANES` partial sums.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let tail: f64 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_chunks.zip(b_chunks) {
        for lane in 0..LANES {
            lanes[lane] += a[lane] * b[lane];
        }
    }
    lanes.iter().sum::<f64>() + tail
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn symmetric() -> impl Strategy<Value = DMatrix<f64>> {
        (1_usize..30, -100.0..100.0_f64).prop_flat_map(|(n, exponent)| {
            proptest::collection::vec(-1.0..1.0_f64, n * n).prop_map(move |values| {
                let matrix = DMatrix::from_vec(n, n, values);
                (&matrix + matrix.transpose()) * 10.0_f64.powf(exponent)
            })
        })
    }

    proptest! {
        #[test]
        fn the_factors_multiply_to_the_matrix(matrix in symmetric()) {
            let n = matrix.nrows();
            let mut eigen = SymmetricEigen::identity(n);
            eigen.decompose(&matrix).unwrap();
            let back = &eigen.vectors * DMatrix::from_diagonal(&eigen.values) * eigen.vectors.transpose();
            prop_assert!((back - &matrix).norm() <= 1e-13 * n as f64 * matrix.norm());
            let gram = eigen.vectors.transpose() * &eigen.vectors;
            prop_assert!((gram - DMatrix::<f64>::identity(n, n)).norm() <= 1e-13 * n as f64);
        }

        #[test]
        fn the_eigenvalues_are_nalgebras(matrix in symmetric()) {
            let mut eigen = SymmetricEigen::identity(matrix.nrows());
            eigen.decompose(&matrix).unwrap();
            let mut ours: Vec<f64> = eigen.values.iter().copied().collect();
            let mut theirs: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
            ours.sort_by(f64::total_cmp);
            theirs.sort_by(f64::total_cmp);
            for (a, b) in ours.iter().zip(&theirs) {
                prop_assert!((a - b).abs() <= 1e-12 * matrix.norm());
            }
        }
    }

    #[test]
    fn diagonal_and_split_matrices_are_decomposed() {
        let mut eigen = SymmetricEigen::identity(4);
        let mut matrix = DMatrix::from_diagonal(&DVector::from_vec(vec![3.0, 1.0, 1.0, 0.0]));
        matrix[(0, 1)] = 2.0;
        matrix[(1, 0)] = 2.0;
        eigen.decompose(&matrix).unwrap();
        let back =
            &eigen.vectors * DMatrix::from_diagonal(&eigen.values) * eigen.vectors.transpose();
        approx::assert_relative_eq!(back, matrix, epsilon = 1e-14);
    }

    #[test]
    fn a_value_that_is_not_finite_is_refused() {
        let mut eigen = SymmetricEigen::identity(2);
        let matrix = DMatrix::from_vec(2, 2, vec![1.0, f64::NAN, f64::NAN, 1.0]);
        assert_eq!(eigen.decompose(&matrix), Err(NotDecomposed));
    }
}
