//! Process profiles: a process with the limits of its machine, as TOML.

use serde::Deserialize;

use crate::error::check_option;
use crate::{
    FeedSpeedLaw, Footprint, FootprintTable, MillingError, Process, RemovalLaw, SlopeLaw, SlopeSign,
};

/// Longest profile that is read, bytes.
const MAX_PROFILE_BYTES: usize = 16 << 20;

/// Name and text of each shipped profile.
const SHIPPED: [(&str, &str); 2] = [
    ("laser-graphite", include_str!("../profiles/laser-graphite.toml")),
    ("waterjet-garnet", include_str!("../profiles/waterjet-garnet.toml")),
];

/// A process and the machine that runs it.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// What it is called.
    pub name: String,
    /// What the beam does.
    pub process: Process,
    /// Lowest speed of the beam, mm/s, above 0.
    pub slowest_mm_s: f64,
    /// Highest speed of the beam, mm/s, at least the lowest.
    pub fastest_mm_s: f64,
    /// Distance between passes, µm, above 0 and at most the radius that the footprint reaches.
    pub pitch_um: f64,
    /// Whether the beam can be switched off within a pass.
    pub can_switch_off: bool,
}

impl Profile {
    /// The shipped profile of that name: `laser-graphite` or `waterjet-garnet`.
    ///
    /// # Errors
    /// [`MillingError::UnknownProfile`] lists the names there are.
    pub fn shipped(name: &str) -> Result<Self, MillingError> {
        match SHIPPED.iter().find(|(known, _)| *known == name) {
            Some((_, text)) => Self::from_toml(text),
            None => Err(MillingError::UnknownProfile {
                name: name.to_owned(),
                accepted: SHIPPED.map(|(known, _)| known).join(", "),
            }),
        }
    }

    /// Names of the shipped profiles.
    #[must_use]
    pub fn shipped_names() -> [&'static str; 2] {
        SHIPPED.map(|(name, _)| name)
    }

    /// Name and TOML text of each shipped profile.
    #[must_use]
    pub fn shipped_texts() -> [(&'static str, &'static str); 2] {
        SHIPPED
    }

    /// Reads a profile; unknown keys are errors.
    ///
    /// # Errors
    /// [`MillingError::Profile`] for text that is no profile, and as [`Profile::validate`].
    pub fn from_toml(text: &str) -> Result<Self, MillingError> {
        if text.len() > MAX_PROFILE_BYTES {
            let reason = format!("it has {} bytes, more than {MAX_PROFILE_BYTES}", text.len());
            return Err(MillingError::Profile { reason });
        }
        let file: ProfileFile = toml::from_str(text).map_err(|error| MillingError::Profile {
            reason: error.to_string().trim().to_owned(),
        })?;
        let profile = Self {
            name: file.name,
            process: Process { footprint: file.footprint.build()?, law: file.law.build() },
            slowest_mm_s: file.slowest_mm_s,
            fastest_mm_s: file.fastest_mm_s,
            pitch_um: file.pitch_um,
            can_switch_off: file.can_switch_off,
        };
        profile.validate()?;
        Ok(profile)
    }

    /// Checks speeds, pitch and law.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] names the first value out of range.
    pub fn validate(&self) -> Result<(), MillingError> {
        self.process.law.validate()?;
        let (slowest, fastest) = (self.slowest_mm_s, self.fastest_mm_s);
        let ok = slowest > 0.0 && slowest <= 1e6;
        check_option("slowest_mm_s", slowest, ok, "above 0 and at most 1e6 mm/s")?;
        let ok = fastest >= slowest && fastest <= 1e6;
        check_option("fastest_mm_s", fastest, ok, "at least slowest_mm_s and at most 1e6 mm/s")?;
        let ok = self.pitch_um > 0.0 && self.pitch_um <= self.process.footprint.reach_um();
        check_option("pitch_um", self.pitch_um, ok, "above 0 and at most the footprint's radius")
    }

    /// Dwell at the highest and at the lowest speed, s/mm.
    #[must_use]
    pub fn dwell_range_s_mm(&self) -> (f64, f64) {
        (1.0 / self.fastest_mm_s, 1.0 / self.slowest_mm_s)
    }

    /// Depth that one layer of passes removes from flat ground at the given dwell, µm, where every
    /// pass removes as much as the first: α Q D^(1−β)/pitch.
    #[must_use]
    pub fn layer_depth_um(&self, dwell_s_mm: f64) -> f64 {
        self.process.law.dose_s_mm(dwell_s_mm) * 1e-3 * self.process.footprint.volume_rate_um3_s()
            / self.pitch_um
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ProfileFile {
    name: String,
    slowest_mm_s: f64,
    fastest_mm_s: f64,
    pitch_um: f64,
    can_switch_off: bool,
    footprint: FootprintFile,
    law: LawFile,
}

#[derive(Deserialize)]
#[serde(tag = "shape", rename_all = "kebab-case", deny_unknown_fields)]
enum FootprintFile {
    Gaussian { peak_um_s: f64, radius_um: f64 },
    Compact { peak_um_s: f64, radius_um: f64 },
    Table { spacing_um: f64, rates_um_s: Vec<f64> },
}

impl FootprintFile {
    fn build(self) -> Result<Footprint, MillingError> {
        match self {
            Self::Gaussian { peak_um_s, radius_um } => Footprint::gaussian(peak_um_s, radius_um),
            Self::Compact { peak_um_s, radius_um } => Footprint::compact(peak_um_s, radius_um),
            Self::Table { spacing_um, rates_um_s } => {
                Ok(Footprint::Table(FootprintTable::new(spacing_um, &rates_um_s)?))
            }
        }
    }
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum LawFile {
    Linear,
    Slope { first_per_rad: f64, second_per_rad2: f64, sign: SignFile, smoothing: f64 },
    FeedSpeed { factor: f64, exponent: f64, reference_mm_s: f64 },
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum SignFile {
    Minus,
    Plus,
}

impl LawFile {
    fn build(self) -> RemovalLaw {
        match self {
            Self::Linear => RemovalLaw::Linear,
            Self::Slope { first_per_rad, second_per_rad2, sign, smoothing } => {
                let sign = match sign {
                    SignFile::Minus => SlopeSign::Minus,
                    SignFile::Plus => SlopeSign::Plus,
                };
                RemovalLaw::Slope(SlopeLaw { first_per_rad, second_per_rad2, sign, smoothing })
            }
            Self::FeedSpeed { factor, exponent, reference_mm_s } => {
                RemovalLaw::FeedSpeed(FeedSpeedLaw { factor, exponent, reference_mm_s })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_profiles_are_valid_and_named() {
        for name in Profile::shipped_names() {
            assert_eq!(Profile::shipped(name).unwrap().name, name);
        }
        let error = Profile::shipped("laser").unwrap_err().to_string();
        assert!(error.contains("laser-graphite, waterjet-garnet"), "{error}");
    }

    #[test]
    fn a_layer_of_the_laser_spans_the_speeds() {
        let profile = Profile::shipped("laser-graphite").unwrap();
        let (least, most) = profile.dwell_range_s_mm();
        let ratio = profile.layer_depth_um(most) / profile.layer_depth_um(least);
        assert!((ratio - 4.0_f64.powf(0.7)).abs() < 1e-9);
    }

    #[test]
    fn bad_profiles_are_refused() {
        let text = SHIPPED[0].1;
        let fault = |from: &str, to: &str| {
            let changed = text.replace(from, to);
            assert_ne!(changed, text);
            Profile::from_toml(&changed).unwrap_err()
        };
        for (from, to) in [
            ("pitch_um", "pitch_mm"),
            ("\"gaussian\"", "\"square\""),
            ("exponent = 0.3\n", ""),
            ("800.0", "fast"),
            ("name", "nom"),
        ] {
            assert!(matches!(fault(from, to), MillingError::Profile { .. }), "{from}");
        }
        for (from, to, expected) in [
            ("slowest_mm_s = 200.0", "slowest_mm_s = 0.0", "slowest_mm_s"),
            ("fastest_mm_s = 800.0", "fastest_mm_s = 100.0", "fastest_mm_s"),
            ("pitch_um = 15.0", "pitch_um = 150.0", "pitch_um"),
            ("peak_um_s = 75000.0", "peak_um_s = -1.0", "peak_um_s"),
            ("exponent = 0.3", "exponent = 3.0", "exponent"),
        ] {
            match fault(from, to) {
                MillingError::InvalidOption { name, .. } => assert_eq!(name, expected),
                other => panic!("{from}: {other}"),
            }
        }
    }
}
