//! ASCII DXF as records of group codes.
//!
//! A DXF file is a list of line pairs: a group code and its value. A pair with code 0 begins a
//! record: an entity, a table entry or the mark of a section. Reading this needs no more than the
//! few lines below, and on bytes from outside they cannot fail but by a named error; entities this
//! crate cannot fill are named rather than skipped, which a general DXF reader does not offer.

use crate::{DrawingError, DrawingFormat};

/// Largest file, bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Largest absolute number, drawing units: far beyond any drawing, far below overflow.
const MAX_NUMBER: f64 = 1e12;

/// One record of a file: what begins with group code 0 and what follows it.
#[derive(Debug, Clone)]
pub(crate) struct Record<'a> {
    /// The value of group code 0, such as `LINE`.
    pub(crate) kind: &'a str,
    /// The line on which it stands, from 1.
    line: usize,
    /// Group codes and values in the order of the file.
    groups: Vec<Group<'a>>,
}

/// A group code with its value.
#[derive(Debug, Clone, Copy)]
struct Group<'a> {
    code: i32,
    value: &'a str,
    line: usize,
}

/// The text of a DXF file; bytes that are not UTF-8 are replaced (they occur in names only).
pub(crate) fn text(bytes: &[u8]) -> Result<std::borrow::Cow<'_, str>, DrawingError> {
    let found = bytes.len() as u64;
    if found > MAX_BYTES {
        return Err(DrawingError::TooLarge { unit: "bytes", found, limit: MAX_BYTES });
    }
    if bytes.starts_with(b"AutoCAD Binary DXF") {
        return Err(malformed("it is a binary DXF; save it as ASCII DXF".into()));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    Ok(String::from_utf8_lossy(bytes))
}

/// Splits the text of a file into records, up to the `EOF` record.
pub(crate) fn records(text: &str) -> Result<Vec<Record<'_>>, DrawingError> {
    let mut records: Vec<Record> = Vec::new();
    let mut lines = text.lines().map(str::trim).zip(1..);
    while let Some((code, line)) = lines.next() {
        let code: i32 = match code.parse() {
            Ok(code) => code,
            // Blank lines at the end are no pair.
            Err(_) if code.is_empty() && text.lines().skip(line).all(|l| l.trim().is_empty()) => {
                break;
            }
            Err(_) => {
                let code: String = code.chars().take(20).collect();
                return Err(malformed(format!("line {line}: {code:?} is not a group code")));
            }
        };
        let Some((value, line)) = lines.next() else { break };
        match (code, records.last_mut()) {
            (0, _) if value == "EOF" => return Ok(records),
            (0, _) => records.push(Record { kind: value, line, groups: Vec::new() }),
            (_, Some(record)) => record.groups.push(Group { code, value, line }),
            // Comments before the first record.
            (_, None) => {}
        }
    }
    Err(DrawingError::Truncated { format: DrawingFormat::Dxf })
}

/// The records of section `name`, without those that begin and end it.
pub(crate) fn section<'a, 'b>(records: &'b [Record<'a>], name: &str) -> &'b [Record<'a>] {
    let begins = |record: &Record| record.kind == "SECTION" && record.text(2) == Some(name);
    let Some(start) = records.iter().position(begins) else { return &[] };
    let inner = &records[start + 1..];
    let end = inner.iter().position(|record| record.kind == "ENDSEC").unwrap_or(inner.len());
    &inner[..end]
}

impl<'a> Record<'a> {
    /// Number of group codes, the one that begins the record included.
    pub(crate) fn len(&self) -> usize {
        self.groups.len() + 1
    }

    /// The first value of `code`.
    pub(crate) fn text(&self, code: i32) -> Option<&'a str> {
        self.groups.iter().find(|group| group.code == code).map(|group| group.value)
    }

    /// The number of `code`, or `default` where the record has none.
    pub(crate) fn number_or(&self, code: i32, default: f64) -> Result<f64, DrawingError> {
        let group = self.groups.iter().find(|group| group.code == code);
        group.map_or(Ok(default), Group::number)
    }

    /// The number of `code`, which the record must have.
    pub(crate) fn number(&self, code: i32) -> Result<f64, DrawingError> {
        let number = self.groups.iter().find(|group| group.code == code);
        number.ok_or_else(|| self.malformed(&format!("has no group {code}")))?.number()
    }

    /// The bits of the integer of `code`; none set where the record has none.
    pub(crate) fn flags(&self, code: i32) -> Result<i64, DrawingError> {
        Ok(self.number_or(code, 0.0)? as i64)
    }

    /// All numbers of `code` in order.
    pub(crate) fn numbers(&self, code: i32) -> Result<Vec<f64>, DrawingError> {
        let groups = self.groups.iter().filter(|group| group.code == code);
        groups.map(Group::number).collect()
    }

    /// The point (x, y) with x in `code` and y in `code + 10`.
    pub(crate) fn point(&self, code: i32) -> Result<[f64; 2], DrawingError> {
        Ok([self.number(code)?, self.number(code + 10)?])
    }

    /// All points with x in `code`, y in `code + 10`, and the number of group `extra` that follows
    /// each (0 where none does): (x, y, extra).
    pub(crate) fn points(&self, code: i32, extra: i32) -> Result<Vec<[f64; 3]>, DrawingError> {
        let mut points: Vec<[f64; 3]> = Vec::new();
        for group in &self.groups {
            let place = [code, code + 10, extra].iter().position(|&code| code == group.code);
            match (place, points.last_mut()) {
                (Some(0), _) => points.push([group.number()?, 0.0, 0.0]),
                (Some(place), Some(point)) => point[place] = group.number()?,
                _ => {}
            }
        }
        Ok(points)
    }

    /// The error that this record `problem`.
    pub(crate) fn malformed(&self, problem: &str) -> DrawingError {
        malformed(format!("line {}: {} {problem}", self.line, self.kind))
    }
}

impl Group<'_> {
    fn number(&self) -> Result<f64, DrawingError> {
        match self.value.parse::<f64>() {
            Ok(number) if number.abs() <= MAX_NUMBER => Ok(number),
            _ => {
                let value: String = self.value.chars().take(20).collect();
                let line = self.line;
                Err(malformed(format!("line {line}: {value:?} is not a number up to 1e12")))
            }
        }
    }
}

fn malformed(reason: String) -> DrawingError {
    DrawingError::Malformed { format: DrawingFormat::Dxf, reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_hold_their_groups_in_order() {
        let text = "999\nmade by hand\n0\nSECTION\n2\nENTITIES\n0\nLWPOLYLINE\n10\n1\n20\n2\n42\n\
                    0.5\n10\n3\n20\n4\n0\nENDSEC\n0\nEOF\n";
        let records = records(text).unwrap();
        let [polyline] = section(&records, "ENTITIES") else { panic!("{records:?}") };
        assert_eq!(polyline.kind, "LWPOLYLINE");
        assert_eq!(polyline.points(10, 42).unwrap(), [[1.0, 2.0, 0.5], [3.0, 4.0, 0.0]]);
        assert!(section(&records, "BLOCKS").is_empty());
    }

    #[test]
    fn a_number_that_is_not_finite_names_its_line() {
        let text = "0\nCIRCLE\n40\ninf\n0\nEOF\n";
        let error = records(text).unwrap()[0].number(40).unwrap_err();
        assert!(error.to_string().contains("line 4"), "{error}");
    }
}
