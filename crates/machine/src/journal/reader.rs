//! Reading a journal, of which any part may be missing or wrong.

use std::fmt;

use super::line::{LineError, MAX_LINE_BYTES, decode};
use super::record::Record;

/// Most bytes of a journal.
pub const MAX_JOURNAL_BYTES: u64 = 64 << 20;

/// What is wrong with a journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DamageKind {
    /// The last line has no end.
    Truncated,
    /// A line, or the one before it, is not what was written.
    Checksum,
    /// A line is missing or stands twice.
    Sequence,
    /// A line is none of a journal.
    Malformed,
    /// A line or the whole journal is too long.
    TooLarge,
}

/// Where a journal breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Damage {
    /// Offset of the first line that cannot be used, bytes.
    pub at_byte: usize,
    /// The sequence number that it should have.
    pub n: u64,
    /// What is wrong with it.
    pub kind: DamageKind,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self.kind {
            DamageKind::Truncated => "is cut off",
            DamageKind::Checksum => "is not what was written",
            DamageKind::Sequence => "is not the next one",
            DamageKind::Malformed => "is none of a journal",
            DamageKind::TooLarge => "is too long",
        };
        write!(f, "the line of record {} at byte {} {what}", self.n, self.at_byte)
    }
}

/// The intact part of a journal.
#[derive(Debug, Clone, PartialEq)]
pub struct JournalReading {
    /// Its records.
    pub records: Vec<Record>,
    /// Its length, bytes.
    pub intact_bytes: usize,
    /// Checksum of its last line; 0 without one.
    pub last_crc: u32,
    /// Where it breaks; `None` for a journal that is all intact.
    pub damage: Option<Damage>,
}

/// Reads a journal up to where it breaks.
#[must_use]
pub fn read_journal(bytes: &[u8]) -> JournalReading {
    let mut reading =
        JournalReading { records: Vec::new(), intact_bytes: 0, last_crc: 0, damage: None };
    while reading.intact_bytes < bytes.len() {
        let n = reading.records.len() as u64;
        match next_line(bytes, reading.intact_bytes, n, reading.last_crc) {
            Ok((record, crc, end)) => {
                reading.records.push(record);
                (reading.last_crc, reading.intact_bytes) = (crc, end);
            }
            Err(kind) => {
                reading.damage = Some(Damage { at_byte: reading.intact_bytes, n, kind });
                break;
            }
        }
    }
    reading
}

/// The record of the line at `start`, its checksum, and where the next line begins.
fn next_line(
    bytes: &[u8],
    start: usize,
    n: u64,
    last_crc: u32,
) -> Result<(Record, u32, usize), DamageKind> {
    let rest = &bytes[start..];
    let window = &rest[..rest.len().min(MAX_LINE_BYTES + 1)];
    let Some(length) = window.iter().position(|&byte| byte == b'\n') else {
        let too_large = window.len() > MAX_LINE_BYTES;
        return Err(if too_large { DamageKind::TooLarge } else { DamageKind::Truncated });
    };
    let end = start + length + 1;
    if end as u64 > MAX_JOURNAL_BYTES {
        return Err(DamageKind::TooLarge);
    }
    let (record, crc) = decode(&rest[..length], n, last_crc).map_err(|error| match error {
        LineError::Checksum => DamageKind::Checksum,
        LineError::Sequence => DamageKind::Sequence,
        LineError::Malformed => DamageKind::Malformed,
    })?;
    Ok((record, crc, end))
}

#[cfg(test)]
mod tests {
    use super::super::line::encode;
    use super::super::record::{
        FiredRecord, IntentOrigin, IntentRecord, JournalVerdict, MarkRecord, ObservedRecord,
        ResumedRecord,
    };
    use super::*;
    use crate::JobError;
    use proptest::prelude::*;

    fn any_record() -> impl Strategy<Value = Record> {
        let intent = (0_usize..50, any::<f64>(), -1e3..1e3).prop_map(|(pulse, x_px, y_px)| {
            let x_px = if x_px.is_finite() { x_px } else { 0.1 };
            let origin = IntentOrigin::Decided;
            let correction_px = [0.25, -0.5];
            Record::Intent(IntentRecord {
                pulse,
                x_px,
                y_px,
                correction_px,
                decided_ms: 0.3,
                origin,
            })
        });
        let mark = (0.0..100.0, 0.0..100.0, 0.1..50.0).prop_map(|(x_px, y_px, radius_px)| {
            MarkRecord { x_px, y_px, radius_px, confidence: 1.0 / 3.0 }
        });
        let observed =
            (0_usize..50, proptest::collection::vec(mark, 0..3)).prop_map(|(pulse, marks)| {
                Record::Observed(ObservedRecord {
                    pulse,
                    verdict: JournalVerdict::Seen,
                    marks,
                    shift_px: [0.1, -0.7],
                    looks: 1,
                    vision_ms: 0.7,
                    gave_up: false,
                    state_hash: format!("{:016x}", u64::MAX),
                    machined_fraction: 0.1 + 0.2,
                    off_target_fraction: 1e-300,
                    reward: -0.0,
                })
            });
        let resumed = ".{0,20}".prop_map(|text| {
            Record::Resumed(ResumedRecord { dropped_bytes: 7, damage: Some(text) })
        });
        let fired = (0_usize..50).prop_map(|pulse| Record::Fired(FiredRecord { pulse }));
        prop_oneof![intent, observed, resumed, fired]
    }

    /// The bytes of a journal and where its lines end.
    fn journal(records: &[Record]) -> (Vec<u8>, Vec<usize>) {
        let (mut bytes, mut ends, mut crc) = (Vec::new(), vec![0], 0);
        for (n, record) in records.iter().enumerate() {
            let (line, line_crc) = encode(n as u64, record, crc).unwrap();
            bytes.extend(line);
            ends.push(bytes.len());
            crc = line_crc;
        }
        (bytes, ends)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn a_journal_cut_anywhere_reads_back_up_to_there(
            records in proptest::collection::vec(any_record(), 0..6),
        ) {
            let (bytes, ends) = journal(&records);
            for cut in 0..=bytes.len() {
                let reading = read_journal(&bytes[..cut]);
                let whole = ends.iter().filter(|&&end| end <= cut).count() - 1;
                prop_assert_eq!(&reading.records[..], &records[..whole]);
                prop_assert_eq!(reading.intact_bytes, ends[whole]);
                let expected = (cut > ends[whole]).then_some(DamageKind::Truncated);
                prop_assert_eq!(reading.damage.map(|damage| damage.kind), expected);
            }
        }

        #[test]
        fn a_changed_byte_is_found_and_what_stands_before_it_is_kept(
            records in proptest::collection::vec(any_record(), 1..6),
            place in any::<proptest::sample::Index>(),
            flip in 1_u8..=255,
        ) {
            let (mut bytes, ends) = journal(&records);
            let place = place.index(bytes.len());
            bytes[place] ^= flip;
            let reading = read_journal(&bytes);
            let before = ends.iter().filter(|&&end| end <= place).count() - 1;
            prop_assert_eq!(&reading.records[..], &records[..before]);
            let damage = reading.damage.unwrap();
            prop_assert_eq!((damage.at_byte, damage.n), (ends[before], before as u64));
        }

        #[test]
        fn any_bytes_are_read(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let reading = read_journal(&bytes);
            prop_assert!(reading.records.is_empty());
            prop_assert_eq!(reading.damage.is_some(), !bytes.is_empty());
        }
    }

    fn fired(pulse: usize) -> Record {
        Record::Fired(FiredRecord { pulse })
    }

    #[test]
    fn lines_that_are_missing_doubled_or_exchanged_are_found() {
        let records: Vec<Record> = (0..4).map(fired).collect();
        let (bytes, ends) = journal(&records);
        let line = |k: usize| &bytes[ends[k]..ends[k + 1]];
        for order in [[0, 2, 3, 1], [0, 0, 1, 2], [0, 1, 3, 2]] {
            let shuffled: Vec<u8> = order.iter().flat_map(|&k| line(k).to_vec()).collect();
            let reading = read_journal(&shuffled);
            assert_eq!(reading.damage.unwrap().kind, DamageKind::Checksum);
            assert!(reading.records.len() < 4);
        }
    }

    #[test]
    fn a_line_that_never_ends_is_too_large() {
        let reading = read_journal(&vec![b'{'; MAX_LINE_BYTES + 1]);
        assert_eq!(reading.damage.unwrap().kind, DamageKind::TooLarge);
    }

    #[test]
    fn a_record_with_a_number_that_is_not_finite_is_not_written() {
        let origin = IntentOrigin::Decided;
        let (x_px, correction_px) = (f64::NAN, [0.0; 2]);
        let intent =
            IntentRecord { pulse: 1, x_px, y_px: 0.0, correction_px, decided_ms: 0.0, origin };
        let error = encode(0, &Record::Intent(intent), 0).unwrap_err();
        assert!(matches!(error, JobError::Record { .. }), "{error}");
    }
}
