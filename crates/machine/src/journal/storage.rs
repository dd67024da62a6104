//! Where a job is kept: a folder with its journal and its frames.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use fs4::{FileExt, TryLockError};

use super::reader::MAX_JOURNAL_BYTES;
use crate::JobError;

/// Largest frame file that is read, bytes.
const MAX_FRAME_BYTES: u64 = 256 << 20;

/// Keeps what a job writes.
pub trait JobStorage: Send {
    /// The place, for messages.
    fn name(&self) -> String;

    /// The whole journal; of one that is too large, more bytes than are accepted.
    ///
    /// # Errors
    /// It cannot be read.
    fn read_journal(&self) -> io::Result<Vec<u8>>;

    /// Appends `line` to the journal. With `durable` it is safe from a power loss on return, and all
    /// lines before it.
    ///
    /// # Errors
    /// It cannot be written; part of the line may have been.
    fn append(&mut self, line: &[u8], durable: bool) -> io::Result<()>;

    /// Puts everything behind the first `intact_bytes` of the journal aside.
    ///
    /// # Errors
    /// It cannot be written.
    fn cut_journal(&mut self, intact_bytes: u64) -> io::Result<()>;

    /// Writes the frame file `name` whole or not at all, safe from a power loss on return.
    ///
    /// # Errors
    /// It cannot be written.
    fn save_frame(&mut self, name: &str, png: &[u8]) -> io::Result<()>;

    /// Reads the frame file `name`.
    ///
    /// # Errors
    /// It cannot be read.
    fn load_frame(&self, name: &str) -> io::Result<Vec<u8>>;
}

/// A job in a folder: `journal.jsonl` and `frames/0000.png`, `frames/0001.png` and so on.
///
/// One process works on a folder at a time: it holds a lock on the file `lock`, which the system
/// releases when the process ends in whatever way.
#[derive(Debug)]
pub struct JobFolder {
    path: PathBuf,
    journal: File,
    _lock: File,
}

impl JobFolder {
    /// A folder for a job that is to begin; it is made where it is missing.
    ///
    /// # Errors
    /// [`JobError::JobExists`], [`JobError::JobRuns`], [`JobError::Storage`].
    pub fn create(path: impl AsRef<Path>) -> Result<Self, JobError> {
        let path = path.as_ref();
        let failed = |source: io::Error| {
            let path = path.display().to_string();
            if source.kind() == io::ErrorKind::AlreadyExists {
                return JobError::JobExists { path };
            }
            JobError::Storage { action: "create", path, source }
        };
        fs::create_dir_all(path.join("frames")).map_err(failed)?;
        let lock = lock(path)?;
        let mut options = OpenOptions::new();
        let journal = options.append(true).create_new(true).open(journal_path(path));
        let journal = journal.map_err(failed)?;
        let folder = Self { path: path.to_owned(), journal, _lock: lock };
        sync_folder(path).map_err(failed)?;
        Ok(folder)
    }

    /// The folder of a job that was begun.
    ///
    /// # Errors
    /// [`JobError::NoJob`], [`JobError::JobRuns`], [`JobError::Storage`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, JobError> {
        let path = path.as_ref();
        let journal = OpenOptions::new().append(true).open(journal_path(path));
        let journal = journal.map_err(|source| {
            let path = path.display().to_string();
            if source.kind() == io::ErrorKind::NotFound {
                let reason = "there is no journal.jsonl".to_owned();
                return JobError::NoJob { path, reason };
            }
            JobError::Storage { action: "open", path, source }
        })?;
        Ok(Self { path: path.to_owned(), journal, _lock: lock(path)? })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn journal_path(folder: &Path) -> PathBuf {
    folder.join("journal.jsonl")
}

/// The lock on a job's folder.
fn lock(folder: &Path) -> Result<File, JobError> {
    let failed = |source: io::Error| {
        let path = folder.display().to_string();
        JobError::Storage { action: "lock", path, source }
    };
    let mut options = OpenOptions::new();
    let options = options.write(true).create(true).truncate(false);
    let file = options.open(folder.join("lock")).map_err(failed)?;
    match FileExt::try_lock(&file) {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            Err(JobError::JobRuns { path: folder.display().to_string() })
        }
        Err(TryLockError::Error(source)) => Err(failed(source)),
    }
}

/// Makes new names in a folder safe from a power loss.
fn sync_folder(path: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(path)?.sync_all() } else { Ok(()) }
}

fn read_at_most(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(limit + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

impl JobStorage for JobFolder {
    fn name(&self) -> String {
        self.path.display().to_string()
    }

    fn read_journal(&self) -> io::Result<Vec<u8>> {
        read_at_most(&journal_path(&self.path), MAX_JOURNAL_BYTES)
    }

    fn append(&mut self, line: &[u8], durable: bool) -> io::Result<()> {
        self.journal.write_all(line)?;
        if durable { self.journal.sync_data() } else { Ok(()) }
    }

    fn cut_journal(&mut self, intact_bytes: u64) -> io::Result<()> {
        let bytes = fs::read(journal_path(&self.path))?;
        let start = usize::try_from(intact_bytes).unwrap_or(usize::MAX).min(bytes.len());
        let mut k = 0;
        let mut aside = loop {
            let name = self.path.join(format!("journal.damaged-{k}"));
            match OpenOptions::new().write(true).create_new(true).open(name) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => k += 1,
                other => break other?,
            }
        };
        aside.write_all(&bytes[start..])?;
        aside.sync_all()?;
        sync_folder(&self.path)?;
        self.journal.set_len(intact_bytes)?;
        self.journal.sync_all()
    }

    fn save_frame(&mut self, name: &str, png: &[u8]) -> io::Result<()> {
        let path = self.path.join(name);
        let part = path.with_extension("part");
        let mut file = File::create(&part)?;
        file.write_all(png)?;
        file.sync_all()?;
        fs::rename(part, &path)?;
        sync_folder(path.parent().unwrap_or(&self.path))
    }

    fn load_frame(&self, name: &str) -> io::Result<Vec<u8>> {
        read_at_most(&self.path.join(name), MAX_FRAME_BYTES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_holds_one_job() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("job");
        assert!(matches!(JobFolder::open(&path), Err(JobError::NoJob { .. })));
        let mut job = JobFolder::create(&path).unwrap();
        job.append(b"one\n", true).unwrap();
        job.append(b"tw", false).unwrap();
        assert!(matches!(JobFolder::create(&path), Err(JobError::JobRuns { .. })));
        assert!(matches!(JobFolder::open(&path), Err(JobError::JobRuns { .. })));
        drop(job);
        assert!(matches!(JobFolder::create(&path), Err(JobError::JobExists { .. })));
        let mut again = JobFolder::open(&path).unwrap();
        again.cut_journal(4).unwrap();
        again.append(b"two\n", true).unwrap();
        assert_eq!(again.read_journal().unwrap(), b"one\ntwo\n");
        assert_eq!(fs::read(path.join("journal.damaged-0")).unwrap(), b"tw");
    }

    #[test]
    fn a_frame_file_is_written_whole() {
        let folder = tempfile::tempdir().unwrap();
        let mut job = JobFolder::create(folder.path()).unwrap();
        job.save_frame("frames/0000.png", b"first").unwrap();
        job.save_frame("frames/0000.png", b"second").unwrap();
        assert_eq!(job.load_frame("frames/0000.png").unwrap(), b"second");
        assert_eq!(fs::read_dir(folder.path().join("frames")).unwrap().count(), 1);
        assert!(job.load_frame("frames/0001.png").is_err());
    }
}
