//! Lists of micro-vectors, read. Their form is told in `micro_vector_list.rs`.

use std::collections::VecDeque;
use std::io::BufRead;

use lasergym_geom::Point;
use lasergym_toolpath::LineSource;

use crate::field::Field;
use crate::head_command::{HeadCommand, StrokeEnd};
use crate::laser::check_pulse_rate;
use crate::micro_vector_list::{CLOCK_US, MICRO_VECTOR_HEADER, NOTE_PREFIX, PURPOSES, check_step};
use crate::player::Purpose;
use crate::program::check_speed;
use crate::{GalvoError, ScanHead};

/// Reads the commands of a list, ours or a foreign one; the memory does not grow with the list.
///
/// Where no note names the stroke of the pulses, each time with the laser on is a stroke, from where the
/// command is then to where it is when the laser goes off, with the pulse rate of the head.
#[derive(Debug)]
pub struct MicroVectorReader<R> {
    source: LineSource<R>,
    field: Field,
    step_us: f64,
    /// Pulse rate where no note gives one, Hz.
    pulse_rate_hz: f64,
    /// The last row, whose step is made when its end is known.
    row: Option<Row>,
    lit: bool,
    /// What was noted last.
    purpose: Option<Purpose>,
    pulses: Option<(u64, f64)>,
    /// Strokes that no note has named.
    unnamed: u64,
    ahead: VecDeque<HeadCommand>,
}

#[derive(Debug, Clone, Copy)]
struct Row {
    at_um: Point,
    on_us: Option<f64>,
    off_us: Option<f64>,
    purpose: Option<Purpose>,
    /// Stroke and rate of the pulses, Hz.
    pulses: Option<(u64, f64)>,
}

impl<R: BufRead> MicroVectorReader<R> {
    /// A reader at the start of a list for `head`.
    pub fn new(reader: R, head: &ScanHead) -> Self {
        Self {
            source: LineSource::new(reader),
            field: head.field,
            step_us: CLOCK_US,
            pulse_rate_hz: head.laser.pulse_rate_hz,
            row: None,
            lit: false,
            purpose: None,
            pulses: None,
            unnamed: 0,
            ahead: VecDeque::new(),
        }
    }

    /// The next command; none at the end.
    ///
    /// # Errors
    /// [`GalvoError::Program`] says what is wrong, in which line and column;
    /// [`GalvoError::Toolpath`] guards the file.
    pub fn next_command(&mut self) -> Result<Option<HeadCommand>, GalvoError> {
        loop {
            if let Some(command) = self.ahead.pop_front() {
                return Ok(Some(command));
            }
            let Some(content) = self.source.next_line()? else {
                let Some(last) = self.row.take() else { return Ok(None) };
                self.step(last, last.at_um);
                if self.lit {
                    return Err(self.fault(1, "the list ends with the laser on: switch it off"));
                }
                // The last row ends the list: its step is not made.
                self.ahead.retain(|command| !matches!(command, HeadCommand::Move { .. }));
                continue;
            };
            let content = content.trim_end().to_owned();
            if self.source.line() == 1 {
                if content.split(',').map(str::trim).ne(MICRO_VECTOR_HEADER.split(',')) {
                    let reason = format!("the header is not {MICRO_VECTOR_HEADER:?}");
                    return Err(self.fault(1, &reason));
                }
            } else if let Some(note) = content.strip_prefix(NOTE_PREFIX) {
                self.note(note)?;
            } else if !content.trim_start().is_empty() && !content.starts_with('#') {
                self.take_row(&content)?;
            }
        }
    }

    fn fault(&self, column: usize, reason: &str) -> GalvoError {
        GalvoError::Program { line: self.source.line(), column, reason: reason.to_owned() }
    }

    fn take_row(&mut self, content: &str) -> Result<(), GalvoError> {
        let mut values = [None; 5];
        let mut starts = [1; 5];
        let mut column = 1;
        let mut count = 0;
        for field in content.split(',') {
            let Some(slot) = values.get_mut(count) else {
                return Err(self.fault(column, "the end of the row is due here"));
            };
            starts[count] = column;
            let trimmed = field.trim();
            if !(trimmed.is_empty() && count >= 3) {
                let value = trimmed.parse::<f64>().ok().filter(|value| value.is_finite());
                let Some(value) = value else {
                    return Err(self.fault(column, "a number is due here"));
                };
                *slot = Some(value);
            }
            count += 1;
            column += field.chars().count() + 1;
        }
        let ([Some(x), Some(y), Some(laser), on_us, off_us], 5) = (values, count) else {
            return Err(self.fault(column - 1, "five fields are due: x, y, laser, on, off"));
        };
        let at_um = Point::new(x, y);
        if !self.field.contains(at_um) {
            let half_um = self.field.half_um();
            return Err(self.fault(1, &format!("outside the field of ±{half_um} µm")));
        }
        let lit = laser > 0.5;
        if (laser - f64::from(u8::from(lit))).abs() > 0.0 {
            return Err(self.fault(starts[2], "the laser is 0 or 1"));
        }
        for (start, time_us) in [(starts[3], on_us), (starts[4], off_us)] {
            if !(0.0..=self.step_us).contains(&time_us.unwrap_or(0.0)) {
                let reason = format!("a time from 0 to the step of {} µs is due", self.step_us);
                return Err(self.fault(start, &reason));
            }
        }
        let fits = match (lit, on_us, off_us) {
            (_, None, None) | (false, Some(_), None) | (true, None, Some(_)) => true,
            (false, Some(on), Some(off)) => on <= off,
            (true, Some(on), Some(off)) => off <= on,
            (false, None, Some(_)) | (true, Some(_), None) => false,
        };
        if !fits {
            let reason =
                if lit { "lit: off is due before on" } else { "dark: on is due before off" };
            return Err(self.fault(starts[3], &format!("the row begins {reason}")));
        }
        match self.row.take() {
            None => self.ahead.push_back(HeadCommand::Rest { at_um }),
            Some(before) => self.step(before, at_um),
        }
        let mut row = Row { at_um, on_us, off_us, purpose: self.purpose, pulses: self.pulses };
        // A row whose laser is not as the last step left it switches it at its beginning.
        if lit != self.lit {
            let switched = if lit { &mut row.on_us } else { &mut row.off_us };
            if switched.replace(0.0).is_some() {
                return Err(self.fault(starts[2], "the laser is not as the row before it left it"));
            }
        }
        self.row = Some(row);
        Ok(())
    }

    /// The step of `row`, which leads to `to`.
    fn step(&mut self, row: Row, to: Point) {
        for lit in [self.lit, !self.lit] {
            match (lit, row.on_us, row.off_us) {
                (false, Some(on_us), _) => self.switch_on(&row, to, on_us),
                (true, _, Some(off_us)) => self.switch_off(&row, to, off_us),
                _ => {}
            }
        }
        let purpose = row.purpose.unwrap_or(if row.at_um == to {
            Purpose::Delay
        } else if self.lit {
            Purpose::Mark
        } else {
            Purpose::Jump
        });
        self.ahead.push_back(HeadCommand::Move { to_um: to, duration_us: self.step_us, purpose });
    }

    fn switch_on(&mut self, row: &Row, to: Point, after_us: f64) {
        self.lit = true;
        let (stroke, pulse_rate_hz) = row.pulses.unwrap_or((self.unnamed, self.pulse_rate_hz));
        if row.pulses.is_none() {
            let begin = self.unnamed_end(row, to, after_us);
            self.ahead.push_back(HeadCommand::StrokeBegins(begin));
        }
        self.ahead.push_back(HeadCommand::LaserOn { after_us, pulse_rate_hz, stroke });
    }

    fn switch_off(&mut self, row: &Row, to: Point, after_us: f64) {
        self.lit = false;
        self.ahead.push_back(HeadCommand::LaserOff { after_us });
        if row.pulses.is_none() {
            let end = self.unnamed_end(row, to, after_us);
            self.ahead.push_back(HeadCommand::StrokeEnds(end));
            self.unnamed += 1;
        }
    }

    /// Where the command is `after_us` after the beginning of a step, as the end of a stroke.
    fn unnamed_end(&self, row: &Row, to: Point, after_us: f64) -> StrokeEnd {
        let way = to - row.at_um;
        StrokeEnd {
            stroke: self.unnamed,
            at_um: row.at_um + way * (after_us / self.step_us),
            direction: if way.length() > 0.0 { way.normalized() } else { Point::new(1.0, 0.0) },
            speed_m_s: way.length() / self.step_us,
            beam_um: 0.0,
        }
    }

    fn note(&mut self, note: &str) -> Result<(), GalvoError> {
        let kind = note.split_whitespace().next().unwrap_or("");
        if let Some((purpose, _)) = PURPOSES.iter().find(|(_, name)| *name == kind) {
            let [] = self.values(note, [])?;
            self.purpose = Some(*purpose);
            return Ok(());
        }
        let command = match kind {
            "step" => {
                let [step_us] = self.values(note, ["step_us"])?;
                if self.row.is_some() {
                    return Err(self.fault(1, "the step is due before the first row"));
                }
                check_step(step_us).map_err(|error| self.fault(1, &error.to_string()))?;
                self.step_us = step_us;
                return Ok(());
            }
            "pulses" => {
                let [stroke, rate_hz] = self.values(note, ["stroke", "pulse_rate_hz"])?;
                check_pulse_rate(rate_hz).map_err(|error| self.fault(1, &error.to_string()))?;
                self.pulses = Some((self.number(stroke)?, rate_hz));
                return Ok(());
            }
            "begin" | "end" => {
                let keys = ["stroke", "x_um", "y_um", "angle_deg", "speed_m_s", "beam_um"];
                let [stroke, x, y, angle_deg, speed_m_s, beam_um] = self.values(note, keys)?;
                check_speed("speed_m_s", speed_m_s)
                    .map_err(|error| self.fault(1, &error.to_string()))?;
                let (sin, cos) = angle_deg.to_radians().sin_cos();
                let (stroke, at_um) = (self.number(stroke)?, Point::new(x, y));
                let end = StrokeEnd {
                    stroke,
                    at_um,
                    direction: Point::new(cos, sin),
                    speed_m_s,
                    beam_um,
                };
                if kind == "begin" {
                    HeadCommand::StrokeBegins(end)
                } else {
                    HeadCommand::StrokeEnds(end)
                }
            }
            "corner" => {
                let keys = ["stroke", "x_um", "y_um", "reach_um"];
                let [stroke, x, y, reach_um] = self.values(note, keys)?;
                HeadCommand::Corner {
                    stroke: self.number(stroke)?,
                    at_um: Point::new(x, y),
                    reach_um,
                }
            }
            "layer" => {
                let [z_um] = self.values(note, ["z_um"])?;
                HeadCommand::Layer { z_um }
            }
            _ => {
                let shown: String = kind.chars().take(24).collect();
                let column = NOTE_PREFIX.len() + 1;
                return Err(self.fault(column, &format!("the note {shown:?} is not known")));
            }
        };
        self.ahead.push_back(command);
        Ok(())
    }

    /// The values behind `keys`, all of which a note has, in this order.
    fn values<const N: usize>(&self, note: &str, keys: [&str; N]) -> Result<[f64; N], GalvoError> {
        let mut values = [0.0; N];
        let mut rest = note.split_once(char::is_whitespace).map_or("", |(_, rest)| rest);
        let column = |rest: &str| {
            let before = &note[..note.len() - rest.len()];
            NOTE_PREFIX.len() + before.chars().count() + 1
        };
        for (key, slot) in keys.iter().zip(&mut values) {
            rest = rest.trim_start();
            let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
            let value = rest[..end].split_once('=').filter(|(found, _)| found == key);
            let value = value.and_then(|(_, value)| value.parse::<f64>().ok());
            let Some(value) = value.filter(|value| value.abs() <= 1e15) else {
                return Err(self.fault(column(rest), &format!("{key}=<number> is due here")));
            };
            *slot = value;
            rest = &rest[end..];
        }
        if !rest.trim().is_empty() {
            return Err(self.fault(column(rest.trim_start()), "the end of the note is due here"));
        }
        Ok(values)
    }

    fn number(&self, stroke: f64) -> Result<u64, GalvoError> {
        if stroke >= 0.0 && stroke.fract() == 0.0 {
            return Ok(stroke as u64);
        }
        Err(self.fault(1, "strokes count from 0"))
    }
}
