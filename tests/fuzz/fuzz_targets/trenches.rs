//! Any text as trenches gives trenches or an error.
#![no_main]

use lasergym_milling::read_trenches;

libfuzzer_sys::fuzz_target!(|text: &str| {
    let Ok(trenches) = read_trenches(text) else { return };
    assert!(trenches.iter().all(|trench| trench.y_um.len() == trench.depth_um.len()));
});
