//! Any text as a process profile gives a profile that is valid, or an error.
#![no_main]

use lasergym_milling::Profile;

libfuzzer_sys::fuzz_target!(|text: &str| {
    let Ok(profile) = Profile::from_toml(text) else { return };
    assert_eq!(profile.validate(), Ok(()));
    let (least, most) = profile.dwell_range_s_mm();
    assert!(least <= most && profile.layer_depth_um(most) >= 0.0);
});
