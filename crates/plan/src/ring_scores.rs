//! How promising each pixel centre is for the next pulse.

use lasergym_ablation::{Footprint, MAX_PULSE_RADIUS_PX, PulseOutcome, Workpiece};
use lasergym_geom::{Bitmap, Row, WORKPIECE_SIZE_PX};

use crate::GainMap;

/// Width of the ring about a pulse in which remaining target counts against it, px.
pub const RING_WIDTH_PX: f64 = 3.0;

/// The ring score of a pulse at every pixel centre, kept exact while pixels are machined: hits −
/// misses − `ring_weight` × (target left within [`RING_WIDTH_PX`] about the mark).
#[derive(Debug, Clone)]
pub struct RingScores {
    ring_weight: f64,
    gains: GainMap,
    /// Target that remains within the ring's outer radius and within the pulse; only kept when the
    /// ring counts.
    surroundings: Option<[GainMap; 2]>,
}

impl RingScores {
    /// The scores on `workpiece` of pulses of `pulse_radius_px`, which is in (0, 50].
    #[must_use]
    pub fn new(workpiece: &Workpiece, pulse_radius_px: f64, ring_weight: f64) -> Self {
        let target = Workpiece::partly_machined(workpiece.remaining(), &Bitmap::EMPTY);
        Self {
            ring_weight,
            gains: GainMap::new(workpiece, pulse_radius_px),
            surroundings: (ring_weight > 0.0).then(|| {
                let outer_px = (pulse_radius_px + RING_WIDTH_PX).min(MAX_PULSE_RADIUS_PX);
                [outer_px, pulse_radius_px].map(|radius_px| GainMap::new(&target, radius_px))
            }),
        }
    }

    /// Machines the pixels under `footprint`, a disc of any radius, on `workpiece` and follows what
    /// changes.
    pub fn machine(&mut self, workpiece: &mut Workpiece, footprint: &Footprint) -> PulseOutcome {
        workpiece.pulse_with(footprint, |row, hits, misses| self.machined(row, hits, misses))
    }

    /// Accounts for the pixels of `row` that are no longer remaining target and those that are no
    /// longer forbidden.
    pub(crate) fn machined(&mut self, row: usize, hits: Row, misses: Row) {
        self.gains.machined(row, hits, misses);
        for map in self.surroundings.iter_mut().flatten() {
            map.machined(row, hits, 0);
        }
    }

    /// Hits − misses of a pulse at the centre of each pixel.
    #[must_use]
    pub fn gains(&self) -> &GainMap {
        &self.gains
    }

    /// Target left in the ring about a pulse at the centre of the pixel at (`row`, `column`), px; 0
    /// when the ring does not count.
    #[must_use]
    #[inline]
    pub fn ring_px(&self, row: usize, column: usize) -> i32 {
        self.surroundings
            .as_ref()
            .map_or(0, |[outer, inner]| outer.gain_px(row, column) - inner.gain_px(row, column))
    }

    /// The score of the pixel at (`row`, `column`), px.
    #[must_use]
    #[inline]
    pub fn score_px(&self, row: usize, column: usize) -> f64 {
        f64::from(self.gains.gain_px(row, column))
            - self.ring_weight * f64::from(self.ring_px(row, column))
    }

    /// The pixel (row, column) of largest score among those that gain anything, the first of
    /// several; where none gains, the one of largest gain.
    #[must_use]
    pub fn best(&self) -> (usize, usize) {
        let (best_row, best_column, _) = self.gains.best();
        let Some([outer, inner]) = &self.surroundings else { return (best_row, best_column) };
        let mut best = (f32::NEG_INFINITY, best_row, best_column);
        let ring_weight = self.ring_weight as f32;
        for row in 0..WORKPIECE_SIZE_PX {
            let mut scores = [f32::NEG_INFINITY; WORKPIECE_SIZE_PX];
            let surroundings = outer.row(row).iter().zip(inner.row(row));
            for ((score, &gain), (&outer, &inner)) in
                scores.iter_mut().zip(self.gains.row(row)).zip(surroundings)
            {
                let promise = f32::from(gain) - ring_weight * f32::from(outer - inner);
                *score = if gain > 0 { promise } else { f32::NEG_INFINITY };
            }
            let largest = scores.iter().fold(f32::NEG_INFINITY, |a, &b| if b > a { b } else { a });
            if largest > best.0 {
                let column = scores.iter().position(|&score| score >= largest);
                best = (largest, row, column.unwrap_or(0));
            }
        }
        (best.1, best.2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Job;
    use lasergym_ablation::{Pulse, star};
    use lasergym_geom::Point;
    use proptest::prelude::*;

    /// Target left under a disc.
    fn remaining_px(workpiece: &Workpiece, position: Point, radius_px: f64) -> i32 {
        let outcome = workpiece.preview(&Footprint::of(Pulse { position, radius_px }));
        outcome.hit_px.cast_signed()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn scores_are_what_a_pulse_gains_less_what_it_leaves_about_it_after_discs_of_any_radius(
            discs in proptest::collection::vec((-5.0..105.0, -5.0..105.0, 0.5..20.0), 0..20),
            ring_weight in 0.0..1.0,
        ) {
            let mut workpiece = Workpiece::new(&star(0.0)).unwrap();
            let job = Job::new(workpiece.clone(), 9.0, 45).unwrap();
            let mut scores = RingScores::new(&workpiece, 9.0, ring_weight);
            for (x, y, radius_px) in discs {
                let disc = Pulse { position: Point::new(x, y), radius_px };
                scores.machine(&mut workpiece, &Footprint::of(disc));
            }
            let mut largest = f64::NEG_INFINITY;
            for row in 0..WORKPIECE_SIZE_PX {
                for column in 0..WORKPIECE_SIZE_PX {
                    let position = Point::new(column as f64 + 0.5, row as f64 + 0.5);
                    let gain_px = workpiece.preview(&job.footprint(position)).gain_px();
                    let ring_px = remaining_px(&workpiece, position, 9.0 + RING_WIDTH_PX)
                        - remaining_px(&workpiece, position, 9.0);
                    let score_px = f64::from(gain_px) - ring_weight * f64::from(ring_px);
                    prop_assert!((scores.score_px(row, column) - score_px).abs() < 1e-9);
                    if gain_px > 0 {
                        largest = largest.max(score_px);
                    }
                }
            }
            let (row, column) = scores.best();
            prop_assert!(largest.is_infinite() || scores.score_px(row, column) > largest - 1e-3);
        }
    }
}
