//! Any bytes as a PNG or JPEG image give a target or an error.
#![no_main]

use lasergym_geom::{DrawingFormat, DrawingOptions, drawing_from_bytes};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let format = DrawingFormat::from_magic(bytes).unwrap_or(DrawingFormat::Png);
    if matches!(format, DrawingFormat::Png | DrawingFormat::Jpeg) {
        let _ = drawing_from_bytes(bytes, format, &DrawingOptions::default());
    }
});
