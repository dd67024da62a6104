//! Writing a journal.

use std::io;

use super::line::encode;
use super::reader::{JournalReading, MAX_JOURNAL_BYTES, read_journal};
use super::record::Record;
use super::storage::JobStorage;
use crate::JobError;

/// When a record is safe from a power loss.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Durability {
    /// At once.
    Now,
    /// With the next one that is safe at once; until then it can be found out by looking.
    Later,
}

/// A journal that is open at its end.
pub(crate) struct Journal {
    storage: Box<dyn JobStorage>,
    next_n: u64,
    last_crc: u32,
    bytes: u64,
}

impl Journal {
    /// An empty journal in a storage without one.
    pub(crate) fn new(storage: Box<dyn JobStorage>) -> Self {
        Self { storage, next_n: 0, last_crc: 0, bytes: 0 }
    }

    /// The journal in `storage`, open at the end of its intact part, and that part. Nothing is
    /// changed yet.
    pub(crate) fn open(storage: Box<dyn JobStorage>) -> Result<(Self, JournalReading), JobError> {
        let reading = read(&*storage)?;
        let journal = Self {
            storage,
            next_n: reading.records.len() as u64,
            last_crc: reading.last_crc,
            bytes: reading.intact_bytes as u64,
        };
        Ok((journal, reading))
    }

    /// Puts what is behind the intact part aside.
    pub(crate) fn cut(&mut self) -> Result<(), JobError> {
        let cut = self.storage.cut_journal(self.bytes);
        cut.map_err(|source| failed("repair the journal of", &*self.storage, source))
    }

    /// Appends `record`.
    pub(crate) fn append(
        &mut self,
        record: &Record,
        durability: Durability,
    ) -> Result<(), JobError> {
        let (line, crc) = encode(self.next_n, record, self.last_crc)?;
        let bytes = self.bytes + line.len() as u64;
        if bytes > MAX_JOURNAL_BYTES {
            return Err(JobError::JournalFull { limit: MAX_JOURNAL_BYTES });
        }
        let appended = self.storage.append(&line, durability == Durability::Now);
        appended.map_err(|source| failed("write the journal of", &*self.storage, source))?;
        (self.next_n, self.last_crc, self.bytes) = (self.next_n + 1, crc, bytes);
        Ok(())
    }

    /// Writes a frame file.
    pub(crate) fn save_frame(&mut self, name: &str, png: &[u8]) -> Result<(), JobError> {
        let saved = self.storage.save_frame(name, png);
        saved.map_err(|source| failed("write a frame of", &*self.storage, source))
    }

    /// Reads a frame file; `None` where there is none.
    pub(crate) fn load_frame(&self, name: &str) -> Result<Option<Vec<u8>>, JobError> {
        match self.storage.load_frame(name) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(JobError::Frame { file: name.to_owned(), reason: error.to_string() }),
        }
    }
}

/// The intact part of the journal in `storage`, which has at least one record.
pub(crate) fn read(storage: &dyn JobStorage) -> Result<JournalReading, JobError> {
    let bytes = storage.read_journal();
    let bytes = bytes.map_err(|source| failed("read the journal of", storage, source))?;
    let reading = read_journal(&bytes);
    if reading.records.is_empty() {
        let reason = reading.damage.map_or_else(
            || "its journal is empty".to_owned(),
            |damage| format!("in its journal {damage}"),
        );
        return Err(JobError::NoJob { path: storage.name(), reason });
    }
    Ok(reading)
}

fn failed(action: &'static str, storage: &dyn JobStorage, source: io::Error) -> JobError {
    JobError::Storage { action, path: storage.name(), source }
}
