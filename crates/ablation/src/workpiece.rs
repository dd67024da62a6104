//! The state of a workpiece and what a pulse does to it: the process itself.

use crate::{AblationError, Footprint};
use lasergym_geom::{Bitmap, Row, WORKPIECE_SIZE_PX};

/// Reward of one target pixel that is machined, and cost of one pixel beside it: one
/// ten-thousandth, so that the return is (target machined − off-target machined) / workpiece area.
pub const REWARD_PER_PX: f64 = 1.0 / (WORKPIECE_SIZE_PX * WORKPIECE_SIZE_PX) as f64;

/// What one pulse machined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PulseOutcome {
    /// Remaining target pixels that were machined.
    pub hit_px: u32,
    /// Forbidden pixels that were machined.
    pub miss_px: u32,
}

impl PulseOutcome {
    /// Hits − misses, px.
    #[must_use]
    #[inline]
    pub fn gain_px(self) -> i32 {
        self.hit_px.cast_signed() - self.miss_px.cast_signed()
    }

    /// (hits − misses) / 10 000.
    #[must_use]
    #[inline]
    pub fn reward(self) -> f64 {
        f64::from(self.gain_px()) / (WORKPIECE_SIZE_PX * WORKPIECE_SIZE_PX) as f64
    }
}

/// Every pixel of a workpiece is remaining target, forbidden (pristine ground beside the target) or
/// free (machined). Cloning it is cheap (3.2 kB): planners try pulses on copies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Workpiece {
    remaining: Bitmap,
    forbidden: Bitmap,
}

impl Workpiece {
    /// The pristine workpiece of `target`.
    ///
    /// # Errors
    /// [`AblationError::EmptyTarget`], [`AblationError::FullTarget`].
    pub fn new(target: &Bitmap) -> Result<Self, AblationError> {
        if target.is_empty() {
            return Err(AblationError::EmptyTarget);
        }
        let forbidden = target.complement();
        if forbidden.is_empty() {
            return Err(AblationError::FullTarget);
        }
        Ok(Self { remaining: target.clone(), forbidden })
    }

    /// A partly machined workpiece: `remaining` is still to be machined, `forbidden` must stay, and
    /// everything else is free. Where the two overlap the pixel counts as remaining.
    #[must_use]
    pub fn partly_machined(remaining: &Bitmap, forbidden: &Bitmap) -> Self {
        let mut forbidden = forbidden.clone();
        for (row, &target) in forbidden.rows_mut().iter_mut().zip(remaining.rows()) {
            *row &= !target;
        }
        Self { remaining: remaining.clone(), forbidden }
    }

    /// Target pixels not machined yet.
    #[must_use]
    #[inline]
    pub fn remaining(&self) -> &Bitmap {
        &self.remaining
    }

    /// Pristine pixels that must stay.
    #[must_use]
    #[inline]
    pub fn forbidden(&self) -> &Bitmap {
        &self.forbidden
    }

    /// Machines the pixels under `footprint`.
    #[inline]
    pub fn pulse(&mut self, footprint: &Footprint) -> PulseOutcome {
        self.pulse_with(footprint, |_, _, _| ())
    }

    /// Machines the pixels under `footprint` and reports every row in which something changed as
    /// (row, remaining pixels machined, forbidden pixels machined).
    #[inline]
    pub fn pulse_with(
        &mut self,
        footprint: &Footprint,
        mut changed: impl FnMut(usize, Row, Row),
    ) -> PulseOutcome {
        let (first_row, spans) = footprint.rows();
        let rows = first_row..first_row + spans.len();
        let remaining = &mut self.remaining.rows_mut()[rows.clone()];
        let forbidden = &mut self.forbidden.rows_mut()[rows];
        let mut outcome = PulseOutcome::default();
        for (k, ((span, remaining), forbidden)) in
            spans.iter().zip(remaining).zip(forbidden).enumerate()
        {
            let mask = span.mask();
            let (hits, misses) = (*remaining & mask, *forbidden & mask);
            if hits | misses != 0 {
                *remaining ^= hits;
                *forbidden ^= misses;
                outcome.hit_px += hits.count_ones();
                outcome.miss_px += misses.count_ones();
                changed(first_row + k, hits, misses);
            }
        }
        outcome
    }

    /// What a pulse would machine, without machining it.
    #[must_use]
    #[inline]
    pub fn preview(&self, footprint: &Footprint) -> PulseOutcome {
        let (first_row, spans) = footprint.rows();
        let mut outcome = PulseOutcome::default();
        for ((span, remaining), forbidden) in spans
            .iter()
            .zip(&self.remaining.rows()[first_row..])
            .zip(&self.forbidden.rows()[first_row..])
        {
            let mask = span.mask();
            outcome.hit_px += (remaining & mask).count_ones();
            outcome.miss_px += (forbidden & mask).count_ones();
        }
        outcome
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pulse, star};
    use lasergym_geom::Point;
    use proptest::prelude::*;

    fn pulses() -> impl Strategy<Value = Vec<Pulse>> {
        let pulse = (-10.0..110.0, -10.0..110.0, 1.0..20.0)
            .prop_map(|(x, y, radius_px)| Pulse { position: Point::new(x, y), radius_px });
        proptest::collection::vec(pulse, 1..60)
    }

    proptest! {
        /// Every pixel is machined at most once: hits and misses add up to what has gone.
        #[test]
        fn pixels_are_conserved(pulses in pulses(), angle_deg in 0.0..360.0) {
            let target = star(angle_deg);
            let mut workpiece = Workpiece::new(&target).unwrap();
            let (mut hits, mut misses) = (0, 0);
            for pulse in pulses {
                let footprint = Footprint::of(pulse);
                let expected = workpiece.preview(&footprint);
                let mut reported = PulseOutcome::default();
                let outcome = workpiece.pulse_with(&footprint, |_, hit, miss| {
                    reported.hit_px += hit.count_ones();
                    reported.miss_px += miss.count_ones();
                });
                prop_assert_eq!(outcome, expected);
                prop_assert_eq!(outcome, reported);
                // The same pulse again finds free ground only.
                prop_assert_eq!(workpiece.pulse(&footprint), PulseOutcome::default());
                hits += outcome.hit_px;
                misses += outcome.miss_px;
            }
            prop_assert_eq!(hits, target.area_px() - workpiece.remaining().area_px());
            prop_assert_eq!(misses, 10_000 - target.area_px() - workpiece.forbidden().area_px());
        }

        /// The order of the pulses does not matter for the sum.
        #[test]
        fn pulses_commute(pulses in pulses()) {
            let run = |pulses: &mut dyn Iterator<Item = &Pulse>| {
                let mut workpiece = Workpiece::new(&star(0.0)).unwrap();
                let gain: i32 =
                    pulses.map(|&pulse| workpiece.pulse(&Footprint::of(pulse)).gain_px()).sum();
                (gain, workpiece)
            };
            prop_assert_eq!(run(&mut pulses.iter()), run(&mut pulses.iter().rev()));
        }
    }

    #[test]
    fn empty_and_full_targets_are_named() {
        assert_eq!(Workpiece::new(&Bitmap::EMPTY), Err(AblationError::EmptyTarget));
        assert_eq!(Workpiece::new(&Bitmap::full()), Err(AblationError::FullTarget));
    }

    #[test]
    fn a_partly_machined_workpiece_has_disjoint_sets() {
        let workpiece = Workpiece::partly_machined(&star(0.0), &Bitmap::full());
        assert_eq!(workpiece, Workpiece::new(&star(0.0)).unwrap());
    }
}
