//! Settings of a program as a note: `key=value` pairs, only those that change.

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

/// What is wrong with a note.
#[derive(Debug)]
pub(crate) struct NoteFault {
    /// Characters of the note before the place.
    pub(crate) offset: usize,
    /// What is wrong there.
    pub(crate) reason: String,
}

/// Applies a note to settings.
pub(crate) fn apply_note(note: &str, settings: &mut ProgramSettings) -> Result<(), NoteFault> {
    let mut rest = note.trim_start();
    while !rest.is_empty() {
        let (pair, after) = rest.split_at(rest.find(char::is_whitespace).unwrap_or(rest.len()));
        let fault = |reason: &str| NoteFault {
            offset: note[..note.len() - rest.len()].chars().count(),
            reason: format!("{:?} {reason}", pair.chars().take(40).collect::<String>()),
        };
        let (key, value) = pair.split_once('=').ok_or_else(|| fault("is no key=value"))?;
        let slot = SLOTS.iter().find(|(name, _)| *name == key);
        let (_, slot) = slot.ok_or_else(|| fault("has a key that is not known"))?;
        *slot(settings) = value.parse().map_err(|_| fault("has no number"))?;
        settings.validate().map_err(|error| fault(&format!("is out of range: {error}")))?;
        rest = after.trim_start();
    }
    Ok(())
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
        for (note, offset, word) in [
            ("x", 0, "key=value"),
            (" x=1", 1, "known"),
            ("mark_us=2 mark_us=a", 10, "number"),
            ("mark_us=-1", 0, "mark_us is -1"),
        ] {
            let fault = apply_note(note, &mut settings).unwrap_err();
            assert!(fault.offset == offset && fault.reason.contains(word), "{fault:?}");
        }
    }
}
