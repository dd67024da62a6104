//! Any bytes as a DXF drawing give a target or an error, fitted by scale or exactly.
#![no_main]

use lasergym_geom::{DrawingFormat, DrawingOptions, Fit, drawing_from_bytes};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for fit in [Fit::Scale, Fit::Exact] {
        let options = DrawingOptions { fit, ..DrawingOptions::default() };
        let _ = drawing_from_bytes(bytes, DrawingFormat::Dxf, &options);
    }
});
