//! Programs of a scan head, step by step: what the postprocessor writes and controllers run.

use lasergym_geom::Point;

use crate::delays::Delays;
use crate::error::check_option;
use crate::laser::check_pulse_rate;
use crate::{GalvoError, ScanHead};

/// What holds until the next settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProgramSettings {
    /// Pulses per second, Hz, in [1, 10⁸].
    pub pulse_rate_hz: f64,
    /// Delays of scanner and laser.
    pub delays: Delays,
    /// Speed of jumps, m/s, in [10⁻⁴, 100].
    pub jump_speed_m_s: f64,
    /// Part of a stroke's first vector that leads up to the drawn start, µm, in [0, 10⁵].
    pub run_in_um: f64,
    /// Part of a stroke's last vector that leads on from the drawn end, µm, in [0, 10⁵].
    pub run_out_um: f64,
    /// Crater diameter by which strokes are shortened so that their edges are as drawn, µm, in
    /// [0, 1000]; 0: pulse centres are as drawn.
    pub beam_um: f64,
    /// How far strokes are commanded to the left of where they are drawn, µm, in [−10⁵, 10⁵]: axes of
    /// different lags bring the beam back.
    pub lateral_um: f64,
}

impl ProgramSettings {
    /// What a head's controller does when a program says nothing.
    #[must_use]
    pub fn of_head(head: &ScanHead) -> Self {
        Self {
            pulse_rate_hz: head.laser.pulse_rate_hz,
            delays: head.controller.delays,
            jump_speed_m_s: head.controller.jump_speed_m_s,
            run_in_um: 0.0,
            run_out_um: 0.0,
            beam_um: 0.0,
            lateral_um: 0.0,
        }
    }

    /// Accepts finite values within the ranges of their fields.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        check_pulse_rate(self.pulse_rate_hz)?;
        self.delays.validate()?;
        check_speed("jump_speed_m_s", self.jump_speed_m_s)?;
        for (name, value) in [("run_in_um", self.run_in_um), ("run_out_um", self.run_out_um)] {
            check_option(name, value, (0.0..=1e5).contains(&value), "in [0, 1e5] µm")?;
        }
        let lateral = self.lateral_um;
        check_option("lateral_um", lateral, lateral.abs() <= 1e5, "in [-1e5, 1e5] µm")?;
        let beam = self.beam_um;
        check_option("beam_um", beam, (0.0..=1e3).contains(&beam), "in [0, 1000] µm")
    }
}

/// Accepts a speed in [10⁻⁴, 100] m/s.
pub(crate) fn check_speed(name: &'static str, speed_m_s: f64) -> Result<(), GalvoError> {
    check_option(name, speed_m_s, (1e-4..=100.0).contains(&speed_m_s), "in [1e-4, 100] m/s")
}

/// One step of a program. Marks without a jump between them are one stroke.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProgramStep {
    /// From here on these settings hold; they end a stroke.
    Settings(ProgramSettings),
    /// To a place with the laser off.
    Jump {
        /// The place, µm.
        to_um: Point,
    },
    /// A straight vector.
    Mark {
        /// Its end, µm.
        to_um: Point,
        /// Its speed, m/s.
        speed_m_s: f64,
        /// Whether the laser is on.
        lit: bool,
    },
    /// To another height, with the laser off; the head stands still.
    Layer {
        /// The height, µm.
        z_um: f64,
    },
    /// Stands still, with the laser off.
    Dwell {
        /// How long, µs.
        duration_us: f64,
    },
}
