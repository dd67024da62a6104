//! Any bytes as an SVG document give a target or an error.
#![no_main]

use lasergym_geom::{DrawingFormat, DrawingOptions, drawing_from_bytes};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = drawing_from_bytes(bytes, DrawingFormat::Svg, &DrawingOptions::default());
});
