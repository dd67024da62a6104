//! Time and memory of a million vectors through the postprocessor, from file to file, and of a million
//! pulses through a head.
//!
//! `cargo run --release -p lasergym-galvo --example throughput`

use std::error::Error;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::time::Instant;

use lasergym_galvo::{
    HeadKnowledge, JobReader, PostOptions, ProgramFormat, ProgramReader, ProgramWriter, ScanHead,
    postprocess, simulate,
};

/// A hatch of lines of 1 mm, back and forth, as a cutter-location file.
fn write_hatch(name: &std::path::Path, vectors: u32) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(name)?);
    writeln!(file, "UNITS/MM\nFEDRAT/120000,MMPM")?;
    for k in 0..vectors {
        let y = f64::from(k % 10_000) * 1e-3;
        let side = if k % 2 == 0 { 0.5 } else { -0.5 };
        writeln!(file, "RAPID\nGOTO/{:.4},{y:.4},0\nGOTO/{side:.4},{y:.4},0", -side)?;
    }
    file.flush()
}

/// Processor time of this process so far, s, and the most memory it has held, MB; where the system
/// tells.
fn used() -> (f64, f64) {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    // utime and stime, in hundredths of a second.
    let ticks = |k: usize| fields.get(k).and_then(|field| field.parse::<f64>().ok());
    let cpu_s = ticks(11).zip(ticks(12)).map_or(f64::NAN, |(user, system)| (user + system) / 100.0);
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let peak_kb = peak.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    (cpu_s, peak_kb.map_or(f64::NAN, |kb| kb / 1e3))
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::temp_dir();
    let (job, program) = (folder.join("lasergym_hatch.apt"), folder.join("lasergym_hatch.nc"));
    let head = ScanHead::default();
    let knowledge = HeadKnowledge::of_head(&head);
    for (vectors, pitch_um, dialect) in
        [(1_000_000, None, "grbl"), (5_000, None, "rtc-micro-vectors"), (4_150, Some(4.0), "grbl")]
    {
        let format = ProgramFormat::of_name(dialect)?;
        write_hatch(&job, vectors)?;
        let options = PostOptions { pitch_um, ..PostOptions::default() };
        let (before, _) = used();
        let started = Instant::now();
        let mut reader = JobReader::of_name("hatch.apt", BufReader::new(File::open(&job)?))?;
        let writer = ProgramWriter::begin(File::create(&program)?, format, 255.0, &head)?;
        postprocess(&head, &knowledge, &options, &mut reader, writer)?.0.finish()?;
        let (after, peak_mb) = used();
        println!(
            "{vectors} vectors as {dialect}, {:.1} MB: {:.2} s of processor, {:.2} s in all, at most {peak_mb:.1} MB",
            std::fs::metadata(&program)?.len() as f64 / 1e6,
            after - before,
            started.elapsed().as_secs_f64()
        );
    }
    let (before, _) = used();
    let started = Instant::now();
    let reader = ProgramReader::gcode(BufReader::new(File::open(&program)?), &head);
    let (report, _) = simulate(&head, reader, None, |_| {})?;
    let (after, peak_mb) = used();
    println!(
        "{} pulses simulated: {:.2} s of processor, {:.2} s in all, at most {peak_mb:.1} MB",
        report.pulses,
        after - before,
        started.elapsed().as_secs_f64()
    );
    std::fs::remove_file(&job)?;
    std::fs::remove_file(&program)?;
    Ok(())
}
