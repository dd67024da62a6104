//! How a job is done.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use lasergym_geom::Point;
use serde_json::Value;

use crate::{Deadlines, Frame, JobError, Observer, ObserverError};

/// The drivers of a machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Drivers<S, L, C> {
    /// Moves the workpiece.
    pub stage: S,
    /// Fires.
    pub laser: L,
    /// Looks.
    pub camera: C,
}

/// Makes the observer of a job from its reference frame, the one before the first pulse.
pub type ObserverMaker = Box<dyn FnOnce(&Frame) -> Result<Box<dyn Observer>, ObserverError> + Send>;

/// What a job is done with, for its journal; nothing of it is read by the job itself.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JobDescription {
    /// Name and settings of the planner.
    pub planner: Value,
    /// Names and settings of the drivers.
    pub drivers: Value,
    /// The calibration of camera to stage.
    pub calibration: Value,
    /// Seed of the job.
    pub seed: u64,
}

/// Settings of a job.
#[derive(Debug, Clone)]
pub struct JobOptions {
    /// Where the stage is while frames are taken, µm. Default (50, 50): the centre of the pattern is
    /// under the objective.
    pub imaging_um: Point,
    /// How far from its goal the stage may be, µm, in (0, 100]; the laser is not armed further
    /// away. Default 0.5: half a pixel.
    pub tolerance_um: f64,
    /// Positions in a row that must be within the tolerance before the stage counts as at rest, in
    /// 1..=1000. Default 2.
    pub settle_reads: u32,
    /// Positions that are read at most after a move, at least `settle_reads`. Default 20.
    pub settle_tries: u32,
    /// Wait after a position out of tolerance. Default 5 ms.
    pub settle_wait: Duration,
    /// How often a move is commanded before the stage counts as unable to get there, in 1..=100.
    /// Default 2.
    pub moves: u32,
    /// Frames of one pulse that are looked at while the observer is uncertain, in 1..=100. Default 3.
    pub looks: u32,
    /// Commands after which the job ends, whatever they have left; `None` for
    /// 2 × the pulses of the job + 10. At least 1.
    pub max_commands: Option<usize>,
    /// Pulses in a row that left nothing before the laser counts as dead, at least 1; those
    /// that would have left little new, on ground that is machined already, do not count. Default 6: with one
    /// misfire in ten that happens once in a million.
    pub unseen_limit: u32,
    /// Commands at one place (within half a pulse radius) of which no mark was seen for certain
    /// before the target there is given up, at least 1. Default 3.
    pub tries_per_place: u32,
    /// Machined fraction of the target at which the job is complete, in (0, 1]. Default 1: go on
    /// while pulses gain anything.
    pub completion: f64,
    /// Whether the stage is sent beside the aim by as much as pulses have lately landed beside theirs.
    /// Default true.
    pub correct_pointing: bool,
    /// Exposure time of the camera, s, above 0; `None` leaves it as it is.
    pub exposure_s: Option<f64>,
    /// Whether the stage looks for its origin first. Default true.
    pub home: bool,
    /// Whether everything is done but arming and firing, as if each pulse landed where it was
    /// commanded. Default true: firing has to be asked for.
    pub dry_run: bool,
    /// How long the drivers may take.
    pub deadlines: Deadlines,
    /// Set it, from a signal handler or another thread, and the job ends after the driver call at
    /// hand, with the laser off.
    pub stop: Arc<AtomicBool>,
}

impl Default for JobOptions {
    fn default() -> Self {
        Self {
            imaging_um: Point::new(50.0, 50.0),
            tolerance_um: 0.5,
            settle_reads: 2,
            settle_tries: 20,
            settle_wait: Duration::from_millis(5),
            moves: 2,
            looks: 3,
            max_commands: None,
            unseen_limit: 6,
            tries_per_place: 3,
            completion: 1.0,
            correct_pointing: true,
            exposure_s: None,
            home: true,
            dry_run: true,
            deadlines: Deadlines::default(),
            stop: Arc::default(),
        }
    }
}

impl JobOptions {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`JobError::InvalidOption`] names the first one out of range.
    pub fn validate(&self) -> Result<(), JobError> {
        let check = |ok: bool, name, value: String, expected| {
            if ok { Ok(()) } else { Err(JobError::InvalidOption { name, value, expected }) }
        };
        let Point { x, y } = self.imaging_um;
        check(
            x.is_finite() && y.is_finite(),
            "imaging_um",
            format!("({x}, {y})"),
            "a position of finite numbers",
        )?;
        let tolerance_ok = self.tolerance_um > 0.0 && self.tolerance_um <= 100.0;
        check(tolerance_ok, "tolerance_um", self.tolerance_um.to_string(), "in (0, 100]")?;
        let completion_ok = self.completion > 0.0 && self.completion <= 1.0;
        check(completion_ok, "completion", self.completion.to_string(), "in (0, 1]")?;
        for (name, value, most, expected) in [
            ("settle_reads", self.settle_reads, 1000, "in 1..=1000"),
            ("moves", self.moves, 100, "in 1..=100"),
            ("looks", self.looks, 100, "in 1..=100"),
            ("unseen_limit", self.unseen_limit, u32::MAX, "at least 1"),
            ("tries_per_place", self.tries_per_place, u32::MAX, "at least 1"),
        ] {
            check((1..=most).contains(&value), name, value.to_string(), expected)?;
        }
        check(
            self.settle_tries >= self.settle_reads,
            "settle_tries",
            self.settle_tries.to_string(),
            "at least settle_reads",
        )?;
        check(self.max_commands != Some(0), "max_commands", "0".to_owned(), "at least 1")?;
        if let Some(exposure_s) = self.exposure_s {
            let ok = exposure_s > 0.0 && exposure_s.is_finite();
            check(ok, "exposure_s", exposure_s.to_string(), "above 0")?;
        }
        let Deadlines { home, move_to, stage, laser, camera } = self.deadlines;
        let shortest = home.min(move_to).min(stage).min(laser).min(camera);
        check(!shortest.is_zero(), "deadlines", "0 s".to_owned(), "above 0")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_never_fire() {
        assert!(JobOptions::default().dry_run);
        assert!(JobOptions::default().validate().is_ok());
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let deadlines = Deadlines { laser: Duration::ZERO, ..Deadlines::default() };
        let default = JobOptions::default;
        for (name, options) in [
            ("imaging_um", JobOptions { imaging_um: Point::new(f64::NAN, 0.0), ..default() }),
            ("tolerance_um", JobOptions { tolerance_um: 0.0, ..default() }),
            ("tolerance_um", JobOptions { tolerance_um: f64::NAN, ..default() }),
            ("completion", JobOptions { completion: 1.1, ..default() }),
            ("settle_reads", JobOptions { settle_reads: 0, ..default() }),
            ("settle_tries", JobOptions { settle_tries: 1, ..default() }),
            ("moves", JobOptions { moves: 0, ..default() }),
            ("looks", JobOptions { looks: 101, ..default() }),
            ("unseen_limit", JobOptions { unseen_limit: 0, ..default() }),
            ("tries_per_place", JobOptions { tries_per_place: 0, ..default() }),
            ("max_commands", JobOptions { max_commands: Some(0), ..default() }),
            ("exposure_s", JobOptions { exposure_s: Some(0.0), ..default() }),
            ("deadlines", JobOptions { deadlines, ..default() }),
        ] {
            let error = options.validate().unwrap_err();
            assert!(matches!(error, JobError::InvalidOption { name: n, .. } if n == name));
        }
    }
}
