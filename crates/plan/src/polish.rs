//! Refining the position of one pulse below the pixel.
//!
//! The pixel-centre rule makes a disc of radius 9 px cover 249 to 257 pixels depending on where its
//! centre lies within a pixel, and lets it meet an edge exactly or not.

use lasergym_ablation::reachable_position;
use lasergym_geom::{Point, WORKPIECE_SIZE_PX};

use crate::PlanError;

/// The square of positions that are tried about a pulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolishOptions {
    /// Half the side of the square, px, in [0, 10]; 0 leaves the pulse alone. Wider finds better
    /// places for this pulse, but may leave narrow strips to the next ones. Default 0.5.
    pub range_px: f64,
    /// Positions per pixel along x and along y, in 1..=64; the time of a polish grows with the
    /// square. Default 16.
    pub steps_per_px: u32,
}

impl Default for PolishOptions {
    fn default() -> Self {
        Self { range_px: 0.5, steps_per_px: 16 }
    }
}

impl PolishOptions {
    /// Checks both settings.
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`].
    pub fn validate(&self) -> Result<(), PlanError> {
        if !(0.0..=10.0).contains(&self.range_px) {
            return Err(PlanError::InvalidOption {
                name: "range_px",
                value: self.range_px.to_string(),
                expected: "in [0, 10]",
            });
        }
        if !(1..=64).contains(&self.steps_per_px) {
            return Err(PlanError::InvalidOption {
                name: "steps_per_px",
                value: self.steps_per_px.to_string(),
                expected: "in 1..=64",
            });
        }
        Ok(())
    }

    /// Steps from the pulse to the border of the square.
    fn reach(&self) -> i32 {
        (self.range_px * f64::from(self.steps_per_px)).floor() as i32
    }
}

/// The position about `start` of the largest `value`, and the value; of several the nearest.
/// Positions stay on the workpiece and are ones that actions can reach; without a square to search,
/// the pulse is left alone.
pub fn polish<V: PartialOrd>(
    start: Point,
    options: PolishOptions,
    mut value: impl FnMut(Point) -> V,
) -> (Point, V) {
    let step_px = f64::from(options.steps_per_px.max(1)).recip();
    let reach = options.reach();
    if reach == 0 {
        return (start, value(start));
    }
    let center = reachable_position(start);
    let mut best = ((value(center), 0), center);
    for row in -reach..=reach {
        for column in -reach..=reach {
            let offset = Point::new(f64::from(column) * step_px, f64::from(row) * step_px);
            let wanted = start + offset;
            let on_workpiece = 0.0..=WORKPIECE_SIZE_PX as f64;
            if !(on_workpiece.contains(&wanted.x) && on_workpiece.contains(&wanted.y)) {
                continue;
            }
            let position = reachable_position(wanted);
            // Larger value first, shorter way second.
            let candidate = (value(position), -(row * row + column * column));
            if candidate > best.0 {
                best = (candidate, position);
            }
        }
    }
    (best.1, best.0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Job;
    use lasergym_ablation::{Workpiece, star};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn a_polished_pulse_gains_at_least_as_much_and_stays_near(
            x in 0.0..100.0, y in 0.0..100.0, range_px in 0.0..2.0, steps_per_px in 1_u32..10,
        ) {
            let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 1).unwrap();
            let start = Point::new(x, y);
            let options = PolishOptions { range_px, steps_per_px };
            let gain_at = |position| job.workpiece().preview(&job.footprint(position)).gain_px();
            let (position, gain_px) = polish(start, options, gain_at);
            prop_assert_eq!(gain_at(position), gain_px);
            let searched = options.reach() > 0;
            let center = if searched { reachable_position(start) } else { start };
            prop_assert!(gain_px >= gain_at(center));
            prop_assert!(!searched || reachable_position(position) == position);
            let offset = position - start;
            prop_assert!(offset.x.abs().max(offset.y.abs()) <= range_px + 1e-5);
            prop_assert!((0.0..=100.0).contains(&position.x) && (0.0..=100.0).contains(&position.y));
        }
    }

    #[test]
    fn a_range_out_of_bounds_is_refused() {
        for range_px in [-0.1, 10.1, f64::NAN] {
            let options = PolishOptions { range_px, ..PolishOptions::default() };
            assert!(matches!(
                options.validate(),
                Err(PlanError::InvalidOption { name: "range_px", .. })
            ));
        }
    }

    #[test]
    fn a_number_of_steps_out_of_bounds_is_refused() {
        for steps_per_px in [0, 65] {
            let options = PolishOptions { steps_per_px, ..PolishOptions::default() };
            assert!(matches!(
                options.validate(),
                Err(PlanError::InvalidOption { name: "steps_per_px", .. })
            ));
        }
    }
}
