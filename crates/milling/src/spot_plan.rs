//! Plans for the milling environment: all spots of an episode, chosen together.

use std::ops::ControlFlow;

use crate::bounded_lbfgs::{Smooth, StopRule, minimise};
use crate::environment::Action;
use crate::{
    Environment, GradientMemory, MillingError, Objective, Progress, SIZE_PX, Simulator, Spot,
};

/// Iterations on the dwell of spots on a raster, then on dwell and y together.
const ITERATIONS: [usize; 2] = [60, 60];

/// How far a spot may leave its place, as a part of the distance between rows.
const FREE_RANGE: f64 = 0.5;

/// An optimisation ends when five iterations in a row lower the objective by less than this part.
const LEAST_FALL: f64 = 1e-4;

/// How spots are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpotPlanner {
    /// The usual practice: spots on a raster, each with the dwell that removes the depth there from
    /// flat ground with f = 1, as if no other spot removed anything.
    PixelByPixel,
    /// Dwell and y of the same spots optimised together with the discrete adjoint.
    Adjoint,
}

/// Spots in the order in which they are milled, and what they achieve.
#[derive(Debug, Clone, PartialEq)]
pub struct SpotPlan {
    /// The spots as actions of the environment; stepping through them achieves exactly `progress`.
    pub actions: Vec<[f32; 3]>,
    /// How far the episode has come after them.
    pub progress: Progress,
    /// Sum of the rewards of the episode.
    pub episode_return: f64,
    /// Whether the planner was stopped before it had finished; then this is the best so far.
    pub partial: bool,
}

impl SpotPlanner {
    /// Plans the rest of an episode without errors of the machine. `progress` is called after each
    /// iteration with the part that is done, in [0, 1], and may stop the planner.
    ///
    /// # Errors
    /// [`MillingError::EmptyTarget`] before the first reset.
    pub fn plan(
        self,
        environment: &Environment,
        progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
    ) -> Result<SpotPlan, MillingError> {
        let objective = environment.objective()?;
        let mut spots = raster(environment);
        let mut flow = ControlFlow::Continue(());
        if self == Self::Adjoint && !spots.is_empty() {
            let mut search = Search {
                simulator: environment.simulator(),
                start_um: environment.surface_um(),
                objective: &objective,
                longest_dwell_s: environment.longest_dwell_s(),
                spots: &mut spots,
                free: false,
                memory: GradientMemory::default(),
            };
            flow = search.improve(FREE_RANGE * pitch_um(environment), progress)?;
        }
        let actions = spots.iter().map(|spot| action_of(environment, spot)).collect();
        replay(environment, actions, flow.is_break())
    }
}

/// Rows of the raster: as many as columns, or fewer.
fn rows(environment: &Environment) -> usize {
    f64::from(environment.spots_left()).sqrt() as usize
}

/// Distance between rows, µm.
fn pitch_um(environment: &Environment) -> f64 {
    environment.side_um() / rows(environment).max(1) as f64
}

/// Spots on a raster, row by row in alternating direction, with the dwell of the depth that is left
/// there.
fn raster(environment: &Environment) -> Vec<Spot> {
    let rows = rows(environment);
    // More spots than pixels would not help.
    let rows = rows.min(SIZE_PX);
    let columns = (environment.spots_left() as usize).checked_div(rows).unwrap_or(0).min(SIZE_PX);
    let (side_um, footprint) =
        (environment.side_um(), &environment.options().profile.process.footprint);
    let cell_um2 = side_um * side_um / (rows * columns).max(1) as f64;
    let per_um = cell_um2 / footprint.volume_rate_um3_s();
    let mut spots = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        for k in 0..columns {
            let column = if row % 2 == 0 { k } else { columns - 1 - k };
            let middle = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
            let (x, y) = (middle(column, columns), middle(row, rows));
            let (depths, targets) = environment.row((y * SIZE_PX as f64) as usize);
            let pixel = (x * SIZE_PX as f64) as usize;
            let left_um = (targets[pixel] - depths[pixel]).max(0.0);
            let dwell_s = (left_um * per_um).min(environment.longest_dwell_s());
            spots.push(Spot { x_um: x * side_um, y_um: y * side_um, dwell_s });
        }
    }
    spots
}

/// The action nearest to a spot.
fn action_of(environment: &Environment, spot: &Spot) -> Action {
    let scaled = |value: f64, whole: f64| (2.0 * value / whole - 1.0) as f32;
    [
        scaled(spot.x_um, environment.side_um()),
        scaled(spot.y_um, environment.side_um()),
        scaled(spot.dwell_s, environment.longest_dwell_s()),
    ]
}

/// What the actions achieve; those after the end of the episode and those without a dwell are left
/// out.
fn replay(
    environment: &Environment,
    actions: Vec<Action>,
    partial: bool,
) -> Result<SpotPlan, MillingError> {
    let mut environment = environment.without_errors();
    let mut done = Vec::with_capacity(actions.len());
    for action in actions.into_iter().filter(|action| action[2] > -1.0) {
        done.push(action);
        if environment.step(action)?.terminated {
            break;
        }
    }
    let (progress, episode_return) = (environment.progress(), environment.episode_return());
    Ok(SpotPlan { actions: done, progress, episode_return, partial })
}

/// The spots as the optimiser sees them: dwells as parts of the longest, y as parts of the reach.
struct Search<'a> {
    simulator: &'a Simulator,
    start_um: &'a [f64],
    objective: &'a Objective,
    longest_dwell_s: f64,
    spots: &'a mut Vec<Spot>,
    /// Whether y may change, too.
    free: bool,
    memory: GradientMemory,
}

impl Search<'_> {
    fn improve(
        &mut self,
        range_um: f64,
        progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, MillingError> {
        let count = self.spots.len();
        let all = ITERATIONS.iter().sum::<usize>() as f64;
        let mut before = 0;
        for (free, iterations) in [false, true].into_iter().zip(ITERATIONS) {
            self.free = free;
            let mut x: Vec<f64> =
                self.spots.iter().map(|spot| spot.dwell_s / self.longest_dwell_s).collect();
            let (mut lower, mut upper) = (vec![0.0; count], vec![1.0; count]);
            if free {
                let (unit_um, last_um) = (self.unit_um(), self.last_y_um());
                for spot in self.spots.iter() {
                    x.push(spot.y_um / unit_um);
                    lower.push((spot.y_um - range_um).max(0.0) / unit_um);
                    upper.push((spot.y_um + range_um).min(last_um) / unit_um);
                }
            }
            let rule = StopRule { iterations, least_fall: LEAST_FALL };
            let flow = minimise(self, &mut x, &lower, &upper, rule, &mut |iteration, _| {
                progress((before + iteration) as f64 / all)
            })?;
            self.set(&x);
            before += iterations;
            if flow.is_break() {
                return Ok(flow);
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    fn unit_um(&self) -> f64 {
        self.simulator.kernel.footprint.reach_um()
    }

    /// y of the lower edge of the workpiece, µm.
    fn last_y_um(&self) -> f64 {
        let grid = self.simulator.grid();
        grid.origin_y_um + self.objective.rows().end as f64 * grid.cell_um
    }

    fn set(&mut self, x: &[f64]) {
        let (unit_um, count) = (self.unit_um(), self.spots.len());
        for (k, spot) in self.spots.iter_mut().enumerate() {
            spot.dwell_s = x[k] * self.longest_dwell_s;
            if self.free {
                spot.y_um = x[count + k] * unit_um;
            }
        }
    }
}

impl Smooth for Search<'_> {
    fn value(&mut self, x: &[f64], gradient: &mut [f64]) -> Result<f64, MillingError> {
        self.set(x);
        let found = self.simulator.spots_gradient(
            self.spots,
            self.start_um,
            self.objective,
            &mut self.memory,
        )?;
        let scale = 1.0 / self.objective.value_of(self.start_um).max(f64::MIN_POSITIVE);
        let (dwells, places) = gradient.split_at_mut(self.spots.len());
        for (entry, found) in dwells.iter_mut().zip(&found.dwell) {
            *entry = found * self.longest_dwell_s * scale;
        }
        let unit_um = self.unit_um();
        for (entry, found) in places.iter_mut().zip(&found.y) {
            *entry = found * unit_um * scale;
        }
        Ok(found.objective * scale)
    }
}
