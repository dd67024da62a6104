//! How far to extend a stroke and when to switch the laser, so that it comes out as drawn.

use crate::axis::{AxisModel, AxisTracker};
use crate::calibration::Calibration;
use crate::error::check_option;
use crate::servo::Ramp;
use crate::{GalvoError, ScanHead};

/// Largest part by which pulses may be nearer or farther apart, by default.
pub const DEFAULT_PITCH_TOLERANCE: f64 = 0.02;

/// What is known of a head.
#[derive(Debug, Clone, PartialEq)]
pub enum HeadKnowledge {
    /// Regressions of test lines: the formulas of Penchev et al.
    Lines(Calibration),
    /// A model of its axes, which are taken to be alike.
    Model(AxisModel),
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
    /// Lag of the head, µs.
    pub lag_us: f64,
    /// Time in which the head settles, µs.
    pub settling_us: f64,
}

impl HeadKnowledge {
    /// What a head file knows: its calibration, or else its axis.
    #[must_use]
    pub fn of_head(head: &ScanHead) -> Self {
        head.calibration.map_or_else(|| Self::Model(head.x.clone()), Self::Lines)
    }

    /// Offsets and delays at `speed_m_s` for craters of `beam_um`, where pulses may be nearer or
    /// farther apart by the part `tolerance`.
    ///
    /// Lines: `l_a`(V) and ΔL(V) = V τ from the regressions, `l_d` = V τ,
    /// `t_on` = (`l_a` + d/2)/V + τ, `t_off` = τ − (`l_d` + d/2)/V; with delays only `l_a` and `l_d` are
    /// 0. The tolerance is that of the measured acceleration lengths. Model: the shortest run-in and run-out that keep the speed
    /// within the tolerance, and the times at which the mirror really passes.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] for a speed, diameter or tolerance out of range.
    pub fn compensation(
        &self,
        method: Method,
        speed_m_s: f64,
        beam_um: f64,
        tolerance: f64,
    ) -> Result<Compensation, GalvoError> {
        crate::program::check_speed("speed_m_s", speed_m_s)?;
        check_option("beam_um", beam_um, (0.0..=1e3).contains(&beam_um), "in [0, 1000] µm")?;
        let ok = (1e-4..=0.5).contains(&tolerance);
        check_option("tolerance", tolerance, ok, "in [1e-4, 0.5]")?;
        let half_us = 0.5 * beam_um / speed_m_s;
        let (lag_us, settling_us) = match self {
            Self::Lines(lines) => (
                lines.lag.at_um(speed_m_s) / speed_m_s,
                lines.acceleration.at_um(speed_m_s) / speed_m_s,
            ),
            Self::Model(axis) => {
                let run = UnitRun::new(axis, tolerance);
                (axis.lag_us(), run.position_um_per_m_s)
            }
        };
        Ok(match (method, self) {
            (Method::None, _) => Compensation { lag_us, settling_us, ..Compensation::default() },
            (Method::DelaysOnly, Self::Model(axis)) => Compensation {
                on_us: passing_us(axis, half_us, 0.0),
                // Within half a micrometre per m/s: the last of the way takes for ever.
                off_us: leaving_us(axis, half_us.max(0.5)),
                lag_us,
                settling_us,
                ..Compensation::default()
            },
            (Method::DelaysOnly, Self::Lines(_)) => Compensation {
                on_us: lag_us + half_us,
                off_us: lag_us - half_us,
                lag_us,
                settling_us,
                ..Compensation::default()
            },
            (Method::Adaptive, Self::Lines(_)) => {
                let run_in_um = settling_us * speed_m_s;
                let run_out_um = lag_us * speed_m_s;
                Compensation {
                    run_in_um,
                    run_out_um,
                    on_us: settling_us + lag_us + half_us,
                    off_us: lag_us - run_out_um / speed_m_s - half_us,
                    lag_us,
                    settling_us,
                }
            }
            (Method::Adaptive, Self::Model(axis)) => {
                UnitRun::new(axis, tolerance).compensation(axis, speed_m_s, half_us)
            }
        })
    }
}

/// Run-in and run-out of an axis at unit speed: everything else scales with speed.
#[derive(Debug, Clone, Copy)]
struct UnitRun {
    /// Time after which the speed stays within the tolerance, µs.
    settled_us: f64,
    /// Position at that time at 1 m/s, µm per m/s.
    position_um_per_m_s: f64,
    /// Time after the command stops until the speed leaves the tolerance, µs.
    holding_us: f64,
}

impl UnitRun {
    fn new(axis: &AxisModel, tolerance: f64) -> Self {
        // Linear heads have forgotten the start after some lags.
        let end_us = 12.0 * axis.lag_us().max(1.0);
        let steps = 2400;
        let step_us = end_us / f64::from(steps);
        let mut tracker = started(axis, 2.0 * end_us);
        let mut run = Self { settled_us: 0.0, position_um_per_m_s: 0.0, holding_us: 0.0 };
        let mut held = true;
        for k in 1..=steps {
            tracker.advance(step_us);
            let mirror = tracker.mirror();
            if (mirror.speed_m_s - 1.0).abs() > tolerance {
                run.settled_us = f64::from(k) * step_us;
                run.position_um_per_m_s = mirror.position_um.max(0.0);
            }
            // After a stop the speed is 1 minus that after a start, since the axis is linear.
            held = held && mirror.speed_m_s.abs() <= tolerance;
            if held {
                run.holding_us = f64::from(k) * step_us;
            }
        }
        run
    }

    fn compensation(self, axis: &AxisModel, speed_m_s: f64, half_us: f64) -> Compensation {
        let lag_us = axis.lag_us();
        let run_in_us = self.position_um_per_m_s;
        let on_us = passing_us(axis, run_in_us + half_us, self.settled_us);
        // The last pulse is due half a crater before the end, at most `holding_us` after the stop.
        let run_out_us = (lag_us - half_us - self.holding_us).max(0.0);
        Compensation {
            run_in_um: run_in_us * speed_m_s,
            run_out_um: run_out_us * speed_m_s,
            on_us,
            off_us: lag_us - half_us - run_out_us,
            lag_us,
            settling_us: run_in_us,
        }
    }
}

/// Acceleration length at 1 m/s within `tolerance`, µm per m/s.
pub(crate) fn acceleration_us(axis: &AxisModel, tolerance: f64) -> f64 {
    UnitRun::new(axis, tolerance).position_um_per_m_s
}

/// An axis that starts to move at 1 m/s.
fn started(axis: &AxisModel, duration_us: f64) -> AxisTracker {
    let mut tracker = AxisTracker::new(axis, 0.0);
    tracker.command(Ramp { start_um: 0.0, speed: 1.0, duration_us });
    tracker
}

/// How long after a stop at 1 m/s an axis still has `left_us` (µm) to go.
fn leaving_us(axis: &AxisModel, left_us: f64) -> f64 {
    let lag_us = axis.lag_us();
    let (mut low_us, mut high_us) = (0.0, 20.0 * lag_us);
    for _ in 0..60 {
        let middle_us = 0.5 * (low_us + high_us);
        let mut tracker = started(axis, high_us + 1.0);
        tracker.advance(middle_us);
        // What a start has covered, a stop has yet to cover: the axis is linear.
        let to_go = lag_us - middle_us + tracker.mirror().position_um;
        if to_go > left_us {
            low_us = middle_us;
        } else {
            high_us = middle_us;
        }
    }
    0.5 * (low_us + high_us)
}

/// When an axis that started at 1 m/s passes `position_um`, not before `earliest_us`.
fn passing_us(axis: &AxisModel, position_um: f64, earliest_us: f64) -> f64 {
    let mut low_us = 0.0;
    let mut high_us = earliest_us + position_um + 20.0 * axis.lag_us();
    for _ in 0..60 {
        let middle_us = 0.5 * (low_us + high_us);
        let mut tracker = started(axis, high_us + 1.0);
        tracker.advance(middle_us);
        if tracker.mirror().position_um < position_um {
            low_us = middle_us;
        } else {
            high_us = middle_us;
        }
    }
    0.5 * (low_us + high_us)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Regression;

    #[test]
    fn the_formulas_are_consistent() {
        let lines = HeadKnowledge::Lines(Calibration {
            lag: Regression::proportional(216.4),
            acceleration: Regression::proportional(175.0),
        });
        let found = lines.compensation(Method::Adaptive, 2.0, 40.0, 0.02).unwrap();
        assert!((found.run_in_um - 350.0).abs() < 1e-9);
        assert!((found.run_out_um - 432.8).abs() < 1e-9);
        assert!((found.on_us - (175.0 + 216.4 + 10.0)).abs() < 1e-9);
        // t_off + (l_a + L + l_d)/V − t_on = (L − d)/V.
        let length_um = 2000.0;
        let whole_us = (found.run_in_um + length_um + found.run_out_um) / 2.0;
        assert!((found.off_us + whole_us - found.on_us - (length_um - 40.0) / 2.0).abs() < 1e-9);
        let delays = lines.compensation(Method::DelaysOnly, 2.0, 40.0, 0.02).unwrap();
        assert!((delays.on_us - 226.4).abs() < 1e-9 && (delays.off_us - 206.4).abs() < 1e-9);
    }

    #[test]
    fn a_model_finds_the_shortest_run_in() {
        let head = ScanHead::default();
        let knowledge = HeadKnowledge::of_head(&head);
        // η = 93.7 % at 350 µm and 2 m/s: a looser tolerance needs no more.
        let loose = knowledge.compensation(Method::Adaptive, 2.0, 40.0, 0.063).unwrap();
        assert!((loose.run_in_um - 350.0).abs() < 0.03 * 350.0, "{}", loose.run_in_um);
        let tight = knowledge.compensation(Method::Adaptive, 2.0, 40.0, 0.02).unwrap();
        assert!(tight.run_in_um > loose.run_in_um && tight.run_out_um > loose.run_out_um);
        let slow = knowledge.compensation(Method::Adaptive, 1.0, 40.0, 0.02).unwrap();
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
            let error = knowledge.compensation(Method::Adaptive, speed, beam, tolerance);
            assert!(error.unwrap_err().to_string().starts_with(name));
        }
    }
}
