//! Any text as a program of robot or scanner gives a program that is written as it was read, or an
//! error.
#![no_main]

use lasergym_remote::{RobotProgram, ScannerProgram};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(program) = RobotProgram::from_csv(text) {
        let written = program.to_csv();
        let again = RobotProgram::from_csv(&written);
        assert_eq!(again.map(|program| program.moves.len()).ok(), Some(program.moves.len()));
    }
    if let Ok(program) = ScannerProgram::from_csv(text) {
        let written = program.to_csv();
        let again = ScannerProgram::from_csv(&written);
        assert_eq!(again.map(|program| program.lists.len()).ok(), Some(program.lists.len()));
    }
});
