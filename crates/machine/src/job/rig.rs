//! The machine of a job: stage, interlocked laser and camera, with everything they say checked.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::{Duration, Instant};

use lasergym_geom::{Point, WORKPIECE_SIZE_PX};

use crate::halt::Halt;
use crate::interlock::Interlock;
use crate::{
    Camera, Device, Fault, FaultKind, Frame, JobError, Laser, Stage, StageLimits, Supervised,
};

use super::options::{Drivers, JobOptions};
use super::report::PhaseTimes;

/// What the checks need to know.
#[derive(Debug, Clone)]
struct Checks {
    imaging_um: Point,
    settle_reads: u32,
    settle_tries: u32,
    settle_wait: Duration,
    moves: u32,
}

/// The machine of a job.
#[derive(Debug)]
pub(super) struct Rig<S, L, C> {
    stage: Supervised<S>,
    interlock: Interlock<Supervised<L>>,
    camera: Supervised<C>,
    checks: Checks,
    /// Columns and rows of all frames, px.
    frame_sides_px: Option<(usize, usize)>,
    pub(super) phases: PhaseTimes,
}

impl<S: Stage, L: Laser, C: Camera> Rig<S, L, C> {
    pub(super) fn new(drivers: Drivers<S, L, C>, options: &JobOptions) -> Result<Self, JobError> {
        let JobOptions { deadlines, .. } = *options;
        let laser = Supervised::laser(drivers.laser, deadlines)?;
        let stop: Arc<AtomicBool> = Arc::clone(&options.stop);
        Ok(Self {
            stage: Supervised::stage(drivers.stage, deadlines)?,
            interlock: Interlock::new(laser, options.tolerance_um, options.dry_run, stop),
            camera: Supervised::camera(drivers.camera, deadlines)?,
            checks: Checks {
                imaging_um: options.imaging_um,
                settle_reads: options.settle_reads,
                settle_tries: options.settle_tries,
                settle_wait: options.settle_wait,
                moves: options.moves,
            },
            frame_sides_px: None,
            phases: PhaseTimes::default(),
        })
    }

    /// Laser off, origin found, exposure set.
    pub(super) fn prepare(&mut self, options: &JobOptions) -> Result<(), Halt> {
        self.interlock.make_safe()?;
        self.check_stop()?;
        if options.home {
            let began = Instant::now();
            self.stage.home()?;
            self.phases.move_s += began.elapsed().as_secs_f64();
        }
        if let Some(exposure_s) = options.exposure_s {
            self.camera.set_exposure_s(exposure_s)?;
        }
        self.check_stop()
    }

    /// Whether the user wants to stop.
    pub(super) fn check_stop(&self) -> Result<(), Halt> {
        self.interlock.check_stop()
    }

    /// Whether a pulse may be aimed at `aimed`: on the workpiece, and within reach of the stage.
    pub(super) fn check_aim(&self, aimed: Point) -> Result<(), Fault> {
        let side = 0.0..=WORKPIECE_SIZE_PX as f64;
        let Point { x, y } = aimed;
        if !(side.contains(&x) && side.contains(&y)) {
            let message = format!("it wants a pulse at ({x}, {y}) px, beside the workpiece");
            return Err(Fault::new(Device::Planner, FaultKind::OutOfLimits, message));
        }
        self.check_reach(aimed)
    }

    /// The place on the workpiece, within reach of the stage, that is nearest to `position_um`.
    pub(super) fn nearest_reachable(&self, position_um: Point) -> Point {
        let StageLimits { least_um, most_um } = self.stage.limits_um();
        let side_um = WORKPIECE_SIZE_PX as f64;
        let within = |at: f64, least: f64, most: f64| at.max(least.max(0.0)).min(most.min(side_um));
        Point::new(
            within(position_um.x, least_um.x, most_um.x),
            within(position_um.y, least_um.y, most_um.y),
        )
    }

    fn check_reach(&self, position_um: Point) -> Result<(), Fault> {
        let limits_um = self.stage.limits_um();
        if limits_um.contains(position_um) {
            return Ok(());
        }
        let Point { x, y } = position_um;
        let StageLimits { least_um, most_um } = limits_um;
        let message = format!(
            "({x}, {y}) µm is beyond its limits, ({}, {}) to ({}, {}) µm",
            least_um.x, least_um.y, most_um.x, most_um.y
        );
        Err(Fault::new(Device::Stage, FaultKind::OutOfLimits, message))
    }

    /// Goes to `goal_um` and comes back with the position when the stage has confirmed, several times
    /// in a row, that it rests there.
    pub(super) fn go_to(&mut self, goal_um: Point) -> Result<Point, Halt> {
        self.check_reach(goal_um)?;
        let mut last = None;
        for _ in 0..self.checks.moves {
            self.check_stop()?;
            self.interlock.leave();
            let began = Instant::now();
            let moved = self.stage.move_to(goal_um);
            self.phases.move_s += began.elapsed().as_secs_f64();
            moved?;
            let began = Instant::now();
            let confirmed = self.confirm(goal_um, &mut last);
            self.phases.settle_s += began.elapsed().as_secs_f64();
            if let Some(position_um) = confirmed? {
                return Ok(position_um);
            }
        }
        let Point { x, y } = last.unwrap_or(goal_um);
        let message =
            format!("it rests at ({x}, {y}) µm instead of ({}, {}) µm", goal_um.x, goal_um.y);
        Err(Fault::new(Device::Stage, FaultKind::OutOfTolerance, message).into())
    }

    fn confirm(&mut self, goal_um: Point, last: &mut Option<Point>) -> Result<Option<Point>, Halt> {
        let mut in_a_row = 0;
        for _ in 0..self.checks.settle_tries {
            self.check_stop()?;
            let position_um = self.stage.position_um()?;
            if self.interlock.confirm(goal_um, position_um)? {
                in_a_row += 1;
            } else {
                in_a_row = 0;
                thread::sleep(self.checks.settle_wait);
            }
            *last = Some(position_um);
            if in_a_row == self.checks.settle_reads {
                return Ok(Some(position_um));
            }
        }
        self.interlock.leave();
        Ok(None)
    }

    /// Fires one pulse where the stage has just confirmed to be.
    pub(super) fn fire(&mut self) -> Result<(), Halt> {
        let began = Instant::now();
        let fired = self.interlock.fire();
        self.phases.fire_s += began.elapsed().as_secs_f64();
        fired
    }

    /// Goes where frames are taken.
    pub(super) fn go_to_imaging_position(&mut self) -> Result<(), Halt> {
        self.go_to(self.checks.imaging_um)?;
        // Nothing is fired here.
        self.interlock.leave();
        Ok(())
    }

    /// A frame that was exposed just now, of the same sides as all others.
    pub(super) fn frame(&mut self) -> Result<Frame, Halt> {
        self.check_stop()?;
        let began = Instant::now();
        let frame = self.camera.frame();
        let now = Instant::now();
        self.phases.camera_s += (now - began).as_secs_f64();
        let frame = frame?;
        if frame.taken_at() < began {
            let age_s = began.duration_since(frame.taken_at()).as_secs_f64();
            let message = format!("its frame was exposed {age_s} s before it was asked for");
            return Err(Fault::new(Device::Camera, FaultKind::StaleFrame, message).into());
        }
        if frame.taken_at() > now {
            let message = "its frame comes from the future";
            return Err(Fault::new(Device::Camera, FaultKind::Protocol, message).into());
        }
        self.check_sides(&frame)?;
        Ok(frame)
    }

    /// Whether `frame` has the sides of the first one.
    pub(super) fn check_sides(&mut self, frame: &Frame) -> Result<(), Fault> {
        let sides_px = (frame.width_px(), frame.height_px());
        let expected_px = *self.frame_sides_px.get_or_insert(sides_px);
        if sides_px == expected_px {
            return Ok(());
        }
        let message = format!(
            "its frame is {} × {} px, those before it were {} × {} px",
            sides_px.0, sides_px.1, expected_px.0, expected_px.1
        );
        Err(Fault::new(Device::Camera, FaultKind::Protocol, message))
    }

    /// Laser off and stage stopped, for good. Both are tried; the first failure is told.
    pub(super) fn shut_down(&mut self) -> Result<(), Fault> {
        let disarmed = self.interlock.trip();
        let stopped = self.stage.stop();
        disarmed.and(stopped)
    }
}
