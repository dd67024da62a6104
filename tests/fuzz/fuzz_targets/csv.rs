//! Any text as a pulse table gives pulses or an error, and pulses survive being written and read
//! again bit by bit.
#![no_main]

use lasergym_toolpath::{read_csv, write_csv};

libfuzzer_sys::fuzz_target!(|text: &str| {
    let Ok(path) = read_csv(text, 9.0) else { return };
    assert_eq!(read_csv(&write_csv(&path), 9.0), Ok(path));
});
