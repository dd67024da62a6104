//! Settings of the process.

use crate::AblationError;
use crate::footprint::MAX_PULSE_RADIUS_PX;

/// Radius of the mark that one pulse of the paper's laser leaves (diameter 18 µm), px.
pub const DEFAULT_PULSE_RADIUS_PX: f64 = 9.0;

/// Settings of the pulse-ablation process; the defaults are those of the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Radius of the disc that one pulse machines, px, in (0, 50]. Smaller pulses follow outlines
    /// more closely and need more of them.
    pub pulse_radius_px: f64,
    /// Pulses after which the episode terminates, at least 1. The paper's best plan for the star
    /// uses 45.
    pub max_pulses: u32,
    /// Machined fraction of the target at which the episode terminates, in (0, 1].
    pub completion: f64,
    /// Standard deviation of the displacement of each pulse along x and along y, px, at least 0.
    pub pointing_error_px: f64,
    /// Relative standard deviation of the pulse radius, in [0, 0.5]. The radius never leaves
    /// (0, [`MAX_PULSE_RADIUS_PX`]].
    pub radius_error: f64,
    /// Whether a pulse that machines no target pixel terminates the episode.
    pub stop_on_miss: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            pulse_radius_px: DEFAULT_PULSE_RADIUS_PX,
            max_pulses: 45,
            completion: 0.99,
            pointing_error_px: 0.0,
            radius_error: 0.0,
            stop_on_miss: false,
        }
    }
}

impl Options {
    /// Checks every setting against its range.
    ///
    /// # Errors
    /// [`AblationError::InvalidOption`] names the first setting outside its range.
    pub fn validate(&self) -> Result<(), AblationError> {
        let check = |ok: bool, name, value: String, expected| {
            if ok { Ok(()) } else { Err(AblationError::InvalidOption { name, value, expected }) }
        };
        check(
            self.pulse_radius_px > 0.0 && self.pulse_radius_px <= MAX_PULSE_RADIUS_PX,
            "pulse_radius_px",
            self.pulse_radius_px.to_string(),
            "in (0, 50]",
        )?;
        check(self.max_pulses >= 1, "max_pulses", self.max_pulses.to_string(), "at least 1")?;
        check(
            self.completion > 0.0 && self.completion <= 1.0,
            "completion",
            self.completion.to_string(),
            "in (0, 1]",
        )?;
        check(
            self.pointing_error_px >= 0.0 && self.pointing_error_px <= 100.0,
            "pointing_error_px",
            self.pointing_error_px.to_string(),
            "in [0, 100]",
        )?;
        check(
            (0.0..=0.5).contains(&self.radius_error),
            "radius_error",
            self.radius_error.to_string(),
            "in [0, 0.5]",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rejected(change: impl FnOnce(&mut Options)) -> &'static str {
        let mut options = Options::default();
        change(&mut options);
        match options.validate() {
            Err(AblationError::InvalidOption { name, .. }) => name,
            other => panic!("{options:?} gave {other:?}"),
        }
    }

    #[test]
    fn every_setting_outside_its_range_is_named() {
        assert_eq!(rejected(|o| o.pulse_radius_px = 0.0), "pulse_radius_px");
        assert_eq!(rejected(|o| o.pulse_radius_px = f64::NAN), "pulse_radius_px");
        assert_eq!(rejected(|o| o.pulse_radius_px = 50.5), "pulse_radius_px");
        assert_eq!(rejected(|o| o.max_pulses = 0), "max_pulses");
        assert_eq!(rejected(|o| o.completion = 0.0), "completion");
        assert_eq!(rejected(|o| o.completion = 1.5), "completion");
        assert_eq!(rejected(|o| o.pointing_error_px = -1.0), "pointing_error_px");
        assert_eq!(rejected(|o| o.pointing_error_px = f64::INFINITY), "pointing_error_px");
        assert_eq!(rejected(|o| o.radius_error = f64::NAN), "radius_error");
        assert!(Options::default().validate().is_ok());
    }
}
