//! From corrections of the ring score to a position.

use lasergym_ablation::reachable_position;
use lasergym_geom::{Point, WORKPIECE_SIZE_PX};

use crate::JobState;
use crate::polish::{PolishOptions, polish};

/// How far the corrections reach from the candidate along x and along y, px.
pub const CORRECTION_REACH_PX: usize = 8;

/// Rows and columns of the corrections.
const WIDTH: usize = 2 * CORRECTION_REACH_PX + 1;

/// Corrections of the ring score at whole pixels about a candidate, px, rows from top to bottom.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corrections<'a> {
    values_px: &'a [f32],
}

impl<'a> Corrections<'a> {
    /// Number of corrections.
    pub(super) const LEN: usize = WIDTH * WIDTH;

    /// The first [`Self::LEN`] of `values_px`, where there are as many.
    pub(super) fn new(values_px: &'a [f32]) -> Option<Self> {
        values_px.get(..Self::LEN).map(|values_px| Self { values_px })
    }

    /// The correction at (`row`, `column`) from the first.
    fn at(&self, row: usize, column: usize) -> f32 {
        self.values_px[row * WIDTH + column]
    }

    /// The correction between pixels, `x` and `y` px from the candidate: bilinear, and constant
    /// beyond the last pixels.
    fn between(&self, x: f64, y: f64) -> f32 {
        let split = |value: f64| {
            let value = (value + CORRECTION_REACH_PX as f64).clamp(0.0, (WIDTH - 1) as f64);
            let whole = (value as usize).min(WIDTH - 2);
            (whole, (value - whole as f64) as f32)
        };
        let ((column, right), (row, down)) = (split(x), split(y));
        let along = |row| (1.0 - right) * self.at(row, column) + right * self.at(row, column + 1);
        (1.0 - down) * along(row) + down * along(row + 1)
    }
}

/// The best position about the pixel `candidate` (row, column): the pixel of largest ring score +
/// correction, then the place within `polish_px` of its centre, in steps of 1/8 px, where the same
/// sum is largest. Of several the nearest.
pub(super) fn best_position(
    state: &JobState,
    candidate: (usize, usize),
    corrections: Corrections<'_>,
    polish_px: f64,
) -> Point {
    let (row, column) = best_pixel(state, candidate, corrections);
    let center = |pixel: usize| pixel as f64 + 0.5;
    let start = Point::new(center(column), center(row));
    let origin = Point::new(center(candidate.1), center(candidate.0));
    let options = PolishOptions { range_px: polish_px, steps_per_px: 8 };
    let corrected_px = |position: Point| {
        let offset = position - origin;
        state.score_px(position) as f32 + corrections.between(offset.x, offset.y)
    };
    reachable_position(polish(start, options, corrected_px).0)
}

/// The pixel of largest ring score + correction among the candidate and those that gain anything,
/// the first of several.
fn best_pixel(
    state: &JobState,
    candidate: (usize, usize),
    corrections: Corrections<'_>,
) -> (usize, usize) {
    let mut best = (f32::NEG_INFINITY, candidate);
    let pixel = |from: usize, k: usize| {
        (from + k).checked_sub(CORRECTION_REACH_PX).filter(|&pixel| pixel < WORKPIECE_SIZE_PX)
    };
    for down in 0..WIDTH {
        let Some(row) = pixel(candidate.0, down) else { continue };
        for right in 0..WIDTH {
            let Some(column) = pixel(candidate.1, right) else { continue };
            if state.scores().gains().gain_px(row, column) <= 0 && (row, column) != candidate {
                continue;
            }
            let value_px =
                state.scores().score_px(row, column) as f32 + corrections.at(down, right);
            if value_px > best.0 {
                best = (value_px, (row, column));
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Greedy, Job, Planner};
    use lasergym_ablation::{Workpiece, star};
    use proptest::prelude::*;

    const NONE: [f32; Corrections::LEN] = [0.0; Corrections::LEN];

    fn job() -> Job {
        Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 40).unwrap()
    }

    #[test]
    fn without_corrections_the_agent_is_the_greedy_planner_with_ring_score() {
        let job = job();
        let polish = PolishOptions { range_px: 0.5, steps_per_px: 8 };
        let plan = Greedy { ring_weight: 0.35, polish }.plan_to_end(&job).unwrap();
        let mut state = JobState::new(&job, 0.35);
        for &position in &plan.positions {
            let candidate = state.scores().best();
            let corrections = Corrections::new(&NONE).unwrap();
            let decided = best_position(&state, candidate, corrections, 0.5);
            assert_eq!(state.gain_px(decided), state.gain_px(position));
            state.pulse(position);
        }
    }

    #[test]
    fn a_large_correction_decides() {
        let state = JobState::new(&job(), 0.35);
        let (row, column) = state.scores().best();
        let mut values = NONE;
        values[5 * WIDTH + 10] = 1e4;
        let corrections = Corrections::new(&values).unwrap();
        let position = best_position(&state, (row, column), corrections, 0.5);
        let wanted = Point::new((column + 2) as f64 + 0.5, row as f64 - 3.0 + 0.5);
        assert!(position.distance(wanted) < 1e-5);
    }

    #[test]
    fn too_few_corrections_are_refused() {
        assert!(Corrections::new(&NONE[1..]).is_none());
    }

    proptest! {
        #[test]
        fn corrections_of_a_plane_are_exact_between_pixels(
            x in -8.0..8.0, y in -8.0..8.0, slope_x in -5.0..5.0, slope_y in -5.0..5.0,
        ) {
            let plane = |x: f64, y: f64| (slope_x * x + slope_y * y + 1.0) as f32;
            let values: Vec<f32> = (0..Corrections::LEN)
                .map(|k| plane((k % WIDTH) as f64 - 8.0, (k / WIDTH) as f64 - 8.0))
                .collect();
            let corrections = Corrections::new(&values).unwrap();
            prop_assert!((corrections.between(x, y) - plane(x, y)).abs() < 1e-3);
        }
    }
}
