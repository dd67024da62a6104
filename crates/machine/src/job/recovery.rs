//! What has happened since the journal of a resumed job ended: the workpiece says it.

use lasergym_geom::Point;

use crate::halt::Halt;
use crate::journal::{
    Durability, FrameRecord, IntentOrigin, IntentRecord, JournalVerdict, Record, frame_from_png,
    frame_name, recorded_frame,
};
use crate::{Camera, Frame, JobError, Laser, Stage};

use super::account::Outcome;
use super::controller::{Eyes, MachineJob, Progress};

impl<S: Stage, L: Laser, C: Camera> MachineJob<S, L, C> {
    /// Settles the command whose outcome is unknown, or finds pulses that the journal has lost.
    pub(super) fn recover(
        &mut self,
        eyes: &mut Eyes,
        progress: &mut Progress<'_>,
    ) -> Result<(), Halt> {
        if self.account.resumed == 0 {
            return Ok(());
        }
        match self.account.pending {
            Some(pending) if self.options.dry_run => {
                // Nothing was fired, and nothing is to be seen.
                let frame = eyes.before.clone();
                let outcome = Outcome {
                    verdict: JournalVerdict::Nothing,
                    marks: Vec::new(),
                    shift_px: Point::default(),
                    looks: 0,
                    vision_ms: 0.0,
                };
                self.conclude(eyes, pending.intent, outcome, frame, progress)
            }
            Some(pending) => self.observe(eyes, pending.intent, progress),
            None if self.options.dry_run => Ok(()),
            None => self.find_lost_pulses(eyes, progress),
        }
    }

    /// Compares the workpiece with the last frame. With an intact journal they are the same.
    fn find_lost_pulses(
        &mut self,
        eyes: &mut Eyes,
        progress: &mut Progress<'_>,
    ) -> Result<(), Halt> {
        let imaging_um = self.options.imaging_um;
        let mut intent = IntentRecord {
            pulse: self.account.commands + 1,
            x_px: imaging_um.x,
            y_px: imaging_um.y,
            correction_px: [0.0; 2],
            decided_ms: 0.0,
            origin: IntentOrigin::Recovered,
        };
        let (outcome, frame) = self.see(eyes, intent)?;
        let lost = match outcome.verdict {
            JournalVerdict::Seen => true,
            // Dust and another light are no reason to doubt a journal that is all there.
            JournalVerdict::Uncertain => self.account.records_lost,
            JournalVerdict::Nothing | JournalVerdict::Dry => {
                eyes.before = frame;
                return Ok(());
            }
        };
        if !lost {
            return Ok(());
        }
        if let Some(mark) = outcome.marks.first() {
            (intent.x_px, intent.y_px) = (mark.x_px, mark.y_px);
        }
        self.note(&Record::Intent(intent), Durability::Now)?;
        self.conclude(eyes, intent, outcome, frame, progress)
    }

    /// The frame of `record` from the folder.
    pub(super) fn load_frame(&self, record: &FrameRecord) -> Result<Frame, JobError> {
        let file = frame_name(record.pulse);
        match self.journal.load_frame(&file)? {
            Some(bytes) => recorded_frame(&bytes, record),
            None => Err(JobError::Frame { file, reason: "it is missing".to_owned() }),
        }
    }

    /// The reference frame of a journal that has lost the record of it. Without its file no pulse can
    /// have been commanded; with it, there may have been any number.
    pub(super) fn load_reference(&self) -> Result<Option<Frame>, JobError> {
        let file = frame_name(0);
        let bytes = self.journal.load_frame(&file)?;
        bytes.map(|bytes| frame_from_png(&bytes, &file)).transpose()
    }
}
