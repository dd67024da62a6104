//! Programs as lists of RTC commands in CSV: `command,first,second,third`.
//!
//! | command | first | second | third |
//! |---|---|---|---|
//! | `set_scanner_delays` | jump, 10 µs | mark, 10 µs | polygon, 10 µs |
//! | `set_laser_delays` | on, 0.5 µs | off, 0.5 µs | |
//! | `set_jump_speed`, `set_mark_speed` | m/s | | |
//! | `set_pulse_rate` | Hz | | |
//! | `set_stroke` | run-in, µm | run-out, µm | beam, µm (for simulation only) |
//! | `jump_abs`, `mark_abs`, `dark_abs` | x, µm | y, µm | |
//! | `layer` | z, µm | | |
//! | `long_delay` | 10 µs | | |

use std::io::{BufRead, Write};

use lasergym_geom::Point;
use lasergym_toolpath::{LineSource, MAX_VECTOR_UM};

use crate::program::{ProgramSettings, ProgramStep};
use crate::{GalvoError, ScanHead};

/// First line of a command list.
pub const RTC_LIST_HEADER: &str = "command,first,second,third";

/// Scanner delays count in this, µs.
const SCANNER_STEP_US: f64 = 10.0;

/// Laser delays count in this, µs.
const LASER_STEP_US: f64 = 0.5;

/// Writes a list.
#[derive(Debug)]
pub(crate) struct RtcList<W: Write> {
    out: std::io::BufWriter<W>,
    speed_m_s: f64,
}

impl<W: Write> RtcList<W> {
    pub(crate) fn begin(out: W) -> std::io::Result<Self> {
        let mut out = std::io::BufWriter::with_capacity(1 << 16, out);
        writeln!(out, "{RTC_LIST_HEADER}")?;
        Ok(Self { out, speed_m_s: 0.0 })
    }

    pub(crate) fn step(&mut self, step: &ProgramStep) -> std::io::Result<()> {
        let out = &mut self.out;
        match *step {
            ProgramStep::Settings(settings) => {
                let delays = settings.delays;
                let tens = |us: f64| (us / SCANNER_STEP_US).ceil();
                let halves = |us: f64| (us / LASER_STEP_US).round();
                writeln!(
                    out,
                    "set_scanner_delays,{},{},{}\nset_laser_delays,{},{},",
                    tens(delays.jump_us),
                    tens(delays.mark_us),
                    tens(delays.polygon_us),
                    halves(delays.laser_on_us),
                    halves(delays.laser_off_us),
                )?;
                writeln!(
                    out,
                    "set_jump_speed,{},,\nset_pulse_rate,{},,\nset_stroke,{:.4},{:.4},{:.4}",
                    settings.jump_speed_m_s,
                    settings.pulse_rate_hz,
                    settings.run_in_um,
                    settings.run_out_um,
                    settings.beam_um,
                )
            }
            ProgramStep::Jump { to_um } => {
                writeln!(out, "jump_abs,{:.4},{:.4},", to_um.x, to_um.y)
            }
            ProgramStep::Mark { to_um, speed_m_s, lit } => {
                if (speed_m_s - self.speed_m_s).abs() > 0.0 {
                    self.speed_m_s = speed_m_s;
                    writeln!(out, "set_mark_speed,{speed_m_s},,")?;
                }
                let command = if lit { "mark_abs" } else { "dark_abs" };
                writeln!(out, "{command},{:.4},{:.4},", to_um.x, to_um.y)
            }
            ProgramStep::Layer { z_um } => writeln!(out, "layer,{z_um:.4},,"),
            ProgramStep::Dwell { duration_us } => {
                writeln!(out, "long_delay,{},,", (duration_us / SCANNER_STEP_US).ceil())
            }
        }
    }

    pub(crate) fn finish(self) -> std::io::Result<W> {
        self.out.into_inner().map_err(std::io::IntoInnerError::into_error)
    }
}

/// Reads a list.
#[derive(Debug)]
pub(crate) struct RtcListReader<R> {
    source: LineSource<R>,
    settings: ProgramSettings,
    changed: bool,
    speed_m_s: Option<f64>,
    ahead: Option<ProgramStep>,
}

impl<R: BufRead> RtcListReader<R> {
    pub(crate) fn new(reader: R, head: &ScanHead) -> Self {
        Self {
            source: LineSource::new(reader),
            settings: ProgramSettings::of_head(head),
            changed: false,
            speed_m_s: None,
            ahead: None,
        }
    }

    pub(crate) fn next_step(&mut self) -> Result<Option<ProgramStep>, GalvoError> {
        if let Some(step) = self.ahead.take() {
            return Ok(Some(step));
        }
        loop {
            let Some(content) = self.source.next_line()? else { return Ok(None) };
            let content = content.into_owned();
            let text = content.trim_end();
            if self.source.line() == 1 {
                if text != RTC_LIST_HEADER {
                    return Err(self.fault(1, &format!("the header is not {RTC_LIST_HEADER:?}")));
                }
                continue;
            }
            if text.trim_start().is_empty() || text.starts_with('#') {
                continue;
            }
            let Some(step) = self.command(text)? else { continue };
            if std::mem::take(&mut self.changed) {
                self.settings.validate().map_err(|error| self.fault(1, &error.to_string()))?;
                self.ahead = Some(step);
                return Ok(Some(ProgramStep::Settings(self.settings)));
            }
            return Ok(Some(step));
        }
    }

    fn fault(&self, column: usize, reason: &str) -> GalvoError {
        GalvoError::Program { line: self.source.line(), column, reason: reason.to_owned() }
    }

    fn command(&mut self, text: &str) -> Result<Option<ProgramStep>, GalvoError> {
        let mut fields = text.split(',');
        let name = fields.next().unwrap_or("").trim();
        let column_of_first = text.split(',').next().unwrap_or("").chars().count() + 2;
        let mut column = column_of_first;
        let mut values = [0.0; 3];
        let mut count = 0;
        for field in fields {
            let trimmed = field.trim();
            if !trimmed.is_empty() {
                let value =
                    trimmed.parse::<f64>().ok().filter(|v| v.abs() <= MAX_VECTOR_UM.max(1e8));
                match (value, values.get_mut(count)) {
                    (Some(value), Some(slot)) => *slot = value,
                    _ => return Err(self.fault(column, "a number within ±1e8 is due here")),
                }
                count += 1;
            }
            column += field.chars().count() + 1;
        }
        let needed = match name {
            "set_scanner_delays" | "set_stroke" => 3,
            "set_laser_delays" | "jump_abs" | "mark_abs" | "dark_abs" => 2,
            "set_jump_speed" | "set_mark_speed" | "set_pulse_rate" | "layer" | "long_delay" => 1,
            _ => {
                let shown: String = name.chars().take(24).collect();
                return Err(self.fault(1, &format!("the command {shown:?} is not known")));
            }
        };
        if count != needed {
            return Err(self.fault(1, &format!("{name} takes {needed} numbers, not {count}")));
        }
        let [first, second, third] = values;
        let to_um = Point::new(first, second);
        let settings = &mut self.settings;
        match name {
            "set_scanner_delays" => {
                settings.delays.jump_us = first * SCANNER_STEP_US;
                settings.delays.mark_us = second * SCANNER_STEP_US;
                settings.delays.polygon_us = third * SCANNER_STEP_US;
            }
            "set_laser_delays" => {
                settings.delays.laser_on_us = first * LASER_STEP_US;
                settings.delays.laser_off_us = second * LASER_STEP_US;
            }
            "set_stroke" => {
                (settings.run_in_um, settings.run_out_um, settings.beam_um) =
                    (first, second, third);
            }
            "set_jump_speed" => settings.jump_speed_m_s = first,
            "set_pulse_rate" => settings.pulse_rate_hz = first,
            "set_mark_speed" => {
                crate::program::check_speed("set_mark_speed", first)
                    .map_err(|error| self.fault(column_of_first, &error.to_string()))?;
                self.speed_m_s = Some(first);
                return Ok(None);
            }
            "jump_abs" => return Ok(Some(ProgramStep::Jump { to_um })),
            "layer" => return Ok(Some(ProgramStep::Layer { z_um: first })),
            "long_delay" => {
                return Ok(Some(ProgramStep::Dwell {
                    duration_us: first.max(0.0) * SCANNER_STEP_US,
                }));
            }
            _ => {
                let Some(speed_m_s) = self.speed_m_s else {
                    return Err(self.fault(1, "set_mark_speed is due before the first mark"));
                };
                return Ok(Some(ProgramStep::Mark { to_um, speed_m_s, lit: name == "mark_abs" }));
            }
        }
        self.changed = true;
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<ProgramStep>, GalvoError> {
        let head = ScanHead::default();
        let mut reader = RtcListReader::new(text.as_bytes(), &head);
        let mut steps = Vec::new();
        while let Some(step) = reader.next_step()? {
            steps.push(step);
        }
        Ok(steps)
    }

    #[test]
    fn what_was_written_is_read_again() {
        let mut settings = ProgramSettings::of_head(&ScanHead::default());
        settings.delays.jump_us = 120.0;
        settings.delays.laser_off_us = -12.5;
        settings.run_in_um = 350.0;
        let to_um = Point::new(10.0, -20.5);
        let steps = [
            ProgramStep::Settings(settings),
            ProgramStep::Jump { to_um },
            ProgramStep::Mark { to_um: Point::default(), speed_m_s: 1.5, lit: true },
            ProgramStep::Layer { z_um: -3.0 },
            ProgramStep::Dwell { duration_us: 50.0 },
        ];
        let mut list = RtcList::begin(Vec::new()).unwrap();
        for step in &steps {
            list.step(step).unwrap();
        }
        let text = String::from_utf8(list.finish().unwrap()).unwrap();
        assert_eq!(read(&text).unwrap(), steps);
    }

    #[test]
    fn faults_have_a_place() {
        for (line, column, text) in [
            (1, 1, "x"),
            (2, 1, "command,first,second,third\nmark_abs,1,2,\n"),
            (2, 1, "command,first,second,third\nhop,1,2,\n"),
            (2, 1, "command,first,second,third\njump_abs,1,,\n"),
            (2, 12, "command,first,second,third\njump_abs,1,x,\n"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.starts_with(&format!("line {line}, column {column}: ")), "{message}");
        }
    }
}
