//! What a planner is asked to do.

use lasergym_ablation::{Footprint, MAX_PULSE_RADIUS_PX, Pulse, PulseOutcome, Score, Workpiece};
use lasergym_geom::{Bitmap, Point, WORKPIECE_SIZE_PX};

use crate::PlanError;

/// Most pulses a job may allow: one for every pixel of the workpiece.
pub const MAX_JOB_PULSES: usize = WORKPIECE_SIZE_PX * WORKPIECE_SIZE_PX;

/// A workpiece to be machined, which may be partly machined already, with a number of equal pulses.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    workpiece: Workpiece,
    pulse_radius_px: f64,
    max_pulses: usize,
}

impl Job {
    /// The job of machining what remains of the target on `workpiece` with at most `max_pulses`
    /// pulses of `pulse_radius_px`.
    ///
    /// # Errors
    /// - [`PlanError::NoPulses`], [`PlanError::TooManyPulses`] when `max_pulses` is not in
    ///   1..=[`MAX_JOB_PULSES`];
    /// - [`PlanError::PulseRadius`] when the radius is not in (0, 50] px;
    /// - [`PlanError::NothingRemains`] when no target is left.
    pub fn new(
        workpiece: Workpiece,
        pulse_radius_px: f64,
        max_pulses: usize,
    ) -> Result<Self, PlanError> {
        if max_pulses == 0 {
            return Err(PlanError::NoPulses);
        }
        if max_pulses > MAX_JOB_PULSES {
            return Err(PlanError::TooManyPulses { max_pulses, limit: MAX_JOB_PULSES });
        }
        if !(pulse_radius_px > 0.0 && pulse_radius_px <= MAX_PULSE_RADIUS_PX) {
            let limit = MAX_PULSE_RADIUS_PX;
            return Err(PlanError::PulseRadius { radius_px: pulse_radius_px, limit });
        }
        if workpiece.remaining().is_empty() {
            return Err(PlanError::NothingRemains);
        }
        Ok(Self { workpiece, pulse_radius_px, max_pulses })
    }

    /// The workpiece before the first pulse.
    #[must_use]
    pub fn workpiece(&self) -> &Workpiece {
        &self.workpiece
    }

    /// Target that remains before the first pulse.
    #[must_use]
    pub fn target(&self) -> &Bitmap {
        self.workpiece.remaining()
    }

    /// Radius of every pulse, px.
    #[must_use]
    pub fn pulse_radius_px(&self) -> f64 {
        self.pulse_radius_px
    }

    /// Most pulses the plan may have.
    #[must_use]
    pub fn max_pulses(&self) -> usize {
        self.max_pulses
    }

    /// The pixels that a pulse of this job at `position` covers.
    #[must_use]
    #[inline]
    pub fn footprint(&self, position: Point) -> Footprint {
        Footprint::of(Pulse { position, radius_px: self.pulse_radius_px })
    }

    /// What `positions` machine together. A pixel is machined once, so the pulses may be laid over
    /// one another first and compared with the workpiece then.
    #[must_use]
    pub fn outcome(&self, positions: &[Point]) -> PulseOutcome {
        let mut covered = [0; WORKPIECE_SIZE_PX];
        for &position in positions {
            let footprint = self.footprint(position);
            let (first_row, spans) = footprint.rows();
            for (row, span) in covered[first_row..].iter_mut().zip(spans) {
                *row |= span.mask();
            }
        }
        let area_px = |bitmap: &Bitmap| {
            covered.iter().zip(bitmap.rows()).map(|(row, pixels)| (row & pixels).count_ones()).sum()
        };
        PulseOutcome {
            hit_px: area_px(self.workpiece.remaining()),
            miss_px: area_px(self.workpiece.forbidden()),
        }
    }

    /// Judges `positions` by what they add to the workpiece: both fractions are of the target that
    /// remains before the first pulse. On a pristine workpiece this is [`lasergym_ablation::score`].
    ///
    /// # Errors
    /// [`PlanError::PositionNotFinite`].
    pub fn score(&self, positions: &[Point]) -> Result<Score, PlanError> {
        check_positions(positions)?;
        let outcome = self.outcome(positions);
        let area_px = f64::from(self.target().area_px());
        Ok(Score {
            reward: outcome.reward(),
            machined_fraction: f64::from(outcome.hit_px) / area_px,
            off_target_fraction: f64::from(outcome.miss_px) / area_px,
            pulses: positions.len(),
        })
    }

    /// The reward that no plan can exceed: all that remains machined and nothing else.
    #[must_use]
    pub fn reward_limit(&self) -> f64 {
        reward_of(self.target().area_px().cast_signed())
    }
}

/// The reward of hits − misses, exactly as [`PulseOutcome::reward`] has it.
pub(crate) fn reward_of(gain_px: i32) -> f64 {
    f64::from(gain_px) / (WORKPIECE_SIZE_PX * WORKPIECE_SIZE_PX) as f64
}

/// Accepts positions that are finite.
pub(crate) fn check_positions(positions: &[Point]) -> Result<(), PlanError> {
    match positions.iter().enumerate().find(|(_, p)| !(p.x.is_finite() && p.y.is_finite())) {
        Some((index, &Point { x, y })) => Err(PlanError::PositionNotFinite { index, x, y }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_ablation::star;
    use proptest::prelude::*;

    fn workpiece() -> Workpiece {
        Workpiece::new(&star(0.0)).unwrap()
    }

    #[test]
    fn zero_pulses_are_refused() {
        assert_eq!(Job::new(workpiece(), 9.0, 0), Err(PlanError::NoPulses));
    }

    #[test]
    fn more_pulses_than_pixels_are_refused() {
        assert!(Job::new(workpiece(), 9.0, 10_000).is_ok());
        let refused = PlanError::TooManyPulses { max_pulses: 10_001, limit: 10_000 };
        assert_eq!(Job::new(workpiece(), 9.0, 10_001), Err(refused));
    }

    #[test]
    fn a_radius_out_of_range_is_refused() {
        for radius_px in [0.0, -1.0, 50.1, f64::INFINITY, f64::NAN] {
            let error = Job::new(workpiece(), radius_px, 45).unwrap_err();
            assert!(matches!(error, PlanError::PulseRadius { .. }), "{error}");
        }
    }

    #[test]
    fn a_workpiece_without_target_is_refused() {
        let done = Workpiece::partly_machined(&Bitmap::EMPTY, &star(0.0).complement());
        assert_eq!(Job::new(done, 9.0, 45), Err(PlanError::NothingRemains));
    }

    #[test]
    fn a_position_that_is_not_finite_is_named() {
        let job = Job::new(workpiece(), 9.0, 45).unwrap();
        let positions = [Point::new(1.0, 2.0), Point::new(f64::NAN, 2.0)];
        let error = job.score(&positions).unwrap_err();
        assert!(matches!(error, PlanError::PositionNotFinite { index: 1, .. }), "{error}");
    }

    proptest! {
        #[test]
        fn a_job_scores_as_the_process_does(
            positions in proptest::collection::vec((-10.0..110.0, -10.0..110.0), 0..60),
            radius_px in 0.1..50.0,
        ) {
            let job = Job::new(workpiece(), radius_px, 45).unwrap();
            let positions: Vec<Point> = positions.iter().map(|&(x, y)| Point::new(x, y)).collect();
            let expected = lasergym_ablation::score(&star(0.0), &positions, radius_px).unwrap();
            prop_assert_eq!(job.score(&positions).unwrap(), expected);
        }
    }
}
