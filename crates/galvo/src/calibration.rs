//! Lag and acceleration length as functions of speed, from measured test lines.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::GalvoError;
use crate::error::check_option;
use crate::student_t::two_sided_95;
use crate::table::read_table;

/// First line of a file of test lines.
pub const TEST_LINE_HEADER: &str = "speed_m_s,nominal_um,measured_um,acceleration_um";

/// What is measured on a line that was machined without compensation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TestLine {
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// Length as drawn, µm.
    pub nominal_um: f64,
    /// Distance from the centre of the first crater to that of the last, µm.
    pub measured_um: f64,
    /// Length at the start within which pulses are not equally far apart, µm.
    pub acceleration_um: f64,
}

/// The lines in a text: [`TEST_LINE_HEADER`], then a line for each.
///
/// # Errors
/// [`GalvoError::Table`] for what is no table of numbers, or no length or speed.
pub fn read_test_lines(text: &str) -> Result<Vec<TestLine>, GalvoError> {
    let rows = read_table(text, TEST_LINE_HEADER)?;
    rows.iter()
        .enumerate()
        .map(|(k, row)| {
            let fault = |column: usize, reason: &str| {
                Err(GalvoError::Table { line: k + 2, column, reason: reason.to_owned() })
            };
            if !(1e-4..=100.0).contains(&row[0]) {
                return fault(1, "speed_m_s must be in [1e-4, 100]");
            }
            if row[1] <= 0.0 || row[2] < 0.0 || row[3] < 0.0 {
                return fault(1, "lengths must not be negative, and nominal_um above 0");
            }
            Ok(TestLine {
                speed_m_s: row[0],
                nominal_um: row[1],
                measured_um: row[2],
                acceleration_um: row[3],
            })
        })
        .collect()
}

/// A length that grows linearly with speed: intercept + slope × speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Regression {
    /// Length at speed 0, µm.
    pub intercept_um: f64,
    /// Length per speed, µm per m/s, which are µs.
    pub slope_us: f64,
    /// Half-width of the 95 % interval of the intercept, µm.
    #[serde(default)]
    pub intercept_confidence_95: f64,
    /// Half-width of the 95 % interval of the slope, µs.
    #[serde(default)]
    pub slope_confidence_95: f64,
    /// Root mean square of what the line leaves, µm.
    #[serde(default)]
    pub rms_um: f64,
}

impl Regression {
    /// The line of least squares through `(speed m/s, length µm)`, with intervals of Student's t.
    ///
    /// # Errors
    /// [`GalvoError::Calibration`] with fewer than 3 points, or at a single speed.
    pub fn fit(points: &[(f64, f64)]) -> Result<Self, GalvoError> {
        if points.len() < 3 {
            let reason = format!("{} lines, at least 3 are needed", points.len());
            return Err(GalvoError::Calibration { reason });
        }
        let mut normal = Matrix2::zeros();
        let mut right = Vector2::zeros();
        for &(speed, length) in points {
            let row = Vector2::new(1.0, speed);
            normal += row * row.transpose();
            right += row * length;
        }
        let spread = normal.determinant() / (points.len() as f64 * normal[(1, 1)]);
        let inverse = normal.try_inverse().filter(|_| spread > 1e-9).ok_or_else(|| {
            GalvoError::Calibration { reason: "all lines have the same speed".to_owned() }
        })?;
        let found = inverse * right;
        let residual: f64 = points
            .iter()
            .map(|(speed, length)| (length - found[0] - found[1] * speed).powi(2))
            .sum();
        let freedom = points.len() - 2;
        let variance = residual / freedom as f64;
        let width = |k: usize| two_sided_95(freedom) * (variance * inverse[(k, k)]).sqrt();
        Ok(Self {
            intercept_um: found[0],
            slope_us: found[1],
            intercept_confidence_95: width(0),
            slope_confidence_95: width(1),
            rms_um: (residual / points.len() as f64).sqrt(),
        })
    }

    /// A length that is proportional to speed, exactly.
    #[must_use]
    pub fn proportional(slope_us: f64) -> Self {
        Self {
            intercept_um: 0.0,
            slope_us,
            intercept_confidence_95: 0.0,
            slope_confidence_95: 0.0,
            rms_um: 0.0,
        }
    }

    /// The length at a speed, µm, at least 0.
    #[must_use]
    pub fn at_um(&self, speed_m_s: f64) -> f64 {
        (self.intercept_um + self.slope_us * speed_m_s).max(0.0)
    }
}

/// What the postprocessor knows of a head: lag ΔL(V) and acceleration length `l_a`(V), equations (4)
/// and (3) of Penchev et al., whose own constants are lost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// What a line is too short without compensation, centre to centre: the lag of the head.
    pub lag: Regression,
    /// Length over which the mirror takes up its speed.
    pub acceleration: Regression,
}

impl Calibration {
    /// Fits both regressions to measured lines.
    ///
    /// # Errors
    /// As [`Regression::fit`], and [`GalvoError::InvalidOption`] when the result is no lag.
    pub fn fit(lines: &[TestLine]) -> Result<Self, GalvoError> {
        let points = |length: fn(&TestLine) -> f64| -> Vec<(f64, f64)> {
            lines.iter().map(|line| (line.speed_m_s, length(line))).collect()
        };
        let calibration = Self {
            lag: Regression::fit(&points(|line| line.nominal_um - line.measured_um))?,
            acceleration: Regression::fit(&points(|line| line.acceleration_um))?,
        };
        calibration.validate()?;
        Ok(calibration)
    }

    /// Accepts finite lags from 0 to 10⁵ µs with intercepts within ±10⁴ µm.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        for (slope, intercept, regression) in [
            ("lag.slope_us", "lag.intercept_um", &self.lag),
            ("acceleration.slope_us", "acceleration.intercept_um", &self.acceleration),
        ] {
            let value = regression.slope_us;
            check_option(slope, value, (0.0..=1e5).contains(&value), "in [0, 1e5] µs")?;
            let value = regression.intercept_um;
            check_option(intercept, value, value.abs() <= 1e4, "in [-1e4, 1e4] µm")?;
        }
        Ok(())
    }

    /// The calibration as the TOML section `[calibration]` of a head file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let section = |name: &str, of: &Regression| {
            format!(
                "[calibration.{name}]\nintercept_um = {:?}\nslope_us = {:?}\n\
                 intercept_confidence_95 = {:?}\nslope_confidence_95 = {:?}\nrms_um = {:?}\n",
                of.intercept_um,
                of.slope_us,
                of.intercept_confidence_95,
                of.slope_confidence_95,
                of.rms_um
            )
        };
        section("lag", &self.lag) + &section("acceleration", &self.acceleration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exact_lines_are_found_exactly(
            intercept in -5.0..5.0_f64, slope in 10.0..500.0_f64,
            speeds in proptest::collection::vec(0.1..3.0_f64, 3..9),
        ) {
            prop_assume!(speeds.iter().any(|speed| (speed - speeds[0]).abs() > 0.1));
            let points: Vec<(f64, f64)> =
                speeds.iter().map(|&speed| (speed, intercept + slope * speed)).collect();
            let found = Regression::fit(&points).unwrap();
            prop_assert!((found.intercept_um - intercept).abs() < 1e-6);
            prop_assert!((found.slope_us - slope).abs() < 1e-6);
            prop_assert!(found.slope_confidence_95 < 1e-5 && found.rms_um < 1e-6);
        }
    }

    #[test]
    fn the_regression_is_that_of_the_textbook() {
        // Five points by hand: slope 1.99 ± t₃ s/√Sxx.
        let points = [(1.0, 2.2), (2.0, 4.1), (3.0, 6.2), (4.0, 7.9), (5.0, 10.2)];
        let found = Regression::fit(&points).unwrap();
        assert!((found.slope_us - 1.98).abs() < 1e-12);
        assert!((found.intercept_um - 0.18).abs() < 1e-12);
        let residual: f64 = points.iter().map(|(x, y)| (y - 0.18 - 1.98 * x).powi(2)).sum();
        let width = 3.182_446 * (residual / 3.0 / 10.0).sqrt();
        assert!((found.slope_confidence_95 - width).abs() < 1e-5);
    }

    #[test]
    fn lines_are_read_and_fitted() {
        let text = format!(
            "{TEST_LINE_HEADER}\n0.5,2000,1892.7,87.5\n1,2000,1784.5,175\n2,2000,1568.1,350\n"
        );
        let calibration = Calibration::fit(&read_test_lines(&text).unwrap()).unwrap();
        assert!((calibration.lag.slope_us - 216.4).abs() < 0.1);
        assert!((calibration.acceleration.at_um(2.0) - 350.0).abs() < 1e-9);
        let toml = calibration.to_toml();
        let head = crate::ScanHead::from_toml(&toml).unwrap();
        assert_eq!(head.calibration, Some(calibration));
    }

    #[test]
    fn useless_lines_are_refused() {
        let line = TestLine {
            speed_m_s: 1.0,
            nominal_um: 2e3,
            measured_um: 1.8e3,
            acceleration_um: 175.0,
        };
        for lines in [vec![line; 2], vec![line; 5]] {
            assert!(matches!(Calibration::fit(&lines), Err(GalvoError::Calibration { .. })));
        }
        let text = format!("{TEST_LINE_HEADER}\n0,2000,1892.7,87.5\n");
        assert!(matches!(read_test_lines(&text), Err(GalvoError::Table { line: 2, .. })));
    }
}
