//! The milling environment: one spot after another on one workpiece.

use std::ops::Range;
use std::sync::Arc;

use lasergym_batch::{BatchError, Landing, Phase, Stream};

use crate::objective::check_depths;
use crate::simulator::{MAX_COURANT, courant_per_s, substeps_for};
use crate::spots::SpotRoom;
use crate::{
    EnvironmentOptions, Grid, MillingError, Objective, SIZE_PX, Simulator, Spot, random_relief,
};

/// Position and dwell of a spot, each scaled to [−1, 1]: (x, y, dwell).
pub(crate) type Action = [f32; 3];

/// A task with its settings, shared by all environments of a batch.
#[derive(Debug)]
struct Setup {
    options: EnvironmentOptions,
    simulator: Simulator,
    /// Rows and columns of the grid that are the workpiece.
    window: Range<usize>,
    /// Side of the workpiece, µm.
    side_um: f64,
    depth_um: f64,
    longest_dwell_s: f64,
}

/// How far an episode has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// 100 Σ|d − d*| / Σ d*, %.
    pub tracking_error_percent: f64,
    /// Volume removed where it should be over the volume of the target: Σ min(d, d*) / Σ d*.
    pub machined_fraction: f64,
    /// Volume removed below the target over the volume of the target: Σ max(d − d*, 0) / Σ d*.
    pub off_target_fraction: f64,
    /// Spots milled.
    pub spots: u32,
}

/// What one step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Fall of the tracking error, as a part of 1: 0.01 is one percent.
    pub reward: f64,
    /// Whether the episode is over: within the tolerance, or out of spots.
    pub terminated: bool,
    /// The spot as it was milled, errors included.
    pub spot: Spot,
}

/// Depths summed over pixels, µm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Removed {
    /// Σ min(d, d*).
    wanted_um: f64,
    /// Σ max(d − d*, 0).
    beyond_um: f64,
}

/// A workpiece of 100 × 100 pixels, the spots milled into it, and the random stream that draws its
/// targets and errors.
///
/// A clone is a saved state: stepping the clone and the original with the same actions gives the same
/// results bit for bit, random errors and following episodes included.
#[derive(Debug, Clone)]
pub struct Environment {
    setup: Arc<Setup>,
    stream: Stream,
    /// Depths on the simulation's grid, which has a margin around the workpiece.
    surface_um: Vec<f64>,
    /// Depths to reach, 100 × 100.
    target_um: Vec<f64>,
    target_sum_um: f64,
    removed: Removed,
    spots: u32,
    last_spot: Option<Spot>,
    phase: Phase,
}

impl Environment {
    /// An environment before its first reset, with the random stream of seed 0.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] for an option outside its range; as [`Simulator::new`] for
    /// pixels too coarse or too fine for the footprint; as [`Environment::reset_to`] for a target.
    pub fn new(options: EnvironmentOptions) -> Result<Self, MillingError> {
        options.validate()?;
        if let Some(target_um) = &options.target_um {
            check_target(target_um)?;
        }
        let process = &options.profile.process;
        let (pixel_um, reach_um) = (options.pixel_um(), process.footprint.reach_um());
        let margin = (reach_um / pixel_um).ceil() as usize + 3;
        let grid = Grid::new(SIZE_PX, SIZE_PX, pixel_um)?.with_margin(margin)?;
        let longest_dwell_s = options.longest_dwell_s();
        let courant = courant_per_s(&process.footprint, &process.law, pixel_um) * longest_dwell_s;
        let simulator = Simulator::new(grid, process, substeps_for(courant / MAX_COURANT))?;
        let setup = Setup {
            simulator,
            window: margin..margin + SIZE_PX,
            side_um: SIZE_PX as f64 * pixel_um,
            depth_um: options.depth_um(),
            longest_dwell_s,
            options,
        };
        Ok(Self {
            surface_um: vec![0.0; grid.len()],
            setup: Arc::new(setup),
            stream: Stream::from_seed(0),
            target_um: vec![0.0; SIZE_PX * SIZE_PX],
            target_sum_um: 1.0,
            removed: Removed::default(),
            spots: 0,
            last_spot: None,
            phase: Phase::NotBegun,
        })
    }

    /// Begins an episode on flat ground with a new target. With `seed` the random stream starts anew,
    /// without it the stream goes on.
    pub fn reset(&mut self, seed: Option<u64>) {
        if let Some(seed) = seed {
            self.seed(seed);
        }
        match &self.setup.options.target_um {
            Some(target_um) => self.target_um.clone_from(target_um),
            None => {
                self.target_um = random_relief(&mut self.stream, SIZE_PX, self.setup.depth_um);
            }
        }
        self.start();
    }

    /// Starts the random stream anew.
    pub(crate) fn seed(&mut self, seed: u64) {
        self.stream = Stream::from_seed(seed);
    }

    /// Begins an episode with the given target, 100 × 100 depths in µm; the random stream goes on.
    ///
    /// # Errors
    /// [`MillingError::WrongLength`], [`MillingError::TargetValue`], [`MillingError::EmptyTarget`]; the
    /// episode under way is kept.
    pub fn reset_to(&mut self, target_um: &[f64]) -> Result<(), MillingError> {
        check_target(target_um)?;
        self.target_um = target_um.to_vec();
        self.start();
        Ok(())
    }

    fn start(&mut self) {
        self.surface_um.fill(0.0);
        self.target_sum_um = self.target_um.iter().sum();
        self.removed = Removed::default();
        self.spots = 0;
        self.last_spot = None;
        self.phase = Phase::Running;
    }

    /// Mills one spot: x = ½ (1 + a₀) side, y = ½ (1 + a₁) side, dwell = ½ (1 + a₂) longest dwell.
    ///
    /// # Errors
    /// [`MillingError::ActionNotFinite`]; [`BatchError::EpisodeOver`]. Nothing has happened then.
    pub fn step(&mut self, action: [f32; 3]) -> Result<Step, MillingError> {
        check_finite(action, 0)?;
        if self.phase != Phase::Running {
            return Err(BatchError::EpisodeOver { environment: 0 }.into());
        }
        let spot = self.aim(action);
        let mut room = self.setup.simulator.spot_room();
        let (Landing { reward, terminated }, _, _) = self.mill(&spot, &mut room);
        Ok(Step { reward, terminated, spot })
    }

    /// The spot of `action`, errors included. Each spot aimed is to be [milled](Self::mill).
    pub(crate) fn aim(&mut self, action: Action) -> Spot {
        let Setup { options, side_um, longest_dwell_s, .. } = &*self.setup;
        let [x, y, dwell] = action.map(|a| 0.5 * (1.0 + f64::from(a.clamp(-1.0, 1.0))));
        let mut spot =
            Spot { x_um: x * side_um, y_um: y * side_um, dwell_s: dwell * longest_dwell_s };
        if options.pointing_error_um > 0.0 {
            let error = self.stream.displacement(options.pointing_error_um);
            spot.x_um = (spot.x_um + error.x).clamp(0.0, *side_um);
            spot.y_um = (spot.y_um + error.y).clamp(0.0, *side_um);
        }
        if options.dwell_error > 0.0 {
            let factor = 1.0 + options.dwell_error * self.stream.normal();
            spot.dwell_s = (spot.dwell_s * factor).clamp(0.0, *longest_dwell_s);
        }
        self.last_spot = Some(spot);
        spot
    }

    /// Mills an aimed spot, and returns the rows and columns of the workpiece that it changed. The
    /// episode must be running.
    pub(crate) fn mill(
        &mut self,
        spot: &Spot,
        room: &mut SpotRoom,
    ) -> (Landing, Range<usize>, Range<usize>) {
        let setup = Arc::clone(&self.setup);
        let [row, column, side] = setup.simulator.window_of(spot);
        let margin = setup.window.start;
        let part = |first: usize| {
            let clip = |index: usize| index.saturating_sub(margin).min(SIZE_PX);
            clip(first)..clip(first + side)
        };
        let (rows, columns) = (part(row), part(column));
        let before = self.removed_within(&rows, &columns);
        let error_before = self.error();
        setup.simulator.mill_spot(spot, &mut self.surface_um, room);
        let after = self.removed_within(&rows, &columns);
        self.removed.wanted_um += after.wanted_um - before.wanted_um;
        self.removed.beyond_um += after.beyond_um - before.beyond_um;
        self.spots += 1;
        let terminated = self.is_success() || self.spots >= setup.options.max_spots;
        if terminated {
            self.phase = Phase::Over;
        }
        (Landing { reward: error_before - self.error(), terminated }, rows, columns)
    }

    fn removed_within(&self, rows: &Range<usize>, columns: &Range<usize>) -> Removed {
        let mut removed = Removed::default();
        for row in rows.clone() {
            let (depths, targets) = self.row(row);
            for (depth, target) in depths[columns.clone()].iter().zip(&targets[columns.clone()]) {
                removed.wanted_um += depth.min(*target);
                removed.beyond_um += (depth - target).max(0.0);
            }
        }
        removed
    }

    /// Tracking error as a part of 1.
    fn error(&self) -> f64 {
        1.0 - (self.removed.wanted_um - self.removed.beyond_um) / self.target_sum_um
    }

    /// Ends the episode without a further spot, as a time limit does.
    pub(crate) fn end(&mut self) {
        self.phase = Phase::Over;
    }

    /// How far the episode has come.
    #[must_use]
    pub fn progress(&self) -> Progress {
        Progress {
            tracking_error_percent: 100.0 * self.error(),
            machined_fraction: self.removed.wanted_um / self.target_sum_um,
            off_target_fraction: self.removed.beyond_um / self.target_sum_um,
            spots: self.spots,
        }
    }

    /// Sum of the rewards since the episode began: 1 − tracking error.
    #[must_use]
    pub fn episode_return(&self) -> f64 {
        1.0 - self.error()
    }

    /// Whether the tracking error is within the tolerance.
    #[must_use]
    pub fn is_success(&self) -> bool {
        self.spots > 0 && 100.0 * self.error() <= self.setup.options.tolerance_percent
    }

    /// The last spot of the episode as it was milled, errors included.
    #[must_use]
    pub fn last_spot(&self) -> Option<Spot> {
        self.last_spot
    }

    /// Spots that the budget still allows.
    #[must_use]
    pub fn spots_left(&self) -> u32 {
        self.max_spots().saturating_sub(self.spots)
    }

    /// Spots after which an episode terminates.
    #[must_use]
    pub fn max_spots(&self) -> u32 {
        self.setup.options.max_spots
    }

    /// Full scale of observations, µm.
    #[must_use]
    pub fn full_scale_um(&self) -> f64 {
        self.setup.depth_um
    }

    /// Side of the workpiece, µm.
    #[must_use]
    pub fn side_um(&self) -> f64 {
        self.setup.side_um
    }

    /// Longest dwell of a spot, s.
    #[must_use]
    pub fn longest_dwell_s(&self) -> f64 {
        self.setup.longest_dwell_s
    }

    /// The forward model, on a grid with a margin around the workpiece.
    #[must_use]
    pub fn simulator(&self) -> &Simulator {
        &self.setup.simulator
    }

    /// The settings.
    #[must_use]
    pub fn options(&self) -> &EnvironmentOptions {
        &self.setup.options
    }

    /// The target, 100 × 100 depths, µm.
    #[must_use]
    pub fn target_um(&self) -> &[f64] {
        &self.target_um
    }

    /// The surface as it is now, 100 × 100 depths, µm.
    #[must_use]
    pub fn depth_um(&self) -> Vec<f64> {
        (0..SIZE_PX).flat_map(|row| self.row(row).0.iter().copied()).collect()
    }

    /// The surface on the simulation's grid, µm.
    pub(crate) fn surface_um(&self) -> &[f64] {
        &self.surface_um
    }

    /// This environment as it is, with a machine that makes no errors.
    pub(crate) fn without_errors(&self) -> Self {
        let setup = &self.setup;
        let options = EnvironmentOptions {
            pointing_error_um: 0.0,
            dwell_error: 0.0,
            ..setup.options.clone()
        };
        let setup = Setup {
            options,
            simulator: setup.simulator.clone(),
            window: setup.window.clone(),
            ..**setup
        };
        Self { setup: Arc::new(setup), ..self.clone() }
    }

    /// Depths and targets of a row of the workpiece, µm.
    pub(crate) fn row(&self, row: usize) -> (&[f64], &[f64]) {
        let window = &self.setup.window;
        let start = (window.start + row) * self.setup.simulator.grid().columns + window.start;
        (&self.surface_um[start..][..SIZE_PX], &self.target_um[row * SIZE_PX..][..SIZE_PX])
    }

    /// What surfaces on the simulation's grid are compared with in this episode.
    ///
    /// # Errors
    /// [`MillingError::EmptyTarget`] before the first reset.
    pub(crate) fn objective(&self) -> Result<Objective, MillingError> {
        let grid = *self.setup.simulator.grid();
        let mut target_um = vec![0.0; grid.len()];
        let window = self.setup.window.clone();
        for (row, depths) in self.target_um.chunks_exact(SIZE_PX).enumerate() {
            let start = (window.start + row) * grid.columns + window.start;
            target_um[start..start + SIZE_PX].copy_from_slice(depths);
        }
        Objective::new(grid, target_um, window.clone(), window)
    }
}

/// Refuses targets that cannot be milled.
fn check_target(target_um: &[f64]) -> Result<(), MillingError> {
    let expected = SIZE_PX * SIZE_PX;
    if target_um.len() != expected {
        let actual = target_um.len();
        return Err(MillingError::WrongLength { name: "target_um", actual, expected });
    }
    check_depths(target_um, SIZE_PX)?;
    if target_um.iter().all(|depth| *depth <= 0.0) {
        Err(MillingError::EmptyTarget)
    } else {
        Ok(())
    }
}

/// Refuses actions that are not finite; `environment` is the index for the error.
pub(crate) fn check_finite(action: Action, environment: usize) -> Result<(), MillingError> {
    let [x, y, dwell] = action;
    if action.iter().all(|component| component.is_finite()) {
        Ok(())
    } else {
        Err(MillingError::ActionNotFinite { environment, x, y, dwell })
    }
}
