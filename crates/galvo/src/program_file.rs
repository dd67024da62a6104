//! Programs and jobs as files: G-code in three dialects, lists of RTC boards, and what jobs come in.

use std::io::{BufRead, Write};

use lasergym_geom::Point;
use lasergym_toolpath::{
    AptReader, GcodeDialect, GcodeMotion, GcodeMotionReader, VectorGcode, VectorStep,
    VectorTableReader, arc_chords,
};

use crate::controller::ProgramRun;
use crate::micro_vector_list::MicroVectorList;
use crate::program::{ProgramSettings, ProgramStep};
use crate::rtc_list::{RtcList, RtcListReader};
use crate::settings_note::{apply_note, settings_note};
use crate::{GalvoError, ScanHead};

/// Chords of G2 and G3 stay within this of their arcs, µm.
const ARC_TOLERANCE_UM: f64 = 0.05;

/// What a program is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProgramFormat {
    /// G-code.
    Gcode(GcodeDialect),
    /// Commands of an RTC board as CSV.
    RtcList,
    /// Micro-vectors of an RTC board as CSV, one every so many µs, a multiple of 10 up to 1000.
    RtcMicroVectors {
        /// The step, µs.
        step_us: u32,
    },
}

impl ProgramFormat {
    /// The format of a name: grbl, linuxcnc, mach4, rtc or rtc-micro-vectors, which has a step of
    /// 10 µs.
    ///
    /// # Errors
    /// [`GalvoError::UnknownName`] lists the names.
    pub fn of_name(name: &str) -> Result<Self, GalvoError> {
        match name {
            "grbl" => Ok(Self::Gcode(GcodeDialect::Grbl)),
            "linuxcnc" => Ok(Self::Gcode(GcodeDialect::LinuxCnc)),
            "mach4" => Ok(Self::Gcode(GcodeDialect::Mach4)),
            "rtc" => Ok(Self::RtcList),
            "rtc-micro-vectors" => Ok(Self::RtcMicroVectors { step_us: 10 }),
            _ => Err(GalvoError::UnknownName {
                name: "dialect",
                value: name.chars().take(40).collect(),
                accepted: "grbl, linuxcnc, mach4, rtc, rtc-micro-vectors",
            }),
        }
    }

    /// The same format; micro-vectors have a step of `step_us`, others know of none.
    #[must_use]
    pub fn with_step_us(self, step_us: u32) -> Self {
        match self {
            Self::RtcMicroVectors { .. } => Self::RtcMicroVectors { step_us },
            Self::Gcode(_) | Self::RtcList => self,
        }
    }
}

/// Writes a program step by step.
#[derive(Debug)]
pub struct ProgramWriter<'a, W: Write> {
    out: Output<'a, W>,
    settings: Option<ProgramSettings>,
}

#[derive(Debug)]
enum Output<'a, W: Write> {
    Gcode(VectorGcode<W>),
    Rtc(RtcList<W>),
    MicroVectors(Box<ProgramRun<'a, MicroVectorList<W>>>),
}

impl<'a, W: Write> ProgramWriter<'a, W> {
    /// Begins a program of `format`; `power` is the S word of lit vectors, from 0 to 255 for Mach4.
    /// Micro-vectors are what the controller of `head` makes of the steps.
    ///
    /// # Errors
    /// [`GalvoError::Write`] when writing fails, [`GalvoError::InvalidOption`] for a step of
    /// micro-vectors out of range.
    pub fn begin(
        out: W,
        format: ProgramFormat,
        power: f64,
        head: &'a ScanHead,
    ) -> Result<Self, GalvoError> {
        let comments = [
            "lasergym: strokes extended by run-in and run-out for the dynamics of a scan head",
            "lasergym: laser on and off count from start and end of the extended stroke",
        ];
        let out = match format {
            ProgramFormat::Gcode(dialect) => {
                Output::Gcode(VectorGcode::begin(out, dialect, power, &comments)?)
            }
            ProgramFormat::RtcList => Output::Rtc(RtcList::begin(out)?),
            ProgramFormat::RtcMicroVectors { step_us } => {
                let list = MicroVectorList::begin(out, f64::from(step_us))?;
                Output::MicroVectors(Box::new(ProgramRun::onto(head, list)))
            }
        };
        Ok(Self { out, settings: None })
    }

    /// Writes a step.
    ///
    /// # Errors
    /// [`GalvoError::Write`] when writing fails; with micro-vectors also what [`ProgramRun::step`]
    /// reports.
    pub fn step(&mut self, step: &ProgramStep) -> Result<(), GalvoError> {
        match (&mut self.out, *step) {
            (Output::Rtc(list), _) => list.step(step)?,
            (Output::MicroVectors(run), _) => run.step(step)?,
            (Output::Gcode(program), ProgramStep::Settings(settings)) => {
                program.note(&settings_note(self.settings.as_ref(), &settings))?;
                self.settings = Some(settings);
            }
            (Output::Gcode(program), ProgramStep::Jump { to_um }) => program.jump(to_um)?,
            (Output::Gcode(program), ProgramStep::Mark { to_um, speed_m_s, lit }) => {
                program.mark(to_um, speed_m_s, lit)?;
            }
            (Output::Gcode(program), ProgramStep::Layer { z_um }) => program.layer(z_um)?,
            (Output::Gcode(program), ProgramStep::Dwell { duration_us }) => {
                program.dwell(duration_us)?;
            }
        }
        Ok(())
    }

    /// Ends the program with the laser off, and hands the writer back.
    ///
    /// # Errors
    /// As [`ProgramWriter::step`].
    pub fn finish(self) -> Result<W, GalvoError> {
        Ok(match self.out {
            Output::Gcode(program) => program.finish()?,
            Output::Rtc(list) => list.finish()?,
            Output::MicroVectors(run) => run.end()?.finish()?,
        })
    }
}

/// Reads a program, ours or foreign G-code, step by step.
#[derive(Debug)]
pub struct ProgramReader<R> {
    input: Input<R>,
    settings: ProgramSettings,
    at_um: Point,
    /// Speed of marks before the first F, m/s.
    speed_m_s: Option<f64>,
    chords: std::vec::IntoIter<ProgramStep>,
    vectors: u64,
}

#[derive(Debug)]
enum Input<R> {
    Gcode(Box<GcodeMotionReader<R>>),
    Rtc(Box<RtcListReader<R>>),
}

impl<R: BufRead> ProgramReader<R> {
    /// A G-code program for `head`, whose settings hold until the program says otherwise.
    pub fn gcode(reader: R, head: &ScanHead) -> Self {
        Self::new(Input::Gcode(Box::new(GcodeMotionReader::new(reader))), head)
    }

    /// A command list for `head`.
    pub fn rtc_list(reader: R, head: &ScanHead) -> Self {
        Self::new(Input::Rtc(Box::new(RtcListReader::new(reader, head))), head)
    }

    fn new(input: Input<R>, head: &ScanHead) -> Self {
        Self {
            input,
            settings: ProgramSettings::of_head(head),
            at_um: Point::default(),
            speed_m_s: None,
            chords: Vec::new().into_iter(),
            vectors: 0,
        }
    }

    /// The next step; none at the end.
    ///
    /// # Errors
    /// [`GalvoError::Toolpath`] and [`GalvoError::Program`] say what is wrong with the file and where.
    pub fn next_step(&mut self) -> Result<Option<ProgramStep>, GalvoError> {
        if let Some(step) = self.chords.next() {
            return Ok(Some(step));
        }
        let reader = match &mut self.input {
            Input::Rtc(reader) => return reader.next_step(),
            Input::Gcode(reader) => reader,
        };
        let Some(motion) = reader.next_motion()? else { return Ok(None) };
        let step = match motion {
            GcodeMotion::Note { text, line, column } => {
                apply_note(&text, &mut self.settings).map_err(|fault| GalvoError::Program {
                    line,
                    column: column + fault.offset,
                    reason: fault.reason,
                })?;
                return Ok(Some(ProgramStep::Settings(self.settings)));
            }
            GcodeMotion::Dwell { duration_us, .. } => ProgramStep::Dwell { duration_us },
            GcodeMotion::Rapid { to_um } => {
                self.at_um = to_um;
                ProgramStep::Jump { to_um }
            }
            GcodeMotion::Line { to_um, speed_m_s, lit } => {
                let speed_m_s = self.speed(speed_m_s)?;
                self.at_um = to_um;
                ProgramStep::Mark { to_um, speed_m_s, lit }
            }
            GcodeMotion::Arc { to_um, center_um, counterclockwise, speed_m_s, lit } => {
                let speed_m_s = self.speed(speed_m_s)?;
                let from = std::mem::replace(&mut self.at_um, to_um);
                let chords = arc_chords(from, to_um, center_um, counterclockwise, ARC_TOLERANCE_UM)
                    .map(|to_um| ProgramStep::Mark { to_um, speed_m_s, lit });
                self.chords = chords.collect::<Vec<_>>().into_iter();
                return Ok(self.chords.next());
            }
        };
        Ok(Some(step))
    }

    fn speed(&mut self, found: Option<f64>) -> Result<f64, GalvoError> {
        self.vectors += 1;
        self.speed_m_s = found.or(self.speed_m_s);
        self.speed_m_s.ok_or(GalvoError::SpeedUnknown { vector: self.vectors })
    }
}

/// Reads a job, vector by vector.
#[derive(Debug)]
pub enum JobReader<R> {
    /// A cutter-location file.
    Apt(Box<AptReader<R>>),
    /// A G-code program whose lit lines and arcs are the vectors, and whose lit dwells are pulses.
    Gcode(Box<GcodeMotionReader<R>>),
    /// A table of passes or pulses.
    Table(Box<VectorTableReader<R>>),
}

impl<R: BufRead> JobReader<R> {
    /// A reader for the ending of a name: .apt, .cl, .cls or .cldata; .nc, .gcode, .ngc or .tap; .csv.
    ///
    /// # Errors
    /// [`GalvoError::UnknownName`] lists the endings.
    pub fn of_name(name: &str, reader: R) -> Result<Self, GalvoError> {
        let ending = name.rsplit('.').next().unwrap_or("").to_ascii_lowercase();
        match ending.as_str() {
            "apt" | "cl" | "cls" | "cldata" => Ok(Self::Apt(Box::new(AptReader::new(reader)))),
            "nc" | "gcode" | "ngc" | "tap" => {
                Ok(Self::Gcode(Box::new(GcodeMotionReader::new(reader))))
            }
            "csv" => Ok(Self::Table(Box::new(VectorTableReader::new(reader)))),
            _ => Err(GalvoError::UnknownName {
                name: "job",
                value: name.chars().rev().take(40).collect::<Vec<_>>().iter().rev().collect(),
                accepted: "files ending in .apt, .cl, .cls, .cldata, .nc, .gcode, .ngc, .tap, .csv",
            }),
        }
    }

    /// The next step; none at the end.
    ///
    /// # Errors
    /// [`GalvoError::Toolpath`] says what is wrong and where.
    pub fn next_step(&mut self) -> Result<Option<VectorStep>, GalvoError> {
        let reader = match self {
            Self::Apt(reader) => return Ok(reader.next_step()?),
            Self::Table(reader) => return Ok(reader.next_step()?),
            Self::Gcode(reader) => reader,
        };
        while let Some(motion) = reader.next_motion()? {
            let step = match motion {
                GcodeMotion::Note { .. } | GcodeMotion::Dwell { lit: false, .. } => continue,
                GcodeMotion::Dwell { at_um, lit: true, .. } => VectorStep::Pulse { at_um },
                GcodeMotion::Rapid { to_um }
                | GcodeMotion::Line { to_um, lit: false, .. }
                | GcodeMotion::Arc { to_um, lit: false, .. } => VectorStep::Jump { to_um },
                GcodeMotion::Line { to_um, speed_m_s, lit: true } => {
                    VectorStep::Mark { to_um, speed_m_s }
                }
                GcodeMotion::Arc { to_um, center_um, counterclockwise, speed_m_s, lit: true } => {
                    VectorStep::Arc { to_um, center_um, counterclockwise, speed_m_s }
                }
            };
            return Ok(Some(step));
        }
        Ok(None)
    }
}
