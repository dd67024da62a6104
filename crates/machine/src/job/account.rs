//! What is known of a job: everything that its journal says, and nothing else.
//!
//! A job under way keeps its account by the same functions that restore it from the journal.

use lasergym_ablation::{Footprint, MAX_PULSE_RADIUS_PX, PulseOutcome, Workpiece};
use lasergym_geom::{Bitmap, Point, WORKPIECE_SIZE_PX};
use lasergym_plan::{Decider, Job, JobState};

use super::pointing::PointingError;
use crate::JobError;
use crate::journal::{
    BeginRecord, EndRecord, FaultRecord, FrameRecord, IntentOrigin, IntentRecord, JOURNAL_VERSION,
    JournalVerdict, MarkRecord, ObservedRecord, Record,
};

/// Part of a mark that must be new for its absence to tell of the laser: vision does not overlook
/// so much, even where the pulse lands a little beside its aim.
const SHOWING_PART: f64 = 0.25;

/// A command whose outcome is not known yet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pending {
    pub(super) intent: IntentRecord,
    /// Whether the laser has said that it fired.
    pub(super) fired: bool,
}

/// What was seen after a command.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outcome {
    pub(super) verdict: JournalVerdict,
    pub(super) marks: Vec<MarkRecord>,
    pub(super) shift_px: Point,
    pub(super) looks: u32,
    pub(super) vision_ms: f64,
}

/// Everything that is known of a job.
#[derive(Debug, Clone)]
pub(super) struct Account {
    pub(super) begin: BeginRecord,
    pub(super) state: JobState,
    machined: PulseOutcome,
    pub(super) pulses: usize,
    pub(super) commands: usize,
    pub(super) unseen: usize,
    pub(super) uncertain: usize,
    pub(super) looks: usize,
    pub(super) given_up_px: u32,
    pub(super) resumed: usize,
    pub(super) unseen_in_a_row: u32,
    pub(super) faults: Vec<FaultRecord>,
    pub(super) end: Option<EndRecord>,
    /// The command at hand.
    pub(super) pending: Option<Pending>,
    /// A command that was never carried out and is due again.
    pub(super) again: Option<Point>,
    /// The frame before the first pulse.
    pub(super) reference: Option<FrameRecord>,
    /// The frame that shows everything of the account.
    pub(super) last_frame: Option<FrameRecord>,
    /// A newer frame, which shows the command at hand too.
    newer_frame: Option<FrameRecord>,
    /// Where commands were fired without a mark that was seen for certain.
    in_vain: Vec<Point>,
    /// What the marks have told of the stage.
    pointing: PointingError,
    /// Whether nothing has been observed since the job was resumed: there may be marks of pulses that
    /// the journal does not know.
    just_resumed: bool,
    /// Whether besides the end of its journal was damaged.
    pub(super) records_lost: bool,
}

impl Account {
    /// The account of a job that is about to begin.
    pub(super) fn new(begin: BeginRecord, state: JobState) -> Self {
        Self {
            begin,
            state,
            machined: PulseOutcome::default(),
            pulses: 0,
            commands: 0,
            unseen: 0,
            uncertain: 0,
            looks: 0,
            given_up_px: 0,
            resumed: 0,
            unseen_in_a_row: 0,
            faults: Vec::new(),
            end: None,
            pending: None,
            again: None,
            reference: None,
            last_frame: None,
            newer_frame: None,
            in_vain: Vec::new(),
            pointing: PointingError::default(),
            just_resumed: false,
            records_lost: false,
        }
    }

    /// The account that `records` add up to. The `decider`, if any, makes the state before the first
    /// pulse and recalls every decision.
    pub(super) fn replay(
        records: &[Record],
        mut decider: Option<&mut dyn Decider>,
    ) -> Result<Self, JobError> {
        let foreign = |n: usize, reason: String| JobError::Journal { n: n as u64, reason };
        let Some(Record::Begin(begin)) = records.first() else {
            return Err(foreign(0, "it is not the beginning of a job".to_owned()));
        };
        let job = job_of(begin).map_err(|reason| foreign(0, reason))?;
        let state = match &decider {
            Some(decider) => decider.start(&job),
            None => JobState::new(&job, 0.0),
        };
        let mut account = Self::new((**begin).clone(), state);
        for (n, record) in records.iter().enumerate().skip(1) {
            if let Record::Intent(intent) = record
                && intent.origin == IntentOrigin::Decided
                && let Some(decider) = &mut decider
            {
                decider.recall(&account.state, Point::new(intent.x_px, intent.y_px))?;
            }
            account.apply(record).map_err(|reason| foreign(n, reason))?;
        }
        Ok(account)
    }

    /// Accounts for a record; an error says why it cannot be the next one.
    pub(super) fn apply(&mut self, record: &Record) -> Result<(), String> {
        match record {
            Record::Begin(_) => return Err("the job begins twice".to_owned()),
            Record::Frame(frame) => self.keep_frame(frame),
            Record::Intent(intent) => self.intend(*intent)?,
            Record::Position(_) => {}
            Record::Fired(fired) => self.pending(fired.pulse)?.fired = true,
            Record::Observed(observed) => self.replay_observed(observed)?,
            Record::Fault(fault) => self.faults.push(fault.clone()),
            Record::Resumed(resumed) => {
                self.resumed += 1;
                self.just_resumed = true;
                self.records_lost = resumed.dropped_bytes > 0;
                if self.end.take().is_some() {
                    // Somebody has looked after the laser.
                    self.unseen_in_a_row = 0;
                }
            }
            Record::End(end) => self.end = Some(end.clone()),
        }
        Ok(())
    }

    fn keep_frame(&mut self, frame: &FrameRecord) {
        if frame.pulse == 0 && self.commands == 0 {
            self.reference = Some(frame.clone());
        }
        if self.pending.is_some_and(|pending| pending.intent.pulse == frame.pulse) {
            self.newer_frame = Some(frame.clone());
        } else {
            self.last_frame = Some(frame.clone());
        }
    }

    fn intend(&mut self, intent: IntentRecord) -> Result<(), String> {
        if let Some(pending) = self.pending {
            let pulse = pending.intent.pulse;
            return Err(format!("pulse {pulse} has no outcome yet"));
        }
        if intent.pulse != self.commands + 1 {
            return Err(format!("pulse {} follows pulse {}", intent.pulse, self.commands));
        }
        self.commands += 1;
        self.again = None;
        self.pending = Some(Pending { intent, fired: false });
        Ok(())
    }

    fn pending(&mut self, pulse: usize) -> Result<&mut Pending, String> {
        let pending = self.pending.as_mut().filter(|pending| pending.intent.pulse == pulse);
        pending.ok_or_else(|| format!("pulse {pulse} was never commanded"))
    }

    fn replay_observed(&mut self, observed: &ObservedRecord) -> Result<(), String> {
        let outcome = Outcome {
            verdict: observed.verdict,
            marks: observed.marks.clone(),
            shift_px: Point::new(observed.shift_px[0], observed.shift_px[1]),
            looks: observed.looks,
            vision_ms: observed.vision_ms,
        };
        if let Some(mark) = outcome.marks.iter().find(|mark| !is_mark(mark)) {
            return Err(format!("{mark:?} is no mark"));
        }
        let tries = if observed.gave_up { 0 } else { u32::MAX };
        let again = self.observe(observed.pulse, outcome, tries)?;
        if again == *observed {
            return Ok(());
        }
        Err(format!("it ends with state {}, not {}", again.state_hash, observed.state_hash))
    }

    /// Accounts for the outcome of the command at hand, and gives the target about it up after
    /// `tries_per_place` commands in vain. Only marks that were seen count as machined.
    pub(super) fn observe(
        &mut self,
        pulse: usize,
        outcome: Outcome,
        tries_per_place: u32,
    ) -> Result<ObservedRecord, String> {
        let Pending { intent, fired } = *self.pending(pulse)?;
        self.pending = None;
        self.looks += outcome.looks as usize;
        let aimed = Point::new(intent.x_px, intent.y_px);
        let mut gave_up = false;
        match outcome.verdict {
            JournalVerdict::Seen | JournalVerdict::Dry => {
                for mark in &outcome.marks {
                    let disc = self.state.machine(&Footprint::of(mark.disc()));
                    self.machined = self.machined + disc;
                }
                // A journal may also end too early where no record is cut in two.
                let several = self.just_resumed || intent.origin == IntentOrigin::Recovered;
                if outcome.verdict == JournalVerdict::Seen {
                    self.learn_pointing(intent, &outcome.marks);
                }
                let pulses = if several { outcome.marks.len().max(1) } else { 1 };
                (0..pulses).for_each(|_| self.state.count_pulse());
                self.pulses += pulses;
                self.unseen_in_a_row = 0;
            }
            JournalVerdict::Uncertain => {
                // It may have marked, so it is one pulse less, but nothing counts as machined.
                self.state.count_pulse();
                self.pulses += 1;
                self.uncertain += 1;
                self.unseen_in_a_row = 0;
                gave_up = self.try_in_vain(aimed, tries_per_place);
            }
            JournalVerdict::Nothing if fired => {
                self.unseen += 1;
                if self.would_show(aimed) {
                    self.unseen_in_a_row += 1;
                }
                gave_up = self.try_in_vain(aimed, tries_per_place);
            }
            JournalVerdict::Nothing => {
                self.unseen += 1;
                if intent.origin != IntentOrigin::Recovered {
                    self.again = Some(aimed);
                }
            }
        }
        (self.just_resumed, self.records_lost) = (false, false);
        if let Some(frame) = self.newer_frame.take() {
            self.last_frame = Some(frame);
        }
        let (reward, machined_fraction, off_target_fraction) = self.score();
        Ok(ObservedRecord {
            pulse,
            verdict: outcome.verdict,
            marks: outcome.marks,
            shift_px: [outcome.shift_px.x, outcome.shift_px.y],
            looks: outcome.looks,
            vision_ms: outcome.vision_ms,
            gave_up,
            state_hash: format!("{:016x}", self.state.hash()),
            machined_fraction,
            off_target_fraction,
            reward,
        })
    }

    /// How far beside `aimed` the stage is to be sent, px.
    pub(super) fn correction_px(&self, aimed: Point) -> Point {
        self.pointing.correction_px(aimed, self.imaging_px())
    }

    fn learn_pointing(&mut self, intent: IntentRecord, marks: &[MarkRecord]) {
        // Of several marks nobody knows which one was aimed.
        if let [mark] = marks
            && intent.origin != IntentOrigin::Recovered
        {
            let seen = Point::new(mark.x_px, mark.y_px);
            self.pointing.learn(intent.commanded_px(), seen, self.imaging_px());
        }
    }

    /// Where the stage comes from; 1 px is 1 µm.
    fn imaging_px(&self) -> Point {
        let [x, y] = self.begin.imaging_um;
        Point::new(x, y)
    }

    /// Whether a pulse at `aimed` would newly machine so much that its mark can hardly be overlooked.
    fn would_show(&self, aimed: Point) -> bool {
        let footprint = self.state.job().footprint(aimed);
        let outcome = self.state.workpiece().preview(&footprint);
        let new_px = f64::from(outcome.hit_px + outcome.miss_px);
        new_px >= SHOWING_PART * f64::from(footprint.area_px())
    }

    /// Counts a command at `aimed` of which no mark was seen for certain; gives up what is there
    /// after too many.
    fn try_in_vain(&mut self, aimed: Point, tries_per_place: u32) -> bool {
        self.in_vain.push(aimed);
        let here = |place: &Point| place.distance(aimed) <= self.begin.pulse_radius_px / 2.0;
        let tries = self.in_vain.iter().filter(|place| here(place)).count();
        if tries < tries_per_place as usize {
            return false;
        }
        self.in_vain.retain(|place| !here(place));
        let footprint = self.state.job().footprint(aimed);
        self.given_up_px += self.state.give_up(&footprint);
        true
    }

    /// Reward, machined fraction and off-target fraction of what was seen.
    pub(super) fn score(&self) -> (f64, f64, f64) {
        let area_px = f64::from(self.state.job().target().area_px());
        let PulseOutcome { hit_px, miss_px } = self.machined;
        (self.machined.reward(), f64::from(hit_px) / area_px, f64::from(miss_px) / area_px)
    }
}

/// Whether a mark is one that a workpiece can have.
pub(super) fn is_mark(mark: &MarkRecord) -> bool {
    let numbers = [mark.x_px, mark.y_px, mark.confidence];
    numbers.iter().all(|number| number.is_finite())
        && mark.radius_px > 0.0
        && mark.radius_px <= MAX_PULSE_RADIUS_PX
}

/// The rows of a target as they are written down.
pub(super) fn target_rows(target: &Bitmap) -> Vec<String> {
    let pixel = |row, column| if target.contains(row, column) { '1' } else { '0' };
    (0..WORKPIECE_SIZE_PX)
        .map(|row| (0..WORKPIECE_SIZE_PX).map(|column| pixel(row, column)).collect())
        .collect()
}

/// The job that was begun.
pub(super) fn job_of(begin: &BeginRecord) -> Result<Job, String> {
    if begin.version != JOURNAL_VERSION {
        return Err(format!("version {} instead of {JOURNAL_VERSION}", begin.version));
    }
    let rows: Vec<&[u8]> = begin.target.iter().map(String::as_bytes).collect();
    let is_row = |row: &&[u8]| {
        row.len() == WORKPIECE_SIZE_PX && row.iter().all(|pixel| matches!(pixel, b'0' | b'1'))
    };
    if rows.len() != WORKPIECE_SIZE_PX || !rows.iter().all(is_row) {
        return Err("its target is not 100 rows of 100 characters 0 or 1".to_owned());
    }
    let target = Bitmap::from_fn(|row, column| rows[row][column] == b'1');
    let workpiece = Workpiece::new(&target).map_err(|error| error.to_string())?;
    Job::new(workpiece, begin.pulse_radius_px, begin.max_pulses).map_err(|error| error.to_string())
}
