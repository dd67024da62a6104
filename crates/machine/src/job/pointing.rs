//! Where pulses land beside their aim, learnt from the marks that were seen.

use lasergym_geom::Point;

/// Largest correction along an axis, px: what errs by more is broken.
const MOST_CORRECTION_PX: f64 = 3.0;

/// Largest surprise that is learnt from, px: a shock to the stage says nothing of the next pulse.
const MOST_SURPRISE_PX: f64 = 1.0;

/// Part of a surprise that goes into the offset, at least; a part, so that drift is followed.
const OFFSET_GAIN: f64 = 0.2;

/// Part of a surprise that goes into the backlash, at least.
const BACKLASH_GAIN: f64 = 0.1;

/// The lasting part of the error of a stage along both axes: an offset that may drift, and backlash,
/// which is of opposite sign on the two sides of the place that the stage comes from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct PointingError {
    x: AxisError,
    y: AxisError,
    marks: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct AxisError {
    offset_px: f64,
    backlash_px: f64,
}

impl PointingError {
    /// How far beside `aimed` the stage must be sent, px, when it comes from `from_px`.
    pub(super) fn correction_px(&self, aimed: Point, from_px: Point) -> Point {
        Point::new(
            self.x.correction_px(aimed.x - from_px.x),
            self.y.correction_px(aimed.y - from_px.y),
        )
    }

    /// Learns from a mark at `seen` of a pulse that was sent to `commanded`.
    pub(super) fn learn(&mut self, commanded: Point, seen: Point, from_px: Point) {
        self.marks += 1;
        self.x.learn(seen.x - commanded.x, commanded.x - from_px.x, self.marks);
        self.y.learn(seen.y - commanded.y, commanded.y - from_px.y, self.marks);
    }
}

impl AxisError {
    fn expected_px(&self, way_px: f64) -> f64 {
        self.offset_px + self.backlash_px * way_px.signum()
    }

    fn correction_px(&self, way_px: f64) -> f64 {
        (-self.expected_px(way_px)).clamp(-MOST_CORRECTION_PX, MOST_CORRECTION_PX)
    }

    fn learn(&mut self, error_px: f64, way_px: f64, marks: u32) {
        let surprise_px =
            (error_px - self.expected_px(way_px)).clamp(-MOST_SURPRISE_PX, MOST_SURPRISE_PX);
        // The first marks count as much as a mean gives them.
        let mean_gain = 1.0 / f64::from(marks.saturating_add(1));
        self.offset_px += OFFSET_GAIN.max(mean_gain) * surprise_px;
        self.backlash_px += BACKLASH_GAIN.max(mean_gain) * surprise_px * way_px.signum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CENTER: Point = Point::new(50.0, 50.0);

    /// Not so near to the middle that a correction could change the side.
    fn place() -> impl Strategy<Value = f64> {
        prop_oneof![0.0..44.0_f64, 56.0..100.0_f64]
    }

    proptest! {
        /// A stage with an offset and backlash is corrected until nothing is left, as far as the
        /// largest correction goes.
        #[test]
        fn lasting_errors_vanish(
            aims in prop::collection::vec((place(), place()), 60),
            x in -1.5..1.5_f64,
            y in -1.5..1.5_f64,
            backlash in -1.0..1.0_f64,
        ) {
            let mut learnt = PointingError::default();
            let lands = |at: f64, offset: f64| at + offset + backlash * (at - 50.0).signum();
            for (round, &(to_x, to_y)) in aims.iter().cycle().take(600).enumerate() {
                let aimed = Point::new(to_x, to_y);
                let correction = learnt.correction_px(aimed, CENTER);
                let commanded = Point::new(to_x + correction.x, to_y + correction.y);
                let seen = Point::new(lands(commanded.x, x), lands(commanded.y, y));
                if round >= 540 {
                    prop_assert!(seen.distance(aimed) < 0.05, "{seen:?} for {aimed:?}");
                }
                learnt.learn(commanded, seen, CENTER);
            }
        }

        #[test]
        fn corrections_are_bounded(errors in prop::collection::vec((-50.0..50.0_f64, 0.0..100.0_f64), 1..200)) {
            let mut learnt = PointingError::default();
            for (error, at) in errors {
                let aimed = Point::new(at, 100.0 - at);
                learnt.learn(aimed, Point::new(at + error, 100.0 - at - error), CENTER);
                let correction = learnt.correction_px(aimed, CENTER);
                prop_assert!(correction.x.abs() <= 3.0 && correction.y.abs() <= 3.0);
            }
        }
    }

    #[test]
    fn nothing_is_corrected_before_the_first_mark() {
        let aimed = Point::new(10.0, 90.0);
        assert_eq!(PointingError::default().correction_px(aimed, CENTER), Point::new(0.0, 0.0));
    }

    #[test]
    fn a_single_shock_moves_the_next_pulse_by_less_than_half_a_pixel() {
        let mut learnt = PointingError::default();
        let aimed = Point::new(30.0, 70.0);
        for _ in 0..20 {
            learnt.learn(aimed, aimed, CENTER);
        }
        learnt.learn(aimed, Point::new(42.0, 70.0), CENTER);
        assert!(learnt.correction_px(aimed, CENTER).x.abs() < 0.5);
    }
}
