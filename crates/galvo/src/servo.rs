//! Servos with two or three poles, followed exactly through piecewise linear commands.
//!
//! The closed loop has DC gain 1, so under a ramp u = V t the mirror ends up at V (t − τ) with the
//! lag τ. Its deviation from that obeys the homogeneous equation, whose modes have closed forms:
//! there is no integration and no error but rounding.

use nalgebra::{Matrix3, Vector3};

use crate::GalvoError;
use crate::error::check_option;

/// Normalised third-order Bessel filter of unit delay: complex pair and real pole
/// (Thomson 1949; s³ + 6s² + 15s + 15).
const BESSEL_NATURAL: f64 = 2.541_541_401_095_675;
const BESSEL_DAMPING: f64 = 0.723_540_179_945_207;
const BESSEL_POLE: f64 = 2.322_185_354_626_086;

/// Deviations below this, µm, count as none: they would end as denormal numbers.
const NEGLIGIBLE_UM: f64 = 1e-14;

/// Poles of a servo with DC gain 1 and no zeros. Times are µs, rates rad/µs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoPoles {
    /// ω of the pair of poles, rad/µs, in [10⁻⁵, 10].
    pub natural_rad_us: f64,
    /// ζ of the pair, in [0.05, 5]; with a real pole below 0.99. 1 is critical.
    pub damping: f64,
    /// Rate of the real pole, rad/µs, in [10⁻⁵, 10]; none for a second-order servo.
    pub real_rad_us: Option<f64>,
}

impl ServoPoles {
    /// The second-order servo of damping ζ whose lag is `lag_us`: ω = 2ζ/τ.
    #[must_use]
    pub fn second_order(lag_us: f64, damping: f64) -> Self {
        Self { natural_rad_us: 2.0 * damping / lag_us, damping, real_rad_us: None }
    }

    /// The third-order Bessel servo whose lag is `lag_us`: almost the same delay for all frequencies.
    #[must_use]
    pub fn bessel(lag_us: f64) -> Self {
        Self {
            natural_rad_us: BESSEL_NATURAL / lag_us,
            damping: BESSEL_DAMPING,
            real_rad_us: Some(BESSEL_POLE / lag_us),
        }
    }

    /// The lag τ behind a ramp, µs: the sum of 1/(−pole).
    #[must_use]
    pub fn lag_us(&self) -> f64 {
        2.0 * self.damping / self.natural_rad_us + self.real_rad_us.map_or(0.0, f64::recip)
    }

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first parameter outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        let rate = 1e-5..=10.0;
        let natural = self.natural_rad_us;
        check_option("natural_rad_us", natural, rate.contains(&natural), "in [1e-5, 10] rad/µs")?;
        let damping = self.damping;
        let Some(real) = self.real_rad_us else {
            return check_option(
                "damping",
                damping,
                (0.05..=5.0).contains(&damping),
                "in [0.05, 5]",
            );
        };
        check_option("real_rad_us", real, rate.contains(&real), "in [1e-5, 10] rad/µs")?;
        let ok = (0.05..=0.99).contains(&damping);
        check_option("damping", damping, ok, "in [0.05, 0.99] with three poles")
    }

    /// (e^(−σt) cos βt, e^(−σt) sin(βt)/β) of the pair; cosh and sinh where it is overdamped.
    pub(crate) fn oscillation(&self, t_us: f64) -> (f64, f64) {
        let sigma = self.damping * self.natural_rad_us;
        let beta_squared = self.natural_rad_us.powi(2) * (1.0 - self.damping.powi(2));
        if beta_squared > 0.0 {
            let beta = beta_squared.sqrt();
            let (sin, cos) = (beta * t_us).sin_cos();
            let decay = (-sigma * t_us).exp();
            return (decay * cos, decay * sin / beta);
        }
        let beta = (-beta_squared).sqrt();
        let (slow, fast) = (((beta - sigma) * t_us).exp(), (-(beta + sigma) * t_us).exp());
        let sine = if beta * t_us > 1e-6 {
            0.5 * (slow - fast) / beta
        } else {
            t_us * (-sigma * t_us).exp()
        };
        (0.5 * (slow + fast), sine)
    }
}

/// A straight piece of a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ramp {
    /// Where it begins, µm.
    pub(crate) start_um: f64,
    /// Its speed, µm/µs = m/s.
    pub(crate) speed: f64,
    /// Its duration, µs.
    pub(crate) duration_us: f64,
}

/// Position and speed of a mirror.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MirrorState {
    /// Position, µm.
    pub position_um: f64,
    /// Speed, m/s.
    pub speed_m_s: f64,
}

/// A servo on its way: modal amplitudes of the deviation from the steady ramp.
#[derive(Debug, Clone)]
pub(crate) struct ServoState {
    poles: ServoPoles,
    lag_us: f64,
    /// Amplitudes of e^(−σt) cos βt, e^(−σt) sin(βt)/β and e^(−pt), µm, µm/µs and µm.
    modes: Vector3<f64>,
    /// Change of the amplitudes for a unit change of the command's speed and of its position.
    per_speed: Vector3<f64>,
    per_position: Vector3<f64>,
}

impl ServoState {
    /// A servo at rest on its command.
    pub(crate) fn new(poles: &ServoPoles) -> Self {
        let lag_us = poles.lag_us();
        let sigma = poles.damping * poles.natural_rad_us;
        let beta_squared = poles.natural_rad_us.powi(2) * (1.0 - poles.damping.powi(2));
        // Position, speed and acceleration at t = 0 of each mode.
        let mut initial = Matrix3::new(
            1.0,
            0.0,
            1.0, //
            -sigma,
            1.0,
            0.0, //
            sigma * sigma - beta_squared,
            -2.0 * sigma,
            0.0,
        );
        if let Some(p) = poles.real_rad_us {
            (initial[(1, 2)], initial[(2, 2)]) = (-p, p * p);
        } else {
            // Without a third pole there is no third mode, and the acceleration is not free.
            initial.set_row(2, &nalgebra::RowVector3::new(0.0, 0.0, 1.0));
            initial[(0, 2)] = 0.0;
        }
        // A servo has two states more than its command shows; their matrix is regular (validated).
        let inverse = initial.try_inverse().unwrap_or_else(Matrix3::zeros);
        Self {
            poles: *poles,
            lag_us,
            modes: Vector3::zeros(),
            per_speed: inverse * Vector3::new(lag_us, -1.0, 0.0),
            per_position: inverse * Vector3::new(-1.0, 0.0, 0.0),
        }
    }

    /// The command changes its speed by `speed` and leaps by `position_um`.
    pub(crate) fn kink(&mut self, speed: f64, position_um: f64) {
        self.modes += self.per_speed * speed + self.per_position * position_um;
    }

    /// Lets `t_us` go by.
    pub(crate) fn advance(&mut self, t_us: f64) {
        self.modes = self.after(t_us);
        if self.modes.amax() < NEGLIGIBLE_UM {
            self.modes = Vector3::zeros();
        }
    }

    /// Position and speed when the command is at `command_um` and moves at `speed`.
    pub(crate) fn mirror(&self, command_um: f64, speed: f64) -> MirrorState {
        let sigma = self.poles.damping * self.poles.natural_rad_us;
        let [a, b, c] = [self.modes[0], self.modes[1], self.modes[2]];
        let p = self.poles.real_rad_us.unwrap_or(0.0);
        MirrorState {
            position_um: command_um - speed * self.lag_us + a + c,
            speed_m_s: speed - sigma * a + b - p * c,
        }
    }

    /// The amplitudes `t_us` later.
    fn after(&self, t_us: f64) -> Vector3<f64> {
        if self.modes == Vector3::zeros() {
            return self.modes;
        }
        let [a, b, c] = [self.modes[0], self.modes[1], self.modes[2]];
        let beta_squared = self.poles.natural_rad_us.powi(2) * (1.0 - self.poles.damping.powi(2));
        let (cosine, sine) = self.poles.oscillation(t_us);
        let real = self.poles.real_rad_us.map_or(0.0, |p| (-p * t_us).exp());
        // cos β(t+h) and sin β(t+h)/β by the addition theorems.
        Vector3::new(a * cosine + b * sine, b * cosine - a * beta_squared * sine, c * real)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix5;
    use proptest::prelude::*;

    fn any_poles() -> impl Strategy<Value = ServoPoles> {
        let two = (1e-3..0.05_f64, 0.2..2.0_f64).prop_map(|(w, z)| ServoPoles {
            natural_rad_us: w,
            damping: z,
            real_rad_us: None,
        });
        let three = (1e-3..0.05_f64, 0.2..0.95_f64, 1e-3..0.05_f64).prop_map(|(w, z, p)| {
            ServoPoles { natural_rad_us: w, damping: z, real_rad_us: Some(p) }
        });
        prop_oneof![two, three]
    }

    /// Position and speed after one ramp from rest, by the exponential of the augmented matrix.
    fn oracle(poles: &ServoPoles, speed: f64, t_us: f64) -> (f64, f64) {
        let (w, z) = (poles.natural_rad_us, poles.damping);
        // States: position, speed, acceleration, command, command speed.
        let mut system = Matrix5::zeros();
        system[(0, 1)] = 1.0;
        system[(3, 4)] = 1.0;
        if let Some(p) = poles.real_rad_us {
            system[(1, 2)] = 1.0;
            let gain = p * w * w;
            system[(2, 0)] = -gain;
            system[(2, 1)] = -(w * w + 2.0 * z * w * p);
            system[(2, 2)] = -(2.0 * z * w + p);
            system[(2, 3)] = gain;
        } else {
            system[(1, 0)] = -w * w;
            system[(1, 1)] = -2.0 * z * w;
            system[(1, 3)] = w * w;
        }
        let mut state = nalgebra::Vector5::zeros();
        state[4] = speed;
        state = (system * t_us).exp() * state;
        (state[0], state[1])
    }

    proptest! {
        #[test]
        fn the_closed_form_agrees_with_the_matrix_exponential(
            poles in any_poles(), speed in -3.0..3.0_f64, t_us in 0.0..2e3_f64
        ) {
            let mut servo = ServoState::new(&poles);
            servo.kink(speed, 0.0);
            servo.advance(t_us);
            let mirror = servo.mirror(speed * t_us, speed);
            let (position, mirror_speed) = oracle(&poles, speed, t_us);
            prop_assert!((mirror.position_um - position).abs() < 1e-6, "{} {position}", mirror.position_um);
            prop_assert!((mirror.speed_m_s - mirror_speed).abs() < 1e-8);
        }

        #[test]
        fn two_short_waits_are_one_long_wait(
            poles in any_poles(), first in 0.0..500.0_f64, second in 0.0..500.0_f64
        ) {
            let mut once = ServoState::new(&poles);
            once.kink(1.0, 5.0);
            let mut twice = once.clone();
            once.advance(first + second);
            twice.advance(first);
            twice.advance(second);
            prop_assert!((once.modes - twice.modes).amax() < 1e-8);
        }
    }

    #[test]
    fn the_bessel_servo_is_the_one_of_the_tables() {
        // ω = 11745 rad/s, p = 10731 rad/s, ζ = 0.7235 at a lag of 216.4 µs.
        let poles = ServoPoles::bessel(216.4);
        assert!((poles.natural_rad_us * 1e6 - 11_745.0).abs() < 2.0);
        assert!((poles.real_rad_us.unwrap() * 1e6 - 10_731.0).abs() < 2.0);
        assert!((poles.lag_us() - 216.4).abs() < 1e-9);
    }

    #[test]
    fn critical_damping_is_the_limit_of_both_sides() {
        let near = |damping| {
            let poles = ServoPoles { natural_rad_us: 0.01, damping, real_rad_us: None };
            let mut servo = ServoState::new(&poles);
            servo.kink(2.0, 0.0);
            servo.advance(150.0);
            servo.mirror(300.0, 2.0).position_um
        };
        for damping in [1.0 - 1e-7, 1.0 + 1e-7] {
            assert!((near(damping) - near(1.0)).abs() < 1e-4);
        }
    }

    #[test]
    fn a_resting_servo_stays() {
        let mut servo = ServoState::new(&ServoPoles::bessel(200.0));
        servo.kink(1.0, 0.0);
        servo.advance(1e9);
        assert_eq!(servo.modes, Vector3::zeros());
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let good = ServoPoles::bessel(200.0);
        for (name, poles) in [
            ("natural_rad_us", ServoPoles { natural_rad_us: 0.0, ..good }),
            ("damping", ServoPoles { damping: 1.2, ..good }),
            ("damping", ServoPoles { damping: f64::NAN, real_rad_us: None, ..good }),
            ("real_rad_us", ServoPoles { real_rad_us: Some(-1.0), ..good }),
        ] {
            assert!(poles.validate().unwrap_err().to_string().starts_with(name));
        }
    }
}
