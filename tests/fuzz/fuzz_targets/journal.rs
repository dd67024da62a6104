//! Any bytes as the journal of a job give its intact part, which reads back as itself.
#![no_main]

use std::io;

use lasergym_machine::{JobStorage, read_job, read_journal};

/// A journal without a job folder.
struct Bytes<'a>(&'a [u8]);

impl JobStorage for Bytes<'_> {
    fn name(&self) -> String {
        "the bytes".to_owned()
    }
    fn read_journal(&self) -> io::Result<Vec<u8>> {
        Ok(self.0.to_vec())
    }
    fn append(&mut self, _: &[u8], _: bool) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }
    fn cut_journal(&mut self, _: u64) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }
    fn save_frame(&mut self, _: &str, _: &[u8]) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }
    fn load_frame(&self, _: &str) -> io::Result<Vec<u8>> {
        Err(io::ErrorKind::NotFound.into())
    }
}

/// The lines of `bytes` with valid checksums, so that what they say is looked at.
fn signed(bytes: &[u8]) -> Vec<u8> {
    let mut journal = Vec::new();
    let mut crc = 0;
    for line in bytes.split(|&byte| byte == b'\n') {
        crc = crc32fast::hash(&[format!("{crc:08x}").as_bytes(), line].concat());
        journal.extend(line);
        journal.extend(format!(",\"crc\":\"{crc:08x}\"}}\n").bytes());
    }
    journal
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for bytes in [bytes, &signed(bytes)] {
        let reading = read_journal(bytes);
        let again = read_journal(&bytes[..reading.intact_bytes]);
        assert!(again.damage.is_none() && again.records == reading.records);
        let _ = read_job(&Bytes(bytes));
    }
});
