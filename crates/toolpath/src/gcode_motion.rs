//! G-code as moves of a laser head, ours or foreign, read as a stream.

use std::io::BufRead;

use lasergym_geom::Point;

use crate::ToolpathError;
use crate::error::shortened;
use crate::gcode_words::{Word, next_word};
use crate::line_source::LineSource;
use crate::vector_step::MAX_VECTOR_UM;

/// Comments that begin with this are handed out as notes.
pub const NOTE_PREFIX: &str = "lasergym ";

const ACCEPTED: &str = "G0 G1 G2 G3 G4 G17 G20 G21 G40 G49 G54 G61 G64 G80 G90 G91 G91.1 G94, M2 M3 \
    M4 M5 M7 M8 M9 M30 M67 and the letters X Y Z I J R F S P Q E N T are supported";

const UM_PER_MM: f64 = 1e3;
const UM_PER_INCH: f64 = 25.4e3;

/// Ends of an arc may differ in radius by this, µm, or a hundredth.
const ARC_MISMATCH_UM: f64 = 20.0;

/// What a program does. Positions are µm, x right and y up.
#[derive(Debug, Clone, PartialEq)]
pub enum GcodeMotion {
    /// G0, with the laser off whatever its power, as in GRBL's laser mode.
    Rapid {
        /// Where to.
        to_um: Point,
    },
    /// G1.
    Line {
        /// Where to.
        to_um: Point,
        /// Speed, m/s; none before the first F.
        speed_m_s: Option<f64>,
        /// Whether the laser is on: M3 or M4 with a power above 0.
        lit: bool,
    },
    /// G2 or G3.
    Arc {
        /// Where to; where it begins: a full circle.
        to_um: Point,
        /// Its centre.
        center_um: Point,
        /// G3.
        counterclockwise: bool,
        /// Speed, m/s; none before the first F.
        speed_m_s: Option<f64>,
        /// Whether the laser is on.
        lit: bool,
    },
    /// G4.
    Dwell {
        /// How long, µs.
        duration_us: f64,
        /// Where, µm.
        at_um: Point,
        /// Whether the laser is on.
        lit: bool,
    },
    /// A comment for lasergym.
    Note {
        /// The comment without [`NOTE_PREFIX`].
        text: String,
        /// Number of its line.
        line: usize,
        /// Number of the character in the line at which it begins.
        column: usize,
    },
}

/// Reads moves out of a program; the memory does not grow with the program.
///
/// Read: G0 to G4, G20, G21, G90, G91, F, S, M3, M4, M5, the analog output M67 E0 Q as power (Mach4),
/// M2 and M30; Z and what else has no effect in a plane is passed over. Arcs have I and J (relative) or
/// R. A machine starts at (0, 0), with G0, mm, absolute, laser off.
#[derive(Debug)]
pub struct GcodeMotionReader<R> {
    source: LineSource<R>,
    um_per_unit: f64,
    relative: bool,
    motion: u32,
    at_um: Point,
    speed_m_s: Option<f64>,
    enabled: bool,
    power: f64,
    ended: bool,
}

/// The words of a line.
#[derive(Debug, Default)]
struct Line {
    motion: Option<u32>,
    dwell: bool,
    analog: bool,
    laser: Option<bool>,
    units: Option<f64>,
    relative: Option<bool>,
    end: bool,
    x: Option<f64>,
    y: Option<f64>,
    i: Option<f64>,
    j: Option<f64>,
    r: Option<f64>,
    f: Option<f64>,
    s: Option<f64>,
    p: Option<f64>,
    q: Option<f64>,
}

impl<R: BufRead> GcodeMotionReader<R> {
    /// A reader at the start of a program.
    pub fn new(reader: R) -> Self {
        Self {
            source: LineSource::new(reader),
            um_per_unit: UM_PER_MM,
            relative: false,
            motion: 0,
            at_um: Point::default(),
            speed_m_s: None,
            enabled: false,
            power: 0.0,
            ended: false,
        }
    }

    /// The next move, dwell or note; none at the end.
    ///
    /// # Errors
    /// [`ToolpathError::GcodeVector`] says what has no meaning, in which line and column;
    /// [`ToolpathError::LineTooLong`] and [`ToolpathError::Unreadable`] guard the file.
    pub fn next_motion(&mut self) -> Result<Option<GcodeMotion>, ToolpathError> {
        while let Some(content) = self.source.next_line()? {
            let content = content.trim_end();
            if let "" | "%" = content.trim_start() {
                continue;
            }
            if let Some((before, note)) = note_of(content) {
                let (text, column) = (note.to_owned(), before.chars().count() + 1);
                return Ok(Some(GcodeMotion::Note { text, line: self.source.line(), column }));
            }
            let content = content.to_owned();
            if let Some(motion) = self.execute(&content)? {
                return Ok(Some(motion));
            }
        }
        Ok(None)
    }

    fn execute(&mut self, content: &str) -> Result<Option<GcodeMotion>, ToolpathError> {
        let number = self.source.line();
        let fault = |rest: &str, expected: &'static str| {
            let before = content.get(..content.len() - rest.len()).unwrap_or("");
            ToolpathError::GcodeVector {
                line: number,
                column: before.chars().count() + 1,
                found: shortened(rest),
                expected,
            }
        };
        let mut line = Line::default();
        let mut rest = content;
        let mut any = false;
        loop {
            let next = next_word(rest, number).map_err(|error| match error {
                ToolpathError::GcodeOpenComment { .. } => {
                    fault(rest.trim_start(), "close the comment in its line")
                }
                _ => fault(rest.trim_start(), "a word is a letter and a number, such as X1.5"),
            })?;
            let Some((word, at, after)) = next else { break };
            any = true;
            line.take(word).map_err(|expected| fault(at, expected))?;
            rest = after;
        }
        if any && self.ended {
            let reason = "the program has ended (M2 or M30) and yet goes on";
            return Err(fault(content.trim_start(), reason));
        }
        self.act(&line).map_err(|expected| fault(content.trim_start(), expected))
    }

    /// Carries a line out in the order of the machine: S, M3 to M5, dwell, units, distance, motion.
    fn act(&mut self, line: &Line) -> Result<Option<GcodeMotion>, &'static str> {
        self.power = line.s.unwrap_or(self.power);
        if line.analog {
            self.power = line.q.ok_or("M67 needs its Q")?;
        }
        self.enabled = line.laser.unwrap_or(self.enabled);
        self.um_per_unit = line.units.unwrap_or(self.um_per_unit);
        self.relative = line.relative.unwrap_or(self.relative);
        if let Some(feed) = line.f {
            let speed_m_s = feed * self.um_per_unit * 1e-6 / 60.0;
            self.speed_m_s = (speed_m_s > 0.0).then_some(speed_m_s);
        }
        self.ended = line.end;
        self.motion = line.motion.unwrap_or(self.motion);
        if line.dwell {
            let seconds = line.p.ok_or("G4 needs its P, in seconds")?;
            let (at_um, lit) = (self.at_um, self.is_lit());
            return Ok(Some(GcodeMotion::Dwell { duration_us: seconds * 1e6, at_um, lit }));
        }
        let is_arc = self.motion >= 2;
        let turns = is_arc && (line.i.is_some() || line.j.is_some());
        if line.x.is_none() && line.y.is_none() && !turns {
            return Ok(None);
        }
        let axis = |word: Option<f64>, at: f64| match word {
            Some(word) if self.relative => at + word * self.um_per_unit,
            Some(word) => word * self.um_per_unit,
            None => at,
        };
        let from = self.at_um;
        let to_um = Point::new(axis(line.x, from.x), axis(line.y, from.y));
        if !(to_um.x.abs() <= MAX_VECTOR_UM && to_um.y.abs() <= MAX_VECTOR_UM) {
            return Err("coordinates must be within ±10 m");
        }
        let lit = self.is_lit();
        let speed_m_s = self.speed_m_s;
        let center_um = if is_arc { Some(self.center(line, from, to_um)?) } else { None };
        self.at_um = to_um;
        Ok(Some(match (self.motion, center_um) {
            (0, _) => GcodeMotion::Rapid { to_um },
            (motion, Some(center_um)) => {
                let counterclockwise = motion == 3;
                GcodeMotion::Arc { to_um, center_um, counterclockwise, speed_m_s, lit }
            }
            _ => GcodeMotion::Line { to_um, speed_m_s, lit },
        }))
    }

    fn is_lit(&self) -> bool {
        self.enabled && self.power > 0.0
    }

    fn center(&self, line: &Line, from: Point, to: Point) -> Result<Point, &'static str> {
        if let Some(r) = line.r {
            let radius = r * self.um_per_unit;
            let chord = to - from;
            let half = 0.5 * chord.length();
            if half <= 0.0 || radius.abs() < half * (1.0 - 1e-6) || radius.abs() > MAX_VECTOR_UM {
                return Err("the radius R must be at least half the distance of the ends");
            }
            let height = (radius * radius - half * half).max(0.0).sqrt();
            let left = Point::new(-chord.y, chord.x).normalized();
            // G3 with R > 0 has its centre on the left of the chord.
            let side = if (self.motion == 3) == (radius > 0.0) { 1.0 } else { -1.0 };
            return Ok(from + chord * 0.5 + left * (side * height));
        }
        if line.i.is_none() && line.j.is_none() {
            return Err("an arc needs I and J or R");
        }
        let offset = Point::new(line.i.unwrap_or(0.0), line.j.unwrap_or(0.0)) * self.um_per_unit;
        let center = from + offset;
        let (begin, end) = (offset.length(), center.distance(to));
        if !(begin > 0.0 && begin <= MAX_VECTOR_UM) {
            return Err("an arc needs a radius above 0 and up to 10 m");
        }
        if (begin - end).abs() > ARC_MISMATCH_UM.max(0.01 * begin) {
            return Err("the ends of the arc are not equally far from its centre");
        }
        Ok(center)
    }
}

impl Line {
    fn take(&mut self, word: Word) -> Result<(), &'static str> {
        const TWICE: &str = "it repeats or contradicts a word before it: put it in its own line";
        let hundredths = (word.number * 100.0).round();
        let code = if (hundredths - word.number * 100.0).abs() < 1e-6 && hundredths >= 0.0 {
            hundredths as u32
        } else {
            u32::MAX
        };
        let fresh = match (word.letter, code) {
            ('G', 0 | 100 | 200 | 300) => self.motion.replace(code / 100).is_none(),
            ('G', 400) => !std::mem::replace(&mut self.dwell, true),
            ('G', 2000) => self.units.replace(UM_PER_INCH).is_none(),
            ('G', 2100) => self.units.replace(UM_PER_MM).is_none(),
            ('G', 9000) => self.relative.replace(false).is_none(),
            ('G', 9100) => self.relative.replace(true).is_none(),
            ('G', 1700 | 4000 | 4900 | 5400 | 6100 | 6400 | 8000 | 9110 | 9400)
            | ('M', 700 | 800 | 900)
            | ('Z' | 'N' | 'E' | 'T', _) => true,
            ('M', 200 | 3000) => !std::mem::replace(&mut self.end, true),
            ('M', 300 | 400) => self.laser.replace(true).is_none(),
            ('M', 500) => self.laser.replace(false).is_none(),
            ('M', 6700) => !std::mem::replace(&mut self.analog, true),
            ('X', _) => self.x.replace(word.number).is_none(),
            ('Y', _) => self.y.replace(word.number).is_none(),
            ('I', _) => self.i.replace(word.number).is_none(),
            ('J', _) => self.j.replace(word.number).is_none(),
            ('R', _) => self.r.replace(word.number).is_none(),
            ('F' | 'S' | 'P' | 'Q', _) if !(0.0..=1e9).contains(&word.number) => {
                return Err("feed, power and dwell are from 0 to 1e9");
            }
            ('F', _) => self.f.replace(word.number).is_none(),
            ('S', _) => self.s.replace(word.number).is_none(),
            ('P', _) => self.p.replace(word.number).is_none(),
            ('Q', _) => self.q.replace(word.number).is_none(),
            _ => return Err(ACCEPTED),
        };
        if fresh { Ok(()) } else { Err(TWICE) }
    }
}

/// The note in a line that is one comment for lasergym, and what is before it.
fn note_of(content: &str) -> Option<(&str, &str)> {
    let comment = content.trim_start();
    let comment = match comment.strip_prefix(';') {
        Some(rest) => rest,
        None => comment.strip_prefix('(')?,
    };
    let note = comment.trim_start().strip_prefix(NOTE_PREFIX)?;
    let before = &content[..content.len() - note.len()];
    if before.trim_start().starts_with('(') {
        return Some((before, note.strip_suffix(')')?));
    }
    Some((before, note))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<GcodeMotion>, ToolpathError> {
        let mut reader = GcodeMotionReader::new(text.as_bytes());
        let mut motions = Vec::new();
        while let Some(motion) = reader.next_motion()? {
            motions.push(motion);
        }
        Ok(motions)
    }

    fn line(x: f64, y: f64, speed: f64, lit: bool) -> GcodeMotion {
        GcodeMotion::Line { to_um: Point::new(x, y), speed_m_s: Some(speed), lit }
    }

    #[test]
    fn grbl_programs_are_read() {
        let text = "(lasergym a=1 b=2)\nG21 G90\nM4 S0\nG0 X1 Y1\nG1 X2 F60000 S500 ; lit\nY2\nX3 S0\nM5\n";
        let motions = read(text).unwrap();
        let note = GcodeMotion::Note { text: "a=1 b=2".to_owned(), line: 1, column: 11 };
        assert_eq!(motions[0], note);
        assert_eq!(motions[1], GcodeMotion::Rapid { to_um: Point::new(1e3, 1e3) });
        let expected =
            [line(2e3, 1e3, 1.0, true), line(2e3, 2e3, 1.0, true), line(3e3, 2e3, 1.0, false)];
        assert_eq!(motions[2..], expected);
    }

    #[test]
    fn mach4_and_linuxcnc_power_is_understood() {
        let text = "M3\nF60000\nM67 E0 Q255\nG1 X1\nM67 E0 Q0\nX2\nM5\nM3 S9\nX3\nG4 P0.001\n";
        let motions = read(text).unwrap();
        let lit: Vec<bool> = motions
            .iter()
            .filter_map(|motion| match motion {
                GcodeMotion::Line { lit, .. } => Some(*lit),
                _ => None,
            })
            .collect();
        assert_eq!(lit, [true, false, true]);
        let at_um = Point::new(3e3, 0.0);
        assert_eq!(motions[3], GcodeMotion::Dwell { duration_us: 1000.0, at_um, lit: true });
    }

    #[test]
    fn arcs_have_their_centre() {
        for text in ["G3 X0 Y1 I-1 J0 F60", "G3 X0 Y1 R1 F60"] {
            let motions = read(&format!("G0 X1 Y0\n{text}\n")).unwrap();
            let GcodeMotion::Arc { center_um, counterclockwise: true, .. } = motions[1] else {
                panic!("{motions:?}");
            };
            assert!(center_um.length() < 1e-6, "{center_um:?}");
        }
        let GcodeMotion::Arc { center_um, .. } = read("G0 X1 Y0\nG2 X0 Y1 R1").unwrap()[1] else {
            panic!("no arc");
        };
        assert!(center_um.distance(Point::new(1e3, 1e3)) < 1e-6);
    }

    #[test]
    fn relative_moves_and_inches_are_followed() {
        let motions = read("G20 G91\nG1 X1 F60\nX1\n").unwrap();
        assert_eq!(motions[1], line(50.8e3, 0.0, 25.4e-3, false));
    }

    #[test]
    fn faults_have_line_column_and_reason() {
        for (text, line, column, word) in [
            ("G90\nX1 G77", 2, 4, "supported"),
            ("X1 X2", 1, 4, "repeats"),
            ("G1 X", 1, 4, "letter"),
            ("G1 (open", 1, 4, "comment"),
            ("  G1 X1 X2", 1, 9, "repeats"),
            (" G4", 1, 2, "P"),
            ("G2 X1", 1, 1, "I and J"),
            ("G2 X1 R0.1", 1, 1, "radius"),
            ("G0X1\nG2 X0 I-9", 2, 1, "equally"),
            ("G2 X1 I0", 1, 1, "radius"),
            ("X99999999", 1, 1, "10 m"),
            ("G4", 1, 1, "P"),
            ("M67 E0", 1, 1, "Q"),
            ("F-1", 1, 1, "1e9"),
            ("M2\nX1", 2, 1, "ended"),
            ("$H", 1, 1, "letter"),
        ] {
            let message = read(text).unwrap_err().to_string();
            let place = format!("line {line}, column {column}: ");
            assert!(message.starts_with(&place) && message.contains(word), "{text:?}: {message}");
        }
    }
}
