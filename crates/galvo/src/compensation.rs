//! How far to extend a stroke and when to switch the laser, so that it comes out as drawn.

use lasergym_geom::Point;

use crate::approach::{Approach, Approaches};
use crate::axis::AxisModel;
use crate::calibration::{Calibration, HeadCalibration};
use crate::correction::{Correction, SpeedCorrection, correction_at};
use crate::error::check_option;
use crate::{GalvoError, ScanHead};

/// Largest part by which pulses may be nearer or farther apart, by default.
pub const DEFAULT_PITCH_TOLERANCE: f64 = 0.02;

/// What is known of the two axes of a head.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "there is one for each head")]
pub enum KnownAxes {
    /// Regressions of test lines: the formulas of Penchev et al.
    Lines {
        /// Of the axis that moves along x.
        x: Calibration,
        /// Of the axis that moves along y.
        y: Calibration,
    },
    /// Models.
    Model {
        /// Of the axis that moves along x.
        x: AxisModel,
        /// Of the axis that moves along y.
        y: AxisModel,
    },
}

/// What is known of a head.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadKnowledge {
    /// Its axes.
    pub axes: KnownAxes,
    /// What tuning adds to what follows from them, by increasing speed.
    pub corrections: Vec<SpeedCorrection>,
}

/// How strokes are compensated, the trials of Penchev et al.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Trial 1: nothing.
    None,
    /// Trial 2: laser delays only.
    DelaysOnly,
    /// Trial 3: run-in, run-out and laser delays.
    #[default]
    Adaptive,
}

/// Offsets and delays of a stroke, equations of Penchev et al. with the correction that the beam
/// lags behind its command also on the run-in.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Compensation {
    /// Run-in `l_a`, µm.
    pub run_in_um: f64,
    /// Run-out `l_d`, µm.
    pub run_out_um: f64,
    /// From the start of the extended vector to the first pulse, µs.
    pub on_us: f64,
    /// From the end of the extended vector to the last pulse, µs.
    pub off_us: f64,
    /// Lag of the head along the stroke, µs.
    pub lag_us: f64,
    /// Time in which the head settles beyond its lag, µs.
    pub settling_us: f64,
    /// How far the stroke is commanded to the left of where it is drawn, µm: 0 where the axes have
    /// the same lag.
    pub lateral_um: f64,
}

/// A stroke of one vector, as it is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StraightStroke {
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// Direction, of length 1.
    pub direction: Point,
    /// Length, µm; none: so long that the head has forgotten the start at the end.
    pub length_um: Option<f64>,
}

impl HeadKnowledge {
    /// Regressions of test lines, for both axes.
    #[must_use]
    pub fn lines(calibration: Calibration) -> Self {
        Self::of_calibration(HeadCalibration { x: calibration.clone(), y: calibration })
    }

    /// Regressions of test lines, for each axis its own.
    #[must_use]
    pub fn of_calibration(found: HeadCalibration) -> Self {
        let axes = KnownAxes::Lines { x: found.x, y: found.y };
        Self { axes, corrections: Vec::new() }
    }

    /// A model, for both axes.
    #[must_use]
    pub fn model(axis: AxisModel) -> Self {
        let axes = KnownAxes::Model { x: axis.clone(), y: axis };
        Self { axes, corrections: Vec::new() }
    }

    /// What a head file knows: its calibration, or else its axes; and its corrections.
    #[must_use]
    pub fn of_head(head: &ScanHead) -> Self {
        let axes = match &head.calibration {
            Some(known) => KnownAxes::Lines { x: known.x.clone(), y: known.y.clone() },
            None => KnownAxes::Model { x: head.x.clone(), y: head.y.clone() },
        };
        Self { axes, corrections: head.corrections.clone() }
    }

    /// Offsets and delays of a stroke for craters of `beam_um`, where pulses may be nearer or farther
    /// apart by the part `tolerance`.
    ///
    /// Lines: `l_a`(V) and ΔL(V) = V τ from the regressions, `l_d` = V τ,
    /// `t_on` = (`l_a` + d/2)/V + τ, `t_off` = τ − (`l_d` + d/2)/V; with delays only `l_a` and `l_d` are
    /// 0. The tolerance is that of the measured acceleration lengths. Model: the shortest run-in and
    /// run-out that keep the speed within the tolerance, and the times at which the mirror really
    /// passes. Axes of different lags `τ_x` and `τ_y`: τ = `u_x`² `τ_x` + `u_y`² `τ_y` along the
    /// direction u, and the beam runs V `u_x` `u_y` (`τ_y` − `τ_x`) to the right of its command.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] for a speed, direction, diameter or tolerance out of range.
    pub fn compensation(
        &self,
        method: Method,
        stroke: &StraightStroke,
        beam_um: f64,
        tolerance: f64,
    ) -> Result<Compensation, GalvoError> {
        Compensator::new(self, method, beam_um, tolerance)?.compensation(stroke)
    }
}

/// Finds offsets and delays of one stroke after another, and remembers the last speed.
#[derive(Debug, Clone)]
pub(crate) struct Compensator<'a> {
    approaches: Approaches<'a>,
    corrections: &'a [SpeedCorrection],
    method: Method,
    beam_um: f64,
    last: Option<(f64, Point, Approach)>,
}

impl<'a> Compensator<'a> {
    pub(crate) fn new(
        knowledge: &'a HeadKnowledge,
        method: Method,
        beam_um: f64,
        tolerance: f64,
    ) -> Result<Self, GalvoError> {
        check_option("beam_um", beam_um, (0.0..=1e3).contains(&beam_um), "in [0, 1000] µm")?;
        let ok = (1e-4..=0.5).contains(&tolerance);
        check_option("tolerance", tolerance, ok, "in [1e-4, 0.5]")?;
        Ok(Self {
            approaches: Approaches::new(&knowledge.axes, tolerance),
            corrections: &knowledge.corrections,
            method,
            beam_um,
            last: None,
        })
    }

    /// Speed of jumps where `set_m_s` is allowed, m/s. Axes whose acceleration is limited jump no faster
    /// than they stay linear, those whose test lines show it no faster than the fastest of these.
    pub(crate) fn jump_speed_m_s(&self, set_m_s: f64) -> f64 {
        self.approaches.fastest_m_s().map_or(set_m_s, |fastest| fastest.min(set_m_s))
    }

    /// Time after which a start at `speed_m_s` along either axis is even, µs.
    pub(crate) fn settled_us(&self, speed_m_s: f64) -> f64 {
        let toward = [Point::new(1.0, 0.0), Point::new(0.0, 1.0)];
        toward
            .map(|direction| self.approaches.approach(speed_m_s, direction).settled_us)
            .into_iter()
            .fold(0.0, f64::max)
    }

    pub(crate) fn compensation(
        &mut self,
        stroke: &StraightStroke,
    ) -> Result<Compensation, GalvoError> {
        let StraightStroke { speed_m_s, direction, length_um } = *stroke;
        crate::program::check_speed("speed_m_s", speed_m_s)?;
        let size = direction.length();
        check_option("direction", size, (size - 1.0).abs() < 1e-6, "of length 1")?;
        let even = self.approaches.are_even();
        let known = match &self.last {
            Some((speed, toward, known))
                if (speed - speed_m_s).abs() <= 0.0 && (even || *toward == direction) =>
            {
                known
            }
            _ => {
                let fresh = self.approaches.approach(speed_m_s, direction);
                &self.last.insert((speed_m_s, direction, fresh)).2
            }
        };
        let found = match self.method {
            Method::None => Compensation {
                lag_us: known.lag_us,
                settling_us: known.settled_us - known.lag_us,
                ..Compensation::default()
            },
            Method::DelaysOnly => delays_only(known, speed_m_s, self.beam_um),
            Method::Adaptive => adaptive(known, speed_m_s, self.beam_um, length_um),
        };
        if self.method == Method::None || self.corrections.is_empty() {
            return Ok(found);
        }
        let correction: Correction = correction_at(self.corrections, speed_m_s);
        Ok(correction.apply(self.method, &found, speed_m_s, direction))
    }
}

fn delays_only(known: &Approach, speed_m_s: f64, beam_um: f64) -> Compensation {
    let half_um = 0.5 * beam_um;
    let settling_us = known.settled_us - known.lag_us;
    let (on_us, off_us) = if known.is_sampled() {
        // Within half a micrometre per m/s: the last of the way takes for ever.
        let left_um = half_um.max(0.5 * speed_m_s);
        (known.passing_us(half_um, f64::INFINITY), known.leaving_us(left_um))
    } else {
        (known.lag_us + half_um / speed_m_s, known.lag_us - half_um / speed_m_s)
    };
    Compensation { on_us, off_us, lag_us: known.lag_us, settling_us, ..Compensation::default() }
}

fn adaptive(
    known: &Approach,
    speed_m_s: f64,
    beam_um: f64,
    length_um: Option<f64>,
) -> Compensation {
    let half_um = 0.5 * beam_um;
    let lag_us = known.lag_us;
    let run_in_um = known.start_um(known.settled_us);
    let on_us = known.passing_us(run_in_um + half_um, f64::INFINITY);
    // The last pulse is due half a crater before the end, at most `holding_us` after the stop.
    let run_out_us = if known.is_sampled() {
        (lag_us - half_um / speed_m_s - known.holding_us).max(0.0)
    } else {
        lag_us
    };
    let run_out_um = run_out_us * speed_m_s;
    let off_us = match length_um {
        None => lag_us - half_um / speed_m_s - run_out_us,
        Some(length_um) => {
            let stop_us = (run_in_um + length_um + run_out_um) / speed_m_s;
            known.passing_us(run_in_um + length_um - half_um, stop_us) - stop_us
        }
    };
    Compensation {
        run_in_um,
        run_out_um,
        on_us,
        off_us,
        lag_us,
        settling_us: known.settled_us - lag_us,
        lateral_um: known.lateral_um,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Regression;

    fn along_x(speed_m_s: f64) -> StraightStroke {
        StraightStroke { speed_m_s, direction: Point::new(1.0, 0.0), length_um: None }
    }

    #[test]
    fn the_formulas_are_consistent() {
        let lines = HeadKnowledge::lines(Calibration {
            lag: Regression::proportional(216.4),
            acceleration: Regression::proportional(175.0),
            lead: None,
        });
        let found = lines.compensation(Method::Adaptive, &along_x(2.0), 40.0, 0.02).unwrap();
        assert!((found.run_in_um - 350.0).abs() < 1e-9);
        assert!((found.run_out_um - 432.8).abs() < 1e-9);
        assert!((found.on_us - (175.0 + 216.4 + 10.0)).abs() < 1e-9);
        // t_off + (l_a + L + l_d)/V − t_on = (L − d)/V.
        let length_um = 2000.0;
        let whole_us = (found.run_in_um + length_um + found.run_out_um) / 2.0;
        assert!((found.off_us + whole_us - found.on_us - (length_um - 40.0) / 2.0).abs() < 1e-9);
        let delays = lines.compensation(Method::DelaysOnly, &along_x(2.0), 40.0, 0.02).unwrap();
        assert!((delays.on_us - 226.4).abs() < 1e-9 && (delays.off_us - 206.4).abs() < 1e-9);
    }

    #[test]
    fn a_model_finds_the_shortest_run_in() {
        let head = ScanHead::default();
        let knowledge = HeadKnowledge::of_head(&head);
        // η = 93.7 % at 350 µm and 2 m/s: a looser tolerance needs no more.
        let loose = knowledge.compensation(Method::Adaptive, &along_x(2.0), 40.0, 0.063).unwrap();
        assert!((loose.run_in_um - 350.0).abs() < 0.03 * 350.0, "{}", loose.run_in_um);
        let tight = knowledge.compensation(Method::Adaptive, &along_x(2.0), 40.0, 0.02).unwrap();
        assert!(tight.run_in_um > loose.run_in_um && tight.run_out_um > loose.run_out_um);
        let slow = knowledge.compensation(Method::Adaptive, &along_x(1.0), 40.0, 0.02).unwrap();
        assert!((slow.run_in_um - 0.5 * tight.run_in_um).abs() < 1e-9);
    }

    #[test]
    fn values_out_of_range_are_named() {
        let knowledge = HeadKnowledge::of_head(&ScanHead::default());
        for (name, speed, beam, tolerance) in [
            ("speed_m_s", 0.0, 40.0, 0.02),
            ("beam_um", 1.0, -1.0, 0.02),
            ("tolerance", 1.0, 40.0, f64::NAN),
        ] {
            let error = knowledge.compensation(Method::Adaptive, &along_x(speed), beam, tolerance);
            assert!(error.unwrap_err().to_string().starts_with(name));
        }
    }
}
