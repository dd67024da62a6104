//! Any bytes as a height map give heights or an error.
#![no_main]

use lasergym_milling::{HeightFormat, HeightMap};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(map) = HeightMap::read(bytes, HeightFormat::Tiff, 1.0) else { return };
    assert_eq!(map.heights.len(), map.rows * map.columns);
});
