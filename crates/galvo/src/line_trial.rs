//! One line on one head with given offsets and delays: what it costs.

use lasergym_geom::Point;

use crate::compensation::Compensation;
use crate::delays::Delays;
use crate::error::check_option;
use crate::program::{ProgramSettings, ProgramStep};
use crate::simulate::simulate_steps;
use crate::{GalvoError, ScanHead};

/// Cost of a line without a pulse.
const NO_PULSE_COST: f64 = 1e3;

/// What costs 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineScales {
    /// Sum of both edge errors and the distance beside the line, µm, in (0, 10⁴]. Default 10.
    pub edge_um: f64,
    /// Largest deviation of the pitch from 1, in (0, 10]. Default 0.05.
    pub pitch: f64,
    /// Time beyond that of the drawn line, µs, in (0, 10⁶]. Default 2000.
    pub time_us: f64,
}

impl Default for LineScales {
    fn default() -> Self {
        Self { edge_um: 10.0, pitch: 0.05, time_us: 2000.0 }
    }
}

impl LineScales {
    /// Accepts finite values within the ranges of their fields.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        let edge = self.edge_um;
        check_option("edge_scale_um", edge, edge > 0.0 && edge <= 1e4, "in (0, 1e4] µm")?;
        let pitch = self.pitch;
        check_option("pitch_scale", pitch, pitch > 0.0 && pitch <= 10.0, "in (0, 10]")?;
        let time = self.time_us;
        check_option("time_scale_us", time, time > 0.0 && time <= 1e6, "in (0, 1e6] µs")
    }
}

/// What a line came out as.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineOutcome {
    /// Edge errors, deviation of the pitch and time in their scales, added up; at least 0 where
    /// nothing is gained by omission.
    pub cost: f64,
    /// How far the line's edges are off, start and end, µm; NaN without a pulse.
    pub edge_errors_um: [f64; 2],
    /// Largest distance of a pulse from the drawn line, µm; NaN without a pulse.
    pub lateral_error_um: f64,
    /// Largest deviation of the pitch from 1; NaN with fewer than two pulses.
    pub pitch_deviation: f64,
    /// Time of the whole stroke, µs.
    pub time_us: f64,
}

/// What the pulse rate of a line is fitted to, so that a pulse falls on its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PulseFit {
    /// The drawn line at its speed.
    #[default]
    Drawn,
    /// The time from the first pulse to the last, as the postprocessor does.
    Gate,
}

/// A line to machine from rest.
#[derive(Debug, Clone, PartialEq)]
pub struct LineTrial {
    /// The head.
    pub head: ScanHead,
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// Length as drawn, µm.
    pub length_um: f64,
    /// Direction, rad from x towards y.
    pub angle_rad: f64,
    /// Crater diameter by which the line is shortened, µm.
    pub beam_um: f64,
    /// Distance of pulses, about, µm.
    pub pitch_um: f64,
    /// Response time of the laser that is allowed for, µs.
    pub known_response_us: f64,
    /// What the pulse rate is fitted to.
    pub fit: PulseFit,
    /// What costs 1.
    pub scales: LineScales,
}

impl LineTrial {
    /// Direction of the line, of length 1.
    #[must_use]
    pub fn direction(&self) -> Point {
        Point::new(self.angle_rad.cos(), self.angle_rad.sin())
    }

    /// Machines the line with `found`.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] and [`GalvoError::OutsideField`] for what cannot be machined.
    pub fn machine(&self, found: &Compensation) -> Result<LineOutcome, GalvoError> {
        let (speed, length_um) = (self.speed_m_s, self.length_um);
        crate::program::check_speed("speed_m_s", speed)?;
        let pitch_um = self.pitch_um;
        check_option("pitch_um", pitch_um, (0.1..=1e4).contains(&pitch_um), "in [0.1, 1e4] µm")?;
        let ok = length_um > self.beam_um && length_um <= 1e5;
        check_option("length_um", length_um, ok, "above the beam's diameter, up to 1e5 µm")?;
        let direction = self.direction();
        let drawn_us = (length_um - self.beam_um) / speed;
        let way_um = found.run_in_um + length_um + found.run_out_um;
        let lit_us = match self.fit {
            PulseFit::Drawn => drawn_us,
            PulseFit::Gate => Some(way_um / speed + found.off_us - found.on_us)
                .filter(|&gate_us| gate_us > 0.0)
                .unwrap_or(drawn_us),
        };
        let period_us = lit_us / (lit_us * speed / pitch_um).round().max(1.0);
        let settings = ProgramSettings {
            pulse_rate_hz: 1e6 / period_us,
            delays: Delays {
                laser_on_us: found.on_us - self.known_response_us,
                laser_off_us: found.off_us + 0.5 * period_us - self.known_response_us,
                ..Delays::default()
            },
            run_in_um: found.run_in_um,
            run_out_um: found.run_out_um,
            beam_um: self.beam_um,
            lateral_um: found.lateral_um,
            ..ProgramSettings::of_head(&self.head)
        };
        let beside = Point::new(-direction.y, direction.x) * found.lateral_um;
        let steps = [
            ProgramStep::Settings(settings),
            ProgramStep::Jump { to_um: beside - direction * found.run_in_um },
            ProgramStep::Mark {
                to_um: beside + direction * (length_um + found.run_out_um),
                speed_m_s: speed,
                lit: true,
            },
        ];
        let mut measure = None;
        let report = simulate_steps(&self.head, &steps, |stroke| measure = Some(*stroke))?;
        let time_us = report.time.total_s() * 1e6;
        let excess = (time_us - length_um / speed) / self.scales.time_us;
        let Some(stroke) = measure else {
            return Ok(LineOutcome {
                cost: NO_PULSE_COST,
                edge_errors_um: [f64::NAN; 2],
                lateral_error_um: f64::NAN,
                pitch_deviation: f64::NAN,
                time_us,
            });
        };
        let pitch_deviation = (stroke.pitch_max - 1.0).abs().max((1.0 - stroke.pitch_min).abs());
        // Without two pulses there is no pitch: as bad as none of it being right.
        let spread = if pitch_deviation.is_nan() { 1.0 } else { pitch_deviation };
        let lateral_error_um = stroke.lateral_error_um;
        let edges =
            stroke.start_error_um.abs() + stroke.end_error_um.abs() + lateral_error_um.abs();
        Ok(LineOutcome {
            cost: edges / self.scales.edge_um + spread / self.scales.pitch + excess,
            edge_errors_um: [stroke.start_error_um, stroke.end_error_um],
            lateral_error_um,
            pitch_deviation,
            time_us,
        })
    }

    /// Costs of offsets and delays, rows of run-in µm, run-out µm, laser on µs and last pulse µs; what
    /// cannot be machined costs the most.
    #[must_use]
    pub fn costs(&self, rows: &[[f64; 4]]) -> Vec<f64> {
        rows.iter()
            .map(|&[run_in_um, run_out_um, on_us, off_us]| {
                let found = Compensation {
                    run_in_um,
                    run_out_um,
                    on_us,
                    off_us,
                    ..Compensation::default()
                };
                self.machine(&found).map_or(NO_PULSE_COST, |made| made.cost)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HeadKnowledge, Method, StraightStroke};

    #[test]
    fn the_postprocessor_costs_less_than_delays_and_those_less_than_nothing() {
        let head = ScanHead::default();
        let trial = LineTrial {
            head: head.clone(),
            speed_m_s: 2.0,
            length_um: 2000.0,
            angle_rad: 0.3,
            beam_um: 40.0,
            pitch_um: 40.0,
            known_response_us: 0.0,
            fit: PulseFit::Gate,
            scales: LineScales::default(),
        };
        let knowledge = HeadKnowledge::of_head(&head);
        let [none, delays, adaptive] =
            [Method::None, Method::DelaysOnly, Method::Adaptive].map(|method| {
                let stroke = StraightStroke {
                    speed_m_s: 2.0,
                    direction: Point::new(0.3_f64.cos(), 0.3_f64.sin()),
                    length_um: Some(2000.0),
                };
                let found = knowledge.compensation(method, &stroke, 40.0, 0.02).unwrap();
                trial.machine(&found).unwrap()
            });
        assert!(adaptive.cost < 1.0 && adaptive.cost < delays.cost && delays.cost < none.cost);
        assert!(adaptive.pitch_deviation < 0.021, "{adaptive:?}");
        assert!(delays.pitch_deviation > 0.3, "{delays:?}");
        let rows = [[-1.0, 0.0, 0.0, 0.0], [700.0, 400.0, 550.0, 0.0]];
        let costs = trial.costs(&rows);
        assert!(costs[0] >= 1e3 && costs[1] < 1e3);
    }
}
