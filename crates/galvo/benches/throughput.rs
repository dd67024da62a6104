//! A million vectors through the postprocessor, and a million pulses through a head.

use std::fmt::Write as _;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lasergym_galvo::{
    GalvoError, HeadKnowledge, JobReader, PostOptions, ProgramFormat, ProgramReader, ProgramWriter,
    ScanHead, postprocess, simulate,
};

const VECTORS: u32 = 1_000_000;
const PULSES: u32 = 1_000_000;

/// Hatch lines of 1 mm, back and forth, as a cutter-location file.
fn hatch(vectors: u32) -> String {
    let mut text = String::from("UNITS/MM\nFEDRAT/120000,MMPM\n");
    for k in 0..vectors {
        let y = f64::from(k % 10_000) * 1e-3;
        let side = if k % 2 == 0 { 1.0 } else { -1.0 };
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "RAPID\nGOTO/{:.4},{y:.4},0\nGOTO/{:.4},{y:.4},0",
            -0.5 * side,
            0.5 * side
        );
    }
    text
}

fn program(job: &str, options: &PostOptions) -> Result<Vec<u8>, GalvoError> {
    let head = ScanHead::default();
    let mut reader = JobReader::of_name("job.apt", job.as_bytes())?;
    let format = ProgramFormat::of_name("grbl")?;
    let writer = ProgramWriter::begin(Vec::new(), format, 255.0, &head)?;
    let knowledge = HeadKnowledge::of_head(&head);
    postprocess(&head, &knowledge, options, &mut reader, writer)?.0.finish()
}

fn benches(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("galvo");
    group.sample_size(10);
    let job = hatch(VECTORS);
    group.throughput(Throughput::Elements(u64::from(VECTORS)));
    let options = PostOptions::default();
    group.bench_function("postprocess a million vectors", |bench| {
        bench.iter(|| black_box(program(&job, &options)));
    });
    // 1 mm with pulses every 4 µm: 241 pulses a line.
    let options = PostOptions { pitch_um: Some(4.0), ..PostOptions::default() };
    let Ok(text) = program(&hatch(PULSES / 241), &options) else { return };
    let head = ScanHead::default();
    group.throughput(Throughput::Elements(u64::from(PULSES)));
    group.bench_function("simulate a million pulses", |bench| {
        bench.iter(|| {
            let reader = ProgramReader::gcode(&text[..], &head);
            black_box(simulate(&head, reader, None, |_| {}))
        });
    });
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
