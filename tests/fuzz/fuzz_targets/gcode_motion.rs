//! Any bytes as G-code moves, as a list of RTC commands or as one of micro-vectors give steps or an
//! error.
#![no_main]

use lasergym_galvo::{MicroVectorReader, ProgramReader, ScanHead};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let head = ScanHead::default();
    let mut program = ProgramReader::gcode(bytes, &head);
    while let Ok(Some(_)) = program.next_step() {}
    let mut list = ProgramReader::rtc_list(bytes, &head);
    while let Ok(Some(_)) = list.next_step() {}
    let mut list = MicroVectorReader::new(bytes, &head);
    while let Ok(Some(_)) = list.next_command() {}
});
