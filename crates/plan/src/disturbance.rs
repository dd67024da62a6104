//! Jobs whose pulses do not land where they are aimed, without a machine: what deciding pulse by
//! pulse is worth (Xie et al. 2022, section 3.4).

use lasergym_ablation::{Footprint, Pulse, Score, Stream};
use lasergym_geom::Point;

use crate::{Decider, Job, PlanError};

/// What keeps pulses from landing where they are aimed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Disturbance {
    /// One pulse that lands at a certain place, px, wherever it is aimed: its number, from 1.
    pub displaced: Option<(usize, Point)>,
    /// Standard deviation of every pulse in x and in y, px.
    pub vibration_px: f64,
    /// Play of the stage in x and in y, px: it follows only when it is pushed.
    pub backlash_px: f64,
    /// How far the stage creeps with each pulse, always the same way, px.
    pub drift_px_per_pulse: f64,
    /// Probability that a pulse does nothing.
    pub misfire_probability: f64,
}

impl Disturbance {
    /// Checks every value.
    ///
    /// # Errors
    /// [`PlanError::Disturbance`] names the first one out of range.
    pub fn validate(&self) -> Result<(), PlanError> {
        let lengths = [
            ("vibration_px", self.vibration_px),
            ("backlash_px", self.backlash_px),
            ("drift_px_per_pulse", self.drift_px_per_pulse),
        ];
        for (name, value) in lengths {
            if !(0.0..=50.0).contains(&value) {
                return Err(PlanError::Disturbance { name, value, expected: "in [0, 50]" });
            }
        }
        let value = self.misfire_probability;
        if !(0.0..=1.0).contains(&value) {
            let name = "misfire_probability";
            return Err(PlanError::Disturbance { name, value, expected: "in [0, 1]" });
        }
        match self.displaced {
            Some((number, Point { x, y })) if !(x.is_finite() && y.is_finite()) => {
                Err(PlanError::PositionNotFinite { index: number, x, y })
            }
            _ => Ok(()),
        }
    }
}

/// A job as it went.
#[derive(Debug, Clone, PartialEq)]
pub struct DisturbedJob {
    /// Where the pulses were aimed, px.
    pub aimed: Vec<Point>,
    /// Where they landed, px; `None` where nothing happened.
    pub landed: Vec<Option<Point>>,
    /// What was achieved; every pulse that was commanded counts.
    pub score: Score,
}

/// Does `job` under `disturbance`: `decider` sees where each pulse has landed, and decides the next
/// one from that. A pulse that did nothing is used up.
///
/// # Errors
/// [`PlanError::Disturbance`], or what the decider says.
pub fn disturbed_job(
    job: &Job,
    decider: &mut dyn Decider,
    disturbance: &Disturbance,
    seed: u64,
) -> Result<DisturbedJob, PlanError> {
    disturbance.validate()?;
    let mut stream = Stream::from_seed(seed);
    let creep = Point::new(disturbance.drift_px_per_pulse, 0.0)
        .rotated_about(Point::default(), std::f64::consts::TAU * stream.uniform());
    let half_play = 0.5 * disturbance.backlash_px;
    let mut stage: Option<Point> = None;
    let mut state = decider.start(job);
    let (mut aimed, mut landed) = (Vec::new(), Vec::new());
    while state.pulses_left() > 0 {
        let Some(aim) = decider.decide(&state)? else { break };
        aimed.push(aim);
        let follow = |at: f64, goal: f64| at.clamp(goal - half_play, goal + half_play);
        let before = stage.unwrap_or(aim);
        let at = Point::new(follow(before.x, aim.x), follow(before.y, aim.y));
        stage = Some(at);
        let shaken = stream.displacement(disturbance.vibration_px);
        let misfire = stream.uniform() < disturbance.misfire_probability;
        let place = match disturbance.displaced {
            Some((number, place)) if number == aimed.len() => place,
            _ => at + shaken + creep * (aimed.len() - 1) as f64,
        };
        if misfire {
            landed.push(None);
        } else {
            state.machine(&Footprint::of(Pulse {
                position: place,
                radius_px: job.pulse_radius_px(),
            }));
            landed.push(Some(place));
        }
        state.count_pulse();
    }
    let positions: Vec<Point> = landed.iter().copied().flatten().collect();
    let score = Score { pulses: aimed.len(), ..job.score(&positions)? };
    Ok(DisturbedJob { aimed, landed, score })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FixedPlan, Greedy, Planner};
    use lasergym_ablation::{Workpiece, star};

    fn job() -> Job {
        Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 40).unwrap()
    }

    #[test]
    fn without_disturbance_pulses_land_where_they_are_aimed() {
        let plan = Greedy::default().plan_to_end(&job()).unwrap();
        let made =
            disturbed_job(&job(), &mut Greedy::default(), &Disturbance::default(), 1).unwrap();
        assert_eq!(made.aimed, plan.positions);
        assert_eq!(made.landed, made.aimed.iter().copied().map(Some).collect::<Vec<_>>());
        assert_eq!(made.score, plan.score);
    }

    #[test]
    fn one_pulse_is_displaced_and_the_others_are_not() {
        let place = Point::new(3.0, 97.0);
        let disturbance = Disturbance { displaced: Some((5, place)), ..Disturbance::default() };
        let made = disturbed_job(&job(), &mut Greedy::default(), &disturbance, 1).unwrap();
        assert_eq!(made.landed[4], Some(place));
        for (k, (aimed, landed)) in made.aimed.iter().zip(&made.landed).enumerate() {
            assert!(k == 4 || Some(*aimed) == *landed);
        }
    }

    #[test]
    fn a_closed_loop_earns_more_than_its_own_plan_in_an_open_one() {
        let plan = Greedy::default().plan_to_end(&job()).unwrap().positions;
        let disturbance =
            Disturbance { vibration_px: 2.0, misfire_probability: 0.05, ..Disturbance::default() };
        let mean = |decider: &dyn Fn() -> Box<dyn Decider>| -> f64 {
            (0..20)
                .map(|seed| {
                    let made = disturbed_job(&job(), &mut *decider(), &disturbance, seed);
                    made.unwrap().score.reward
                })
                .sum::<f64>()
                / 20.0
        };
        let closed = mean(&|| Box::new(Greedy::default()));
        let open = mean(&|| Box::new(FixedPlan::new(plan.clone()).unwrap()));
        assert!(closed > open + 0.005, "{closed} {open}");
    }

    #[test]
    fn a_laser_that_never_fires_machines_nothing() {
        let disturbance = Disturbance { misfire_probability: 1.0, ..Disturbance::default() };
        let made = disturbed_job(&job(), &mut Greedy::default(), &disturbance, 1).unwrap();
        assert_eq!((made.score.reward, made.score.pulses), (0.0, 40));
    }

    #[test]
    fn backlash_holds_the_stage_within_half_of_it() {
        let disturbance = Disturbance { backlash_px: 3.0, ..Disturbance::default() };
        let made = disturbed_job(&job(), &mut Greedy::default(), &disturbance, 1).unwrap();
        for (aimed, landed) in made.aimed.iter().zip(made.landed.iter().flatten()) {
            assert!((aimed.x - landed.x).abs() <= 1.5 && (aimed.y - landed.y).abs() <= 1.5);
        }
        assert_eq!(made.landed[0], Some(made.aimed[0]));
    }

    #[test]
    fn values_out_of_range_are_named() {
        for (name, disturbance) in [
            ("vibration_px", Disturbance { vibration_px: -1.0, ..Disturbance::default() }),
            ("backlash_px", Disturbance { backlash_px: f64::NAN, ..Disturbance::default() }),
            ("misfire_probability", Disturbance { misfire_probability: 1.1, ..Default::default() }),
        ] {
            let error = disturbed_job(&job(), &mut Greedy::default(), &disturbance, 1).unwrap_err();
            assert!(matches!(error, PlanError::Disturbance { name: n, .. } if n == name));
        }
    }
}
