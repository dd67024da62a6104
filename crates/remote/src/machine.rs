//! What scanner and robot can do.

use crate::RemoteError;
use crate::error::check_option;

/// A laser scanner that the robot carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scanner {
    /// Radius of the round working field, mm, in (0, 10 000]; the default of 150 mm is the circle in a
    /// square field of 300 mm, whose corners are neglected.
    pub field_radius_mm: f64,
    /// Distance from the scanner to the workpiece, mm, in (0, 10 000]; 400 by default.
    pub distance_mm: f64,
    /// Angle of the field's x axis from that of the plane, °.
    pub field_angle_deg: f64,
    /// Clock of the scanner, µs, in [1, 1000]; 10 by default.
    pub cycle_us: f64,
    /// Time between two subtasks of a line in which the beam, switched off, jumps from one to the
    /// other, s, in [0, 10]. The default of 0.02 s crosses a field of 300 mm at 15 m/s.
    pub jump_s: f64,
    /// Largest part by which whole cycles of the clock may change the speed of the beam, in (0, 1];
    /// 0.01 by default.
    pub clock_tolerance: f64,
}

impl Default for Scanner {
    fn default() -> Self {
        Self {
            field_radius_mm: 150.0,
            distance_mm: 400.0,
            field_angle_deg: 0.0,
            cycle_us: 10.0,
            jump_s: 0.02,
            clock_tolerance: 0.01,
        }
    }
}

impl Scanner {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RemoteError::InvalidOption`] names the first value out of range.
    pub fn validate(&self) -> Result<(), RemoteError> {
        let up_to = |value: f64, limit: f64| value > 0.0 && value <= limit;
        let length = "above 0 and at most 10000 mm";
        let field = self.field_radius_mm;
        check_option("scanner.field_radius_mm", field, up_to(field, 1e4), length)?;
        check_option(
            "scanner.distance_mm",
            self.distance_mm,
            up_to(self.distance_mm, 1e4),
            length,
        )?;
        let angle = self.field_angle_deg;
        check_option("scanner.field_angle_deg", angle, angle.abs() <= 360.0, "within ±360°")?;
        let cycle = self.cycle_us;
        let ok = (1.0..=1000.0).contains(&cycle);
        check_option("scanner.cycle_us", cycle, ok, "from 1 to 1000 µs")?;
        let ok = (0.0..=10.0).contains(&self.jump_s);
        check_option("scanner.jump_s", self.jump_s, ok, "from 0 to 10 s")?;
        let part = self.clock_tolerance;
        check_option("scanner.clock_tolerance", part, up_to(part, 1.0), "above 0 and at most 1")
    }

    /// One cycle of its clock, s.
    #[must_use]
    pub fn cycle_s(&self) -> f64 {
        self.cycle_us * 1e-6
    }

    /// Cycles of a jump between subtasks.
    #[must_use]
    pub fn jump_cycles(&self) -> u64 {
        (self.jump_s / self.cycle_s() - 1e-6).ceil().max(0.0) as u64
    }
}

/// The robot that carries the scanner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Robot {
    /// Highest speed on a line, mm/s, in (0, 10 000]. The default of 200 mm/s is where vibration
    /// begins to spoil the kerf of remote cutting.
    pub max_speed_mm_s: f64,
    /// Lowest speed on a line, mm/s, above 0 and at most the highest; 1 by default.
    pub min_speed_mm_s: f64,
    /// Clock of the robot, ms, in [0.1, 100] and whole cycles of the scanner; 1 by default.
    pub cycle_ms: f64,
    /// Acceleration, mm/s², in [1, 10⁶]; 2000 by default. Lines are led in and out with it.
    pub acceleration_mm_s2: f64,
    /// Speed between lines (PTP), mm/s, in (0, 10⁵]; 1000 by default.
    pub ptp_speed_mm_s: f64,
    /// Time that every line takes before it starts, s, in [0, 60]: the arm settles and the scanner is
    /// made ready. 0.5 s by default.
    pub restart_s: f64,
}

impl Default for Robot {
    fn default() -> Self {
        Self {
            max_speed_mm_s: 200.0,
            min_speed_mm_s: 1.0,
            cycle_ms: 1.0,
            acceleration_mm_s2: 2000.0,
            ptp_speed_mm_s: 1000.0,
            restart_s: 0.5,
        }
    }
}

impl Robot {
    /// Checks the ranges; `scanner` is the one that it carries.
    ///
    /// # Errors
    /// [`RemoteError::InvalidOption`] names the first value out of range.
    pub fn validate(&self, scanner: &Scanner) -> Result<(), RemoteError> {
        let fastest = self.max_speed_mm_s;
        let ok = fastest > 0.0 && fastest <= 1e4;
        check_option("robot.max_speed_mm_s", fastest, ok, "above 0 and at most 10000 mm/s")?;
        let slowest = self.min_speed_mm_s;
        let ok = slowest > 0.0 && slowest <= fastest;
        check_option("robot.min_speed_mm_s", slowest, ok, "above 0 and at most max_speed_mm_s")?;
        let cycle = self.cycle_ms;
        let ok = (0.1..=100.0).contains(&cycle);
        check_option("robot.cycle_ms", cycle, ok, "from 0.1 to 100 ms")?;
        let ratio = cycle * 1e3 / scanner.cycle_us;
        let ok = ratio >= 1.0 && (ratio - ratio.round()).abs() < 1e-6;
        check_option("robot.cycle_ms", cycle, ok, "a whole number of scanner cycles")?;
        let acceleration = self.acceleration_mm_s2;
        let ok = (1.0..=1e6).contains(&acceleration);
        check_option("robot.acceleration_mm_s2", acceleration, ok, "from 1 to 1000000 mm/s²")?;
        let ptp = self.ptp_speed_mm_s;
        let ok = ptp > 0.0 && ptp <= 1e5;
        check_option("robot.ptp_speed_mm_s", ptp, ok, "above 0 and at most 100000 mm/s")?;
        let ok = (0.0..=60.0).contains(&self.restart_s);
        check_option("robot.restart_s", self.restart_s, ok, "from 0 to 60 s")
    }

    /// One cycle of its clock, s.
    #[must_use]
    pub fn cycle_s(&self) -> f64 {
        self.cycle_ms * 1e-3
    }

    /// `time_s` in whole cycles, rounded up, s.
    #[must_use]
    pub fn whole_cycles_s(&self, time_s: f64) -> f64 {
        (time_s / self.cycle_s() - 1e-6).ceil().max(0.0) * self.cycle_s()
    }

    /// Time of a move between lines over `distance_mm`, from rest to rest, in whole cycles, s.
    #[must_use]
    pub fn ptp_s(&self, distance_mm: f64) -> f64 {
        self.whole_cycles_s(self.smooth_ptp_s(distance_mm))
    }

    /// The same without rounding.
    pub(crate) fn smooth_ptp_s(&self, distance_mm: f64) -> f64 {
        let (speed, acceleration) = (self.ptp_speed_mm_s, self.acceleration_mm_s2);
        if distance_mm >= speed * speed / acceleration {
            distance_mm / speed + speed / acceleration
        } else {
            2.0 * (distance_mm / acceleration).sqrt()
        }
    }

    /// Time in which a line of `speed_mm_s` is led in, or out, in whole cycles, s.
    #[must_use]
    pub fn lead_s(&self, speed_mm_s: f64) -> f64 {
        self.whole_cycles_s(speed_mm_s / self.acceleration_mm_s2).max(self.cycle_s())
    }

    /// The way that takes, mm.
    #[must_use]
    pub fn lead_mm(&self, speed_mm_s: f64) -> f64 {
        0.5 * speed_mm_s * self.lead_s(speed_mm_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_ptp_move_covers_its_way(distance_mm in 0.0..3000.0) {
            let robot = Robot::default();
            let (speed, acceleration) = (robot.ptp_speed_mm_s, robot.acceleration_mm_s2);
            // Speed over time is a trapezium as high as the ramps of the move allow.
            let time_s = robot.smooth_ptp_s(distance_mm);
            let top = speed.min(0.5 * acceleration * time_s);
            let way_mm = top * (time_s - top / acceleration);
            prop_assert!((way_mm - distance_mm).abs() < 1e-6, "{way_mm}");
            prop_assert!(robot.ptp_s(distance_mm) >= time_s - 1e-8);
        }
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let scanner = Scanner::default();
        for (field, bad) in [
            ("field_radius_mm", Scanner { field_radius_mm: 0.0, ..scanner }),
            ("distance_mm", Scanner { distance_mm: f64::NAN, ..scanner }),
            ("field_angle_deg", Scanner { field_angle_deg: 361.0, ..scanner }),
            ("cycle_us", Scanner { cycle_us: 0.0, ..scanner }),
            ("jump_s", Scanner { jump_s: -0.1, ..scanner }),
            ("clock_tolerance", Scanner { clock_tolerance: 0.0, ..scanner }),
        ] {
            let message = bad.validate().unwrap_err().to_string();
            assert!(message.contains(field), "{message}");
        }
        let robot = Robot::default();
        for (field, bad) in [
            ("max_speed_mm_s", Robot { max_speed_mm_s: -1.0, ..robot }),
            ("min_speed_mm_s", Robot { min_speed_mm_s: 300.0, ..robot }),
            ("cycle_ms", Robot { cycle_ms: 0.0, ..robot }),
            ("cycle_ms", Robot { cycle_ms: 1.005_5, ..robot }),
            ("acceleration_mm_s2", Robot { acceleration_mm_s2: 0.0, ..robot }),
            ("ptp_speed_mm_s", Robot { ptp_speed_mm_s: f64::INFINITY, ..robot }),
            ("restart_s", Robot { restart_s: -1.0, ..robot }),
        ] {
            let message = bad.validate(&scanner).unwrap_err().to_string();
            assert!(message.contains(field), "{message}");
        }
        scanner.validate().unwrap();
        robot.validate(&scanner).unwrap();
    }
}
