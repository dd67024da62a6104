//! Whole programs through a head, and whole jobs through the postprocessor.

use std::io::{BufRead, Write};

use crate::any_program::AnyProgram;
use crate::compensation::HeadKnowledge;
use crate::controller::ProgramRun;
use crate::energy_map::EnergyMap;
use crate::judge::{Judge, Report, StrokeMeasure};
use crate::postprocessor::{PostOptions, Postprocessor};
use crate::program::ProgramStep;
use crate::program_file::{JobReader, ProgramFormat, ProgramWriter};
use crate::watched_head::Observer;
use crate::{GalvoError, ScanHead};

/// Runs `program` on `head` and judges it; each stroke is handed to `on_stroke`.
///
/// # Errors
/// What the reader and the controller report.
pub fn simulate<R: BufRead>(
    head: &ScanHead,
    program: impl Into<AnyProgram<R>>,
    map: Option<EnergyMap>,
    on_stroke: impl FnMut(&StrokeMeasure),
) -> Result<(Report, Option<EnergyMap>), GalvoError> {
    let judge = Judge::new(head.laser.spot_um, map, on_stroke);
    let (judge, time, pulses) = program.into().play(head, judge)?;
    Ok(judge.report(time, pulses))
}

/// Runs steps on `head` and judges them.
///
/// # Errors
/// As [`simulate`].
pub fn simulate_steps(
    head: &ScanHead,
    steps: &[ProgramStep],
    on_stroke: impl FnMut(&StrokeMeasure),
) -> Result<Report, GalvoError> {
    let mut run = ProgramRun::new(head, Judge::new(head.laser.spot_um, None, on_stroke));
    for step in steps {
        run.step(step)?;
    }
    let (judge, time, pulses) = run.finish()?;
    Ok(judge.report(time, pulses).0)
}

/// Turns the job in `reader` into a program; returns the writer and the number of vectors.
///
/// # Errors
/// What the reader, the postprocessor and the writer report.
pub fn postprocess<'a, R: BufRead, W: Write>(
    head: &ScanHead,
    knowledge: &HeadKnowledge,
    options: &PostOptions,
    reader: &mut JobReader<R>,
    mut writer: ProgramWriter<'a, W>,
) -> Result<(ProgramWriter<'a, W>, u64), GalvoError> {
    let mut post =
        Postprocessor::new(head, knowledge, *options, |step: &ProgramStep| writer.step(step))?;
    while let Some(step) = reader.next_step()? {
        post.step(&step)?;
    }
    post.finish()?;
    let vectors = post.vectors();
    Ok((writer, vectors))
}

/// As [`postprocess`], from and to texts in memory.
///
/// # Errors
/// As [`postprocess`].
pub fn postprocess_text(
    head: &ScanHead,
    knowledge: &HeadKnowledge,
    options: &PostOptions,
    job: (&str, &str),
    format: ProgramFormat,
    power: f64,
) -> Result<(String, u64), GalvoError> {
    let mut reader = JobReader::of_name(job.0, job.1.as_bytes())?;
    let writer = ProgramWriter::begin(Vec::new(), format, power, head)?;
    let (writer, vectors) = postprocess(head, knowledge, options, &mut reader, writer)?;
    // Programs are ASCII.
    Ok((String::from_utf8_lossy(&writer.finish()?).into_owned(), vectors))
}

/// Watches nothing: for runs of which only the time counts.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {}
