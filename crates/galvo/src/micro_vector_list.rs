//! Programs as lists of micro-vectors in CSV, written: where the command is every 10 µs.
//!
//! ```text
//! x_um,y_um,laser,on_us,off_us
//! # lasergym step step_us=10
//! -453.0072,0.0000,0,,
//! -433.0072,0.0000,0,4.0000,
//! -413.0072,0.0000,1,,
//! ```
//!
//! A row is the place of the command at the beginning of a step, and the laser there, 1 or 0; between
//! rows the command is straight. `on_us` and `off_us` say how long after the beginning of the step the
//! laser is switched, where it is: on first in a row that begins dark, off first in one that begins lit.
//! Rows are what `micro_vector_abs` of an RTC takes, which counts both times in 0.5 µs.
//!
//! Notes tell the simulation what the rows cannot; other lines that begin with `#` are comments:
//!
//! | note | meaning |
//! |---|---|
//! | `step step_us=` | length of a step, a multiple of 10 µs; before the first row |
//! | `mark`, `jump`, `delay`, `run-in` | what the steps from here on are for |
//! | `pulses stroke= pulse_rate_hz=` | stroke and rate of the pulses from the next switching on |
//! | `begin`, `end` `stroke= x_um= y_um= angle_deg= speed_m_s= beam_um=` | a stroke as it was drawn |
//! | `corner stroke= x_um= y_um= reach_um=` | a corner of a stroke, and how far a lagging beam rounds it off |
//! | `layer z_um=` | another height |

use std::collections::VecDeque;
use std::io::Write;

use lasergym_geom::Point;

use crate::GalvoError;
use crate::error::check_option;
use crate::head_command::{CommandSink, HeadCommand, StrokeEnd};
use crate::player::Purpose;

/// First line of a list of micro-vectors.
pub const MICRO_VECTOR_HEADER: &str = "x_um,y_um,laser,on_us,off_us";

/// What notes begin with.
pub(crate) const NOTE_PREFIX: &str = "# lasergym ";

/// The clock of an RTC, µs.
pub(crate) const CLOCK_US: f64 = 10.0;

/// Names of what time is for.
pub(crate) const PURPOSES: [(Purpose, &str); 4] = [
    (Purpose::Mark, "mark"),
    (Purpose::Jump, "jump"),
    (Purpose::Delay, "delay"),
    (Purpose::RunIn, "run-in"),
];

/// Accepts a multiple of 10 µs up to 1000 µs.
pub(crate) fn check_step(step_us: f64) -> Result<(), GalvoError> {
    let ok = (CLOCK_US..=1e3).contains(&step_us) && step_us % CLOCK_US <= 0.0;
    check_option("step_us", step_us, ok, "a multiple of 10 µs, up to 1000")
}

/// A row whose step may still switch the laser.
#[derive(Debug, Clone, Copy)]
struct Row {
    at_um: Point,
    purpose: Purpose,
}

/// A time with the laser on, µs from the start.
#[derive(Debug, Clone, Copy)]
struct Lit {
    on_us: f64,
    /// Not known while a stroke is under way.
    off_us: Option<f64>,
    pulse_rate_hz: f64,
    stroke: u64,
}

/// Writes commands as micro-vectors. In memory are the rows of the time by which the laser may be
/// switched before the end of a stroke, no more.
#[derive(Debug)]
pub struct MicroVectorList<W: Write> {
    out: std::io::BufWriter<W>,
    step_us: f64,
    /// Rows that are not written yet, the first of them number `first_row`.
    rows: VecDeque<Row>,
    first_row: u64,
    clock_us: f64,
    at_um: Point,
    hold_us: f64,
    lights: VecDeque<Lit>,
    lit: bool,
    /// What was noted last.
    purpose: Option<Purpose>,
    pulses: Option<(u64, f64)>,
}

impl<W: Write> MicroVectorList<W> {
    /// Begins a list with a row every `step_us`, a multiple of 10 µs, up to 1000.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] for another step, [`GalvoError::Write`] when writing fails.
    pub fn begin(out: W, step_us: f64) -> Result<Self, GalvoError> {
        check_step(step_us)?;
        let mut out = std::io::BufWriter::with_capacity(1 << 16, out);
        writeln!(out, "{MICRO_VECTOR_HEADER}\n{NOTE_PREFIX}step step_us={step_us}")?;
        Ok(Self {
            out,
            step_us,
            rows: VecDeque::new(),
            first_row: 0,
            clock_us: 0.0,
            at_um: Point::default(),
            hold_us: 0.0,
            lights: VecDeque::new(),
            lit: false,
            purpose: None,
            pulses: None,
        })
    }

    /// Writes the last rows, until the laser is off, and hands the writer back.
    ///
    /// # Errors
    /// [`GalvoError::Write`] when writing fails, [`GalvoError::InvalidOption`] as for commands.
    pub fn finish(mut self) -> Result<W, GalvoError> {
        let off_us = self.lights.iter().filter_map(|lit| lit.off_us).fold(0.0, f64::max);
        self.advance(self.at_um, off_us - self.clock_us, Purpose::Delay)?;
        if self.next_row() > 0 {
            while self.next_row() as f64 * self.step_us <= self.clock_us {
                self.rows.push_back(Row { at_um: self.at_um, purpose: Purpose::Delay });
            }
            self.rows.push_back(Row { at_um: self.at_um, purpose: Purpose::Delay });
        }
        self.write_until(f64::INFINITY)?;
        Ok(self.out.into_inner().map_err(std::io::IntoInnerError::into_error)?)
    }

    /// Number of the row that is sampled next.
    fn next_row(&self) -> u64 {
        self.first_row + self.rows.len() as u64
    }

    fn advance(&mut self, to: Point, duration_us: f64, purpose: Purpose) -> Result<(), GalvoError> {
        if duration_us <= 0.0 {
            return Ok(());
        }
        let (from, start_us) = (self.at_um, self.clock_us);
        let end_us = start_us + duration_us;
        loop {
            let passed_us = self.next_row() as f64 * self.step_us - start_us;
            if passed_us >= duration_us {
                break;
            }
            let at_um = from + (to - from) * (passed_us / duration_us);
            self.rows.push_back(Row { at_um, purpose });
            self.write_until(start_us + passed_us - self.hold_us)?;
        }
        (self.clock_us, self.at_um) = (end_us, to);
        self.write_until(end_us - self.hold_us)
    }

    /// Writes the rows whose steps end by `time_us`.
    fn write_until(&mut self, time_us: f64) -> Result<(), GalvoError> {
        while let Some(&row) = self.rows.front() {
            let start_us = self.first_row as f64 * self.step_us;
            if start_us + self.step_us > time_us {
                break;
            }
            self.write_row(row, start_us)?;
            self.rows.pop_front();
            self.first_row += 1;
        }
        Ok(())
    }

    fn write_row(&mut self, row: Row, start_us: f64) -> Result<(), GalvoError> {
        if self.purpose != Some(row.purpose) {
            self.purpose = Some(row.purpose);
            let name = PURPOSES.iter().find(|(purpose, _)| *purpose == row.purpose);
            writeln!(self.out, "{NOTE_PREFIX}{}", name.map_or("", |(_, name)| name))?;
        }
        let lit = self.lit;
        let end_us = start_us + self.step_us;
        let (mut on_us, mut off_us) = (None, None);
        while let Some(&light) = self.lights.front() {
            if !self.lit {
                if light.off_us.is_some_and(|off_us| off_us < light.on_us) {
                    self.lights.pop_front();
                    continue;
                }
                if light.on_us >= end_us {
                    break;
                }
                self.once(on_us.replace((light.on_us - start_us).max(0.0)))?;
                self.note_pulses(light)?;
                self.lit = true;
            }
            let Some(switched_us) = light.off_us.filter(|&off_us| off_us < end_us) else { break };
            self.once(off_us.replace((switched_us - start_us).max(on_us.unwrap_or(0.0))))?;
            self.lights.pop_front();
            self.lit = false;
        }
        write!(self.out, "{:.4},{:.4},{}", row.at_um.x, row.at_um.y, u8::from(lit))?;
        for time_us in [on_us, off_us] {
            match time_us {
                Some(time_us) => write!(self.out, ",{time_us:.4}")?,
                None => write!(self.out, ",")?,
            }
        }
        Ok(writeln!(self.out)?)
    }

    /// Refuses a second switching in the same step.
    fn once(&self, before: Option<f64>) -> Result<(), GalvoError> {
        let expected = "so short that the laser goes on and off at most once in a step";
        check_option("step_us", self.step_us, before.is_none(), expected)
    }

    fn note_pulses(&mut self, lit: Lit) -> Result<(), GalvoError> {
        if self.pulses.replace((lit.stroke, lit.pulse_rate_hz)) != self.pulses {
            let Lit { stroke, pulse_rate_hz, .. } = lit;
            writeln!(
                self.out,
                "{NOTE_PREFIX}pulses stroke={stroke} pulse_rate_hz={pulse_rate_hz}"
            )?;
        }
        Ok(())
    }

    fn note_stroke(&mut self, kind: &str, end: &StrokeEnd) -> Result<(), GalvoError> {
        let StrokeEnd { stroke, at_um, direction, speed_m_s, beam_um } = end;
        let angle_deg = direction.y.atan2(direction.x).to_degrees();
        Ok(writeln!(
            self.out,
            "{NOTE_PREFIX}{kind} stroke={stroke} x_um={:.4} y_um={:.4} angle_deg={angle_deg:.6} \
             speed_m_s={speed_m_s} beam_um={beam_um}",
            at_um.x, at_um.y,
        )?)
    }
}

impl<W: Write> CommandSink for MicroVectorList<W> {
    fn take(&mut self, command: &HeadCommand) -> Result<(), GalvoError> {
        match *command {
            HeadCommand::Rest { at_um } => self.at_um = at_um,
            HeadCommand::Move { to_um, duration_us, purpose } => {
                self.advance(to_um, duration_us, purpose)?;
            }
            HeadCommand::LaserOn { after_us, pulse_rate_hz, stroke } => {
                let on_us = self.clock_us + after_us;
                self.lights.push_back(Lit { on_us, off_us: None, pulse_rate_hz, stroke });
            }
            HeadCommand::LaserOff { after_us } => {
                let off_us = self.clock_us + after_us;
                if let Some(lit) = self.lights.back_mut() {
                    lit.off_us.get_or_insert(off_us);
                }
            }
            HeadCommand::StrokeBegins(begin) => self.note_stroke("begin", &begin)?,
            HeadCommand::Corner { stroke, at_um: Point { x, y }, reach_um } => {
                writeln!(
                    self.out,
                    "{NOTE_PREFIX}corner stroke={stroke} x_um={x:.4} y_um={y:.4} reach_um={reach_um:.4}"
                )?;
            }
            HeadCommand::StrokeEnds(end) => self.note_stroke("end", &end)?,
            HeadCommand::Layer { z_um } => {
                // The rows before it belong to the height before it.
                self.write_until(self.clock_us)?;
                writeln!(self.out, "{NOTE_PREFIX}layer z_um={z_um:.4}")?;
            }
        }
        Ok(())
    }

    fn hold_at_least(&mut self, hold_us: f64) {
        self.hold_us = self.hold_us.max(hold_us);
    }
}
