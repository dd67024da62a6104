//! One line of a journal: `{"n":7,"record":{…},"crc":"0123abcd"}`.
//!
//! The checksum is the CRC-32 (IEEE) of the eight digits of the line before (`00000000` for the
//! first) followed by the line up to `,"crc"`: lines can neither be changed nor left out unnoticed.

use serde::{Deserialize, Serialize};

use super::record::Record;
use crate::JobError;

/// Longest line, bytes.
pub(super) const MAX_LINE_BYTES: usize = 1 << 20;

/// What stands before and behind the eight digits of the checksum.
const BEFORE_CRC: &[u8] = b",\"crc\":\"";
const AFTER_CRC: &[u8] = b"\"}";
const CRC_DIGITS: usize = 8;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NumberedRecord {
    n: u64,
    record: Record,
}

#[derive(Serialize)]
struct NumberedRef<'a> {
    n: u64,
    record: &'a Record,
}

/// Why a line cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LineError {
    Checksum,
    Sequence,
    Malformed,
}

fn crc_of(previous_crc: u32, payload: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(format!("{previous_crc:08x}").as_bytes());
    hasher.update(payload);
    hasher.finalize()
}

/// The line of `record`, with its newline, and its checksum.
///
/// # Errors
/// [`JobError::Record`] for a record that would not read back as itself: one with a number that is
/// not finite, or too long.
pub(super) fn encode(
    n: u64,
    record: &Record,
    previous_crc: u32,
) -> Result<(Vec<u8>, u32), JobError> {
    let refused = |reason: String| JobError::Record { reason };
    let mut line = serde_json::to_vec(&NumberedRef { n, record })
        .map_err(|error| refused(error.to_string()))?;
    line.pop();
    let crc = crc_of(previous_crc, &line);
    line.extend(BEFORE_CRC);
    line.extend(format!("{crc:08x}").bytes());
    line.extend(AFTER_CRC);
    if line.len() > MAX_LINE_BYTES {
        return Err(refused(format!("{} bytes are more than {MAX_LINE_BYTES}", line.len())));
    }
    match decode(&line, n, previous_crc) {
        Ok((read, _)) if read == *record => {}
        _ => return Err(refused("one of its numbers is not finite".to_owned())),
    }
    line.push(b'\n');
    Ok((line, crc))
}

/// The record of `line`, which is without its newline, and its checksum.
pub(super) fn decode(line: &[u8], n: u64, previous_crc: u32) -> Result<(Record, u32), LineError> {
    let malformed = LineError::Malformed;
    let line = line.strip_suffix(AFTER_CRC).ok_or(malformed)?;
    let digits_at = line.len().checked_sub(CRC_DIGITS).ok_or(malformed)?;
    let (line, digits) = line.split_at(digits_at);
    let payload = line.strip_suffix(BEFORE_CRC).ok_or(malformed)?;
    let crc = crc_of(previous_crc, payload);
    if digits != format!("{crc:08x}").as_bytes() {
        return Err(LineError::Checksum);
    }
    let mut json = payload.to_vec();
    json.push(b'}');
    let line: NumberedRecord = serde_json::from_slice(&json).map_err(|_| malformed)?;
    if line.n != n {
        return Err(LineError::Sequence);
    }
    Ok((line.record, crc))
}
