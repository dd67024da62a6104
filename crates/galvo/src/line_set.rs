//! Lines at one speed on one head, on which corrections of the formulas are tuned.

use lasergym_geom::Point;

use crate::compensation::{Compensation, Compensator, HeadKnowledge, Method, StraightStroke};
use crate::correction::{CORRECTION_VALUES, Correction};
use crate::line_trial::{LineOutcome, LineScales, LineTrial, PulseFit};
use crate::{GalvoError, ScanHead};

/// Lines with the offsets and delays of the formulas, to be corrected.
#[derive(Debug, Clone)]
pub struct LineSet {
    method: Method,
    lines: Vec<(LineTrial, Compensation)>,
}

/// What a line that cannot be machined costs.
const WORST_COST: f64 = 1e3;

/// What the lines of a set have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineKind {
    /// Which formulas.
    pub method: Method,
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// Crater diameter by which lines are shortened, µm.
    pub beam_um: f64,
    /// Distance of pulses, about, µm.
    pub pitch_um: f64,
    /// Part by which pulses may be nearer or farther apart, for the formulas of models.
    pub tolerance: f64,
    /// What costs 1.
    pub scales: LineScales,
}

impl LineSet {
    /// Lines of `(length µm, angle rad)` on `head`, of which `known` is known; the response time of
    /// the laser that the formulas allow for is that of `known`.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] for what is out of range.
    pub fn new(
        head: &ScanHead,
        known: &ScanHead,
        kind: &LineKind,
        lines: &[(f64, f64)],
    ) -> Result<Self, GalvoError> {
        kind.scales.validate()?;
        let knowledge = HeadKnowledge::of_head(known);
        let LineKind { method, speed_m_s, beam_um, pitch_um, tolerance, scales } = *kind;
        let mut compensator = Compensator::new(&knowledge, method, beam_um, tolerance)?;
        let lines = lines
            .iter()
            .map(|&(length_um, angle_rad)| {
                let trial = LineTrial {
                    head: head.clone(),
                    speed_m_s,
                    length_um,
                    angle_rad,
                    beam_um,
                    pitch_um,
                    known_response_us: known.laser.response_us,
                    fit: PulseFit::Gate,
                    scales,
                };
                let found = compensator.compensation(&StraightStroke {
                    speed_m_s,
                    direction: trial.direction(),
                    length_um: Some(length_um),
                })?;
                Ok((trial, found))
            })
            .collect::<Result<_, GalvoError>>()?;
        Ok(Self { method, lines })
    }

    /// What the lines come out as with a correction.
    ///
    /// # Errors
    /// As [`LineTrial::machine`].
    pub fn outcomes(&self, correction: &Correction) -> Result<Vec<LineOutcome>, GalvoError> {
        self.lines.iter().map(|line| self.machine(line, correction)).collect()
    }

    /// Mean cost of the lines with each correction, given by its values; a line that cannot be
    /// machined costs 1000.
    #[must_use]
    pub fn costs(&self, rows: &[[f64; CORRECTION_VALUES]]) -> Vec<f64> {
        rows.iter()
            .map(|values| {
                let correction = Correction::of_values(*values);
                let costs = self.lines.iter().map(|line| {
                    self.machine(line, &correction).map_or(WORST_COST, |made| made.cost)
                });
                costs.sum::<f64>() / self.lines.len().max(1) as f64
            })
            .collect()
    }

    fn machine(
        &self,
        (trial, found): &(LineTrial, Compensation),
        correction: &Correction,
    ) -> Result<LineOutcome, GalvoError> {
        let direction: Point = trial.direction();
        trial.machine(&correction.apply(self.method, found, trial.speed_m_s, direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AxisModel, Follower, ServoPoles};

    fn kind(method: Method) -> LineKind {
        LineKind {
            method,
            speed_m_s: 2.0,
            beam_um: 40.0,
            pitch_um: 20.0,
            tolerance: 0.02,
            scales: LineScales::default(),
        }
    }

    #[test]
    fn formulas_of_the_own_model_meet_both_edges_of_lines_of_any_length() {
        for (name, _) in ScanHead::shipped_texts() {
            let head = ScanHead::shipped(name).unwrap();
            let lines: Vec<(f64, f64)> = [80.0, 200.0, 500.0, 1000.0, 5000.0]
                .into_iter()
                .enumerate()
                .map(|(k, length)| (length, 0.7 * k as f64))
                .collect();
            let set = LineSet::new(&head, &head, &kind(Method::Adaptive), &lines).unwrap();
            for made in set.outcomes(&Correction::default()).unwrap() {
                assert!(made.edge_errors_um.iter().all(|e| e.abs() < 0.5), "{name}: {made:?}");
                // On short lines what is left of the start and of the stop adds up.
                assert!(made.pitch_deviation < 0.041, "{name}: {made:?}");
                // Limited axes settle at different times when they move at different speeds.
                let beside_um = if head.x.is_linear() { 1e-6 } else { 5.0 };
                assert!(made.lateral_error_um < beside_um, "{name}: {made:?}");
            }
        }
    }

    #[test]
    fn axes_that_differ_make_straight_lines_of_the_right_length() {
        let servo = |lag_us| AxisModel {
            follower: Follower::Servo(ServoPoles::bessel(lag_us)),
            dead_time_us: 0.0,
        };
        let head = ScanHead { y: servo(280.0), ..ScanHead::with_axis(servo(216.4)) };
        let lines: Vec<(f64, f64)> = (0..20).map(|k| (1000.0, 0.314 * f64::from(k))).collect();
        let worst = |known: &ScanHead, of: fn(&LineOutcome) -> f64| {
            let set = LineSet::new(&head, known, &kind(Method::Adaptive), &lines).unwrap();
            let made = set.outcomes(&Correction::default()).unwrap();
            made.iter().map(of).fold(0.0, f64::max)
        };
        let edge =
            |made: &LineOutcome| made.edge_errors_um[0].abs().max(made.edge_errors_um[1].abs());
        let lateral = |made: &LineOutcome| made.lateral_error_um;
        assert!(worst(&head, edge) < 1.0, "{}", worst(&head, edge));
        assert!(worst(&head, lateral) < 5.0, "{}", worst(&head, lateral));
        // Taken for alike, they draw lines that are wrong by V times the difference of the lags.
        let alike = ScanHead::with_axis(servo(216.4));
        assert!(worst(&alike, edge) > 50.0 && worst(&alike, lateral) > 50.0);
        // A correction of the skew is most of what such a head needs.
        let set = LineSet::new(&head, &alike, &kind(Method::Adaptive), &lines).unwrap();
        let skewed = Correction { skew_us: 63.6, run_in_us: 200.0, ..Correction::default() };
        for made in set.outcomes(&skewed).unwrap() {
            assert!(edge(&made) < 10.0 && lateral(&made) < 5.0, "{made:?}");
        }
    }
}
