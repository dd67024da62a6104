//! Any bytes as a cutter-location file give vectors or an error, and vectors a program that is read
//! again; as a table they give vectors or an error.
#![no_main]

use lasergym_galvo::{
    HeadKnowledge, JobReader, PostOptions, ProgramFormat, ProgramReader, ProgramWriter, ScanHead,
    postprocess,
};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let head = ScanHead::default();
    let knowledge = HeadKnowledge::of_head(&head);
    let mut table = JobReader::of_name("job.csv", bytes).expect("a known ending");
    while let Ok(Some(_)) = table.next_step() {}
    let mut reader = JobReader::of_name("job.apt", bytes).expect("a known ending");
    let format = ProgramFormat::of_name("grbl").expect("a known name");
    let writer = ProgramWriter::begin(Vec::new(), format, 255.0, &head).expect("memory");
    let Ok((writer, _)) =
        postprocess(&head, &knowledge, &PostOptions::default(), &mut reader, writer)
    else {
        return;
    };
    let text = writer.finish().expect("memory");
    let mut program = ProgramReader::gcode(&text[..], &head);
    while program.next_step().expect("our own program").is_some() {}
});
