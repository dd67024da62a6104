//! Cutter-location files (APT) as vectors, read as a stream.
//!
//! The grammar, letters in either case, blanks anywhere:
//!
//! ```text
//! file      = { record } ;
//! record    = [ statement ] [ "$$" comment ] newline ;    (* "$" at the end of a line: goes on *)
//! statement = "GOTO" "/" x "," y [ "," z [ "," i "," j "," k ] ]
//!           | "FROM" "/" x "," y [ "," z ]                 (* a jump *)
//!           | "GODLTA" "/" dx "," dy [ "," dz ]
//!           | "CIRCLE" "/" x "," y "," z "," i "," j "," k "," r   (* the next GOTO is an arc *)
//!           | "RAPID"                                      (* the next GOTO is a jump *)
//!           | "FEDRAT" "/" speed [ "," unit ] | "FEDRAT" "/" unit "," speed
//!           | "UNITS" "/" ( "MM" | "CM" | "INCH" | "INCHES" )
//!           | "FINI"
//!           | ignored [ anything ] ;
//! unit      = "MMPM" | "MMPS" | "IPM" | "PERMIN" ;
//! ignored   = "PARTNO" | "PPRINT" | "REMARK" | "INSERT" | "TPRINT" | "MULTAX" | "LOADTL" | "LOAD" |
//!             "TOOLNO" | "TOOL PATH" | "SPINDL" | "COOLNT" | "CUTTER" | "INTOL" | "OUTTOL" |
//!             "MACHIN" | "END" | "END-OF-PATH" | "MSYS" | "PAINT" | "DISPLY" | "LASER" ;
//! ```
//!
//! A GOTO marks unless RAPID came since the last one, or nothing is known of where the beam is. A
//! GOTO that changes z must be a jump. Speeds without unit are units per minute.

use std::io::BufRead;

use lasergym_geom::Point;

use crate::error::shortened;
use crate::line_source::{LineSource, MAX_LINE_BYTES};
use crate::vector_step::MAX_VECTOR_UM;
use crate::{ToolpathError, VectorStep};

const ACCEPTED: &str = "GOTO FROM GODLTA CIRCLE RAPID FEDRAT UNITS FINI PARTNO PPRINT REMARK INSERT \
    TPRINT MULTAX LOADTL LOAD TOOLNO TOOL SPINDL COOLNT CUTTER INTOL OUTTOL MACHIN END END-OF-PATH \
    MSYS PAINT DISPLY LASER";

const IGNORED: [&str; 22] = [
    "PARTNO",
    "PPRINT",
    "REMARK",
    "INSERT",
    "TPRINT",
    "MULTAX",
    "LOADTL",
    "LOAD",
    "TOOLNO",
    "TOOL",
    "SPINDL",
    "COOLNT",
    "CUTTER",
    "INTOL",
    "OUTTOL",
    "MACHIN",
    "END",
    "END-OF-PATH",
    "MSYS",
    "PAINT",
    "DISPLY",
    "LASER",
];

/// Two heights within this are one, µm.
const SAME_HEIGHT_UM: f64 = 1e-3;

/// Reads vectors out of a cutter-location file; the memory does not grow with the file.
#[derive(Debug)]
pub struct AptReader<R> {
    source: LineSource<R>,
    /// The statement when it goes over several lines.
    joined: String,
    um_per_unit: f64,
    speed_m_s: Option<f64>,
    rapid: bool,
    at_um: Option<Point>,
    z_um: f64,
    center_um: Option<(Point, bool)>,
    /// A jump that follows a change of height.
    pending: Option<VectorStep>,
    ended: bool,
}

/// A place in a file.
#[derive(Debug, Clone, Copy)]
struct Place {
    line: usize,
    column: usize,
}

impl Place {
    fn fault(self, found: &str, expected: &'static str) -> ToolpathError {
        let found = shortened(found.trim());
        ToolpathError::AptSyntax { line: self.line, column: self.column, found, expected }
    }
}

impl<R: BufRead> AptReader<R> {
    /// A reader at the start of a file: millimetres, no speed, no position.
    pub fn new(reader: R) -> Self {
        Self {
            source: LineSource::new(reader),
            joined: String::new(),
            um_per_unit: 1e3,
            speed_m_s: None,
            rapid: false,
            at_um: None,
            z_um: 0.0,
            center_um: None,
            pending: None,
            ended: false,
        }
    }

    /// The next vector; none at the end.
    ///
    /// # Errors
    /// The `Apt` variants of [`ToolpathError`] say what is wrong, in which line and column;
    /// [`ToolpathError::LineTooLong`] and [`ToolpathError::Unreadable`] guard the file.
    pub fn next_step(&mut self) -> Result<Option<VectorStep>, ToolpathError> {
        if let Some(step) = self.pending.take() {
            return Ok(Some(step));
        }
        loop {
            self.joined.clear();
            let first_line = self.source.line() + 1;
            let mut last_line_start = 0;
            loop {
                let Some(content) = self.source.next_line()? else {
                    if self.joined.is_empty() {
                        return Ok(None);
                    }
                    break;
                };
                let content = content.split_once("$$").map_or(&*content, |(before, _)| before);
                let trimmed = content.trim_end();
                last_line_start = self.joined.len();
                if let Some(part) = trimmed.strip_suffix('$') {
                    self.joined.push_str(part);
                    if self.joined.len() > MAX_LINE_BYTES {
                        return Err(ToolpathError::LineTooLong { line: self.source.line() });
                    }
                } else {
                    self.joined.push_str(trimmed);
                    break;
                }
            }
            // Columns are counted in the line where a statement begins, or in its last.
            let statement = std::mem::take(&mut self.joined);
            let lines =
                Lines { first: first_line, last: self.source.line(), last_start: last_line_start };
            let step = self.statement(&statement, lines);
            self.joined = statement;
            if let Some(step) = step? {
                return Ok(Some(step));
            }
        }
    }

    fn statement(
        &mut self,
        statement: &str,
        lines: Lines,
    ) -> Result<Option<VectorStep>, ToolpathError> {
        let body = statement.trim_start();
        if body.is_empty() {
            return Ok(None);
        }
        let place = lines.place(statement, statement.len() - body.len());
        if self.ended {
            return Err(place.fault(body, "nothing after FINI"));
        }
        let end = body.find(|c: char| c == '/' || c.is_whitespace()).unwrap_or(body.len());
        let (word, rest) = body.split_at(end);
        let upper = Upper::of(word);
        let arguments = rest.trim_start().strip_prefix('/');
        let at = |part: &str| {
            let offset = statement.len() - part.len();
            lines.place(statement, offset.min(statement.len()))
        };
        match upper.as_str() {
            "GOTO" => {
                let numbers = self.numbers(arguments, place, &at, 2, 6)?;
                self.go(numbers.coordinates(self.um_per_unit), place).map(Some)
            }
            "GODLTA" => {
                let numbers = self.numbers(arguments, place, &at, 2, 3)?;
                let Some(from) = self.at_um else {
                    return Err(place.fault(body, "a known position: put a GOTO before it"));
                };
                let (by, z) = numbers.coordinates(self.um_per_unit);
                self.go((from + by, z.map(|z| z + self.z_um)), place).map(Some)
            }
            "FROM" => {
                let numbers = self.numbers(arguments, place, &at, 2, 6)?;
                self.rapid = true;
                self.go(numbers.coordinates(self.um_per_unit), place).map(Some)
            }
            "CIRCLE" => {
                let numbers = self.numbers(arguments, place, &at, 7, 7)?;
                let (center, _) = numbers.coordinates(self.um_per_unit);
                self.center_um = Some((center, numbers.values[5] >= 0.0));
                Ok(None)
            }
            "RAPID" => {
                self.rapid = true;
                Ok(None)
            }
            "FEDRAT" => self.feed(arguments.unwrap_or(""), place).map(|()| None),
            "UNITS" => {
                let name = Upper::of(arguments.unwrap_or("").trim());
                self.um_per_unit = match name.as_str() {
                    "MM" => 1e3,
                    "CM" => 1e4,
                    "INCH" | "INCHES" => 25.4e3,
                    _ => return Err(place.fault(rest, "UNITS/MM, UNITS/CM or UNITS/INCHES")),
                };
                Ok(None)
            }
            "FINI" => {
                self.ended = true;
                Ok(None)
            }
            other if IGNORED.contains(&other) => Ok(None),
            _ => Err(ToolpathError::AptUnsupported {
                line: place.line,
                column: place.column,
                word: shortened(word),
                accepted: ACCEPTED,
            }),
        }
    }

    fn numbers(
        &self,
        arguments: Option<&str>,
        place: Place,
        at: &impl Fn(&str) -> Place,
        least: usize,
        most: usize,
    ) -> Result<Numbers, ToolpathError> {
        let Some(mut rest) = arguments else {
            return Err(place.fault("", "\"/\" and coordinates behind the word"));
        };
        let mut numbers = Numbers { values: [0.0; 7], count: 0 };
        loop {
            let end = rest.find(',').unwrap_or(rest.len());
            let field = rest[..end].trim();
            if numbers.count == most {
                return Err(at(rest).fault(field, "fewer coordinates"));
            }
            match field.parse::<f64>() {
                Ok(value) if value.abs() * self.um_per_unit <= MAX_VECTOR_UM => {
                    numbers.values[numbers.count] = value;
                    numbers.count += 1;
                }
                _ => return Err(at(rest).fault(field, "a number, within ±10 m")),
            }
            if end == rest.len() {
                break;
            }
            rest = &rest[end + 1..];
        }
        if numbers.count < least {
            return Err(place.fault("", "more coordinates: x, y and maybe z"));
        }
        Ok(numbers)
    }

    fn feed(&mut self, arguments: &str, place: Place) -> Result<(), ToolpathError> {
        let mut speed = None;
        let mut unit = None;
        for field in arguments.split(',').map(str::trim) {
            match field.parse::<f64>() {
                Ok(value) if value > 0.0 && value <= 1e9 && speed.is_none() => speed = Some(value),
                Ok(_) => return Err(place.fault(field, "one speed, above 0 and up to 1e9")),
                Err(_) => {
                    let m_s_per_unit = match Upper::of(field).as_str() {
                        "MMPM" => 1e-3 / 60.0,
                        "MMPS" => 1e-3,
                        "IPM" => 25.4e-3 / 60.0,
                        "PERMIN" => self.um_per_unit * 1e-6 / 60.0,
                        _ => return Err(place.fault(field, "MMPM, MMPS, IPM or PERMIN")),
                    };
                    if unit.replace(m_s_per_unit).is_some() {
                        return Err(place.fault(field, "one unit"));
                    }
                }
            }
        }
        let speed = speed.ok_or_else(|| place.fault(arguments, "a speed"))?;
        self.speed_m_s = Some(speed * unit.unwrap_or(self.um_per_unit * 1e-6 / 60.0));
        Ok(())
    }

    fn go(
        &mut self,
        (to_um, z_um): (Point, Option<f64>),
        place: Place,
    ) -> Result<VectorStep, ToolpathError> {
        let z_um = z_um.unwrap_or(self.z_um);
        let climbs = (z_um - self.z_um).abs() > SAME_HEIGHT_UM;
        let jumps = std::mem::take(&mut self.rapid) || self.at_um.is_none();
        let arc = self.center_um.take();
        if climbs && !jumps {
            return Err(
                place.fault("", "RAPID before a GOTO that changes z: a head marks in a plane")
            );
        }
        self.at_um = Some(to_um);
        let speed_m_s = self.speed_m_s;
        let step = match arc {
            _ if jumps => VectorStep::Jump { to_um },
            Some((center_um, counterclockwise)) => {
                VectorStep::Arc { to_um, center_um, counterclockwise, speed_m_s }
            }
            None => VectorStep::Mark { to_um, speed_m_s },
        };
        if climbs {
            self.z_um = z_um;
            self.pending = Some(step);
            return Ok(VectorStep::Layer { z_um });
        }
        Ok(step)
    }
}

/// Lines of a statement.
#[derive(Debug, Clone, Copy)]
struct Lines {
    first: usize,
    last: usize,
    /// Where the last line begins in the statement, bytes.
    last_start: usize,
}

impl Lines {
    /// The place of the byte `offset` of a statement.
    fn place(self, statement: &str, offset: usize) -> Place {
        let (line, start) = if offset >= self.last_start && self.last_start > 0 {
            (self.last, self.last_start)
        } else {
            (self.first, 0)
        };
        let column = statement.get(start..offset).map_or(offset, |text| text.chars().count()) + 1;
        Place { line, column }
    }
}

/// A word in upper case, without memory of its own; longer ones are none that is known.
struct Upper {
    bytes: [u8; 16],
    length: usize,
}

impl Upper {
    fn of(word: &str) -> Self {
        let mut upper = Self { bytes: [0; 16], length: 0 };
        if word.len() <= upper.bytes.len() {
            for (slot, byte) in upper.bytes.iter_mut().zip(word.bytes()) {
                *slot = byte.to_ascii_uppercase();
            }
            upper.length = word.len();
        }
        upper
    }

    fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..self.length]).unwrap_or("")
    }
}

struct Numbers {
    values: [f64; 7],
    count: usize,
}

impl Numbers {
    /// x and y, and z where there is one, µm.
    fn coordinates(&self, um_per_unit: f64) -> (Point, Option<f64>) {
        let [x, y, z, ..] = self.values.map(|value| value * um_per_unit);
        (Point::new(x, y), (self.count > 2).then_some(z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<VectorStep>, ToolpathError> {
        let mut reader = AptReader::new(text.as_bytes());
        let mut steps = Vec::new();
        while let Some(step) = reader.next_step()? {
            steps.push(step);
        }
        Ok(steps)
    }

    fn jump(x: f64, y: f64) -> VectorStep {
        VectorStep::Jump { to_um: Point::new(x, y) }
    }

    fn mark(x: f64, y: f64, speed_m_s: Option<f64>) -> VectorStep {
        VectorStep::Mark { to_um: Point::new(x, y), speed_m_s }
    }

    #[test]
    fn a_job_is_jumps_and_marks() {
        let text = "PARTNO lines/1\nUNITS/MM\n$$ note\nFEDRAT/120000,MMPM\nRAPID\nGOTO/0,0,0\n\
                    goto / 2.0 , 0 , 0 $$ along x\nRAPID\nGOTO/0,1\nGOTO/0,1.5\nFINI\n";
        let speed = Some(2.0);
        let expected =
            [jump(0.0, 0.0), mark(2e3, 0.0, speed), jump(0.0, 1e3), mark(0.0, 1.5e3, speed)];
        assert_eq!(read(text).unwrap(), expected);
    }

    #[test]
    fn statements_go_over_lines() {
        let text = "GOTO/0,$\n 1,$ $$ why not\n 0\nGOTO/1,0\n";
        assert_eq!(read(text).unwrap(), [jump(0.0, 1e3), mark(1e3, 0.0, None)]);
    }

    #[test]
    fn units_and_feeds_are_converted() {
        let text = "UNITS/INCHES\nFEDRAT/IPM,60\nGOTO/0,0\nGOTO/1,0\nFEDRAT/60\nGODLTA/0,1\n";
        let speed = Some(25.4e-3);
        let steps = read(text).unwrap();
        assert_eq!(steps[..2], [jump(0.0, 0.0), mark(25.4e3, 0.0, speed)]);
        let VectorStep::Mark { to_um, speed_m_s } = steps[2] else { panic!("{steps:?}") };
        assert!(to_um.distance(Point::new(25.4e3, 25.4e3)) < 1e-9);
        assert!((speed_m_s.unwrap() - 25.4e-3).abs() < 1e-12);
    }

    #[test]
    fn circles_and_layers_are_understood() {
        let text = "GOTO/1,0,0\nCIRCLE/0,0,0,0,0,1,1\nGOTO/0,1,0\nRAPID\nGOTO/0,1,-0.01\n";
        let steps = read(text).unwrap();
        assert!(matches!(
            steps[1],
            VectorStep::Arc { center_um, counterclockwise: true, .. } if center_um == Point::default()
        ));
        assert_eq!(steps[2], VectorStep::Layer { z_um: -10.0 });
        assert_eq!(steps[3], jump(0.0, 1e3));
    }

    #[test]
    fn faults_have_line_column_and_reason() {
        for (text, line, column, word) in [
            ("GOTO/0,x", 1, 8, "number"),
            ("\nGOTO/0,0,0,0,0,0,0", 2, 18, "fewer"),
            ("GOTO/0", 1, 1, "more"),
            ("  GOTO", 1, 3, "\"/\""),
            ("GOTO/0,1e9", 1, 8, "10 m"),
            ("GOTO/0,nan", 1, 8, "number"),
            ("GOTO/0,$\n  y", 2, 1, "number"),
            ("FEDRAT/-1", 1, 1, "above 0"),
            ("FEDRAT/1,MMPR", 1, 1, "MMPM"),
            ("FEDRAT/", 1, 1, "MMPM"),
            ("UNITS/FEET", 1, 1, "INCHES"),
            ("GODLTA/1,1", 1, 1, "known position"),
            ("GOTO/0,0\nGOTO/0,0,1", 2, 1, "RAPID"),
            ("FINI\nRAPID", 2, 1, "FINI"),
            (" BORE/1", 1, 2, "GOTO FROM"),
            ("é", 1, 1, "GOTO FROM"),
        ] {
            let message = read(text).unwrap_err().to_string();
            let place = format!("line {line}, column {column}: ");
            assert!(message.starts_with(&place) && message.contains(word), "{text:?}: {message}");
        }
    }

    #[test]
    fn a_statement_without_end_is_refused() {
        let text = "GOTO/0,$\n".repeat(20_000);
        assert!(matches!(read(&text), Err(ToolpathError::LineTooLong { .. })));
    }
}
