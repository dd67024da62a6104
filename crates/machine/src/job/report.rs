//! What became of a job.

use std::time::Duration;

use lasergym_geom::Point;
use lasergym_plan::JobState;
use serde::{Deserialize, Serialize};

use crate::journal::{self, BeginRecord, FaultRecord, JobStorage, JournalVerdict, Record};
use crate::{Damage, JobError, Mark};

use super::account::Account;

/// Why a job has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobStatus {
    /// As much is machined as was asked for.
    Complete,
    /// All pulses are used.
    PulsesUsed,
    /// No further pulse would gain anything.
    NothingToGain,
    /// All commands are used, though not all of them left a mark. It goes on when resumed with more.
    CommandsUsed,
    /// The user has stopped it. It goes on when resumed.
    Interrupted,
    /// The machine has failed; the last fault says how. It goes on when resumed.
    Fault,
}

impl JobStatus {
    /// Whether there is nothing left to resume.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(self, Self::Complete | Self::PulsesUsed | Self::NothingToGain)
    }
}

/// What the time of a job was spent on, s.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseTimes {
    /// Moving the stage.
    pub move_s: f64,
    /// Waiting for the stage to confirm that it is at rest.
    pub settle_s: f64,
    /// Taking frames.
    pub camera_s: f64,
    /// Finding the marks.
    pub vision_s: f64,
    /// Deciding about the pulses.
    pub decide_s: f64,
    /// Writing journal and frames.
    pub journal_s: f64,
    /// Arming, firing, disarming.
    pub fire_s: f64,
}

/// The result of a job.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JobReport {
    /// Why it has ended.
    pub status: JobStatus,
    /// (target machined − off-target machined) / workpiece area, as far as seen.
    pub reward: f64,
    /// Machined fraction of the target, as far as seen.
    pub machined_fraction: f64,
    /// Area machined beside the target over the area of the target, as far as seen.
    pub off_target_fraction: f64,
    /// Pulses that marked, or may have (those of uncertain outcome).
    pub pulses: usize,
    /// Pulses that were commanded.
    pub commands: usize,
    /// Commands that left nothing.
    pub unseen: usize,
    /// Commands whose outcome stayed uncertain.
    pub uncertain: usize,
    /// Frames that were looked at.
    pub looks: usize,
    /// Target that was given up, px.
    pub given_up_px: u32,
    /// How often the job was resumed.
    pub resumed: usize,
    /// Whether nothing was really fired.
    pub dry_run: bool,
    /// Every fault since the job was begun.
    pub faults: Vec<FaultRecord>,
    /// Time since the job was begun or resumed, s.
    pub elapsed_s: f64,
    /// What it was spent on.
    pub phases: PhaseTimes,
}

impl JobReport {
    pub(super) fn new(
        account: &Account,
        status: JobStatus,
        elapsed: Duration,
        phases: PhaseTimes,
    ) -> Self {
        let (reward, machined_fraction, off_target_fraction) = account.score();
        Self {
            status,
            reward,
            machined_fraction,
            off_target_fraction,
            pulses: account.pulses,
            commands: account.commands,
            unseen: account.unseen,
            uncertain: account.uncertain,
            looks: account.looks,
            given_up_px: account.given_up_px,
            resumed: account.resumed,
            dry_run: account.begin.dry_run,
            faults: account.faults.clone(),
            elapsed_s: elapsed.as_secs_f64(),
            phases,
        }
    }
}

/// A job after one more command.
#[derive(Debug, Clone, Copy)]
pub struct JobProgress<'a> {
    /// The command, from 1.
    pub pulse: usize,
    /// Pulses that marked, or may have, so far.
    pub pulses: usize,
    /// Most pulses of the job.
    pub max_pulses: usize,
    /// Where it was aimed, px.
    pub aimed_px: Point,
    /// What became of it.
    pub verdict: JournalVerdict,
    /// Its marks.
    pub marks: &'a [Mark],
    /// Frames that were looked at for it.
    pub looks: u32,
    /// The job as the planner sees it now.
    pub state: &'a JobState,
    /// (target machined − off-target machined) / workpiece area.
    pub reward: f64,
    /// Machined fraction of the target.
    pub machined_fraction: f64,
    /// Area machined beside the target over the area of the target.
    pub off_target_fraction: f64,
    /// What the time of this run was spent on.
    pub phases: PhaseTimes,
}

/// A job as its journal has it.
#[derive(Debug, Clone)]
pub struct JobRecord {
    /// The job as it was begun.
    pub begin: BeginRecord,
    /// Its intact records, with the first one.
    pub records: Vec<Record>,
    /// Where the journal breaks; `None` for one that is all intact.
    pub damage: Option<Damage>,
    /// What was achieved so far. The status is `None` while no end was written; a job whose process
    /// died has none.
    pub status: Option<JobStatus>,
    /// (target machined − off-target machined) / workpiece area.
    pub reward: f64,
    /// Machined fraction of the target.
    pub machined_fraction: f64,
    /// Area machined beside the target over the area of the target.
    pub off_target_fraction: f64,
}

/// Reads the job in `storage` without a machine.
///
/// # Errors
/// [`JobError::NoJob`], [`JobError::Storage`], [`JobError::Journal`].
pub fn read_job(storage: &dyn JobStorage) -> Result<JobRecord, JobError> {
    let reading = journal::read(storage)?;
    let account = Account::replay(&reading.records, None)?;
    let (reward, machined_fraction, off_target_fraction) = account.score();
    Ok(JobRecord {
        begin: account.begin,
        records: reading.records,
        damage: reading.damage,
        status: account.end.map(|end| end.status),
        reward,
        machined_fraction,
        off_target_fraction,
    })
}
