//! A second-order servo whose mirror may accelerate at most so much, followed exactly.
//!
//! While the servo asks for less than the limit its deviation from the steady lag is a sum of modes;
//! while it asks for more the mirror moves along a parabola. Where one ends and the other begins is
//! solved for, so that there is no integration.

use crate::GalvoError;
use crate::error::check_option;
use crate::servo::{MirrorState, ServoPoles};

/// µm/µs² of 1 m/s².
const UM_US2_PER_M_S2: f64 = 1e-6;

/// Deviations below this, µm and µm/µs, count as none.
const NEGLIGIBLE: f64 = 1e-14;

/// A second-order servo with a bounded acceleration. Its lag at constant speed is that of the servo;
/// the way until it is steady grows faster than the speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitedServo {
    /// The lag behind a ramp, µs, in [1, 10⁵].
    pub lag_us: f64,
    /// Damping ζ, in [0.2, 5].
    pub damping: f64,
    /// Largest acceleration, m/s², in [1, 10⁹].
    pub acceleration_limit_m_s2: f64,
}

impl LimitedServo {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first parameter outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        let lag = self.lag_us;
        check_option("lag_us", lag, (1.0..=1e5).contains(&lag), "in [1, 1e5] µs")?;
        let damping = self.damping;
        check_option("damping", damping, (0.2..=5.0).contains(&damping), "in [0.2, 5]")?;
        let limit = self.acceleration_limit_m_s2;
        let ok = (1.0..=1e9).contains(&limit);
        check_option("acceleration_limit_m_s2", limit, ok, "in [1, 1e9] m/s²")
    }

    /// Up to this speed a start from rest never asks for more than the limit, m/s: the servo is linear.
    #[must_use]
    pub fn free_speed_m_s(&self) -> f64 {
        let poles = self.poles();
        let step_us = 0.002 * self.lag_us;
        // The acceleration after a start at 1 m/s is the impulse response.
        let steepest =
            (1..=2000).map(|k| poles.oscillation(f64::from(k) * step_us).1).fold(0.0, f64::max);
        let limit = self.acceleration_limit_m_s2 * UM_US2_PER_M_S2;
        0.999 * limit / (poles.natural_rad_us.powi(2) * steepest)
    }

    /// The servo without its limit.
    #[must_use]
    pub fn poles(&self) -> ServoPoles {
        ServoPoles::second_order(self.lag_us, self.damping)
    }
}

/// Which law moves the mirror.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Regime {
    /// The servo gets what it asks for.
    Modes,
    /// It gets the limit, with this sign.
    Parabola(f64),
}

/// A limited servo on its way: deviation from the steady ramp and its rate.
#[derive(Debug, Clone)]
pub(crate) struct LimitedState {
    poles: ServoPoles,
    lag_us: f64,
    /// Largest acceleration, µm/µs².
    limit: f64,
    deviation_um: f64,
    rate: f64,
    regime: Regime,
}

impl LimitedState {
    /// A servo at rest on its command.
    pub(crate) fn new(servo: &LimitedServo) -> Self {
        Self {
            poles: servo.poles(),
            lag_us: servo.lag_us,
            limit: servo.acceleration_limit_m_s2 * UM_US2_PER_M_S2,
            deviation_um: 0.0,
            rate: 0.0,
            regime: Regime::Modes,
        }
    }

    /// The command changes its speed by `speed` and leaps by `position_um`.
    pub(crate) fn kink(&mut self, speed: f64, position_um: f64) {
        self.deviation_um += self.lag_us * speed - position_um;
        self.rate -= speed;
        let asked = self.asked();
        self.regime =
            if asked.abs() > self.limit { Regime::Parabola(asked.signum()) } else { Regime::Modes };
    }

    /// Lets `t_us` go by.
    pub(crate) fn advance(&mut self, mut t_us: f64) {
        loop {
            let (change_us, next) = match self.regime {
                Regime::Modes => (self.saturates_us(), Regime::Parabola(0.0)),
                Regime::Parabola(sign) => (self.leaves_us(sign), Regime::Modes),
            };
            if change_us >= t_us {
                self.glide(t_us);
                break;
            }
            self.glide(change_us);
            t_us -= change_us;
            self.regime = match next {
                Regime::Parabola(_) => Regime::Parabola(self.asked().signum()),
                Regime::Modes => next,
            };
        }
        if self.deviation_um.abs() < NEGLIGIBLE && self.rate.abs() < NEGLIGIBLE {
            (self.deviation_um, self.rate) = (0.0, 0.0);
        }
    }

    /// Position and speed when the command is at `command_um` and moves at `speed`.
    pub(crate) fn mirror(&self, command_um: f64, speed: f64) -> MirrorState {
        MirrorState {
            position_um: command_um - speed * self.lag_us + self.deviation_um,
            speed_m_s: speed + self.rate,
        }
    }

    /// The acceleration that the servo asks for, µm/µs².
    fn asked(&self) -> f64 {
        let omega = self.poles.natural_rad_us;
        -omega * (omega * self.deviation_um + 2.0 * self.poles.damping * self.rate)
    }

    /// Moves for `t_us` by the law of the regime.
    fn glide(&mut self, t_us: f64) {
        match self.regime {
            Regime::Modes => {
                let (omega, sigma) = self.modal();
                let (cosine, sine) = self.poles.oscillation(t_us);
                let (x, v) = (self.deviation_um, self.rate);
                self.deviation_um = x * cosine + (v + sigma * x) * sine;
                self.rate = v * cosine - (sigma * v + omega * omega * x) * sine;
            }
            Regime::Parabola(sign) => {
                let a = sign * self.limit;
                self.deviation_um += t_us * (self.rate + 0.5 * a * t_us);
                self.rate += a * t_us;
            }
        }
    }

    /// ω and σ = ζω.
    fn modal(&self) -> (f64, f64) {
        let omega = self.poles.natural_rad_us;
        (omega, self.poles.damping * omega)
    }

    /// How long the servo asks for more than the limit, in the direction `sign`, µs: the only
    /// positive zero of a parabola that is open below and above zero now.
    fn leaves_us(&self, sign: f64) -> f64 {
        let (omega, sigma) = self.modal();
        let (x, v) = (sign * self.deviation_um, sign * self.rate);
        let constant = (-omega * omega * x - 2.0 * sigma * v - self.limit).max(0.0);
        let linear = -omega * omega * v - 2.0 * sigma * self.limit;
        let square = 0.5 * omega * omega * self.limit;
        let root = (linear * linear + 4.0 * square * constant).sqrt();
        if linear < 0.0 { 2.0 * constant / (root - linear) } else { 0.5 * (linear + root) / square }
    }

    /// When the servo begins to ask for more than the limit, µs; infinite if never. What it asks for
    /// obeys the law of its modes, whose peaks become smaller and smaller: only the first counts.
    fn saturates_us(&self) -> f64 {
        let (omega, sigma) = self.modal();
        let asked = self.asked();
        let slope = -omega * omega * self.rate - 2.0 * sigma * asked;
        let sine_part = slope + sigma * asked;
        let beta_squared = omega * omega - sigma * sigma;
        // tan βt/β or tanh βt/β of the first peak.
        let (over, under) = (slope, beta_squared * asked + sigma * sine_part);
        let beta = beta_squared.abs().sqrt();
        let peak_us = if beta_squared > 0.0 {
            let angle = (beta * over).atan2(under);
            if angle > 0.0 { angle / beta } else { (angle + std::f64::consts::PI) / beta }
        } else {
            let ratio = over / under;
            if !(ratio > 0.0 && beta * ratio < 1.0) {
                return f64::INFINITY;
            }
            if beta * ratio > 1e-9 { (beta * ratio).atanh() / beta } else { ratio }
        };
        let asked_at = |t_us: f64| {
            let (cosine, sine) = self.poles.oscillation(t_us);
            asked * cosine + sine_part * sine
        };
        let peak = asked_at(peak_us);
        // Within rounding of the limit there is nothing to cut off.
        if peak.abs() <= self.limit * (1.0 + 1e-12) {
            return f64::INFINITY;
        }
        let (mut low_us, mut high_us) = (0.0, peak_us);
        for _ in 0..60 {
            let middle_us = 0.5 * (low_us + high_us);
            if asked_at(middle_us) * peak.signum() < self.limit {
                low_us = middle_us;
            } else {
                high_us = middle_us;
            }
        }
        high_us
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::ServoState;
    use proptest::prelude::*;

    fn any_servo() -> impl Strategy<Value = LimitedServo> {
        (100.0..400.0_f64, 0.3..2.0_f64, 5e2..1e5_f64).prop_map(|(lag_us, damping, limit)| {
            LimitedServo { lag_us, damping, acceleration_limit_m_s2: limit }
        })
    }

    /// Position after ramps of 300 µs each, by Runge and Kutta's method with steps of 0.05 µs.
    fn integrated(servo: &LimitedServo, speeds: &[f64]) -> f64 {
        let poles = servo.poles();
        let (w, z) = (poles.natural_rad_us, poles.damping);
        let limit = servo.acceleration_limit_m_s2 * 1e-6;
        let (mut x, mut v, mut command, step) = (0.0, 0.0, 0.0, 0.05);
        for &speed in speeds {
            for k in 0..6000 {
                let at = |t: f64| command + speed * (f64::from(k) * step + t);
                let pull = |x: f64, v: f64, t: f64| {
                    (w * w * (at(t) - x) - 2.0 * z * w * v).clamp(-limit, limit)
                };
                let half = 0.5 * step;
                let (x1, v1) = (v, pull(x, v, 0.0));
                let (x2, v2) = (v + half * v1, pull(x + half * x1, v + half * v1, half));
                let (x3, v3) = (v + half * v2, pull(x + half * x2, v + half * v2, half));
                let (x4, v4) = (v + step * v3, pull(x + step * x3, v + step * v3, step));
                x += step / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4);
                v += step / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
            }
            command += speed * 300.0;
        }
        x
    }

    fn played(servo: &LimitedServo, speeds: &[f64], pieces: u32) -> MirrorState {
        let mut state = LimitedState::new(servo);
        let (mut command, mut last) = (0.0, 0.0);
        for &speed in speeds {
            state.kink(speed - last, 0.0);
            for _ in 0..pieces {
                state.advance(300.0 / f64::from(pieces));
            }
            command += speed * 300.0;
            last = speed;
        }
        state.mirror(command, last)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn parabolas_and_modes_agree_with_an_integration(
            servo in any_servo(), speeds in proptest::collection::vec(-5.0..5.0_f64, 1..6)
        ) {
            let found = played(&servo, &speeds, 1).position_um;
            let expected = integrated(&servo, &speeds);
            prop_assert!((found - expected).abs() < 1e-2, "{found} {expected} µm");
        }
    }

    proptest! {
        #[test]
        fn positions_do_not_depend_on_when_they_are_asked_for(
            servo in any_servo(), speeds in proptest::collection::vec(-5.0..5.0_f64, 1..6),
            pieces in 2..40_u32,
        ) {
            let (once, often) = (played(&servo, &speeds, 1), played(&servo, &speeds, pieces));
            prop_assert!((once.position_um - often.position_um).abs() < 1e-6);
            prop_assert!((once.speed_m_s - often.speed_m_s).abs() < 1e-8);
        }

        #[test]
        fn no_mirror_accelerates_beyond_its_limit(
            servo in any_servo(), speeds in proptest::collection::vec(-5.0..5.0_f64, 1..6)
        ) {
            let mut state = LimitedState::new(&servo);
            let mut last = 0.0;
            for &speed in &speeds {
                state.kink(speed - last, 0.0);
                last = speed;
                for _ in 0..100 {
                    let before = state.mirror(0.0, speed).speed_m_s;
                    state.advance(3.0);
                    let gained = (state.mirror(0.0, speed).speed_m_s - before).abs() / 3.0;
                    prop_assert!(gained <= servo.acceleration_limit_m_s2 * 1e-6 * (1.0 + 1e-9));
                }
            }
        }

        #[test]
        fn far_below_the_limit_it_is_the_servo(
            lag_us in 100.0..400.0_f64, damping in 0.3..2.0_f64,
            speeds in proptest::collection::vec(-2.0..2.0_f64, 1..6),
        ) {
            let servo = LimitedServo { lag_us, damping, acceleration_limit_m_s2: 1e9 };
            let found = played(&servo, &speeds, 3);
            let mut free = ServoState::new(&servo.poles());
            let (mut command, mut last) = (0.0, 0.0);
            for &speed in &speeds {
                free.kink(speed - last, 0.0);
                free.advance(300.0);
                command += speed * 300.0;
                last = speed;
            }
            let expected = free.mirror(command, last);
            prop_assert!((found.position_um - expected.position_um).abs() < 1e-7);
        }
    }

    #[test]
    fn a_long_leap_takes_as_long_as_full_acceleration_and_braking() {
        // Far from its target a mirror accelerates at the limit: ½ a t².
        let servo = LimitedServo { lag_us: 200.0, damping: 1.0, acceleration_limit_m_s2: 4000.0 };
        let mut state = LimitedState::new(&servo);
        state.kink(0.0, 10_000.0);
        state.advance(500.0);
        let mirror = state.mirror(10_000.0, 0.0);
        assert!((mirror.position_um - 0.5 * 4e-3 * 500.0_f64.powi(2)).abs() < 1e-9);
        assert!((mirror.speed_m_s - 2.0).abs() < 1e-12);
        state.advance(1e6);
        assert!((state.mirror(10_000.0, 0.0).position_um - 10_000.0).abs() < 1e-9);
    }

    #[test]
    fn at_its_free_speed_it_is_the_servo() {
        let servo = LimitedServo { lag_us: 216.4, damping: 0.9, acceleration_limit_m_s2: 4000.0 };
        let speed = servo.free_speed_m_s();
        // ω exp(−ζ/√(1−ζ²) arccos ζ) is the peak of the impulse response.
        let (omega, root) = (1.8 / 216.4e-6, (1.0 - 0.81_f64).sqrt());
        let peak = omega * (-0.9 / root * 0.9_f64.acos()).exp();
        assert!((speed / (4000.0 / peak) - 0.999).abs() < 1e-5);
        for (factor, free) in [(1.0, true), (1.01, false)] {
            let mut limited = LimitedState::new(&servo);
            let mut linear = ServoState::new(&servo.poles());
            limited.kink(factor * speed, 0.0);
            linear.kink(factor * speed, 0.0);
            limited.advance(300.0);
            linear.advance(300.0);
            let (a, b) = (limited.mirror(0.0, speed), linear.mirror(0.0, speed));
            assert_eq!((a.position_um - b.position_um).abs() < 1e-9, free);
        }
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let good = LimitedServo { lag_us: 200.0, damping: 0.9, acceleration_limit_m_s2: 4e3 };
        for (name, servo) in [
            ("lag_us", LimitedServo { lag_us: 0.0, ..good }),
            ("damping", LimitedServo { damping: f64::NAN, ..good }),
            ("acceleration_limit_m_s2", LimitedServo { acceleration_limit_m_s2: 0.0, ..good }),
        ] {
            assert!(servo.validate().unwrap_err().to_string().starts_with(name));
        }
    }
}
