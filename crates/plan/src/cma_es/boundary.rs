//! Box constraints: the search runs in free variables that a smooth map folds into the box.
//!
//! The map is that of `BoundTransform` in pycma (N. Hansen et al.): the identity in the interior,
//! a quadratic near a bound, mirrored and periodic outside. No candidate is lost, the
//! distribution keeps its shape and an optimum on a bound is reached. Clipping candidates to the
//! box, or drawing them again, shrinks the distribution across a bound and can stop short of an
//! optimum in a corner.

use super::error::CmaEsError;

/// Largest magnitude of a finite bound; the square of the interval must not overflow.
const MAX_BOUND: f64 = 1e100;

/// The box lower ≤ x ≤ upper; infinite bounds leave a side open. Every candidate of a run lies
/// in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Bounds {
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl Bounds {
    /// The box between `lower` and `upper`, one value per variable.
    ///
    /// # Errors
    /// [`CmaEsError::BoundsLength`] when the lengths differ, [`CmaEsError::EmptyInterval`] when a
    /// lower bound is not below its upper bound or is NaN, [`CmaEsError::BoundTooLarge`] when a
    /// finite bound exceeds 1e100.
    pub fn new(lower: Vec<f64>, upper: Vec<f64>) -> Result<Self, CmaEsError> {
        if lower.len() != upper.len() {
            return Err(CmaEsError::BoundsLength { bounds: upper.len(), expected: lower.len() });
        }
        for (index, (&lower, &upper)) in lower.iter().zip(&upper).enumerate() {
            let ordered = lower < upper && lower < f64::INFINITY && upper > f64::NEG_INFINITY;
            if !ordered {
                return Err(CmaEsError::EmptyInterval { index, lower, upper });
            }
            if [lower, upper].iter().any(|bound| bound.is_finite() && bound.abs() > MAX_BOUND) {
                return Err(CmaEsError::BoundTooLarge { index, lower, upper, limit: MAX_BOUND });
            }
        }
        Ok(Self { lower, upper })
    }

    /// The cube `lower` ≤ x ≤ `upper` in `dimension` variables.
    ///
    /// # Errors
    /// As [`Bounds::new`].
    pub fn cube(dimension: usize, lower: f64, upper: f64) -> Result<Self, CmaEsError> {
        Self::new(vec![lower; dimension], vec![upper; dimension])
    }

    /// Lower bounds, one per variable.
    #[must_use]
    pub fn lower(&self) -> &[f64] {
        &self.lower
    }

    /// Upper bounds, one per variable.
    #[must_use]
    pub fn upper(&self) -> &[f64] {
        &self.upper
    }

    /// Whether `x` lies in the box, borders included; false for another number of variables.
    #[must_use]
    pub fn contains(&self, x: &[f64]) -> bool {
        x.len() == self.lower.len()
            && x.iter().enumerate().all(|(i, &x)| x >= self.lower[i] && x <= self.upper[i])
    }

    /// Width of the quadratic part of the map at the bounds of variable `index`: a twentieth of the interval, or (1 + |bound|)/20 when the other side is open.
    fn margin(&self, index: usize) -> f64 {
        let (lower, upper) = (self.lower[index], self.upper[index]);
        match (lower.is_finite(), upper.is_finite()) {
            (true, true) => (upper - lower) / 20.0,
            (true, false) => (1.0 + lower.abs()) / 20.0,
            _ => (1.0 + upper.abs()) / 20.0,
        }
    }

    /// Checks that a run may start at `start`.
    pub(super) fn check_start(&self, start: &[f64]) -> Result<(), CmaEsError> {
        if self.lower.len() != start.len() {
            return Err(CmaEsError::BoundsLength {
                bounds: self.lower.len(),
                expected: start.len(),
            });
        }
        for (index, &value) in start.iter().enumerate() {
            let (lower, upper) = (self.lower[index], self.upper[index]);
            if value < lower || value > upper {
                return Err(CmaEsError::StartOutOfBounds { index, value, lower, upper });
            }
        }
        Ok(())
    }

    /// Folds the free variables `x` into the box in place.
    pub(super) fn fold(&self, x: &mut [f64]) {
        for (index, x) in x.iter_mut().enumerate() {
            *x = fold(*x, self.lower[index], self.upper[index], self.margin(index));
        }
    }

    /// Replaces `x` in the box by the free variables that fold to it, in place.
    pub(super) fn unfold(&self, x: &mut [f64]) {
        for (index, x) in x.iter_mut().enumerate() {
            let (lower, upper, margin) = (self.lower[index], self.upper[index], self.margin(index));
            if *x < lower + margin {
                *x = lower - margin + 2.0 * (margin * (*x - lower)).sqrt();
            } else if *x > upper - margin {
                *x = upper + margin - 2.0 * (margin * (upper - *x)).sqrt();
            }
        }
    }
}

/// The point of [`lower`, `upper`] that the free variable `x` stands for.
fn fold(x: f64, lower: f64, upper: f64, margin: f64) -> f64 {
    // The map rises from lower at lower − margin to upper at upper + margin, then mirrors.
    let (first, last) = (lower - margin, upper + margin);
    let mut x = x;
    if first.is_finite() && last.is_finite() && (x < first || x > last) {
        let span = last - first;
        let phase = (x - first).rem_euclid(2.0 * span);
        x = first + phase.min(2.0 * span - phase);
    } else if x < first {
        x = 2.0 * first - x;
    } else if x > last {
        x = 2.0 * last - x;
    }
    let folded = if x < lower + margin {
        lower + (x - first).powi(2) / (4.0 * margin)
    } else if x > upper - margin {
        upper - (x - last).powi(2) / (4.0 * margin)
    } else {
        x
    };
    folded.clamp(lower, upper)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn interval() -> impl Strategy<Value = (f64, f64)> {
        prop_oneof![
            (-1e3..1e3, 1e-3..1e3_f64).prop_map(|(lower, width)| (lower, lower + width)),
            (-1e3..1e3).prop_map(|lower| (lower, f64::INFINITY)),
            (-1e3..1e3).prop_map(|upper| (f64::NEG_INFINITY, upper)),
        ]
    }

    proptest! {
        #[test]
        fn folding_stays_in_the_box((lower, upper) in interval(), x in -1e6..1e6_f64) {
            let bounds = Bounds::new(vec![lower], vec![upper]).unwrap();
            let mut folded = [x];
            bounds.fold(&mut folded);
            prop_assert!(bounds.contains(&folded), "{folded:?}");
        }

        #[test]
        fn folding_undoes_unfolding((lower, upper) in interval(), part in 0.0..=1.0_f64) {
            let low = if lower.is_finite() { lower } else { upper - 100.0 };
            let high = if upper.is_finite() { upper } else { lower + 100.0 };
            let x = (low + part * (high - low)).clamp(low, high);
            let bounds = Bounds::new(vec![lower], vec![upper]).unwrap();
            let mut there_and_back = [x];
            bounds.unfold(&mut there_and_back);
            bounds.fold(&mut there_and_back);
            prop_assert!((there_and_back[0] - x).abs() <= 1e-9 * (1.0 + x.abs() + high - low));
        }

        #[test]
        fn folding_is_periodic_and_mirrored(x in -40.0..40.0_f64) {
            // Box of width 10: the margin is 0.5 and the period 2 (10 + 2 · 0.5) = 22.
            let f = |x: f64| fold(x, 0.0, 10.0, 0.5);
            prop_assert!((f(x) - f(x + 22.0)).abs() < 1e-9);
            prop_assert!((f(-0.5 - x) - f(-0.5 + x)).abs() < 1e-9);
        }

        #[test]
        fn folding_moves_no_point_faster_than_itself(x in -40.0..40.0_f64, step in 0.0..1.0_f64) {
            let f = |x: f64| fold(x, 0.0, 10.0, 0.5);
            prop_assert!((f(x + step) - f(x)).abs() <= step + 1e-9);
        }
    }

    #[test]
    fn the_interior_is_left_alone() {
        let bounds = Bounds::cube(3, 0.0, 100.0).unwrap();
        let mut x = [5.0, 50.0, 95.0];
        bounds.fold(&mut x);
        assert_eq!(x.map(f64::to_bits), [5.0_f64, 50.0, 95.0].map(f64::to_bits));
    }

    #[test]
    fn different_lengths_are_refused() {
        assert_eq!(
            Bounds::new(vec![0.0, 0.0], vec![1.0]),
            Err(CmaEsError::BoundsLength { bounds: 1, expected: 2 })
        );
    }

    #[test]
    fn an_empty_interval_is_refused() {
        assert_eq!(
            Bounds::new(vec![0.0, 2.0], vec![1.0, 2.0]),
            Err(CmaEsError::EmptyInterval { index: 1, lower: 2.0, upper: 2.0 })
        );
    }

    #[test]
    fn a_bound_near_overflow_is_refused() {
        assert_eq!(
            Bounds::new(vec![-1e300], vec![1.0]),
            Err(CmaEsError::BoundTooLarge { index: 0, lower: -1e300, upper: 1.0, limit: 1e100 })
        );
    }

    #[test]
    fn a_nan_bound_is_refused() {
        assert!(matches!(
            Bounds::new(vec![f64::NAN], vec![1.0]),
            Err(CmaEsError::EmptyInterval { index: 0, .. })
        ));
    }
}
