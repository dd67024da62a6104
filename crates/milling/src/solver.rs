//! The inverse problem: the passes that mill a target.

use std::cell::Cell;
use std::ops::ControlFlow;

use crate::bounded_lbfgs::{Smooth, StopRule, minimise};
use crate::error::check_option;
use crate::switching::switch_beam;
use crate::{BeamPath, GradientMemory, MillingError, MillingJob, TrackingError};

/// How passes are optimised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveOptions {
    /// Most iterations on the dwell of straight passes, from 1 to 10 000.
    pub iterations: usize,
    /// Rounds in which the beam is switched on or off where that lowers the objective, each followed
    /// by a third of the iterations, up to 100. Without effect where the beam cannot be switched.
    pub switching_rounds: usize,
    /// Most iterations in which passes may also leave their lines, up to 10 000; 0 keeps them
    /// straight.
    pub free_iterations: usize,
    /// How far a free pass may leave its line, as a part of the pitch, in (0, 0.5].
    pub free_range: f64,
    /// An optimisation ends early when five iterations in a row lower the objective by less than
    /// this part, in [0, 1).
    pub least_fall: f64,
}

impl Default for SolveOptions {
    fn default() -> Self {
        Self {
            iterations: 45,
            switching_rounds: 2,
            free_iterations: 30,
            free_range: 0.5,
            least_fall: 1e-3,
        }
    }
}

impl SolveOptions {
    /// Checks every option against its range.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] names the first option outside its range.
    pub fn validate(&self) -> Result<(), MillingError> {
        let count = |name, value: usize, range: std::ops::RangeInclusive<usize>, expected| {
            check_option(name, value as f64, range.contains(&value), expected)
        };
        count("iterations", self.iterations, 1..=10_000, "from 1 to 10 000")?;
        count("switching_rounds", self.switching_rounds, 0..=100, "at most 100")?;
        count("free_iterations", self.free_iterations, 0..=10_000, "at most 10 000")?;
        let ok = self.free_range > 0.0 && self.free_range <= 0.5;
        check_option("free_range", self.free_range, ok, "in (0, 0.5]")?;
        check_option(
            "least_fall",
            self.least_fall,
            (0.0..1.0).contains(&self.least_fall),
            "in [0, 1)",
        )
    }
}

/// What is being optimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolveStage {
    /// The dwell of straight passes.
    Straight,
    /// Dwell and place of free passes.
    Free,
}

/// The state after an iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveProgress {
    /// What is being optimised.
    pub stage: SolveStage,
    /// Part of the iterations that is done, in [0, 1], never falling.
    pub fraction: f64,
    /// The objective, µm⁴.
    pub objective: f64,
    /// The tracking error, % ([`TrackingError::percent`]).
    pub error_percent: f64,
}

/// Passes that mill a target, and how well.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The passes, layer by layer.
    pub path: BeamPath,
    /// The surface that they are predicted to leave, µm, on the simulation's grid.
    pub depth_um: Vec<f64>,
    /// Its distance from the target.
    pub error: TrackingError,
    /// Distance of the surface that the pixel-by-pixel passes leave.
    pub pixel_by_pixel: TrackingError,
    /// Distance after the straight passes alone.
    pub straight: TrackingError,
    /// The state after every iteration, the start first.
    pub convergence: Vec<SolveProgress>,
    /// Number of layers.
    pub layers: usize,
    /// Whether the solver was stopped before it had finished; then this is the best so far.
    pub partial: bool,
}

impl MillingJob {
    /// Finds the passes that mill the target from [`MillingJob::start_um`].
    ///
    /// `progress` is called after every iteration; when it answers [`ControlFlow::Break`] the best
    /// passes so far are returned, with [`Solution::partial`] set.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] for options out of range.
    pub fn solve(
        &self,
        options: &SolveOptions,
        progress: &mut dyn FnMut(&SolveProgress) -> ControlFlow<()>,
    ) -> Result<Solution, MillingError> {
        self.solve_from(self.start_um(), self.layers(), options, progress)
    }

    /// As [`MillingJob::solve`], from the surface `start_um` with `layers` layers left, as after
    /// measuring a workpiece between layers.
    ///
    /// # Errors
    /// As [`MillingJob::solve`]; [`MillingError::WrongLength`] unless `start_um` has a depth for each
    /// cell of the simulation's grid.
    pub fn solve_from(
        &self,
        start_um: &[f64],
        layers: usize,
        options: &SolveOptions,
        progress: &mut dyn FnMut(&SolveProgress) -> ControlFlow<()>,
    ) -> Result<Solution, MillingError> {
        options.validate()?;
        let path = self.pixel_by_pixel(start_um, layers)?;
        let mut depth_um = start_um.to_vec();
        self.simulator().mill(&path, &mut depth_um)?;
        let pixel_by_pixel = self.objective().tracking_error(&depth_um)?;
        let start = SolveProgress {
            stage: SolveStage::Straight,
            fraction: 0.0,
            objective: self.objective().value(&depth_um)?,
            error_percent: pixel_by_pixel.percent,
        };
        let mut run = Run { job: self, start_um, options, convergence: vec![start], progress };
        let (path, straight_depth_um, mut flow) = run.straight(path)?;
        let straight = self.objective().tracking_error(&straight_depth_um)?;
        let (mut path, mut depth_um) = (path, straight_depth_um);
        if flow.is_continue() && options.free_iterations > 0 {
            let before = path.clone();
            (path, depth_um, flow) = run.free(path)?;
            // Least squares may trade a little of the mean for the extremes.
            if self.objective().tracking_error(&depth_um)?.percent > straight.percent {
                path = before;
                depth_um = start_um.to_vec();
                self.simulator().mill(&path, &mut depth_um)?;
            }
        }
        Ok(Solution {
            error: self.objective().tracking_error(&depth_um)?,
            path,
            depth_um,
            pixel_by_pixel,
            straight,
            convergence: run.convergence,
            layers,
            partial: flow.is_break(),
        })
    }
}

/// A path, its surface, and whether to go on.
type Stage = (BeamPath, Vec<f64>, ControlFlow<()>);

struct Run<'a> {
    job: &'a MillingJob,
    start_um: &'a [f64],
    options: &'a SolveOptions,
    convergence: Vec<SolveProgress>,
    progress: &'a mut dyn FnMut(&SolveProgress) -> ControlFlow<()>,
}

impl Run<'_> {
    /// Optimises dwells, then switches the beam and optimises again.
    fn straight(&mut self, path: BeamPath) -> Result<Stage, MillingError> {
        let rounds =
            if self.job.profile().can_switch_off { self.options.switching_rounds } else { 0 };
        let refinement = self.options.iterations / 3;
        let (mut path, mut depth_um, mut flow) =
            self.optimise(path, SolveStage::Straight, self.options.iterations)?;
        for _ in 0..rounds {
            if flow.is_break() || refinement == 0 {
                break;
            }
            let before = self.job.objective().value(&depth_um)?;
            let mut switched = path.clone();
            if switch_beam(self.job, &mut switched, &depth_um)? == 0 {
                break;
            }
            let (next, next_depth_um, next_flow) =
                self.optimise(switched, SolveStage::Straight, refinement)?;
            flow = next_flow;
            if self.job.objective().value(&next_depth_um)? >= before {
                break;
            }
            (path, depth_um) = (next, next_depth_um);
        }
        Ok((path, depth_um, flow))
    }

    fn free(&mut self, path: BeamPath) -> Result<Stage, MillingError> {
        self.optimise(path, SolveStage::Free, self.options.free_iterations)
    }

    fn optimise(
        &mut self,
        path: BeamPath,
        stage: SolveStage,
        iterations: usize,
    ) -> Result<Stage, MillingError> {
        let latest = Cell::new(f64::NAN);
        let mut controls = Controls::new(self.job, self.start_um, path, stage, &latest);
        let (mut x, lower, upper) = controls.bounded(self.options.free_range);
        let rule = StopRule { iterations, least_fall: self.options.least_fall };
        let scale = controls.scale;
        let done = self.convergence.last().map_or(0.0, |last| last.fraction);
        let share = self.share(iterations);
        let (convergence, progress) = (&mut self.convergence, &mut self.progress);
        let flow =
            minimise(&mut controls, &mut x, &lower, &upper, rule, &mut |iteration, value| {
                let now = SolveProgress {
                    stage,
                    fraction: (done + share * iteration as f64 / iterations as f64).min(1.0),
                    objective: value * scale,
                    error_percent: latest.get(),
                };
                convergence.push(now);
                progress(&now)
            })?;
        if let Some(last) = self.convergence.last_mut() {
            last.fraction = (done + share).min(1.0);
        }
        controls.set(&x);
        let mut depth_um = self.start_um.to_vec();
        self.job.simulator().mill(&controls.path, &mut depth_um)?;
        Ok((controls.path, depth_um, flow))
    }

    /// Part of all work that so many iterations are.
    fn share(&self, iterations: usize) -> f64 {
        let options = self.options;
        let rounds = if self.job.profile().can_switch_off { options.switching_rounds } else { 0 };
        let all = options.iterations + rounds * (options.iterations / 3) + options.free_iterations;
        iterations as f64 / all as f64
    }
}

/// The controls as the optimiser sees them: doses as parts of the dose at the lowest speed, places as
/// parts of the footprint's reach. In doses the objective of straight passes is a parabola where
/// slopes do not matter.
struct Controls<'a> {
    job: &'a MillingJob,
    start_um: &'a [f64],
    path: BeamPath,
    /// Points beside which the beam is on: only they matter.
    points: Vec<usize>,
    free: bool,
    dose_unit: f64,
    /// µm⁴ of an objective of 1.
    scale: f64,
    /// Tracking error of the point evaluated last, %.
    latest: &'a Cell<f64>,
    memory: GradientMemory,
}

impl<'a> Controls<'a> {
    fn new(
        job: &'a MillingJob,
        start_um: &'a [f64],
        path: BeamPath,
        stage: SolveStage,
        latest: &'a Cell<f64>,
    ) -> Self {
        let (_, longest) = job.profile().dwell_range_s_mm();
        let segments = path.points - 1;
        let matters = |index: &usize| {
            let (pass, point) = (index / path.points, index % path.points);
            let on = |segment: usize| path.beam_on[pass * segments + segment];
            (point > 0 && on(point - 1)) || (point < segments && on(point))
        };
        let points = (0..path.y_um.len()).filter(matters).collect();
        let nothing = vec![0.0; job.grid().len()];
        Self {
            job,
            start_um,
            points,
            free: stage == SolveStage::Free,
            dose_unit: job.profile().process.law.dose_s_mm(longest),
            scale: job.objective().value_of(&nothing),
            path,
            latest,
            memory: GradientMemory::default(),
        }
    }

    /// Variables and their bounds.
    fn bounded(&self, free_range: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let profile = self.job.profile();
        let law = &profile.process.law;
        let (least, most) = profile.dwell_range_s_mm();
        let dose = |dwell: f64| law.dose_s_mm(dwell) / self.dose_unit;
        let count = self.points.len();
        let mut x: Vec<f64> = self.points.iter().map(|&k| dose(self.path.dwell_s_mm[k])).collect();
        let (mut lower, mut upper) = (vec![dose(least); count], vec![dose(most); count]);
        if self.free {
            let reach_um = profile.process.footprint.reach_um();
            let range = free_range * profile.pitch_um / reach_um;
            for &k in &self.points {
                let y = self.path.y_um[k] / reach_um;
                x.push(y);
                lower.push(y - range);
                upper.push(y + range);
            }
        }
        (x, lower, upper)
    }

    /// Takes the variables over into the path.
    fn set(&mut self, x: &[f64]) {
        let profile = self.job.profile();
        let reach_um = profile.process.footprint.reach_um();
        let (least, most) = profile.dwell_range_s_mm();
        let (doses, places) = x.split_at(self.points.len());
        for (&k, dose) in self.points.iter().zip(doses) {
            let dwell = profile.process.law.dwell_of_dose_s_mm(dose * self.dose_unit);
            // Rounding must not leave the speed limits.
            self.path.dwell_s_mm[k] = dwell.clamp(least, most);
        }
        for (&k, y) in self.points.iter().zip(places) {
            self.path.y_um[k] = y * reach_um;
        }
    }
}

impl Smooth for Controls<'_> {
    fn value(&mut self, x: &[f64], gradient: &mut [f64]) -> Result<f64, MillingError> {
        self.set(x);
        let objective = self.job.objective();
        let simulator = self.job.simulator();
        let found = match simulator.gradient(&self.path, self.start_um, objective, &mut self.memory)
        {
            // A free pass may be so much longer than its line that its steps would be unstable.
            Err(MillingError::Unstable { .. }) => return Ok(f64::INFINITY),
            other => other?,
        };
        self.latest.set(objective.tracking_error(&found.depth_um)?.percent);
        let law = &self.job.profile().process.law;
        let reach_um = self.job.profile().process.footprint.reach_um();
        let (doses, places) = gradient.split_at_mut(self.points.len());
        for (&k, dose) in self.points.iter().zip(doses) {
            let (_, slope) = law.dose_and_slope(self.path.dwell_s_mm[k]);
            *dose = found.dwell[k] / slope * self.dose_unit / self.scale;
        }
        for (&k, place) in self.points.iter().zip(places) {
            *place = found.y[k] * reach_um / self.scale;
        }
        Ok(found.objective / self.scale)
    }
}
