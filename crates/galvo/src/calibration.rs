//! Lag and acceleration length as functions of speed, from measured test lines.

use std::fmt::Write as _;

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::GalvoError;
use crate::error::check_option;
use crate::student_t::two_sided_95;
use crate::table::read_table_with;

/// First line of a file of test lines. The columns [`TEST_LINE_OPTIONAL`] may follow.
pub const TEST_LINE_HEADER: &str = "speed_m_s,nominal_um,measured_um,acceleration_um";

/// Columns that a file of test lines may have besides: the axis that moved (`x` or `y`), and the time
/// from the first crater to the end of the acceleration length, which is the number of craters in it
/// times the pulse period.
pub const TEST_LINE_OPTIONAL: [&str; 2] = ["axis", "acceleration_time_us"];

/// Measured lengths that leave at most this beside a straight line, µm, are taken to be straight in the
/// speed: half of what Penchev et al. allow a line to be off.
const STRAIGHT_WITHIN_UM: f64 = 5.0;

/// An axis of a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// The one that moves along x.
    X,
    /// The one that moves along y.
    Y,
}

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
    /// The axis that moved; none: it stands for both.
    pub axis: Option<Axis>,
    /// Time from the first crater to the end of the acceleration length, µs, where it was measured.
    pub acceleration_time_us: Option<f64>,
}

/// The lines in a text: [`TEST_LINE_HEADER`], then a line for each.
///
/// # Errors
/// [`GalvoError::Table`] for what is no table of numbers, or no length, speed or axis.
pub fn read_test_lines(text: &str) -> Result<Vec<TestLine>, GalvoError> {
    let rows = read_table_with(text, TEST_LINE_HEADER, &TEST_LINE_OPTIONAL)?;
    rows.iter()
        .map(|(line, row)| {
            let fault = |reason: &str| {
                Err(GalvoError::Table { line: *line, column: 1, reason: reason.to_owned() })
            };
            if !(1e-4..=100.0).contains(&row[0]) {
                return fault("speed_m_s must be in [1e-4, 100]");
            }
            if row[1] <= 0.0 || row[2] < 0.0 || row[3] < 0.0 || row[5] < 0.0 {
                return fault("lengths and times must not be negative, and nominal_um above 0");
            }
            Ok(TestLine {
                speed_m_s: row[0],
                nominal_um: row[1],
                measured_um: row[2],
                acceleration_um: row[3],
                axis: match row[4] {
                    value if value.is_nan() => None,
                    value if value < 0.5 => Some(Axis::X),
                    _ => Some(Axis::Y),
                },
                acceleration_time_us: Some(row[5]).filter(|time| time.is_finite()),
            })
        })
        .collect()
}

/// The mean of a length at one speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredLength {
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// Mean length, µm.
    pub length_um: f64,
    /// Half-width of the 95 % interval of the mean, µm; none with a single line at this speed.
    #[serde(default)]
    pub confidence_95_um: Option<f64>,
}

/// A length as a function of speed: intercept + slope × speed, or, where that leaves more than 5 µm,
/// linear between the means measured at each speed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Means by increasing speed where the line does not fit, otherwise empty.
    #[serde(default)]
    pub points: Vec<MeasuredLength>,
}

impl Regression {
    /// The line of least squares through `(speed m/s, length µm)`, with intervals of Student's t, and
    /// the means at each speed where it does not fit.
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
            points: if (residual / points.len() as f64).sqrt() > STRAIGHT_WITHIN_UM {
                means(points)
            } else {
                Vec::new()
            },
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
            points: Vec::new(),
        }
    }

    /// The length at a speed, µm, at least 0.
    #[must_use]
    pub fn at_um(&self, speed_m_s: f64) -> f64 {
        self.signed_um(speed_m_s).max(0.0)
    }

    /// The same where it may be negative. Between measured speeds linear, below them in proportion to
    /// the speed, above them on as between the last two.
    #[must_use]
    pub fn signed_um(&self, speed_m_s: f64) -> f64 {
        let above = self.points.iter().position(|point| point.speed_m_s >= speed_m_s);
        let (low, high) = match (above, self.points.as_slice()) {
            (_, [] | [_]) => return self.intercept_um + self.slope_us * speed_m_s,
            (Some(0), [first, ..]) => return first.length_um * speed_m_s / first.speed_m_s,
            (Some(k), points) => (&points[k - 1], &points[k]),
            (None, [.., low, high]) => (low, high),
        };
        let part = (speed_m_s - low.speed_m_s) / (high.speed_m_s - low.speed_m_s);
        low.length_um + (high.length_um - low.length_um) * part
    }
}

/// Means at each speed, with intervals from the spread at that speed.
fn means(points: &[(f64, f64)]) -> Vec<MeasuredLength> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    sorted
        .chunk_by(|a, b| (a.0 - b.0).abs() <= 1e-9 * a.0)
        .map(|group| {
            let count = group.len() as f64;
            let mean = group.iter().map(|point| point.1).sum::<f64>() / count;
            let squares: f64 = group.iter().map(|point| (point.1 - mean).powi(2)).sum();
            let width =
                |freedom: usize| two_sided_95(freedom) * (squares / freedom as f64 / count).sqrt();
            MeasuredLength {
                speed_m_s: group[0].0,
                length_um: mean,
                confidence_95_um: (group.len() > 1).then(|| width(group.len() - 1)),
            }
        })
        .collect()
}

/// What the postprocessor knows of an axis: lag ΔL(V) and acceleration length `l_a`(V), equations (4)
/// and (3) of Penchev et al., whose own constants are lost.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// What a line is too short without compensation, centre to centre: the lag of the head.
    pub lag: Regression,
    /// Length over which the mirror takes up its speed.
    pub acceleration: Regression,
    /// How far the mirror is ahead of its steady lag at the end of that length; none: it is taken to
    /// have found it there.
    #[serde(default)]
    pub lead: Option<Regression>,
}

impl Calibration {
    /// Fits all regressions to measured lines, whatever axis they are of; the lead where every line
    /// has an acceleration time.
    ///
    /// # Errors
    /// As [`Regression::fit`], and [`GalvoError::InvalidOption`] when the result is no lag.
    pub fn fit(lines: &[TestLine]) -> Result<Self, GalvoError> {
        let points = |length: &dyn Fn(&TestLine) -> f64| -> Vec<(f64, f64)> {
            lines.iter().map(|line| (line.speed_m_s, length(line))).collect()
        };
        let lag = Regression::fit(&points(&|line| line.nominal_um - line.measured_um))?;
        let timed = lines.iter().all(|line| line.acceleration_time_us.is_some());
        let lead = timed.then(|| {
            // At that time the beam is where it was measured, and would steadily be at V t − ΔL.
            Regression::fit(&points(&|line| {
                let time_us = line.acceleration_time_us.unwrap_or_default();
                line.acceleration_um - (line.speed_m_s * time_us - lag.at_um(line.speed_m_s))
            }))
        });
        let calibration = Self {
            acceleration: Regression::fit(&points(&|line| line.acceleration_um))?,
            lead: lead.transpose()?,
            lag,
        };
        calibration.validate()?;
        Ok(calibration)
    }

    /// Accepts finite lags from 0 to 10⁵ µs with intercepts and leads within ±10⁴ µm.
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
            check_points(regression, 0.0)?;
        }
        if let Some(lead) = &self.lead {
            for (name, value) in
                [("lead.slope_us", lead.slope_us), ("lead.intercept_um", lead.intercept_um)]
            {
                check_option(name, value, value.abs() <= 1e4, "in [-1e4, 1e4]")?;
            }
            check_points(lead, -1e6)?;
        }
        Ok(())
    }

    /// The calibration as TOML sections below `section`.
    #[must_use]
    pub fn to_toml(&self, section: &str) -> String {
        let of = |name: &str, of: &Regression| {
            let mut text = format!(
                "[{section}.{name}]\nintercept_um = {:?}\nslope_us = {:?}\n\
                 intercept_confidence_95 = {:?}\nslope_confidence_95 = {:?}\nrms_um = {:?}\n",
                of.intercept_um,
                of.slope_us,
                of.intercept_confidence_95,
                of.slope_confidence_95,
                of.rms_um
            );
            for point in &of.points {
                // Writing to a String cannot fail.
                let _ = writeln!(
                    text,
                    "[[{section}.{name}.points]]\nspeed_m_s = {:?}\nlength_um = {:?}",
                    point.speed_m_s, point.length_um
                );
                if let Some(width) = point.confidence_95_um {
                    let _ = writeln!(text, "confidence_95_um = {width:?}");
                }
            }
            text
        };
        let lead = self.lead.as_ref().map_or_else(String::new, |lead| of("lead", lead));
        of("lag", &self.lag) + &of("acceleration", &self.acceleration) + &lead
    }
}

/// Accepts means at increasing speeds in [10⁻⁴, 100] m/s, from `least_um` to 10⁶ µm.
fn check_points(regression: &Regression, least_um: f64) -> Result<(), GalvoError> {
    let mut last = 0.0;
    for point in &regression.points {
        let speed = point.speed_m_s;
        crate::program::check_speed("points.speed_m_s", speed)?;
        check_option("points.speed_m_s", speed, speed > last, "above that of the point before")?;
        last = speed;
        let length = point.length_um;
        let ok = (least_um..=1e6).contains(&length);
        check_option("points.length_um", length, ok, "a length up to 1e6 µm")?;
    }
    Ok(())
}

/// The calibrations of both axes.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadCalibration {
    /// Of the axis that moves along x.
    pub x: Calibration,
    /// Of the axis that moves along y.
    pub y: Calibration,
}

impl HeadCalibration {
    /// Fits each axis to its own lines; lines without an axis count for both.
    ///
    /// # Errors
    /// As [`Calibration::fit`], for either axis.
    pub fn fit(lines: &[TestLine]) -> Result<Self, GalvoError> {
        let of = |axis: Axis| -> Result<Calibration, GalvoError> {
            let own: Vec<TestLine> =
                lines.iter().filter(|line| line.axis.is_none_or(|a| a == axis)).copied().collect();
            Calibration::fit(&own)
        };
        Ok(Self { x: of(Axis::X)?, y: of(Axis::Y)? })
    }

    /// As [`Calibration::validate`], of both axes.
    ///
    /// # Errors
    /// As [`Calibration::validate`].
    pub fn validate(&self) -> Result<(), GalvoError> {
        self.x.validate()?;
        self.y.validate()
    }

    /// The calibrations as the TOML section `[calibration]` of a head file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        if self.x == self.y {
            return self.x.to_toml("calibration");
        }
        self.x.to_toml("calibration.x") + &self.y.to_toml("calibration.y")
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
        let calibration = HeadCalibration::fit(&read_test_lines(&text).unwrap()).unwrap();
        assert_eq!(calibration.x, calibration.y);
        assert!((calibration.x.lag.slope_us - 216.4).abs() < 0.1);
        assert!((calibration.x.acceleration.at_um(2.0) - 350.0).abs() < 1e-9);
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
            axis: None,
            acceleration_time_us: None,
        };
        for lines in [vec![line; 2], vec![line; 5]] {
            assert!(matches!(Calibration::fit(&lines), Err(GalvoError::Calibration { .. })));
        }
        let text = format!("{TEST_LINE_HEADER}\n0,2000,1892.7,87.5\n");
        assert!(matches!(read_test_lines(&text), Err(GalvoError::Table { line: 2, .. })));
    }

    #[test]
    fn each_axis_has_its_own_lines() {
        let mut text = format!("{TEST_LINE_HEADER},axis,acceleration_time_us\n");
        for (axis, lag) in [("x", 200.0), ("y", 260.0)] {
            for speed in [0.5, 1.0, 2.0] {
                let (short, ramp) = (lag * speed, 300.0 * speed);
                // 4 µm per m/s behind the steady lag.
                let time = 300.0 + lag + 4.0;
                writeln!(text, "{speed},2000,{},{ramp},{axis},{time}", 2000.0 - short).unwrap();
            }
        }
        let found = HeadCalibration::fit(&read_test_lines(&text).unwrap()).unwrap();
        for (of, lag) in [(&found.x, 200.0), (&found.y, 260.0)] {
            assert!((of.lag.slope_us - lag).abs() < 1e-9);
            assert!((of.lead.as_ref().unwrap().signed_um(2.0) + 8.0).abs() < 1e-9);
        }
        let head = crate::ScanHead::from_toml(&found.to_toml()).unwrap();
        assert_eq!(head.calibration, Some(found));
        assert!((head.x.lag_us() - 200.0).abs() < 1e-9 && (head.y.lag_us() - 260.0).abs() < 1e-9);
        let error = read_test_lines(&text.replace(",y,", ",z,")).unwrap_err();
        assert!(matches!(error, GalvoError::Table { line: 5, .. }), "{error}");
        let only_x = text.lines().take(4).collect::<Vec<_>>().join("\n");
        assert!(HeadCalibration::fit(&read_test_lines(&only_x).unwrap()).is_err());
    }

    #[test]
    fn what_is_not_straight_goes_through_its_means() {
        let curve = |speed: f64| 200.0 * speed * speed;
        let mut points = Vec::new();
        for speed in [0.5, 1.0, 1.5, 2.0] {
            points.extend([(speed, curve(speed) - 1.0), (speed, curve(speed) + 1.0)]);
        }
        let found = Regression::fit(&points).unwrap();
        assert_eq!(found.points.len(), 4);
        for point in &found.points {
            assert!((found.at_um(point.speed_m_s) - curve(point.speed_m_s)).abs() < 1e-9);
            // t₁ √2 / √2 of two values ±1.
            assert!((point.confidence_95_um.unwrap() - 12.706).abs() < 1e-2);
        }
        assert!((found.at_um(1.25) - 0.5 * (curve(1.0) + curve(1.5))).abs() < 1e-9);
        assert!((found.at_um(0.25) - 0.5 * curve(0.5)).abs() < 1e-9);
        assert!((found.at_um(3.0) - (800.0 + 2.0 * 350.0)).abs() < 1e-9);
        let straight: Vec<(f64, f64)> =
            points.iter().map(|(speed, _)| (*speed, 216.4 * speed)).collect();
        assert!(Regression::fit(&straight).unwrap().points.is_empty());
    }
}
