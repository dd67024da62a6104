//! Heads known by their step response: linear, of any shape, with a finite memory.

use std::collections::VecDeque;

use crate::GalvoError;
use crate::servo::{MirrorState, Ramp};

/// First line of a step-response file.
pub const STEP_RESPONSE_HEADER: &str = "time_us,position";

/// Most samples of a step response.
pub const MAX_STEP_SAMPLES: usize = 4096;

/// The position after a unit step of the command, linear between samples; 0 before the first sample
/// and 1 from the last on.
#[derive(Debug, Clone, PartialEq)]
pub struct StepResponse {
    /// Increasing times, µs, the first at least 0.
    times_us: Vec<f64>,
    /// Rise in each interval, and its duration: the impulse response is their quotient.
    rises: Vec<f64>,
}

impl StepResponse {
    /// The response through `(time_us, position)`; positions are scaled so that the last is 1 and the
    /// first is 0.
    ///
    /// # Errors
    /// [`GalvoError::StepResponse`] when there are fewer than 2 or more than [`MAX_STEP_SAMPLES`]
    /// samples, times do not increase from 0 or more, values are not finite, or the response does not
    /// rise.
    pub fn new(samples: &[(f64, f64)]) -> Result<Self, GalvoError> {
        let fault = |reason: String| Err(GalvoError::StepResponse { reason });
        if !(2..=MAX_STEP_SAMPLES).contains(&samples.len()) {
            let count = samples.len();
            return fault(format!("{count} samples; 2 to {MAX_STEP_SAMPLES} are accepted"));
        }
        if samples.iter().any(|(t, x)| !t.is_finite() || !x.is_finite() || t.abs() > 1e6) {
            return fault("a sample is not finite or beyond 1e6 µs".to_owned());
        }
        if samples[0].0 < 0.0 || samples.windows(2).any(|pair| pair[1].0 <= pair[0].0) {
            return fault("times must increase from 0 or later".to_owned());
        }
        let (first, last) = (samples[0].1, samples[samples.len() - 1].1);
        let height = last - first;
        if height.abs() <= 1e-9 * first.abs().max(last.abs()).max(1e-12) {
            return fault("the last position equals the first".to_owned());
        }
        Ok(Self {
            times_us: samples.iter().map(|sample| sample.0).collect(),
            rises: samples.windows(2).map(|pair| (pair[1].1 - pair[0].1) / height).collect(),
        })
    }

    /// Constant acceleration for `time_us`, whatever the speed: the mean of the command over that
    /// time.
    ///
    /// # Errors
    /// As [`StepResponse::new`].
    pub fn constant_acceleration(time_us: f64) -> Result<Self, GalvoError> {
        Self::new(&[(0.0, 0.0), (time_us, 1.0)])
    }

    /// The response in a text: [`STEP_RESPONSE_HEADER`], then a line for each sample.
    ///
    /// # Errors
    /// [`GalvoError::Table`] for what is no table of numbers, otherwise as [`StepResponse::new`].
    pub fn from_csv(text: &str) -> Result<Self, GalvoError> {
        let rows = crate::table::read_table(text, STEP_RESPONSE_HEADER)?;
        let samples: Vec<(f64, f64)> = rows.iter().map(|row| (row[0], row[1])).collect();
        Self::new(&samples)
    }

    /// The lag τ behind a ramp, µs: the mean of the impulse response.
    #[must_use]
    pub fn lag_us(&self) -> f64 {
        let middles = self.times_us.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
        middles.zip(&self.rises).map(|(middle, rise)| middle * rise).sum()
    }

    /// How far back the mirror remembers its command, µs.
    #[must_use]
    pub fn memory_us(&self) -> f64 {
        self.times_us.last().copied().unwrap_or(0.0)
    }
}

/// A head with a step response on its way.
#[derive(Debug, Clone)]
pub(crate) struct StepState {
    response: StepResponse,
    /// Ramps within memory, the last one current, with the time since each began.
    past: VecDeque<(Ramp, f64)>,
    /// Command before the first of them, µm.
    before_um: f64,
}

impl StepState {
    /// At rest at `position_um`.
    pub(crate) fn new(response: &StepResponse, position_um: f64) -> Self {
        Self { response: response.clone(), past: VecDeque::new(), before_um: position_um }
    }

    /// The command goes on along `ramp`.
    pub(crate) fn begin(&mut self, ramp: Ramp) {
        self.past.push_back((ramp, 0.0));
    }

    /// Lets `t_us` go by.
    pub(crate) fn advance(&mut self, t_us: f64) {
        for (_, age_us) in &mut self.past {
            *age_us += t_us;
        }
        let memory_us = self.response.memory_us();
        while self.past.len() > 1 && self.past[1].1 > memory_us {
            if let Some((ramp, _)) = self.past.pop_front() {
                self.before_um = ramp.start_um + ramp.speed * ramp.duration_us;
            }
        }
    }

    /// Position and speed now: Σ (rise/duration) ∫ u(t − θ) dθ over the intervals.
    pub(crate) fn mirror(&self) -> MirrorState {
        let mut state = MirrorState::default();
        let mut index = self.past.len();
        for (k, rise) in self.response.rises.iter().enumerate() {
            let (from, to) = (self.response.times_us[k], self.response.times_us[k + 1]);
            // Ramps from the newest to the oldest that [from, to] reaches.
            while index > 0 && self.past[index - 1].1 <= from {
                index -= 1;
            }
            let (mut begin, mut area, mut climb) = (from, 0.0, 0.0);
            let mut at = index;
            while begin < to {
                let Some((ramp, age_us)) = at.checked_sub(1).map(|older| self.past[older]) else {
                    area += (to - begin) * self.before_um;
                    break;
                };
                // In [begin, end] the command was on this ramp, age − θ after its start; before the
                // ramp began (θ > age) it was on an older one.
                let end = to.min(age_us);
                if end > begin {
                    let middle = age_us - 0.5 * (begin + end);
                    area += (end - begin) * (ramp.start_um + ramp.speed * middle);
                    climb += (end - begin) * ramp.speed;
                    begin = end;
                }
                at -= 1;
            }
            state.position_um += rise * area / (to - from);
            state.speed_m_s += rise * climb / (to - from);
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(start_um: f64, speed: f64) -> Ramp {
        Ramp { start_um, speed, duration_us: 1e4 }
    }

    #[test]
    fn a_constant_acceleration_gives_a_parabola() {
        let response = StepResponse::constant_acceleration(350.0).unwrap();
        let mut state = StepState::new(&response, 10.0);
        state.begin(ramp(10.0, 2.0));
        state.advance(100.0);
        // a = V/T = 2/350 µm/µs².
        let (a, mirror) = (2.0 / 350.0, state.mirror());
        assert!((mirror.position_um - 10.0 - 0.5 * a * 1e4).abs() < 1e-9);
        assert!((mirror.speed_m_s - a * 100.0).abs() < 1e-12);
        state.advance(400.0);
        assert!((state.mirror().position_um - (10.0 + 2.0 * (500.0 - 175.0))).abs() < 1e-9);
        assert!((response.lag_us() - 175.0).abs() < 1e-12);
    }

    #[test]
    fn a_finely_sampled_servo_agrees_with_its_closed_form() {
        use crate::servo::{ServoPoles, ServoState};
        let poles = ServoPoles::second_order(216.4, 0.7);
        let mut step = ServoState::new(&poles);
        step.kink(0.0, 1.0);
        let mut samples = vec![(0.0, 0.0)];
        for k in 1..=3000 {
            step.advance(1.0);
            samples.push((f64::from(k), step.mirror(1.0, 0.0).position_um));
        }
        let mut sampled = StepState::new(&StepResponse::new(&samples).unwrap(), 0.0);
        let mut exact = ServoState::new(&poles);
        sampled.begin(ramp(0.0, 2.0));
        exact.kink(2.0, 0.0);
        for k in 1..=20 {
            sampled.advance(37.0);
            exact.advance(37.0);
            let difference =
                sampled.mirror().position_um - exact.mirror(74.0 * f64::from(k), 2.0).position_um;
            assert!(difference.abs() < 1e-2, "{difference} µm");
        }
    }

    #[test]
    fn useless_responses_are_refused() {
        for samples in [
            vec![(0.0, 0.0)],
            vec![(0.0, 0.0), (0.0, 1.0)],
            vec![(-1.0, 0.0), (1.0, 1.0)],
            vec![(0.0, 1.0), (1.0, 1.0)],
            vec![(0.0, f64::NAN), (1.0, 1.0)],
        ] {
            assert!(matches!(StepResponse::new(&samples), Err(GalvoError::StepResponse { .. })));
        }
    }

    #[test]
    fn a_file_is_read() {
        let text = "time_us,position\n0,0\n100, 0.5\n200,2\n";
        let response = StepResponse::from_csv(text).unwrap();
        assert_eq!(response.rises, [0.25, 0.75]);
        assert!((response.lag_us() - (0.25 * 50.0 + 0.75 * 150.0)).abs() < 1e-12);
        assert!(StepResponse::from_csv("time_us,position\n0,0\n1,x\n").is_err());
    }
}
