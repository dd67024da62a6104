//! A job under way: what has been machined, and how promising every place is now.

use lasergym_ablation::{Footprint, PulseOutcome, Workpiece};
use lasergym_geom::{Bitmap, Point};

use crate::{Job, PlanError, RingScores};

/// A job after some of its pulses, for planners that decide pulse by pulse.
#[derive(Debug, Clone)]
pub struct JobState {
    job: Job,
    workpiece: Workpiece,
    scores: RingScores,
    pulses_left: usize,
}

impl JobState {
    /// `job` before its first pulse, with ring scores of `ring_weight`.
    #[must_use]
    pub fn new(job: &Job, ring_weight: f64) -> Self {
        Self {
            workpiece: job.workpiece().clone(),
            scores: RingScores::new(job.workpiece(), job.pulse_radius_px(), ring_weight),
            pulses_left: job.max_pulses(),
            job: job.clone(),
        }
    }

    /// The job as it was before the first pulse.
    #[must_use]
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// The workpiece now.
    #[must_use]
    pub fn workpiece(&self) -> &Workpiece {
        &self.workpiece
    }

    /// How promising each pixel centre is now.
    #[must_use]
    pub fn scores(&self) -> &RingScores {
        &self.scores
    }

    /// Pulses that the job still allows.
    #[must_use]
    pub fn pulses_left(&self) -> usize {
        self.pulses_left
    }

    /// Hits − misses that a pulse at `position` would add, px.
    #[must_use]
    #[inline]
    pub fn gain_px(&self, position: Point) -> i32 {
        self.workpiece.preview(&self.job.footprint(position)).gain_px()
    }

    /// Whether no pulse is left, or none at a pixel centre would gain anything.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.pulses_left == 0 || self.scores.gains().best().2 <= 0
    }

    /// What is left of the job, as one of its own.
    ///
    /// # Errors
    /// [`PlanError::NothingRemains`], [`PlanError::NoPulses`] for a job that is done.
    pub fn rest(&self) -> Result<Job, PlanError> {
        Job::new(self.workpiece.clone(), self.job.pulse_radius_px(), self.pulses_left)
    }

    /// Machines a pulse at `position` and counts it.
    pub fn pulse(&mut self, position: Point) -> PulseOutcome {
        self.count_pulse();
        self.machine(&self.job.footprint(position))
    }

    /// Counts a pulse, whatever it has machined.
    pub fn count_pulse(&mut self) {
        self.pulses_left = self.pulses_left.saturating_sub(1);
    }

    /// Machines the pixels under `footprint`, a disc of any radius that was seen on the workpiece. No
    /// pulse is counted: one may leave several marks.
    pub fn machine(&mut self, footprint: &Footprint) -> PulseOutcome {
        self.scores.machine(&mut self.workpiece, footprint)
    }

    /// Strikes the target under `footprint` off what remains, though it was not seen to be machined:
    /// nobody shall aim there any more. Gives its area, px.
    pub fn give_up(&mut self, footprint: &Footprint) -> u32 {
        let mut remaining = self.workpiece.remaining().clone();
        let mut area_px = 0;
        let (first_row, spans) = footprint.rows();
        for (row, span) in (first_row..).zip(spans) {
            let struck = remaining.rows()[row] & span.mask();
            remaining.rows_mut()[row] ^= struck;
            area_px += struck.count_ones();
            self.scores.machined(row, struck, 0);
        }
        self.workpiece = Workpiece::partly_machined(&remaining, self.workpiece.forbidden());
        area_px
    }

    /// A fingerprint of the workpiece: FNV-1a of 64 bits over the rows of the remaining target and
    /// then those of the forbidden ground, from top to bottom, each row as 16 bytes, least
    /// significant first, whose bit i is column i. The same on every machine and in every version.
    #[must_use]
    pub fn hash(&self) -> u64 {
        let layers = [self.workpiece.remaining(), self.workpiece.forbidden()];
        let rows = layers.into_iter().flat_map(Bitmap::rows);
        let bytes = rows.flat_map(|row| row.to_le_bytes());
        bytes.fold(FNV_OFFSET, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(FNV_PRIME))
    }
}

/// Start value of FNV-1a, 64 bits.
const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;

/// Multiplier of FNV-1a, 64 bits.
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_ablation::{Pulse, star};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn gains_add_up_to_the_outcome_of_the_plan(
            pulses in proptest::collection::vec((0.0..100.0, 0.0..100.0), 1..20),
        ) {
            let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 20).unwrap();
            let positions: Vec<Point> = pulses.iter().map(|&(x, y)| Point::new(x, y)).collect();
            let mut state = JobState::new(&job, 0.35);
            let mut sum_px = 0;
            for &position in &positions {
                let expected_px = state.gain_px(position);
                prop_assert_eq!(state.pulse(position).gain_px(), expected_px);
                sum_px += expected_px;
            }
            prop_assert_eq!(sum_px, job.outcome(&positions).gain_px());
            prop_assert_eq!(state.pulses_left(), 20 - positions.len());
        }
    }

    fn star_state() -> JobState {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 20).unwrap();
        JobState::new(&job, 0.35)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn target_given_up_is_neither_left_nor_forbidden_and_no_longer_attracts(
            x in 0.0..100.0, y in 0.0..100.0, radius_px in 0.5..30.0,
        ) {
            let mut state = star_state();
            let before = state.clone();
            let disc = Footprint::of(Pulse { position: Point::new(x, y), radius_px });
            let area_px = state.give_up(&disc);
            prop_assert_eq!(area_px, before.workpiece().preview(&disc).hit_px);
            prop_assert_eq!(state.workpiece().preview(&disc).hit_px, 0);
            prop_assert_eq!(state.workpiece().forbidden(), before.workpiece().forbidden());
            let fresh = RingScores::new(state.workpiece(), 9.0, 0.35);
            prop_assert_eq!(state.scores().best(), fresh.best());
            prop_assert_eq!(state.scores().gains(), fresh.gains());
            prop_assert_eq!(state.pulses_left(), before.pulses_left());
        }
    }

    #[test]
    fn the_hash_tells_states_apart_and_is_that_of_fnv_1a() {
        let mut state = star_state();
        let pristine = state.hash();
        let mut bytes = Vec::new();
        for bitmap in [state.workpiece().remaining(), state.workpiece().forbidden()] {
            bytes.extend(bitmap.rows().iter().flat_map(|row| row.to_le_bytes()));
        }
        let mut expected = 14_695_981_039_346_656_037_u64;
        for byte in bytes {
            expected = (expected ^ u64::from(byte)).wrapping_mul(1_099_511_628_211);
        }
        assert_eq!(pristine, expected);
        state.count_pulse();
        assert_eq!(state.hash(), pristine);
        state.machine(&Footprint::of(Pulse { position: Point::new(50.5, 50.5), radius_px: 0.4 }));
        assert_ne!(state.hash(), pristine);
    }

    #[test]
    fn a_job_without_pulses_left_is_finished() {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 1).unwrap();
        let mut state = JobState::new(&job, 0.0);
        assert!(!state.is_finished());
        state.pulse(Point::new(50.0, 50.0));
        assert!(state.is_finished());
    }
}
