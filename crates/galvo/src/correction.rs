//! What tuning adds to the offsets and delays of the formulas.

use lasergym_geom::Point;
use serde::{Deserialize, Serialize};

use crate::GalvoError;
use crate::compensation::{Compensation, Method};
use crate::error::check_option;

/// Values of a [`Correction`].
pub const CORRECTION_VALUES: usize = 5;

/// Times that are added to offsets and delays, µs. 0 is the formulas.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Correction {
    /// Longer run-in; the laser is switched on later by as much.
    pub run_in_us: f64,
    /// Longer run-out; the last pulse comes earlier before its end by as much.
    pub run_out_us: f64,
    /// Later first pulse.
    pub on_us: f64,
    /// Later last pulse.
    pub off_us: f64,
    /// Larger lag of y than of x.
    pub skew_us: f64,
}

impl Correction {
    /// From values in the order of the fields.
    #[must_use]
    pub fn of_values(values: [f64; CORRECTION_VALUES]) -> Self {
        let [run_in_us, run_out_us, on_us, off_us, skew_us] = values;
        Self { run_in_us, run_out_us, on_us, off_us, skew_us }
    }

    /// The values in the order of the fields.
    #[must_use]
    pub fn values(&self) -> [f64; CORRECTION_VALUES] {
        [self.run_in_us, self.run_out_us, self.on_us, self.off_us, self.skew_us]
    }

    /// Accepts finite times within ±10⁵ µs.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] for a value outside.
    pub fn validate(&self) -> Result<(), GalvoError> {
        for value in self.values() {
            check_option("correction", value, value.abs() <= 1e5, "in [-1e5, 1e5] µs")?;
        }
        Ok(())
    }

    /// `found` with these times added, for a stroke at `speed_m_s` along `direction`; run-ins and
    /// run-outs stay 0 or longer, and 0 where only delays are used.
    #[must_use]
    pub fn apply(
        &self,
        method: Method,
        found: &Compensation,
        speed_m_s: f64,
        direction: Point,
    ) -> Compensation {
        let adaptive = method == Method::Adaptive;
        let longer = |offset_um: f64, more_us: f64| {
            if adaptive { (offset_um + more_us * speed_m_s).max(0.0) } else { offset_um }
        };
        let run_in_um = longer(found.run_in_um, self.run_in_us);
        let run_out_um = longer(found.run_out_um, self.run_out_us);
        let skew_us = direction.y.powi(2) * self.skew_us;
        let beside_um = speed_m_s * direction.x * direction.y * self.skew_us;
        Compensation {
            run_in_um,
            run_out_um,
            on_us: found.on_us + (run_in_um - found.run_in_um) / speed_m_s + self.on_us + skew_us,
            off_us: found.off_us - (run_out_um - found.run_out_um) / speed_m_s
                + self.off_us
                + skew_us,
            lateral_um: found.lateral_um + if adaptive { beside_um } else { 0.0 },
            ..*found
        }
    }
}

/// A correction for strokes at a speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeedCorrection {
    /// The speed, m/s.
    pub speed_m_s: f64,
    /// What is added there.
    pub times: Correction,
}

/// The correction at a speed: linear between those given, and that of the nearest beyond.
pub(crate) fn correction_at(given: &[SpeedCorrection], speed_m_s: f64) -> Correction {
    let above = given.iter().position(|one| one.speed_m_s >= speed_m_s);
    match above {
        None => given.last().map(|one| one.times).unwrap_or_default(),
        Some(0) => given[0].times,
        Some(k) => {
            let (low, high) = (&given[k - 1], &given[k]);
            let part = (speed_m_s - low.speed_m_s) / (high.speed_m_s - low.speed_m_s);
            let (a, b) = (low.times.values(), high.times.values());
            Correction::of_values(std::array::from_fn(|k| a[k] + (b[k] - a[k]) * part))
        }
    }
}

/// Accepts corrections at increasing speeds in [10⁻⁴, 100] m/s.
pub(crate) fn check_corrections(given: &[SpeedCorrection]) -> Result<(), GalvoError> {
    let mut last = 0.0;
    for one in given {
        crate::program::check_speed("speed_m_s", one.speed_m_s)?;
        let speed = one.speed_m_s;
        check_option("speed_m_s", speed, speed > last, "above that of the correction before")?;
        last = speed;
        one.times.validate()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corrections_are_linear_between_speeds() {
        let at = |speed_m_s, on_us| SpeedCorrection {
            speed_m_s,
            times: Correction { on_us, ..Correction::default() },
        };
        let given = [at(1.0, 10.0), at(2.0, 20.0)];
        for (speed, expected) in [(0.5, 10.0), (1.0, 10.0), (1.25, 12.5), (2.0, 20.0), (3.0, 20.0)]
        {
            assert!((correction_at(&given, speed).on_us - expected).abs() < 1e-12);
        }
        assert_eq!(correction_at(&[], 1.0), Correction::default());
        assert!(check_corrections(&given).is_ok());
        assert!(check_corrections(&[given[1], given[0]]).is_err());
        assert!(check_corrections(&[at(1.0, f64::NAN)]).is_err());
    }

    #[test]
    fn a_longer_run_in_leaves_the_place_of_the_first_pulse() {
        let found = Compensation { run_in_um: 100.0, on_us: 300.0, ..Compensation::default() };
        let more = Correction { run_in_us: 50.0, ..Correction::default() };
        let toward = Point::new(1.0, 0.0);
        let changed = more.apply(Method::Adaptive, &found, 2.0, toward);
        assert!((changed.run_in_um - 200.0).abs() < 1e-12);
        assert!((changed.on_us - 350.0).abs() < 1e-12);
        let less = Correction { run_in_us: -80.0, ..Correction::default() };
        let changed = less.apply(Method::Adaptive, &found, 2.0, toward);
        assert!(changed.run_in_um.abs() < 1e-12 && (changed.on_us - 250.0).abs() < 1e-12);
        let unchanged = Correction::default().apply(Method::DelaysOnly, &found, 2.0, toward);
        assert_eq!(unchanged, found);
    }
}
