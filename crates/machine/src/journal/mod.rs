//! The journal of a job: everything that was commanded and seen, written down before and after.

mod frame_file;
mod line;
mod reader;
mod record;
mod storage;
mod writer;

pub use frame_file::{FramePreview, frame_preview};
pub(crate) use frame_file::{frame_from_png, frame_name, frame_to_png, pixels_crc, recorded_frame};
pub use reader::{Damage, DamageKind, JournalReading, MAX_JOURNAL_BYTES, read_journal};
pub use record::{
    BeginRecord, EndRecord, FaultRecord, FiredRecord, FrameRecord, IntentOrigin, IntentRecord,
    JOURNAL_VERSION, JournalVerdict, MarkRecord, ObservedRecord, PositionRecord, Record,
    ResumedRecord,
};
pub use storage::{JobFolder, JobStorage};
pub(crate) use writer::{Durability, Journal, read};
