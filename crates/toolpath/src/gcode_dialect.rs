//! Vectors as G-code, written as a stream in the dialects of common controllers.

use std::fmt::Write as _;
use std::io::Write;

use lasergym_geom::Point;

use crate::gcode_motion::NOTE_PREFIX;

/// A dialect of G-code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GcodeDialect {
    /// GRBL 1.1 in laser mode ($32 = 1): M3 once, S on G1; G0 is dark.
    #[default]
    Grbl,
    /// `LinuxCNC`: M3 S before lit vectors, M5 behind them, path control by G64.
    LinuxCnc,
    /// Mach4: M3 once, the power as analog output M67 E0 Q from 0 to 255.
    Mach4,
}

/// Buffered bytes before they are handed on.
const BUFFER_BYTES: usize = 1 << 16;

/// Writes a program vector by vector. The laser is off first, last, and in every rapid move.
#[derive(Debug)]
pub struct VectorGcode<W: Write> {
    out: W,
    text: String,
    dialect: GcodeDialect,
    power: f64,
    lit: bool,
    feed_mm_min: f64,
}

impl<W: Write> VectorGcode<W> {
    /// Begins a program; `power` is the S of a lit vector (for [`GcodeDialect::Mach4`] from 0 to 255),
    /// `comments` are its first lines.
    ///
    /// # Errors
    /// What the writer reports.
    pub fn begin(
        out: W,
        dialect: GcodeDialect,
        power: f64,
        comments: &[&str],
    ) -> std::io::Result<Self> {
        let text = String::with_capacity(2 * BUFFER_BYTES);
        let mut program = Self { out, text, dialect, power, lit: false, feed_mm_min: 0.0 };
        for comment in comments {
            program.line(format_args!("({comment})"))?;
        }
        program.text.push_str("M5\nG21 G90 G94\n");
        match dialect {
            GcodeDialect::Grbl => program.text.push_str("M3 S0\n"),
            GcodeDialect::LinuxCnc => program.text.push_str("G64 P0.0005\n"),
            GcodeDialect::Mach4 => program.text.push_str("M67 E0 Q0\nM3\n"),
        }
        Ok(program)
    }

    /// A comment that [`crate::GcodeMotionReader`] hands out.
    ///
    /// # Errors
    /// What the writer reports.
    pub fn note(&mut self, note: &str) -> std::io::Result<()> {
        self.switch(false)?;
        self.line(format_args!("({NOTE_PREFIX}{note})"))
    }

    /// A rapid move.
    ///
    /// # Errors
    /// What the writer reports.
    pub fn jump(&mut self, to_um: Point) -> std::io::Result<()> {
        self.switch(false)?;
        self.text.push_str("G0");
        self.place(to_um);
        self.end_line()
    }

    /// A straight vector.
    ///
    /// # Errors
    /// What the writer reports.
    pub fn mark(&mut self, to_um: Point, speed_m_s: f64, lit: bool) -> std::io::Result<()> {
        self.switch(lit)?;
        self.text.push_str("G1");
        self.place(to_um);
        let feed_mm_min = speed_m_s * 60e3;
        if (feed_mm_min - self.feed_mm_min).abs() > 0.0 {
            self.feed_mm_min = feed_mm_min;
            let _ = write!(self.text, " F{feed_mm_min:.4}");
        }
        self.end_line()
    }

    /// A dwell.
    ///
    /// # Errors
    /// What the writer reports.
    pub fn dwell(&mut self, duration_us: f64) -> std::io::Result<()> {
        self.line(format_args!("G4 P{:.6}", duration_us * 1e-6))
    }

    /// A change of height with the laser off.
    ///
    /// # Errors
    /// What the writer reports.
    pub fn layer(&mut self, z_um: f64) -> std::io::Result<()> {
        self.switch(false)?;
        self.line(format_args!("G0 Z{:.6}", z_um * 1e-3))
    }

    /// Ends the program with the laser off, and hands the writer back.
    ///
    /// # Errors
    /// What the writer reports.
    pub fn finish(mut self) -> std::io::Result<W> {
        self.switch(false)?;
        if self.dialect == GcodeDialect::Mach4 {
            self.text.push_str("M67 E0 Q0\n");
        }
        self.text.push_str("M5 S0\nM2\n");
        self.out.write_all(self.text.as_bytes())?;
        self.out.flush()?;
        Ok(self.out)
    }

    fn switch(&mut self, lit: bool) -> std::io::Result<()> {
        if lit == self.lit {
            return Ok(());
        }
        self.lit = lit;
        let power = if lit { self.power } else { 0.0 };
        match self.dialect {
            GcodeDialect::Grbl => self.line(format_args!("S{power}")),
            GcodeDialect::LinuxCnc if lit => self.line(format_args!("M3 S{power}")),
            GcodeDialect::LinuxCnc => self.line(format_args!("M5")),
            GcodeDialect::Mach4 => self.line(format_args!("M67 E0 Q{power}")),
        }
    }

    fn line(&mut self, content: std::fmt::Arguments<'_>) -> std::io::Result<()> {
        // Writing to a String cannot fail.
        let _ = self.text.write_fmt(content);
        self.end_line()
    }

    fn end_line(&mut self) -> std::io::Result<()> {
        self.text.push('\n');
        if self.text.len() >= BUFFER_BYTES {
            self.out.write_all(self.text.as_bytes())?;
            self.text.clear();
        }
        Ok(())
    }

    fn place(&mut self, to_um: Point) {
        self.text.push_str(" X");
        push_millimetres(&mut self.text, to_um.x);
        self.text.push_str(" Y");
        push_millimetres(&mut self.text, to_um.y);
    }
}

/// Appends a length in mm, rounded to a nanometre.
fn push_millimetres(text: &mut String, length_um: f64) {
    let nanometres = (length_um * 1e3).round() as i64;
    if nanometres < 0 {
        text.push('-');
    }
    let size = nanometres.unsigned_abs();
    // Digits of whole millimetres, then six behind the point without trailing zeros.
    let mut digits = [0_u8; 20];
    let mut count = 0;
    let mut whole = size / 1_000_000;
    loop {
        digits[count] = b'0' + (whole % 10) as u8;
        count += 1;
        whole /= 10;
        if whole == 0 {
            break;
        }
    }
    text.extend(digits[..count].iter().rev().map(|&digit| char::from(digit)));
    let mut part = size % 1_000_000;
    if part == 0 {
        return;
    }
    text.push('.');
    let mut weight = 100_000;
    while part > 0 {
        text.push(char::from(b'0' + (part / weight) as u8));
        part %= weight;
        weight /= 10;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GcodeMotion, GcodeMotionReader};
    use proptest::prelude::*;

    const DIALECTS: [GcodeDialect; 3] =
        [GcodeDialect::Grbl, GcodeDialect::LinuxCnc, GcodeDialect::Mach4];

    proptest! {
        #[test]
        fn lengths_are_exact_to_a_nanometre(length_um in -1e7..1e7_f64) {
            let mut text = String::new();
            push_millimetres(&mut text, length_um);
            let read: f64 = text.parse().unwrap();
            prop_assert!((read * 1e3 - length_um).abs() < 0.51e-3);
            prop_assert!(!text.ends_with('.'));
        }

        #[test]
        fn what_was_written_is_read_again(
            vectors in proptest::collection::vec(
                (-17e3..17e3_f64, -17e3..17e3_f64, 0..3_u8, 0.01..3.0_f64), 0..30),
            dialect in 0..3_usize,
        ) {
            let mut program =
                VectorGcode::begin(Vec::new(), DIALECTS[dialect], 200.0, &["test"]).unwrap();
            for &(x, y, kind, speed) in &vectors {
                let to_um = Point::new(x, y);
                match kind {
                    0 => program.jump(to_um).unwrap(),
                    _ => program.mark(to_um, speed, kind == 1).unwrap(),
                }
            }
            let text = program.finish().unwrap();
            let mut reader = GcodeMotionReader::new(&text[..]);
            for &(x, y, kind, speed) in &vectors {
                let (to_um, lit_as, speed_as) = match reader.next_motion().unwrap() {
                    Some(GcodeMotion::Rapid { to_um }) => (to_um, None, None),
                    Some(GcodeMotion::Line { to_um, speed_m_s, lit }) => (to_um, Some(lit), speed_m_s),
                    other => panic!("{other:?}"),
                };
                prop_assert!(to_um.distance(Point::new(x, y)) < 1e-3);
                prop_assert_eq!(lit_as, (kind > 0).then_some(kind == 1));
                if let Some(found) = speed_as {
                    prop_assert!((found / speed - 1.0).abs() < 1e-6);
                }
            }
            prop_assert_eq!(reader.next_motion().unwrap(), None);
        }
    }

    #[test]
    fn the_laser_is_off_first_and_last() {
        for dialect in DIALECTS {
            let mut program = VectorGcode::begin(Vec::new(), dialect, 100.0, &[]).unwrap();
            program.mark(Point::new(1.0, 0.0), 1.0, true).unwrap();
            let text = String::from_utf8(program.finish().unwrap()).unwrap();
            assert!(text.starts_with("M5\n") && text.ends_with("M5 S0\nM2\n"), "{text}");
        }
    }
}
