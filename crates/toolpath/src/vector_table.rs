//! Tables as vectors, read as a stream: the passes of [`crate::write_passes_csv`] and the pulses of
//! [`crate::write_csv`].
//!
//! Tables count y downwards and vectors upwards, so that the place (x, y) becomes (x, −y).

use std::io::BufRead;

use lasergym_geom::Point;

use crate::error::shortened;
use crate::line_source::LineSource;
use crate::vector_step::MAX_VECTOR_UM;
use crate::{CSV_HEADER, PASSES_CSV_HEADER, ToolpathError, VectorStep};

/// Most columns of a table.
const MOST_COLUMNS: usize = 6;

/// Reads vectors out of a table of passes or pulses; the memory does not grow with the file.
///
/// The header tells which. A pass begins with a jump to its first point; the way to each other point is
/// a mark where the beam is on, a jump where it is off. Blank lines are skipped.
#[derive(Debug)]
pub struct VectorTableReader<R> {
    source: LineSource<R>,
    columns: Option<&'static str>,
    /// Numbers of the pass and point, or of the pulse, that were read last.
    pass: u64,
    point: u64,
}

/// A line of the table.
struct Row {
    line: usize,
    values: [f64; MOST_COLUMNS],
    /// Number of the character at which each field begins.
    starts: [usize; MOST_COLUMNS],
}

impl Row {
    /// The fields of `content`, a number for each of `columns`.
    fn new(content: &str, line: usize, columns: &str) -> Result<Self, ToolpathError> {
        let count = columns.split(',').count();
        let mut row = Self { line, values: [0.0; MOST_COLUMNS], starts: [1; MOST_COLUMNS] };
        let mut column = 1;
        let mut found = 0;
        for field in content.split(',') {
            if found == count {
                return Err(fault(line, column, field, "the end of the line"));
            }
            row.starts[found] = column;
            row.values[found] = match field.trim().parse::<f64>() {
                Ok(value) if value.is_finite() => value,
                _ => return Err(fault(line, column, field, "a number")),
            };
            found += 1;
            column += field.chars().count() + 1;
        }
        if found < count {
            return Err(fault(line, column - 1, "", "one field more"));
        }
        Ok(row)
    }

    /// Accepts field `k` when `ok`, or says what is due.
    fn check(&self, k: usize, ok: bool, expected: &'static str) -> Result<(), ToolpathError> {
        if ok {
            return Ok(());
        }
        Err(fault(self.line, self.starts[k], &self.values[k].to_string(), expected))
    }

    /// Field `k` as a number that counts.
    fn count(&self, k: usize) -> Result<u64, ToolpathError> {
        let value = self.values[k];
        let ok = (1.0..=1e15).contains(&value) && value.fract() == 0.0;
        self.check(k, ok, "a whole number from 1")?;
        Ok(value as u64)
    }

    /// The place in field `k` and the next.
    fn place(&self, k: usize) -> Result<Point, ToolpathError> {
        for axis in [k, k + 1] {
            self.check(axis, self.values[axis].abs() <= MAX_VECTOR_UM, "a place within ±10 m")?;
        }
        Ok(Point::new(self.values[k], -self.values[k + 1]))
    }
}

fn fault(line: usize, column: usize, found: &str, expected: &'static str) -> ToolpathError {
    ToolpathError::TableField { line, column, found: shortened(found.trim()), expected }
}

impl<R: BufRead> VectorTableReader<R> {
    /// A reader at the start of a table.
    pub fn new(reader: R) -> Self {
        Self { source: LineSource::new(reader), columns: None, pass: 0, point: 0 }
    }

    /// The next vector; none at the end.
    ///
    /// # Errors
    /// [`ToolpathError::TableField`] says what is wrong, in which line and column;
    /// [`ToolpathError::LineTooLong`] and [`ToolpathError::Unreadable`] guard the file.
    pub fn next_step(&mut self) -> Result<Option<VectorStep>, ToolpathError> {
        let columns = self.columns.map_or_else(|| self.header(), Ok)?;
        self.columns = Some(columns);
        loop {
            let Some(content) = self.source.next_line()? else { return Ok(None) };
            if content.trim().is_empty() {
                continue;
            }
            let content = content.into_owned();
            let row = Row::new(&content, self.source.line(), columns)?;
            return if columns == CSV_HEADER { self.pulse(&row) } else { self.pass(&row) }
                .map(Some);
        }
    }

    fn header(&mut self) -> Result<&'static str, ToolpathError> {
        let header = self.source.next_line()?.unwrap_or_default();
        let is = |columns: &str| header.split(',').map(str::trim).eq(columns.split(','));
        [PASSES_CSV_HEADER, CSV_HEADER].into_iter().find(|columns| is(columns)).ok_or_else(|| {
            let expected = "the header pass,point,x_um,y_um,speed_mm_s,beam_on or pulse,x_um,y_um";
            fault(1, 1, &header, expected)
        })
    }

    fn pulse(&mut self, row: &Row) -> Result<VectorStep, ToolpathError> {
        self.point += 1;
        row.check(0, row.count(0)? == self.point, "the number of the pulse: 1, 2, 3, …")?;
        Ok(VectorStep::Pulse { at_um: row.place(1)? })
    }

    fn pass(&mut self, row: &Row) -> Result<VectorStep, ToolpathError> {
        let (pass, point) = (row.count(0)?, row.count(1)?);
        row.check(0, pass >= self.pass, "the number of the pass, which never falls")?;
        let first = pass > self.pass;
        let due = if first { 1 } else { self.point + 1 };
        row.check(1, point == due, "the number of the point in its pass: 1, 2, 3, …")?;
        let to_um = row.place(2)?;
        let [.., speed_mm_s, beam_on] = row.values;
        let ok = speed_mm_s > 1e-5 && speed_mm_s <= 1e6;
        row.check(4, ok, "a speed above 0.00001 and up to 1e6 mm/s")?;
        let lit = beam_on > 0.5;
        row.check(5, (beam_on - f64::from(u8::from(lit))).abs() <= 0.0, "0 or 1")?;
        (self.pass, self.point) = (pass, point);
        Ok(if lit && !first {
            VectorStep::Mark { to_um, speed_m_s: Some(speed_mm_s * 1e-3) }
        } else {
            VectorStep::Jump { to_um }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        AptReader, DwellPass, DwellPoint, PulsePath, read_csv, write_csv, write_passes_csv,
    };
    use proptest::prelude::*;
    use std::fmt::Write;

    fn read(text: &str) -> Result<Vec<VectorStep>, ToolpathError> {
        let mut reader = VectorTableReader::new(text.as_bytes());
        let mut steps = Vec::new();
        while let Some(step) = reader.next_step()? {
            steps.push(step);
        }
        Ok(steps)
    }

    fn any_passes() -> impl Strategy<Value = Vec<DwellPass>> {
        let point = (-5e3..5e3_f64, -5e3..5e3_f64, 0.01..2e3_f64, any::<bool>()).prop_map(
            |(x_um, y_um, speed_mm_s, beam_on)| DwellPoint { x_um, y_um, speed_mm_s, beam_on },
        );
        let pass = proptest::collection::vec(point, 0..6).prop_map(|points| DwellPass { points });
        proptest::collection::vec(pass, 0..6)
    }

    /// The passes as a cutter-location file.
    fn apt_of(passes: &[DwellPass]) -> String {
        let mut text = String::from("UNITS/MM\n");
        for pass in passes {
            for (k, point) in pass.points.iter().enumerate() {
                if k == 0 || !point.beam_on {
                    text.push_str("RAPID\n");
                }
                let (x, y) = (point.x_um * 1e-3, point.y_um * -1e-3);
                writeln!(text, "FEDRAT/{},MMPS\nGOTO/{x},{y}", point.speed_mm_s).unwrap();
            }
        }
        text
    }

    proptest! {
        #[test]
        fn passes_are_the_vectors_of_the_same_cutter_locations(passes in any_passes()) {
            let steps = read(&write_passes_csv(&passes).unwrap()).unwrap();
            let apt = apt_of(&passes);
            let mut reader = AptReader::new(apt.as_bytes());
            for step in steps {
                let same = match (step, reader.next_step().unwrap().unwrap()) {
                    (VectorStep::Jump { to_um: a }, VectorStep::Jump { to_um: b }) => {
                        a.distance(b) < 1e-4
                    }
                    (
                        VectorStep::Mark { to_um: a, speed_m_s: Some(v) },
                        VectorStep::Mark { to_um: b, speed_m_s: Some(w) },
                    ) => a.distance(b) < 1e-4 && (v - w).abs() < 1e-9,
                    _ => false,
                };
                prop_assert!(same);
            }
            prop_assert_eq!(reader.next_step().unwrap(), None);
        }

        #[test]
        fn pulses_are_those_of_the_pulse_reader(
            places in proptest::collection::vec((-1e4..1e4_f64, -1e4..1e4_f64), 0..30)
        ) {
            let places = places.iter().map(|&(x, y)| Point::new(x, y)).collect();
            let text = write_csv(&PulsePath::new(places, 5.0).unwrap());
            let expected: Vec<VectorStep> = read_csv(&text, 5.0).unwrap().positions_px().iter()
                .map(|place| VectorStep::Pulse { at_um: Point::new(place.x, -place.y) })
                .collect();
            prop_assert_eq!(read(&text).unwrap(), expected);
        }
    }

    #[test]
    fn a_pass_is_a_jump_and_marks() {
        let text = format!(
            "\u{feff}{PASSES_CSV_HEADER}\r\n1,1,0,5,10,0\r\n1,2,10,5,20,1\r\n\n1,3,20,5,10,0\n3,1,0,6,10,1\n"
        );
        let jump = |x: f64, y: f64| VectorStep::Jump { to_um: Point::new(x, y) };
        let mark = VectorStep::Mark { to_um: Point::new(10.0, -5.0), speed_m_s: Some(0.02) };
        let expected = [jump(0.0, -5.0), mark, jump(20.0, -5.0), jump(0.0, -6.0)];
        assert_eq!(read(&text).unwrap(), expected);
    }

    #[test]
    fn faults_have_line_column_and_reason() {
        let passes = |rows: &str| format!("{PASSES_CSV_HEADER}\n{rows}\n");
        let pulses = |rows: &str| format!("{CSV_HEADER}\n{rows}\n");
        for (text, line, column, word) in [
            (String::new(), 1, 1, "header"),
            ("pulse,x_mm,y_mm\n".to_owned(), 1, 1, "header"),
            (passes("1,1,0,0,10,0\n1,2,0,x,10,1"), 3, 7, "number"),
            (passes("1,1,0,inf,10,1"), 2, 7, "number"),
            (passes("1,1,0,0,10"), 2, 11, "one field more"),
            (passes("1,1,0,0,10,1,9"), 2, 14, "end of the line"),
            (passes("0,1,0,0,10,1"), 2, 1, "whole number"),
            (passes("1,1.5,0,0,10,1"), 2, 3, "whole number"),
            (passes("2,1,0,0,10,1\n1,1,0,0,10,1"), 3, 1, "never falls"),
            (passes("1,2,0,0,10,1"), 2, 3, "number of the point"),
            (passes("1,1,0,0,10,1\n1,3,0,0,10,1"), 3, 3, "number of the point"),
            (passes("1,1,0,0,10,1\n2,2,0,0,10,1"), 3, 3, "number of the point"),
            (passes("1,1,2e7,0,10,1"), 2, 5, "10 m"),
            (passes("1,1,0,-2e7,10,1"), 2, 7, "10 m"),
            (passes("1,1,0,0,0,1"), 2, 9, "speed"),
            (passes("1,1,0,0,10,2"), 2, 12, "0 or 1"),
            (pulses("1,0,0\n1,0,0"), 3, 1, "number of the pulse"),
            (pulses("1,0,y"), 2, 5, "number"),
            (pulses("1,0"), 2, 4, "one field more"),
            (pulses("1,2e7,0"), 2, 3, "10 m"),
        ] {
            let message = read(&text).unwrap_err().to_string();
            let place = format!("line {line}, column {column}: ");
            assert!(message.starts_with(&place) && message.contains(word), "{text:?}: {message}");
        }
    }
}
