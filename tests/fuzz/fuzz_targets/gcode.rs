//! Any text as a program gives pulses or an error, and pulses survive being written and read again.
#![no_main]

use lasergym_toolpath::{GcodeOptions, read_gcode, write_gcode};

libfuzzer_sys::fuzz_target!(|text: &str| {
    let options = GcodeOptions::default();
    let Ok(path) = read_gcode(text, &options.frame, 9.0) else { return };
    let written = write_gcode(&path, &options).expect("default options are valid");
    let read = read_gcode(&written, &options.frame, 9.0).expect("our own program");
    assert_eq!(path.len(), read.len());
    for (a, b) in path.positions_px().iter().zip(read.positions_px()) {
        assert!(a.distance(*b) < 1e-8);
    }
});
