//! The records of a journal.

use lasergym_ablation::Pulse;
use lasergym_geom::Point;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::job::{JobStatus, PhaseTimes};
use crate::{Device, Fault, FaultKind, Mark, Verdict};

/// Version of the records; a journal of another one is refused.
pub const JOURNAL_VERSION: u32 = 1;

/// One line of a journal. `pulse` counts the commands of the job from 1, also those that left no mark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Record {
    /// The job; always the first record.
    Begin(Box<BeginRecord>),
    /// A frame has been saved.
    Frame(FrameRecord),
    /// A pulse is about to be fired. On disk before anything moves.
    Intent(IntentRecord),
    /// The stage has confirmed a position.
    Position(PositionRecord),
    /// The laser has confirmed a pulse.
    Fired(FiredRecord),
    /// What a pulse has really machined. On disk before the next pulse is decided.
    Observed(ObservedRecord),
    /// The machine has failed.
    Fault(FaultRecord),
    /// The job goes on.
    Resumed(ResumedRecord),
    /// The job does not go on for now.
    End(EndRecord),
}

/// The job as it was begun.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeginRecord {
    /// [`JOURNAL_VERSION`].
    pub version: u32,
    /// The target: 100 rows from top to bottom, each of 100 characters, `1` where it is to be machined.
    pub target: Vec<String>,
    /// Radius of a planned pulse, px.
    pub pulse_radius_px: f64,
    /// Most pulses that may mark.
    pub max_pulses: usize,
    /// Weight of the ring in the scores of the planner.
    pub ring_weight: f64,
    /// Whether the laser is never armed.
    pub dry_run: bool,
    /// Where the stage is while frames are taken, µm.
    pub imaging_um: [f64; 2],
    /// Machined fraction at which the job is complete.
    pub completion: f64,
    /// Whether the stage is sent beside the aim by as much as pulses have landed beside theirs.
    #[serde(default)]
    pub correct_pointing: bool,
    /// Name and settings of the planner.
    pub planner: Value,
    /// Names and settings of the drivers.
    pub drivers: Value,
    /// The calibration of camera to stage.
    pub calibration: Value,
    /// Seed of the job.
    pub seed: u64,
}

/// A frame in the folder of the job.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameRecord {
    /// The command after which it was taken; 0 is the reference frame.
    pub pulse: usize,
    /// The file, relative to the folder.
    pub file: String,
    /// Columns, px.
    pub width_px: usize,
    /// Rows, px.
    pub height_px: usize,
    /// CRC-32 of the pixels, 8 hexadecimal digits.
    pub crc: String,
}

/// Where a command comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntentOrigin {
    /// The planner has decided it.
    Decided,
    /// An earlier command that was never carried out is repeated.
    Again,
    /// It was found on the workpiece when the job was resumed; the journal had lost it.
    Recovered,
}

/// A pulse that is about to be fired.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntentRecord {
    /// The command.
    pub pulse: usize,
    /// Where it is to land, px.
    pub x_px: f64,
    /// Where it is to land, px.
    pub y_px: f64,
    /// How far beside it the stage is sent, since pulses have landed beside their aim, px.
    #[serde(default)]
    pub correction_px: [f64; 2],
    /// How long the decision took, ms.
    pub decided_ms: f64,
    /// Where it comes from.
    pub origin: IntentOrigin,
}

impl IntentRecord {
    /// Where the stage is sent, px.
    #[must_use]
    pub fn commanded_px(&self) -> Point {
        let [x, y] = self.correction_px;
        Point::new(self.x_px + x, self.y_px + y)
    }
}

/// Where the stage said that it is before a pulse.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionRecord {
    /// The command.
    pub pulse: usize,
    /// Position, µm.
    pub x_um: f64,
    /// Position, µm.
    pub y_um: f64,
    /// Whether that is close enough to fire.
    pub within_tolerance: bool,
}

/// The laser has said that a pulse was fired.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FiredRecord {
    /// The command.
    pub pulse: usize,
}

/// How the outcome of a pulse was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JournalVerdict {
    /// Its marks were seen and count as machined.
    Seen,
    /// It has left nothing.
    Nothing,
    /// All looks were uncertain: nothing counts as machined, the marks are a guess.
    Uncertain,
    /// A dry run: the commanded disc counts as machined.
    Dry,
}

impl From<Verdict> for JournalVerdict {
    fn from(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Seen => Self::Seen,
            Verdict::Nothing => Self::Nothing,
            Verdict::Uncertain => Self::Uncertain,
        }
    }
}

/// A mark in a journal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkRecord {
    /// Centre, px.
    pub x_px: f64,
    /// Centre, px.
    pub y_px: f64,
    /// Radius, px.
    pub radius_px: f64,
    /// How sure the observer was, in [0, 1].
    pub confidence: f64,
}

impl MarkRecord {
    /// The disc that it covers.
    #[must_use]
    pub fn disc(self) -> Pulse {
        Pulse { position: Point::new(self.x_px, self.y_px), radius_px: self.radius_px }
    }
}

impl From<Mark> for MarkRecord {
    fn from(mark: Mark) -> Self {
        Self {
            x_px: mark.center_px.x,
            y_px: mark.center_px.y,
            radius_px: mark.radius_px,
            confidence: mark.confidence,
        }
    }
}

impl From<MarkRecord> for Mark {
    fn from(mark: MarkRecord) -> Self {
        Self {
            center_px: Point::new(mark.x_px, mark.y_px),
            radius_px: mark.radius_px,
            confidence: mark.confidence,
        }
    }
}

/// What a pulse has really machined, and the job after it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservedRecord {
    /// The command.
    pub pulse: usize,
    /// How it was taken.
    pub verdict: JournalVerdict,
    /// New marks.
    pub marks: Vec<MarkRecord>,
    /// How far the workpiece has moved in the view since the reference frame, px.
    pub shift_px: [f64; 2],
    /// Frames that were looked at.
    pub looks: u32,
    /// Time that the observer took, ms.
    pub vision_ms: f64,
    /// Whether the target about the place was given up after too many pulses in vain.
    pub gave_up: bool,
    /// [`lasergym_plan::JobState::hash`] after the pulse, 16 hexadecimal digits.
    pub state_hash: String,
    /// Machined fraction of the target.
    pub machined_fraction: f64,
    /// Area machined beside the target over the area of the target.
    pub off_target_fraction: f64,
    /// (target machined − off-target machined) / workpiece area.
    pub reward: f64,
}

/// A fault of the machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultRecord {
    /// Where it lies.
    pub device: Device,
    /// What kind of fault it is.
    pub fault: FaultKind,
    /// What happened.
    pub message: String,
}

impl From<Fault> for FaultRecord {
    fn from(fault: Fault) -> Self {
        Self { device: fault.device, fault: fault.kind, message: fault.message }
    }
}

impl From<FaultRecord> for Fault {
    fn from(record: FaultRecord) -> Self {
        Self::new(record.device, record.fault, record.message)
    }
}

/// The job goes on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResumedRecord {
    /// Bytes behind the intact part of the journal that were put aside.
    pub dropped_bytes: u64,
    /// What was wrong with them.
    pub damage: Option<String>,
}

/// The job does not go on for now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndRecord {
    /// Why.
    pub status: JobStatus,
    /// (target machined − off-target machined) / workpiece area.
    pub reward: f64,
    /// Machined fraction of the target.
    pub machined_fraction: f64,
    /// Area machined beside the target over the area of the target.
    pub off_target_fraction: f64,
    /// Pulses that marked, or may have.
    pub pulses: usize,
    /// Pulses that were commanded.
    pub commands: usize,
    /// Time since the job was begun or resumed, s.
    pub elapsed_s: f64,
    /// What it was spent on.
    pub phases: PhaseTimes,
}
