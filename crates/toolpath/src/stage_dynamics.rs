//! The time a stage takes to carry the workpiece from pulse to pulse.

use crate::error::check_option;
use crate::{PulsePath, ToolpathError};

/// How fast a motorised XY stage moves, comes to rest and lets the laser fire.
///
/// The limits hold along the straight line of a move, and every move starts and ends at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageDynamics {
    /// Speed limit, µm/s, above 0. More shortens long moves only: a move below
    /// speed² / acceleration never reaches it. Default 5 000 (5 mm/s), what a stepper-driven
    /// microscope stage does without losing steps.
    pub max_speed_um_s: f64,
    /// Acceleration and deceleration, µm/s², above 0. It governs moves of pulse distance: twice the
    /// acceleration shortens them by a factor of √2, and shakes the stage more. Default 50 000
    /// (50 mm/s²): the default speed is reached in 0.1 s and 250 µm, so that every move within the
    /// workpiece is triangular.
    pub acceleration_um_s2: f64,
    /// Wait at rest after each move until the vibration has died down, s, 0 or more. Less fires onto
    /// a moving workpiece. Default 0.05: a few periods of a stage that rings at some 50 Hz.
    pub settling_s: f64,
    /// Time the laser takes for one pulse, s, 0 or more: the shutter opening and closing, not the
    /// far shorter light. Default 0.01, an electromechanical shutter.
    pub pulse_s: f64,
}

impl Default for StageDynamics {
    fn default() -> Self {
        Self {
            max_speed_um_s: 5_000.0,
            acceleration_um_s2: 50_000.0,
            settling_s: 0.05,
            pulse_s: 0.01,
        }
    }
}

impl StageDynamics {
    /// Accepts limits from 10⁻³ to 10¹² and waits from 0 s to 3600 s, all finite.
    ///
    /// # Errors
    /// [`ToolpathError::OptionValue`] naming the first field out of range.
    pub fn validate(&self) -> Result<(), ToolpathError> {
        let limits = [
            ("max_speed_um_s", self.max_speed_um_s, 1e-3..=1e12, "1e-3 to 1e12 µm/s"),
            ("acceleration_um_s2", self.acceleration_um_s2, 1e-3..=1e12, "1e-3 to 1e12 µm/s²"),
            ("settling_s", self.settling_s, 0.0..=3600.0, "0 to 3600 s"),
            ("pulse_s", self.pulse_s, 0.0..=3600.0, "0 to 3600 s"),
        ];
        for (name, value, range, accepted) in limits {
            check_option(name, value, range.contains(&value), accepted)?;
        }
        Ok(())
    }

    /// Time of a straight move of `length_um` (0 or more) from rest to rest, s, without settling.
    ///
    /// The speed is a trapezoid over time, v/a + L/v; or, when the move is shorter than v²/a and the
    /// speed limit is not reached, a triangle, 2 √(L/a).
    #[must_use]
    pub fn move_time_s(&self, length_um: f64) -> f64 {
        let (speed, acceleration) = (self.max_speed_um_s, self.acceleration_um_s2);
        if length_um * acceleration >= speed * speed {
            speed / acceleration + length_um / speed
        } else {
            2.0 * (length_um / acceleration).sqrt()
        }
    }
}

/// Length and duration of a path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Travel {
    /// Way from the first pulse to the last, µm.
    pub length_um: f64,
    /// Whole duration, s: the sum of the three below.
    pub time_s: f64,
    /// Time in motion, s.
    pub moving_s: f64,
    /// Time spent waiting for the stage to come to rest, s.
    pub settling_s: f64,
    /// Time spent firing, s.
    pub firing_s: f64,
}

/// Length and duration of `path`, with the stage at rest under the first pulse when the clock starts.
///
/// Every pulse takes its firing time; between two pulses at different positions the stage moves and
/// settles.
///
/// # Errors
/// [`ToolpathError::OptionValue`] when [`StageDynamics::validate`] refuses `dynamics`.
pub fn travel(path: &PulsePath, dynamics: &StageDynamics) -> Result<Travel, ToolpathError> {
    dynamics.validate()?;
    let mut travel = Travel::default();
    for length_um in path.moves_um().filter(|&length_um| length_um > 0.0) {
        travel.length_um += length_um;
        travel.moving_s += dynamics.move_time_s(length_um);
        travel.settling_s += dynamics.settling_s;
    }
    travel.firing_s = path.len() as f64 * dynamics.pulse_s;
    travel.time_s = travel.moving_s + travel.settling_s + travel.firing_s;
    Ok(travel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_geom::Point;
    use proptest::prelude::*;

    fn any_dynamics() -> impl Strategy<Value = StageDynamics> {
        (1.0..1e6, 1.0..1e7, 0.0..1.0, 0.0..1.0).prop_map(
            |(max_speed_um_s, acceleration_um_s2, settling_s, pulse_s)| StageDynamics {
                max_speed_um_s,
                acceleration_um_s2,
                settling_s,
                pulse_s,
            },
        )
    }

    fn any_path() -> impl Strategy<Value = Vec<Point>> {
        let position = (-20.0..120.0, -20.0..120.0).prop_map(|(x, y)| Point::new(x, y));
        proptest::collection::vec(position, 1..30)
    }

    /// Time to cover `length_um` by small steps of time: an integration of the motion itself.
    fn integrated_time_s(dynamics: &StageDynamics, length_um: f64) -> f64 {
        let (limit, acceleration) = (dynamics.max_speed_um_s, dynamics.acceleration_um_s2);
        let step_s = dynamics.move_time_s(length_um) / 20_000.0;
        let (mut position, mut speed, mut time_s) = (0.0_f64, 0.0_f64, 0.0);
        while position < length_um && time_s < 1e9 * step_s {
            // Brake as soon as the rest of the way is needed for it.
            let braking = speed * speed / (2.0 * acceleration) >= length_um - position;
            let next = if braking {
                speed - acceleration * step_s
            } else {
                (speed + acceleration * step_s).min(limit)
            };
            if next <= 0.0 {
                break;
            }
            position += 0.5 * (speed + next) * step_s;
            speed = next;
            time_s += step_s;
        }
        time_s
    }

    proptest! {
        #[test]
        fn a_longer_move_never_takes_less(
            dynamics in any_dynamics(), length_um in 0.0..1e6_f64, more in 0.0..1e6_f64
        ) {
            let (short, long) =
                (dynamics.move_time_s(length_um), dynamics.move_time_s(length_um + more));
            prop_assert!(short <= long * (1.0 + 1e-12));
        }

        #[test]
        fn triangle_and_trapezoid_meet(dynamics in any_dynamics()) {
            let length_um = dynamics.max_speed_um_s.powi(2) / dynamics.acceleration_um_s2;
            let below = dynamics.move_time_s(length_um * (1.0 - 1e-9));
            let above = dynamics.move_time_s(length_um * (1.0 + 1e-9));
            prop_assert!((above - below).abs() <= 1e-8 * above);
        }

        #[test]
        fn no_move_beats_either_limit_alone(dynamics in any_dynamics(), length_um in 0.0..1e6_f64) {
            let time_s = dynamics.move_time_s(length_um) * (1.0 + 1e-12);
            prop_assert!(time_s >= length_um / dynamics.max_speed_um_s);
            prop_assert!(time_s >= 2.0 * (length_um / dynamics.acceleration_um_s2).sqrt());
        }

        #[test]
        fn a_long_move_runs_at_the_speed_limit(dynamics in any_dynamics()) {
            let length_um = 1e6 * dynamics.max_speed_um_s.powi(2) / dynamics.acceleration_um_s2;
            let mean_speed = length_um / dynamics.move_time_s(length_um);
            prop_assert!((mean_speed / dynamics.max_speed_um_s - 1.0).abs() < 1e-5);
        }

        #[test]
        fn a_faster_stage_never_takes_longer(
            dynamics in any_dynamics(), length_um in 0.0..1e6_f64, factor in 1.0..10.0_f64
        ) {
            let time_s = dynamics.move_time_s(length_um) * (1.0 + 1e-12);
            let speed = dynamics.max_speed_um_s * factor;
            let quicker = StageDynamics { max_speed_um_s: speed, ..dynamics };
            prop_assert!(quicker.move_time_s(length_um) <= time_s);
            let acceleration = dynamics.acceleration_um_s2 * factor;
            let livelier = StageDynamics { acceleration_um_s2: acceleration, ..dynamics };
            prop_assert!(livelier.move_time_s(length_um) <= time_s);
        }

        #[test]
        fn paths_add_up(dynamics in any_dynamics(), head in any_path(), tail in any_path()) {
            let travel_of = |positions: &[Point]| {
                travel(&PulsePath::new(positions.to_vec(), 9.0).unwrap(), &dynamics).unwrap()
            };
            let bridge = [head[head.len() - 1], tail[0]];
            let whole = travel_of(&[head.clone(), tail.clone()].concat());
            let parts = [travel_of(&head), travel_of(&bridge), travel_of(&tail)];
            let sum = |field: fn(&Travel) -> f64| parts.iter().map(field).sum::<f64>();
            // The two ends of the bridge are fired in head and tail already.
            let fired_twice = 2.0 * dynamics.pulse_s;
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + a.abs());
            prop_assert!(near(whole.length_um, sum(|part| part.length_um)));
            prop_assert!(near(whole.moving_s, sum(|part| part.moving_s)));
            prop_assert!(near(whole.settling_s, sum(|part| part.settling_s)));
            prop_assert!(near(whole.firing_s, sum(|part| part.firing_s) - fired_twice));
            prop_assert!(near(whole.time_s, sum(|part| part.time_s) - fired_twice));
        }
    }

    #[test]
    fn move_time_agrees_with_the_integrated_motion() {
        let dynamics = StageDynamics::default();
        for length_um in [1.0, 20.0, 249.0, 251.0, 2_000.0] {
            let expected = integrated_time_s(&dynamics, length_um);
            let relative = dynamics.move_time_s(length_um) / expected - 1.0;
            assert!(relative.abs() < 1e-2, "{length_um} µm: {relative}");
        }
    }

    #[test]
    fn pulses_at_one_place_only_fire() {
        let path = PulsePath::new(vec![Point::new(5.0, 5.0); 4], 9.0).unwrap();
        let travel = travel(&path, &StageDynamics::default()).unwrap();
        assert!((travel.time_s - 0.04).abs() < 1e-12 && travel.settling_s.abs() < 1e-12);
    }

    #[test]
    fn options_out_of_range_are_named() {
        let good = StageDynamics::default();
        let broken = [
            ("max_speed_um_s", StageDynamics { max_speed_um_s: 0.0, ..good }),
            ("acceleration_um_s2", StageDynamics { acceleration_um_s2: f64::NAN, ..good }),
            ("settling_s", StageDynamics { settling_s: -1.0, ..good }),
            ("pulse_s", StageDynamics { pulse_s: f64::INFINITY, ..good }),
        ];
        for (field, dynamics) in broken {
            let error = dynamics.validate().unwrap_err();
            assert!(error.to_string().starts_with(field), "{error}");
        }
    }
}
