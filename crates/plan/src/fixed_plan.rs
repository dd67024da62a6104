//! Open loop: a plan that is fired as it is, whatever happens.

use lasergym_geom::Point;

use crate::job::check_positions;
use crate::{Decider, JobState, PlanError};

/// Fires the pulses of a plan in turn and looks at nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct FixedPlan {
    positions: Vec<Point>,
    next: usize,
}

impl FixedPlan {
    /// The plan of `positions`, px, in firing order.
    ///
    /// # Errors
    /// [`PlanError::PositionNotFinite`].
    pub fn new(positions: Vec<Point>) -> Result<Self, PlanError> {
        check_positions(&positions)?;
        Ok(Self { positions, next: 0 })
    }
}

impl Decider for FixedPlan {
    fn decide(&mut self, _: &JobState) -> Result<Option<Point>, PlanError> {
        let position = self.positions.get(self.next).copied();
        self.next += 1;
        Ok(position)
    }

    fn recall(&mut self, _: &JobState, _: Point) -> Result<(), PlanError> {
        self.next += 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Job;
    use lasergym_ablation::{Workpiece, star};

    #[test]
    fn the_plan_is_fired_in_order_and_ends() {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 5).unwrap();
        let positions = vec![Point::new(1.0, 2.0), Point::new(50.0, 50.0)];
        let mut plan = FixedPlan::new(positions.clone()).unwrap();
        let state = plan.start(&job);
        assert_eq!(plan.decide(&state), Ok(Some(positions[0])));
        assert_eq!(plan.decide(&state), Ok(Some(positions[1])));
        assert_eq!(plan.decide(&state), Ok(None));
    }

    #[test]
    fn a_position_that_is_not_finite_is_refused() {
        let error = FixedPlan::new(vec![Point::new(f64::NAN, 0.0)]).unwrap_err();
        assert!(matches!(error, PlanError::PositionNotFinite { index: 0, .. }));
    }
}
