//! One axis of a head: servo or step response, and dead time.

use std::collections::VecDeque;

use crate::GalvoError;
use crate::error::check_option;
use crate::limited_servo::{LimitedServo, LimitedState};
use crate::servo::{MirrorState, Ramp, ServoPoles, ServoState};
use crate::step_response::{StepResponse, StepState};

/// How a mirror follows its command. All have DC gain 1.
#[derive(Debug, Clone, PartialEq)]
pub enum Follower {
    /// Two or three poles.
    Servo(ServoPoles),
    /// A step response, recorded or that of a constant acceleration time.
    Step(StepResponse),
    /// Two poles and a largest acceleration; the only one that is not linear.
    Limited(LimitedServo),
}

/// A follower behind a dead time.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisModel {
    /// What follows the command.
    pub follower: Follower,
    /// Time until anything happens, µs, in [0, 10⁵].
    pub dead_time_us: f64,
}

impl AxisModel {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first parameter outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        let dead = self.dead_time_us;
        check_option("dead_time_us", dead, (0.0..=1e5).contains(&dead), "in [0, 1e5] µs")?;
        match &self.follower {
            Follower::Servo(poles) => poles.validate(),
            Follower::Step(_) => Ok(()),
            Follower::Limited(servo) => servo.validate(),
        }
    }

    /// The lag τ behind a ramp, µs: at a constant speed V the mirror is V τ behind its command.
    #[must_use]
    pub fn lag_us(&self) -> f64 {
        self.dead_time_us
            + match &self.follower {
                Follower::Servo(poles) => poles.lag_us(),
                Follower::Step(response) => response.lag_us(),
                Follower::Limited(servo) => servo.lag_us,
            }
    }

    /// Whether everything that it does grows in proportion to the speed.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        !matches!(self.follower, Follower::Limited(_))
    }
}

/// An axis on its way: takes the pieces of its command in order, and says where the mirror is.
#[derive(Debug, Clone)]
pub(crate) struct AxisTracker {
    state: State,
    /// Pieces not reached yet, the first one current.
    ahead: VecDeque<Ramp>,
    /// Time spent in the current piece, µs.
    spent_us: f64,
    /// Time still to wait before the first piece begins, µs: the dead time.
    waiting_us: f64,
    /// Where the command is while there is no piece, µm.
    resting_um: f64,
    /// Speed of the current piece.
    speed: f64,
}

#[derive(Debug, Clone)]
enum State {
    Servo(ServoState),
    Step(StepState),
    Limited(LimitedState),
}

impl AxisTracker {
    /// At rest at `position_um`.
    pub(crate) fn new(model: &AxisModel, position_um: f64) -> Self {
        let state = match &model.follower {
            Follower::Servo(poles) => State::Servo(ServoState::new(poles)),
            Follower::Step(response) => State::Step(StepState::new(response, position_um)),
            Follower::Limited(servo) => State::Limited(LimitedState::new(servo)),
        };
        Self {
            state,
            ahead: VecDeque::new(),
            spent_us: 0.0,
            waiting_us: model.dead_time_us,
            resting_um: position_um,
            speed: 0.0,
        }
    }

    /// The command goes on along `ramp` after all that was given before; `ramp.duration_us` above 0.
    pub(crate) fn command(&mut self, ramp: Ramp) {
        self.ahead.push_back(ramp);
        if self.ahead.len() == 1 {
            self.begin();
        }
    }

    /// Lets `t_us` of time go by.
    pub(crate) fn advance(&mut self, mut t_us: f64) {
        if self.waiting_us > 0.0 {
            let waited = t_us.min(self.waiting_us);
            self.waiting_us -= waited;
            t_us -= waited;
        }
        while let Some(ramp) = self.ahead.front().copied() {
            let left_us = ramp.duration_us - self.spent_us;
            if t_us < left_us {
                break;
            }
            self.move_state(left_us);
            t_us -= left_us;
            self.resting_um = ramp.start_um + ramp.speed * ramp.duration_us;
            self.ahead.pop_front();
            self.spent_us = 0.0;
            if self.ahead.is_empty() {
                self.rest();
            } else {
                self.begin();
            }
        }
        self.spent_us += t_us;
        self.move_state(t_us);
    }

    /// Position and speed now.
    pub(crate) fn mirror(&self) -> MirrorState {
        let command_um = || {
            let current = self.ahead.front();
            current.map_or(self.resting_um, |ramp| ramp.start_um + ramp.speed * self.spent_us)
        };
        match &self.state {
            State::Servo(servo) => servo.mirror(command_um(), self.speed),
            State::Step(step) => step.mirror(),
            State::Limited(servo) => servo.mirror(command_um(), self.speed),
        }
    }

    fn begin(&mut self) {
        let Some(&ramp) = self.ahead.front() else { return };
        self.spent_us = 0.0;
        match &mut self.state {
            State::Servo(servo) => {
                servo.kink(ramp.speed - self.speed, ramp.start_um - self.resting_um);
            }
            State::Step(step) => step.begin(ramp),
            State::Limited(servo) => {
                servo.kink(ramp.speed - self.speed, ramp.start_um - self.resting_um);
            }
        }
        self.speed = ramp.speed;
    }

    fn rest(&mut self) {
        match &mut self.state {
            State::Servo(servo) => servo.kink(-self.speed, 0.0),
            State::Limited(servo) => servo.kink(-self.speed, 0.0),
            State::Step(step) => {
                step.begin(Ramp { start_um: self.resting_um, speed: 0.0, duration_us: 1.0 });
            }
        }
        self.speed = 0.0;
    }

    fn move_state(&mut self, t_us: f64) {
        if t_us > 0.0 {
            match &mut self.state {
                State::Servo(servo) => servo.advance(t_us),
                State::Step(step) => step.advance(t_us),
                State::Limited(servo) => servo.advance(t_us),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(crate) fn any_limited_axis() -> impl Strategy<Value = AxisModel> {
        (100.0..400.0_f64, 0.4..1.5_f64, 1e3..1e5_f64, 0.0..100.0_f64).prop_map(
            |(lag_us, damping, acceleration_limit_m_s2, dead_time_us)| AxisModel {
                follower: Follower::Limited(LimitedServo {
                    lag_us,
                    damping,
                    acceleration_limit_m_s2,
                }),
                dead_time_us,
            },
        )
    }

    pub(crate) fn any_axis() -> impl Strategy<Value = AxisModel> {
        let follower = prop_oneof![
            (100.0..400.0_f64).prop_map(|lag| Follower::Servo(ServoPoles::bessel(lag))),
            (100.0..400.0_f64, 0.4..1.5_f64)
                .prop_map(|(lag, z)| Follower::Servo(ServoPoles::second_order(lag, z))),
            (100.0..400.0_f64).prop_map(|time| {
                Follower::Step(StepResponse::constant_acceleration(time).unwrap())
            }),
        ];
        (follower, prop_oneof![Just(0.0), 1.0..100.0_f64])
            .prop_map(|(follower, dead_time_us)| AxisModel { follower, dead_time_us })
    }

    fn ramps(speeds: &[f64], start_um: f64) -> Vec<Ramp> {
        let mut at = start_um;
        speeds
            .iter()
            .map(|&speed| {
                let ramp = Ramp { start_um: at, speed, duration_us: 130.0 };
                at += speed * 130.0;
                ramp
            })
            .collect()
    }

    proptest! {
        #[test]
        fn positions_do_not_depend_on_when_they_are_asked_for(
            axis in prop_oneof![any_axis(), any_limited_axis()],
            speeds in proptest::collection::vec(-2.0..2.0_f64, 1..6),
            steps in proptest::collection::vec(0.0..200.0_f64, 1..8),
        ) {
            let mut often = AxisTracker::new(&axis, 3.0);
            let mut once = AxisTracker::new(&axis, 3.0);
            for ramp in ramps(&speeds, 3.0) {
                often.command(ramp);
                once.command(ramp);
            }
            for &step in &steps {
                often.advance(step);
            }
            once.advance(steps.iter().sum());
            prop_assert!((often.mirror().position_um - once.mirror().position_um).abs() < 1e-7);
        }

        #[test]
        fn at_constant_speed_the_mirror_lags_by_the_lag(
            axis in prop_oneof![any_axis(), any_limited_axis()], speed in 0.1..3.0_f64
        ) {
            let mut tracker = AxisTracker::new(&axis, 0.0);
            tracker.command(Ramp { start_um: 0.0, speed, duration_us: 1e5 });
            tracker.advance(5e4);
            let mirror = tracker.mirror();
            prop_assert!((speed * 5e4 - mirror.position_um - speed * axis.lag_us()).abs() < 1e-6);
            prop_assert!((mirror.speed_m_s - speed).abs() < 1e-9);
        }

        #[test]
        fn superposition_holds(
            axis in any_axis(),
            one in proptest::collection::vec(-2.0..2.0_f64, 4),
            two in proptest::collection::vec(-2.0..2.0_f64, 4),
            t_us in 0.0..900.0_f64,
        ) {
            let both: Vec<f64> = one.iter().zip(&two).map(|(a, b)| a + b).collect();
            let position = |speeds: &[f64]| {
                let mut tracker = AxisTracker::new(&axis, 0.0);
                for ramp in ramps(speeds, 0.0) {
                    tracker.command(ramp);
                }
                tracker.advance(t_us);
                tracker.mirror().position_um
            };
            prop_assert!((position(&one) + position(&two) - position(&both)).abs() < 1e-7);
        }
    }

    #[test]
    fn a_dead_time_only_delays() {
        let prompt =
            AxisModel { follower: Follower::Servo(ServoPoles::bessel(200.0)), dead_time_us: 0.0 };
        let late = AxisModel { dead_time_us: 40.0, ..prompt.clone() };
        let position = |model: &AxisModel, t_us: f64| {
            let mut tracker = AxisTracker::new(model, 0.0);
            for ramp in ramps(&[1.0, -2.0], 0.0) {
                tracker.command(ramp);
            }
            tracker.advance(t_us);
            tracker.mirror().position_um
        };
        for t_us in [0.0, 50.0, 200.0, 400.0] {
            assert!((position(&prompt, t_us) - position(&late, t_us + 40.0)).abs() < 1e-12);
        }
    }
}
