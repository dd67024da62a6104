//! The laser: pulse train, gate and crater.

use serde::{Deserialize, Serialize};

use crate::GalvoError;
use crate::error::check_option;

/// When pulses fire while the gate is open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PulseTrain {
    /// The train begins with the gate: the first pulse fires as it opens.
    #[default]
    Synchronised,
    /// The train runs all the time; the gate only lets pulses through.
    FreeRunning,
}

/// A pulsed laser behind a gate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Laser {
    /// Pulse rate where a program gives none, Hz, in [1, 10⁸]. Default 50 000.
    pub pulse_rate_hz: f64,
    /// Diameter of the crater of a pulse, µm, in [0, 1000]. Default 40.
    pub spot_um: f64,
    /// Time from the gate's signal to light, and from its end to dark, µs, in [0, 10⁴]. Default 0.
    pub response_us: f64,
    /// When pulses fire. Default [`PulseTrain::Synchronised`].
    pub train: PulseTrain,
}

impl Default for Laser {
    fn default() -> Self {
        Self {
            pulse_rate_hz: 50_000.0,
            spot_um: 40.0,
            response_us: 0.0,
            train: PulseTrain::Synchronised,
        }
    }
}

impl Laser {
    /// Accepts finite values within the ranges of their fields.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        check_pulse_rate(self.pulse_rate_hz)?;
        let spot = self.spot_um;
        check_option("spot_um", spot, (0.0..=1e3).contains(&spot), "in [0, 1000] µm")?;
        let response = self.response_us;
        check_option("response_us", response, (0.0..=1e4).contains(&response), "in [0, 1e4] µs")
    }
}

/// Accepts a pulse rate in [1, 10⁸] Hz.
pub(crate) fn check_pulse_rate(rate_hz: f64) -> Result<(), GalvoError> {
    check_option("pulse_rate_hz", rate_hz, (1.0..=1e8).contains(&rate_hz), "in [1, 1e8] Hz")
}

/// An open gate, on an absolute clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gate {
    /// Light begins, µs.
    pub(crate) on_us: f64,
    /// Light ends, µs; not known while a stroke is under way.
    pub(crate) off_us: Option<f64>,
    /// Time between pulses, µs.
    pub(crate) period_us: f64,
    /// The stroke that it belongs to.
    pub(crate) stroke: u64,
    /// Number of the next pulse: of the gate, or of the whole train when that runs freely.
    pub(crate) next: u64,
    /// Whether none of its pulses has been fired yet.
    pub(crate) fresh: bool,
}

impl Gate {
    /// Opens at the signal `on_us`.
    pub(crate) fn open(laser: &Laser, on_us: f64, period_us: f64, stroke: u64) -> Self {
        let on_us = on_us + laser.response_us;
        let next = match laser.train {
            PulseTrain::Synchronised => 0,
            PulseTrain::FreeRunning => (on_us / period_us).ceil().max(0.0) as u64,
        };
        Self { on_us, off_us: None, period_us, stroke, next, fresh: true }
    }

    /// When the next pulse would fire, µs.
    pub(crate) fn next_pulse_us(&self, train: PulseTrain) -> f64 {
        let since_start = self.next as f64 * self.period_us;
        match train {
            PulseTrain::Synchronised => self.on_us + since_start,
            PulseTrain::FreeRunning => since_start,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_synchronised_train_begins_with_the_gate() {
        let laser = Laser { response_us: 3.0, ..Laser::default() };
        let mut gate = Gate::open(&laser, 10.5, 20.0, 1);
        assert!((gate.next_pulse_us(laser.train) - 13.5).abs() < 1e-12);
        gate.next += 1;
        assert!((gate.next_pulse_us(laser.train) - 33.5).abs() < 1e-12);
    }

    #[test]
    fn a_free_running_train_keeps_its_beat() {
        let laser = Laser { train: PulseTrain::FreeRunning, ..Laser::default() };
        let gate = Gate::open(&laser, 10.5, 20.0, 1);
        assert!((gate.next_pulse_us(laser.train) - 20.0).abs() < 1e-12);
    }

    #[test]
    fn values_out_of_range_are_named() {
        let good = Laser::default();
        for (name, laser) in [
            ("pulse_rate_hz", Laser { pulse_rate_hz: 0.0, ..good }),
            ("spot_um", Laser { spot_um: -1.0, ..good }),
            ("response_us", Laser { response_us: f64::NAN, ..good }),
        ] {
            assert!(laser.validate().unwrap_err().to_string().starts_with(name));
        }
    }
}
