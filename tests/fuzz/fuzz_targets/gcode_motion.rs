//! Any bytes as G-code moves, or as a list of RTC commands, give steps or an error.
#![no_main]

use lasergym_galvo::{ProgramReader, ScanHead};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let head = ScanHead::default();
    let mut program = ProgramReader::gcode(bytes, &head);
    while let Ok(Some(_)) = program.next_step() {}
    let mut list = ProgramReader::rtc_list(bytes, &head);
    while let Ok(Some(_)) = list.next_step() {}
});
