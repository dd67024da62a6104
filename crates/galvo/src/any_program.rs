//! Programs of any kind, told apart by name and first line, to be played.

use std::io::BufRead;

use lasergym_geom::Point;

use crate::controller::ProgramRun;
use crate::head_command::{CommandSink, HeadCommand};
use crate::micro_vector_list::MICRO_VECTOR_HEADER;
use crate::micro_vector_reader::MicroVectorReader;
use crate::player::{Purpose, TimeSplit};
use crate::program::ProgramStep;
use crate::program_file::ProgramReader;
use crate::watched_head::{Observer, WatchedHead};
use crate::{GalvoError, ScanHead};

/// A program that is read as it is played.
#[derive(Debug)]
pub enum AnyProgram<R> {
    /// Vectors for a controller.
    Vectors(ProgramReader<R>),
    /// Micro-vectors for the head itself.
    MicroVectors(Box<MicroVectorReader<R>>),
}

impl<R> From<ProgramReader<R>> for AnyProgram<R> {
    fn from(reader: ProgramReader<R>) -> Self {
        Self::Vectors(reader)
    }
}

impl<R> From<MicroVectorReader<R>> for AnyProgram<R> {
    fn from(reader: MicroVectorReader<R>) -> Self {
        Self::MicroVectors(Box::new(reader))
    }
}

impl<R: BufRead> AnyProgram<R> {
    /// The program in a file for `head`: names that end in .csv are lists of micro-vectors or of RTC
    /// commands, as their first line tells; others are G-code.
    ///
    /// # Errors
    /// [`GalvoError::Program`] when a list cannot be read.
    pub fn of_name(name: &str, mut reader: R, head: &ScanHead) -> Result<Self, GalvoError> {
        if !name.to_ascii_lowercase().ends_with(".csv") {
            return Ok(ProgramReader::gcode(reader, head).into());
        }
        let start = reader.fill_buf().map_err(|error| GalvoError::Program {
            line: 1,
            column: 1,
            reason: error.to_string(),
        })?;
        let start = start.strip_prefix("\u{feff}".as_bytes()).unwrap_or(start);
        // The names of the first column are told apart even where a reader has little at a time.
        let column = MICRO_VECTOR_HEADER.split(',').next().unwrap_or("");
        Ok(if start.starts_with(column.as_bytes()) {
            MicroVectorReader::new(reader, head).into()
        } else {
            ProgramReader::rtc_list(reader, head).into()
        })
    }

    /// Plays the program on `head` while `observer` watches. Returns the observer, where the time went,
    /// and the number of pulses.
    ///
    /// # Errors
    /// What is wrong with the file or cannot be done.
    pub fn play<O: Observer>(
        self,
        head: &ScanHead,
        observer: O,
    ) -> Result<(O, TimeSplit, u64), GalvoError> {
        match self {
            Self::Vectors(mut reader) => {
                let mut run = ProgramRun::new(head, observer);
                while let Some(step) = reader.next_step()? {
                    run.step(&step)?;
                }
                run.finish()
            }
            Self::MicroVectors(mut reader) => {
                let mut watched = WatchedHead::new(head, observer);
                while let Some(command) = reader.next_command()? {
                    watched.take(&command)?;
                }
                Ok(watched.finish())
            }
        }
    }

    /// The next stretch that belongs to a stroke, from one place to another; the laser may be off.
    fn next_stretch(&mut self, at: &mut Point) -> Result<Option<[Point; 2]>, GalvoError> {
        match self {
            Self::Vectors(reader) => {
                while let Some(step) = reader.next_step()? {
                    match step {
                        ProgramStep::Jump { to_um } => *at = to_um,
                        ProgramStep::Mark { to_um, .. } => {
                            return Ok(Some([std::mem::replace(at, to_um), to_um]));
                        }
                        ProgramStep::Settings(_)
                        | ProgramStep::Layer { .. }
                        | ProgramStep::Dwell { .. } => {}
                    }
                }
            }
            Self::MicroVectors(reader) => {
                while let Some(command) = reader.next_command()? {
                    match command {
                        HeadCommand::Rest { at_um } => *at = at_um,
                        HeadCommand::Move { to_um, purpose, .. } => {
                            let from = std::mem::replace(at, to_um);
                            if matches!(purpose, Purpose::Mark | Purpose::RunIn) {
                                return Ok(Some([from, to_um]));
                            }
                        }
                        _ => {}
                    }
                }
            }
        }
        Ok(None)
    }

    /// The box around the strokes, low and high corner, µm; none where there is no stroke.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn marked_box(mut self) -> Result<Option<(Point, Point)>, GalvoError> {
        let mut corners = None;
        let mut at = Point::default();
        while let Some(stretch) = self.next_stretch(&mut at)? {
            for place in stretch {
                let (low, high): (Point, Point) = corners.unwrap_or((place, place));
                corners = Some((
                    Point::new(low.x.min(place.x), low.y.min(place.y)),
                    Point::new(high.x.max(place.x), high.y.max(place.y)),
                ));
            }
        }
        Ok(corners)
    }
}
