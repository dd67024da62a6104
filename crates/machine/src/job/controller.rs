//! The closed loop.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use lasergym_ablation::Workpiece;
use lasergym_geom::Point;
use lasergym_plan::{Decider, Job, PlanError};

use crate::halt::Halt;
use crate::journal::{
    BeginRecord, Durability, EndRecord, FiredRecord, FrameRecord, IntentOrigin, IntentRecord,
    JOURNAL_VERSION, JobStorage, Journal, JournalVerdict, MarkRecord, PositionRecord, Record,
    ResumedRecord, frame_name, frame_to_png, pixels_crc,
};
use crate::{
    Camera, Device, Fault, FaultKind, Frame, JobError, Laser, Mark, Observation, Observer,
    ObserverError, Stage, Verdict,
};

use super::account::{Account, Outcome, is_mark, target_rows};
use super::options::{Drivers, JobDescription, JobOptions, ObserverMaker};
use super::report::{JobProgress, JobReport, JobStatus};
use super::rig::Rig;

/// Told after every command; [`ControlFlow::Break`] stops the job as the user's flag does.
pub(super) type Progress<'a> = dyn FnMut(&JobProgress<'_>) -> ControlFlow<()> + 'a;

/// A job in a closed loop: decide, write the command down, move, fire, look, write down what was
/// seen, and decide again from that.
///
/// Only marks that were seen count as machined. A pulse whose outcome stays uncertain after several
/// looks, or that left nothing, leaves the target as it was; after several in vain at one place, the
/// target there is given up, so that the job goes on elsewhere. A pulse whose outcome is unknown
/// because the process died is never fired again before a look has told what became of it.
pub struct MachineJob<S, L, C> {
    pub(super) journal: Journal,
    pub(super) account: Account,
    decider: Box<dyn Decider>,
    pub(super) rig: Rig<S, L, C>,
    observer: Option<ObserverMaker>,
    pub(super) options: JobOptions,
    resumed: Option<ResumedRecord>,
}

/// What compares frames, and the frame that shows all that is known.
pub(super) struct Eyes {
    observer: Box<dyn Observer>,
    pub(super) before: Frame,
}

impl<S: Stage, L: Laser, C: Camera> MachineJob<S, L, C> {
    /// A new job in an empty storage. Nothing moves yet.
    ///
    /// # Errors
    /// [`JobError::InvalidOption`], [`JobError::NotPristine`], [`JobError::Storage`],
    /// [`JobError::Thread`].
    pub fn begin(
        storage: Box<dyn JobStorage>,
        job: &Job,
        decider: Box<dyn Decider>,
        drivers: Drivers<S, L, C>,
        observer: ObserverMaker,
        description: JobDescription,
        options: JobOptions,
    ) -> Result<Self, JobError> {
        options.validate()?;
        if Workpiece::new(job.target()).as_ref() != Ok(job.workpiece()) {
            return Err(JobError::NotPristine);
        }
        let begin = BeginRecord {
            version: JOURNAL_VERSION,
            target: target_rows(job.target()),
            pulse_radius_px: job.pulse_radius_px(),
            max_pulses: job.max_pulses(),
            ring_weight: decider.ring_weight(),
            dry_run: options.dry_run,
            imaging_um: [options.imaging_um.x, options.imaging_um.y],
            completion: options.completion,
            correct_pointing: options.correct_pointing,
            planner: description.planner,
            drivers: description.drivers,
            calibration: description.calibration,
            seed: description.seed,
        };
        let rig = Rig::new(drivers, &options)?;
        let account = Account::new(begin.clone(), decider.start(job));
        let mut journal = Journal::new(storage);
        journal.append(&Record::Begin(Box::new(begin)), Durability::Now)?;
        let observer = Some(observer);
        Ok(Self { journal, account, decider, rig, observer, options, resumed: None })
    }

    /// The job in `storage`, to go on where its journal ends. Nothing moves and nothing is written
    /// yet. `decider` is a new one of the kind that the job was begun with. The process of the last run
    /// must have ended where one of its drivers hung: what it may still do is not seen otherwise.
    ///
    /// # Errors
    /// As [`Self::begin`], and [`JobError::NoJob`], [`JobError::Journal`],
    /// [`JobError::DifferentJob`].
    pub fn resume(
        storage: Box<dyn JobStorage>,
        mut decider: Box<dyn Decider>,
        drivers: Drivers<S, L, C>,
        observer: ObserverMaker,
        options: JobOptions,
    ) -> Result<Self, JobError> {
        options.validate()?;
        let length = storage.read_journal().map_or(0, |bytes| bytes.len());
        let (journal, reading) = Journal::open(storage)?;
        let account = Account::replay(&reading.records, Some(&mut *decider))?;
        let begin = &account.begin;
        let same = |name, journal: String, given: String| {
            if journal == given {
                Ok(())
            } else {
                Err(JobError::DifferentJob { name, journal, given })
            }
        };
        let imaging_um = [options.imaging_um.x, options.imaging_um.y];
        same("dry_run", begin.dry_run.to_string(), options.dry_run.to_string())?;
        same("imaging_um", format!("{:?}", begin.imaging_um), format!("{imaging_um:?}"))?;
        let options = JobOptions {
            completion: begin.completion,
            correct_pointing: begin.correct_pointing,
            ..options
        };
        let rig = Rig::new(drivers, &options)?;
        let resumed = Some(ResumedRecord {
            dropped_bytes: length.saturating_sub(reading.intact_bytes) as u64,
            damage: reading.damage.map(|damage| damage.to_string()),
        });
        let observer = Some(observer);
        Ok(Self { journal, account, decider, rig, observer, options, resumed })
    }

    /// The flag that stops the job when it is set: [`JobOptions::stop`].
    #[must_use]
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.options.stop)
    }

    /// Does the job, telling `progress` after each command. Faults of the machine are part of the
    /// report; whatever happens, the laser is off and the stage stopped in the end. A job that has
    /// ended for good before is only reported.
    ///
    /// # Errors
    /// The journal or a frame cannot be written or read.
    pub fn run(mut self, progress: &mut Progress<'_>) -> Result<JobReport, JobError> {
        let began = Instant::now();
        if let Some(resumed) = self.resumed.take() {
            let ended = self.account.end.as_ref().filter(|end| end.status.is_final());
            if resumed.dropped_bytes == 0
                && let Some(end) = ended
            {
                let (status, phases) = (end.status, end.phases);
                return Ok(JobReport::new(&self.account, status, began.elapsed(), phases));
            }
            if resumed.dropped_bytes > 0 {
                self.journal.cut()?;
            }
            self.note(&Record::Resumed(resumed), Durability::Now)?;
        }
        let worked = self.work(progress);
        let shut_down = self.rig.shut_down();
        let (status, fault) = match (worked, shut_down) {
            (Err(Halt::Error(error)), _) => return Err(error),
            // A laser that may be on is worse than being interrupted.
            (Err(Halt::Fault(fault)), _) | (_, Err(fault)) => (JobStatus::Fault, Some(fault)),
            (Err(Halt::Interrupted), Ok(())) => (JobStatus::Interrupted, None),
            (Ok(status), Ok(())) => (status, None),
        };
        if let Some(fault) = fault {
            self.note(&Record::Fault(fault.into()), Durability::Now)?;
        }
        let report = JobReport::new(&self.account, status, began.elapsed(), self.rig.phases);
        let end = EndRecord {
            status,
            reward: report.reward,
            machined_fraction: report.machined_fraction,
            off_target_fraction: report.off_target_fraction,
            pulses: report.pulses,
            commands: report.commands,
            elapsed_s: report.elapsed_s,
            phases: report.phases,
        };
        self.note(&Record::End(end), Durability::Now)?;
        Ok(report)
    }

    fn work(&mut self, progress: &mut Progress<'_>) -> Result<JobStatus, Halt> {
        self.rig.prepare(&self.options)?;
        let mut eyes = self.open_eyes()?;
        self.recover(&mut eyes, progress)?;
        let max_commands =
            self.options.max_commands.unwrap_or(2 * self.account.begin.max_pulses + 10);
        loop {
            self.rig.check_stop()?;
            if self.account.unseen_in_a_row >= self.options.unseen_limit {
                let message = format!(
                    "{} pulses in a row left nothing: look after laser, shutter and focus",
                    self.account.unseen_in_a_row
                );
                return Err(Fault::new(Device::Laser, FaultKind::LaserDead, message).into());
            }
            if self.is_complete() {
                return Ok(JobStatus::Complete);
            }
            if self.account.state.pulses_left() == 0 {
                return Ok(JobStatus::PulsesUsed);
            }
            if self.account.commands >= max_commands {
                return Ok(JobStatus::CommandsUsed);
            }
            let Some(intent) = self.decide()? else { return Ok(JobStatus::NothingToGain) };
            self.command(intent)?;
            self.observe(&mut eyes, intent, progress)?;
        }
    }

    fn is_complete(&self) -> bool {
        let (_, machined_fraction, _) = self.account.score();
        machined_fraction >= self.options.completion
    }

    /// The next command; `None` when nothing is worth one.
    fn decide(&mut self) -> Result<Option<IntentRecord>, Halt> {
        let began = Instant::now();
        let (aimed, origin) = match self.account.again {
            Some(aimed) => (Some(aimed), IntentOrigin::Again),
            None => (
                self.decider.decide(&self.account.state).map_err(|error| planner_fault(&error))?,
                IntentOrigin::Decided,
            ),
        };
        let decided_s = began.elapsed().as_secs_f64();
        self.rig.phases.decide_s += decided_s;
        let Some(aimed) = aimed else { return Ok(None) };
        self.rig.check_aim(aimed)?;
        Ok(Some(IntentRecord {
            pulse: self.account.commands + 1,
            x_px: aimed.x,
            y_px: aimed.y,
            correction_px: self.correction_px(aimed),
            decided_ms: decided_s * 1e3,
            origin,
        }))
    }

    /// How far beside `aimed` the stage is sent, px, and neither beyond its limits nor off the workpiece.
    fn correction_px(&self, aimed: Point) -> [f64; 2] {
        if !self.options.correct_pointing {
            return [0.0; 2];
        }
        let correction = self.account.correction_px(aimed);
        let wanted = Point::new(aimed.x + correction.x, aimed.y + correction.y);
        let reached = self.rig.nearest_reachable(wanted);
        [reached.x - aimed.x, reached.y - aimed.y]
    }

    /// Writes `intent` down and fires it.
    fn command(&mut self, intent: IntentRecord) -> Result<(), Halt> {
        self.note(&Record::Intent(intent), Durability::Now)?;
        let pulse = intent.pulse;
        // Rounding must not lead beyond the limits.
        let goal_um = self.rig.nearest_reachable(intent.commanded_px());
        let Point { x: x_um, y: y_um } = self.rig.go_to(goal_um)?;
        let position = PositionRecord { pulse, x_um, y_um, within_tolerance: true };
        self.note(&Record::Position(position), Durability::Later)?;
        self.rig.fire()?;
        if !self.options.dry_run {
            self.note(&Record::Fired(FiredRecord { pulse }), Durability::Later)?;
        }
        Ok(())
    }

    /// Finds out what the command at hand has machined, and writes it down.
    pub(super) fn observe(
        &mut self,
        eyes: &mut Eyes,
        intent: IntentRecord,
        progress: &mut Progress<'_>,
    ) -> Result<(), Halt> {
        let (outcome, frame) = self.see(eyes, intent)?;
        self.conclude(eyes, intent, outcome, frame, progress)
    }

    /// Looks until the outcome of `intent` is certain, or often enough.
    pub(super) fn see(
        &mut self,
        eyes: &mut Eyes,
        intent: IntentRecord,
    ) -> Result<(Outcome, Frame), Halt> {
        self.rig.go_to_imaging_position()?;
        let aimed = Point::new(intent.x_px, intent.y_px);
        let mut frame = self.rig.frame()?;
        if self.options.dry_run {
            let radius_px = self.account.begin.pulse_radius_px;
            let mark = Mark { center_px: aimed, radius_px, confidence: 1.0 };
            let observation = Observation {
                verdict: Verdict::Seen,
                marks: vec![mark],
                shift_px: Point::default(),
            };
            let outcome = Outcome { verdict: JournalVerdict::Dry, ..outcome(observation, 1, 0.0) };
            return Ok((outcome, frame));
        }
        let (mut looks, mut vision_s) = (1, 0.0);
        loop {
            let began = Instant::now();
            let observed = eyes.observer.observe(&eyes.before, &frame, aimed);
            vision_s += began.elapsed().as_secs_f64();
            self.rig.phases.vision_s += began.elapsed().as_secs_f64();
            let observation = observed.map_err(|error| observer_fault(&error))?;
            check_observation(&observation)?;
            if observation.verdict != Verdict::Uncertain || looks == self.options.looks {
                return Ok((outcome(observation, looks, vision_s), frame));
            }
            looks += 1;
            frame = self.rig.frame()?;
        }
    }

    /// Writes down what was seen of the command at hand.
    pub(super) fn conclude(
        &mut self,
        eyes: &mut Eyes,
        intent: IntentRecord,
        outcome: Outcome,
        frame: Frame,
        progress: &mut Progress<'_>,
    ) -> Result<(), Halt> {
        let pulse = intent.pulse;
        self.save_frame(pulse, &frame)?;
        let began = Instant::now();
        let tries = self.options.tries_per_place;
        let observed = self.account.observe(pulse, outcome, tries).map_err(lost)?;
        self.journal.append(&Record::Observed(observed.clone()), Durability::Now)?;
        self.rig.phases.journal_s += began.elapsed().as_secs_f64();
        eyes.before = frame;
        let marks: Vec<Mark> = observed.marks.iter().map(|&mark| mark.into()).collect();
        let flow = progress(&JobProgress {
            pulse,
            pulses: self.account.pulses,
            max_pulses: self.account.begin.max_pulses,
            aimed_px: Point::new(intent.x_px, intent.y_px),
            verdict: observed.verdict,
            marks: &marks,
            looks: observed.looks,
            state: &self.account.state,
            reward: observed.reward,
            machined_fraction: observed.machined_fraction,
            off_target_fraction: observed.off_target_fraction,
            phases: self.rig.phases,
        });
        if flow.is_break() { Err(Halt::Interrupted) } else { Ok(()) }
    }

    /// The observer and the frame to compare with: from the folder, or a first one.
    fn open_eyes(&mut self) -> Result<Eyes, Halt> {
        let frames = self.account.reference.clone().zip(self.account.last_frame.clone());
        let (reference, before) = if let Some((reference, last)) = frames {
            (self.load_frame(&reference)?, self.load_frame(&last)?)
        } else {
            if self.account.commands > 0 {
                let reason = "the journal has no record of it".to_owned();
                return Err(JobError::Frame { file: frame_name(0), reason }.into());
            }
            let frame = match self.load_reference()? {
                Some(frame) => frame,
                None => self.take_reference()?,
            };
            self.save_frame(0, &frame)?;
            (frame.clone(), frame)
        };
        self.rig.check_sides(&reference)?;
        let Some(maker) = self.observer.take() else {
            let message = "there is none";
            return Err(Fault::new(Device::Observer, FaultKind::Other, message).into());
        };
        let began = Instant::now();
        let observer = maker(&reference).map_err(|error| observer_fault(&error))?;
        self.rig.phases.vision_s += began.elapsed().as_secs_f64();
        Ok(Eyes { observer, before })
    }

    /// A first frame, with which a second one agrees in size: a wrong one could never be got rid of.
    fn take_reference(&mut self) -> Result<Frame, Halt> {
        self.rig.go_to_imaging_position()?;
        let frame = self.rig.frame()?;
        self.rig.frame()?;
        Ok(frame)
    }

    fn save_frame(&mut self, pulse: usize, frame: &Frame) -> Result<(), JobError> {
        let began = Instant::now();
        let file = frame_name(pulse);
        self.journal.save_frame(&file, &frame_to_png(frame)?)?;
        self.rig.phases.journal_s += began.elapsed().as_secs_f64();
        let (width_px, height_px) = (frame.width_px(), frame.height_px());
        let crc = pixels_crc(frame);
        self.note(
            &Record::Frame(FrameRecord { pulse, file, width_px, height_px, crc }),
            Durability::Later,
        )
    }

    /// Writes a record down and accounts for it.
    pub(super) fn note(&mut self, record: &Record, durability: Durability) -> Result<(), JobError> {
        let began = Instant::now();
        self.journal.append(record, durability)?;
        self.account.apply(record).map_err(lost)?;
        self.rig.phases.journal_s += began.elapsed().as_secs_f64();
        Ok(())
    }
}

/// A record that does not fit the account of its own job.
fn lost(reason: String) -> JobError {
    JobError::Record { reason }
}

fn planner_fault(error: &PlanError) -> Fault {
    Fault::new(Device::Planner, FaultKind::Other, error.to_string())
}

fn observer_fault(error: &ObserverError) -> Fault {
    Fault::new(Device::Observer, FaultKind::Protocol, error.to_string())
}

fn outcome(observation: Observation, looks: u32, vision_s: f64) -> Outcome {
    let nothing = observation.verdict == Verdict::Nothing;
    let marks = if nothing { Vec::new() } else { observation.marks };
    Outcome {
        verdict: observation.verdict.into(),
        marks: marks.into_iter().map(MarkRecord::from).collect(),
        shift_px: observation.shift_px,
        looks,
        vision_ms: vision_s * 1e3,
    }
}

/// Refuses observations that cannot be.
fn check_observation(observation: &Observation) -> Result<(), Fault> {
    let refused = |message: String| Fault::new(Device::Observer, FaultKind::Protocol, message);
    let Point { x, y } = observation.shift_px;
    if !(x.is_finite() && y.is_finite()) {
        return Err(refused(format!("it says that the view has moved by ({x}, {y}) px")));
    }
    if let Some(mark) = observation.marks.iter().find(|&&mark| !is_mark(&mark.into())) {
        return Err(refused(format!("it says that there is {mark:?}")));
    }
    if observation.verdict == Verdict::Seen && observation.marks.is_empty() {
        return Err(refused("it has seen a mark, but not where".to_owned()));
    }
    Ok(())
}
