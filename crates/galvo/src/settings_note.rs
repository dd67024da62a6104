//! Settings of a program as a note: `key=value` pairs, only those that change.

use crate::GalvoError;
use crate::program::ProgramSettings;

type Slot = (&'static str, fn(&mut ProgramSettings) -> &mut f64);

const SLOTS: [Slot; 13] = [
    ("pulse_rate_hz", |s| &mut s.pulse_rate_hz),
    ("laser_on_us", |s| &mut s.delays.laser_on_us),
    ("laser_off_us", |s| &mut s.delays.laser_off_us),
    ("run_in_um", |s| &mut s.run_in_um),
    ("run_out_um", |s| &mut s.run_out_um),
    ("beam_um", |s| &mut s.beam_um),
    ("jump_speed_m_s", |s| &mut s.jump_speed_m_s),
    ("jump_us", |s| &mut s.delays.jump_us),
    ("jump_short_us", |s| &mut s.delays.jump_short_us),
    ("jump_threshold_um", |s| &mut s.delays.jump_threshold_um),
    ("mark_us", |s| &mut s.delays.mark_us),
    ("polygon_us", |s| &mut s.delays.polygon_us),
    ("lateral_um", |s| &mut s.lateral_um),
];

/// A key that only heads of unequal axes need: 0 goes without saying.
const SILENT: &str = "lateral_um";

/// The note that leads from `old` settings to `new` ones; all keys where there are no old ones.
pub(crate) fn settings_note(old: Option<&ProgramSettings>, new: &ProgramSettings) -> String {
    use std::fmt::Write as _;
    let (mut old, mut new) = (old.copied(), *new);
    let mut note = String::new();
    for (key, slot) in SLOTS {
        let value = *slot(&mut new);
        let same = match old.as_mut() {
            Some(old) => (*slot(old) - value).abs() <= 0.0,
            None => key == SILENT && value.abs() <= 0.0,
        };
        if !same {
            let separator = if note.is_empty() { "" } else { " " };
            // Ten digits: a picometre of a metre. Writing to a String cannot fail.
            let rounded = (value * 1e6).round() / 1e6;
            let _ = write!(note, "{separator}{key}={rounded}");
        }
    }
    note
}

/// Applies a note to settings.
pub(crate) fn apply_note(note: &str, settings: &mut ProgramSettings) -> Result<(), GalvoError> {
    for pair in note.split_whitespace() {
        let shown = || pair.chars().take(40).collect::<String>();
        let fault = |reason: &str| GalvoError::Settings {
            what: "program",
            reason: format!("the note {:?} {reason}", shown()),
        };
        let (key, value) = pair.split_once('=').ok_or_else(|| fault("is no key=value"))?;
        let slot = SLOTS.iter().find(|(name, _)| *name == key);
        let (_, slot) = slot.ok_or_else(|| fault("has a key that is not known"))?;
        let value: f64 = value.parse().map_err(|_| fault("has no number"))?;
        *slot(settings) = value;
    }
    settings.validate()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ScanHead;

    #[test]
    fn a_note_says_what_changes() {
        let old = ProgramSettings::of_head(&ScanHead::default());
        let mut new = old;
        new.delays.laser_on_us = 401.5;
        assert_eq!(settings_note(Some(&old), &new), "laser_on_us=401.5");
        let mut read = old;
        apply_note(&settings_note(None, &new), &mut read).unwrap();
        assert_eq!(read, new);
    }

    #[test]
    fn mistakes_are_named() {
        let mut settings = ProgramSettings::of_head(&ScanHead::default());
        for (note, word) in [
            ("x", "key=value"),
            ("x=1", "known"),
            ("mark_us=a", "number"),
            ("mark_us=-1", "mark_us"),
        ] {
            let message = apply_note(note, &mut settings).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }
}
