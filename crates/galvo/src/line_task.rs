//! A contextual problem: one line on a head that is only known by its test lines.

use lasergym_geom::Point;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use crate::approach::acceleration_us;
use crate::axis::{AxisModel, Follower};
use crate::calibration::{Calibration, Regression};
use crate::compensation::{Compensation, HeadKnowledge, Method, StraightStroke};
use crate::error::check_option;
use crate::line_trial::{LineOutcome, LineScales, LineTrial, PulseFit};
use crate::servo::ServoPoles;
use crate::step_response::StepResponse;
use crate::{GalvoError, ScanHead};

/// Values of an observation.
pub const LINE_OBSERVATION: usize = 6;

/// Values of an action.
pub const LINE_ACTION: usize = 4;

/// Crater diameter and distance of pulses, µm.
const BEAM_UM: f64 = 40.0;
const PITCH_UM: f64 = 20.0;

/// What lies beyond counts as this.
const WORST_COST: f64 = 20.0;

/// Ranges of what is drawn.
const SPEED_M_S: (f64, f64) = (0.25, 2.0);
const LENGTH_UM: (f64, f64) = (80.0, 2000.0);
const LAG_US: (f64, f64) = (120.0, 320.0);

/// Largest run-in, run-out, laser-on and laser-off times of an action, in lags.
const ACTION_LAGS: [(f64, f64); LINE_ACTION] = [(0.0, 6.0), (0.0, 3.0), (0.0, 9.0), (-3.0, 3.0)];

/// Settings of the problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineOptions {
    /// Standard deviation of measured lag and acceleration lengths at 1 m/s, µm, in [0, 100]. Default
    /// 1.5.
    pub noise_um: f64,
    /// What costs 1.
    pub scales: LineScales,
}

impl Default for LineOptions {
    fn default() -> Self {
        Self { noise_um: 1.5, scales: LineScales::default() }
    }
}

impl LineOptions {
    /// Accepts finite values within the ranges of their fields.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        let noise = self.noise_um;
        check_option("noise_um", noise, (0.0..=100.0).contains(&noise), "in [0, 100] µm")?;
        self.scales.validate()
    }
}

/// One line on one head.
#[derive(Debug, Clone)]
pub struct LineTask {
    generator: Pcg64,
    options: LineOptions,
    head: ScanHead,
    speed_m_s: f64,
    length_um: f64,
    angle_rad: f64,
    known: Calibration,
}

impl LineTask {
    /// The problem with its random stream (PCG XSL RR 128/64); [`LineTask::reset`] draws the first
    /// line.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] when [`LineOptions::validate`] refuses the options.
    pub fn new(options: LineOptions, seed: u64) -> Result<Self, GalvoError> {
        options.validate()?;
        let unknown = Regression::proportional(0.0);
        let mut task = Self {
            generator: Pcg64::seed_from_u64(seed),
            options,
            head: ScanHead::default(),
            speed_m_s: 1.0,
            length_um: 1000.0,
            angle_rad: 0.0,
            known: Calibration { lag: unknown.clone(), acceleration: unknown, lead: None },
        };
        task.reset(None)?;
        Ok(task)
    }

    /// Draws a new head and line; a seed starts the random stream anew.
    ///
    /// # Errors
    /// None for options that are valid.
    pub fn reset(&mut self, seed: Option<u64>) -> Result<(), GalvoError> {
        if let Some(seed) = seed {
            self.generator = Pcg64::seed_from_u64(seed);
        }
        let lag_us = self.between(LAG_US);
        let shape = self.uniform();
        let axis = match (self.uniform() * 4.0) as u32 {
            0 => servo(ServoPoles::bessel(lag_us), 0.0),
            1 => servo(ServoPoles::second_order(lag_us, 0.65 + 0.3 * shape), 0.0),
            2 => {
                let dead_us = (0.2 + 0.3 * shape) * lag_us;
                servo(ServoPoles::second_order(lag_us - dead_us, 0.8), dead_us)
            }
            _ => {
                let dead_time_us = 0.3 * shape * lag_us;
                let response = StepResponse::constant_acceleration(2.0 * (lag_us - dead_time_us))?;
                AxisModel { follower: Follower::Step(response), dead_time_us }
            }
        };
        self.head = ScanHead::with_axis(axis);
        self.speed_m_s = self.between(SPEED_M_S);
        let (short, long) = LENGTH_UM;
        self.length_um = short * (long / short).powf(self.uniform());
        self.angle_rad = std::f64::consts::TAU * self.uniform();
        let acceleration_um = acceleration_us(&self.head.x, 0.02);
        let mut measured = |length_um: f64| {
            let noise: f64 = StandardNormal.sample(&mut self.generator);
            Regression::proportional((length_um + self.options.noise_um * noise).max(1.0))
        };
        self.known = Calibration {
            lag: measured(lag_us),
            acceleration: measured(acceleration_um),
            lead: None,
        };
        Ok(())
    }

    /// What the agent knows, each value in [−1, 1]: speed, length (logarithmic), cosine and sine of
    /// the direction, measured lag, measured acceleration length over lag.
    #[must_use]
    pub fn observation(&self) -> [f32; LINE_OBSERVATION] {
        let scaled = |value: f64, (low, high): (f64, f64)| {
            (2.0 * (value - low) / (high - low) - 1.0).clamp(-1.0, 1.0) as f32
        };
        let lag_us = self.known.lag.slope_us;
        let (sin, cos) = self.angle_rad.sin_cos();
        [
            scaled(self.speed_m_s, SPEED_M_S),
            scaled(self.length_um.ln(), (LENGTH_UM.0.ln(), LENGTH_UM.1.ln())),
            cos as f32,
            sin as f32,
            scaled(lag_us, (0.0, 500.0)),
            scaled(self.known.acceleration.slope_us / lag_us, (0.0, 6.0)),
        ]
    }

    /// Machines the line with the offsets and delays of `action`, each in [−1, 1]; what exceeds is
    /// clipped. They count in measured lags: run-in 0 to 6, run-out 0 to 3, laser on 0 to 9 after the
    /// start, last pulse −3 to 3 after the end of the extended line.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] when a value is not a number.
    pub fn step(&self, action: [f32; LINE_ACTION]) -> Result<LineOutcome, GalvoError> {
        for value in action {
            check_option("action", f64::from(value), value.is_finite(), "finite")?;
        }
        let made = self.trial().machine(&self.compensation_of(action))?;
        Ok(LineOutcome { cost: made.cost.min(WORST_COST), ..made })
    }

    /// The action of the postprocessor, which knows what the agent observes.
    ///
    /// # Errors
    /// None for a line that was drawn.
    pub fn baseline(&self) -> Result<[f32; LINE_ACTION], GalvoError> {
        let knowledge = HeadKnowledge::lines(self.known.clone());
        let stroke = StraightStroke {
            speed_m_s: self.speed_m_s,
            direction: Point::new(self.angle_rad.cos(), self.angle_rad.sin()),
            length_um: Some(self.length_um),
        };
        let found = knowledge.compensation(Method::Adaptive, &stroke, BEAM_UM, 0.02)?;
        let lag_us = self.known.lag.slope_us;
        let values = [
            found.run_in_um / self.speed_m_s,
            found.run_out_um / self.speed_m_s,
            found.on_us,
            found.off_us,
        ];
        let mut action = [0.0; LINE_ACTION];
        for (slot, (value, (low, high))) in action.iter_mut().zip(values.iter().zip(ACTION_LAGS)) {
            *slot = (2.0 * (value / lag_us - low) / (high - low) - 1.0).clamp(-1.0, 1.0) as f32;
        }
        Ok(action)
    }

    fn trial(&self) -> LineTrial {
        LineTrial {
            head: self.head.clone(),
            speed_m_s: self.speed_m_s,
            length_um: self.length_um,
            angle_rad: self.angle_rad,
            beam_um: BEAM_UM,
            pitch_um: PITCH_UM,
            known_response_us: 0.0,
            fit: PulseFit::Drawn,
            scales: self.options.scales,
        }
    }

    fn compensation_of(&self, action: [f32; LINE_ACTION]) -> Compensation {
        let lag_us = self.known.lag.slope_us;
        let mut times_us = [0.0; LINE_ACTION];
        for (slot, (value, (low, high))) in times_us.iter_mut().zip(action.iter().zip(ACTION_LAGS))
        {
            let part = 0.5 * (f64::from(*value).clamp(-1.0, 1.0) + 1.0);
            *slot = (low + (high - low) * part) * lag_us;
        }
        let [run_in_us, run_out_us, on_us, off_us] = times_us;
        Compensation {
            run_in_um: run_in_us * self.speed_m_s,
            run_out_um: run_out_us * self.speed_m_s,
            on_us,
            off_us,
            lag_us,
            settling_us: run_in_us,
            lateral_um: 0.0,
        }
    }

    fn uniform(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    fn between(&mut self, (low, high): (f64, f64)) -> f64 {
        low + (high - low) * self.uniform()
    }
}

fn servo(poles: ServoPoles, dead_time_us: f64) -> AxisModel {
    AxisModel { follower: Follower::Servo(poles), dead_time_us }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_lines() {
        let mut one = LineTask::new(LineOptions::default(), 5).unwrap();
        let mut two = LineTask::new(LineOptions::default(), 99).unwrap();
        two.reset(Some(5)).unwrap();
        for _ in 0..5 {
            assert_eq!(one.observation().map(f32::to_bits), two.observation().map(f32::to_bits));
            assert_eq!(one.step([0.1; 4]).unwrap(), two.step([0.1; 4]).unwrap());
            one.reset(None).unwrap();
            two.reset(None).unwrap();
        }
    }

    #[test]
    fn the_postprocessor_is_far_better_than_nothing() {
        let mut task = LineTask::new(LineOptions::default(), 1).unwrap();
        let (mut baseline, mut nothing) = (0.0, 0.0);
        for _ in 0..50 {
            let made = task.step(task.baseline().unwrap()).unwrap();
            assert!(made.cost < 6.0, "{made:?}");
            baseline += made.cost;
            nothing += task.step([-1.0, -1.0, -1.0, 0.0]).unwrap().cost;
            task.reset(None).unwrap();
        }
        assert!(baseline < 0.25 * nothing, "{baseline} {nothing}");
    }

    #[test]
    fn observations_stay_in_range() {
        let mut task = LineTask::new(LineOptions::default(), 2).unwrap();
        for _ in 0..200 {
            assert!(task.observation().iter().all(|value| (-1.0..=1.0).contains(value)));
            task.reset(None).unwrap();
        }
    }

    #[test]
    fn mistakes_are_refused() {
        let task = LineTask::new(LineOptions::default(), 3).unwrap();
        assert!(task.step([f32::NAN, 0.0, 0.0, 0.0]).is_err());
        let scales = LineScales { pitch: 0.0, ..LineScales::default() };
        let options = LineOptions { scales, ..LineOptions::default() };
        assert!(LineTask::new(options, 0).is_err());
    }
}
