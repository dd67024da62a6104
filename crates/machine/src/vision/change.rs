//! What has changed between two registered frames.

use super::cells::{Grid, Inside};
use super::registration::Registered;

/// Standard deviation that a difference has at least: what is left by registration.
const LEAST_NOISE: f32 = 0.002;

/// The difference between two frames, cell by cell, relative to the brightness of pristine ground.
#[derive(Debug)]
pub(super) struct Change {
    pub(super) grid: Grid,
    /// After − before; 0 outside of `inside`.
    pub(super) difference: Vec<f32>,
    /// Brightness before.
    pub(super) before: Vec<f32>,
    /// Standard deviation of the difference where nothing has changed.
    pub(super) noise: f32,
    /// Cells that both frames show.
    pub(super) inside: Inside,
}

impl Change {
    pub(super) fn between(grid: Grid, before: &Registered, after: &Registered) -> Self {
        let inside = before.inside.and(after.inside, 1);
        let mut difference = grid.picture();
        let stride = grid.stride();
        let mut sizes = Vec::with_capacity(grid.len() / 5);
        for j in inside.rows.0..inside.rows.1 {
            let row = j * stride + inside.columns.0..j * stride + inside.columns.1;
            let into = &mut difference[row.clone()];
            for ((value, after), before) in
                into.iter_mut().zip(&after.brightness[row.clone()]).zip(&before.brightness[row])
            {
                *value = after - before;
            }
            sizes.extend(into.iter().skip(j % 7).step_by(7).map(|value| value.abs()));
        }
        let middle = sizes.len() / 2;
        let noise = if sizes.is_empty() {
            LEAST_NOISE
        } else {
            // The median of |x| of a normal is 0.6745 standard deviations.
            1.4826 * *sizes.select_nth_unstable_by(middle, f32::total_cmp).1
        };
        Self {
            grid,
            difference,
            before: before.brightness.clone(),
            noise: noise.max(LEAST_NOISE),
            inside,
        }
    }
}
