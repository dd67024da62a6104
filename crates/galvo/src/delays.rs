//! What a controller does beside moving: scanner delays, laser delays and sky writing.
//!
//! Names and meaning are those of SCANLAB's RTC boards; EZCAD's names are accepted as aliases.

use serde::{Deserialize, Serialize};

use crate::GalvoError;
use crate::error::check_option;

/// Delays of a controller, µs. An RTC counts scanner delays in 10 µs and laser delays in 0.5 µs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Delays {
    /// Wait after a jump of `jump_threshold_um` or more, in [0, 10⁶]. Default 0.
    #[serde(alias = "delay_jump_long_us", alias = "jump_long_tc_us")]
    pub jump_us: f64,
    /// Wait after a shorter jump, in [0, 10⁶]. Default 0.
    #[serde(alias = "delay_jump_short_us", alias = "jump_short_tc_us")]
    pub jump_short_us: f64,
    /// Jumps below this are short, µm, in [0, 10⁶]. Default 0: none is. EZCAD: 10 000.
    #[serde(alias = "delay_distance_long_um")]
    pub jump_threshold_um: f64,
    /// Wait after the last vector of a stroke, in [0, 10⁶]. Default 0.
    #[serde(alias = "delay_end_us", alias = "end_tc_us")]
    pub mark_us: f64,
    /// Wait between vectors of a stroke, in [0, 10⁶]. Default 0.
    #[serde(alias = "delay_polygon_us", alias = "polygon_tc_us")]
    pub polygon_us: f64,
    /// Whether the polygon delay grows with the corner: × (1 − cos angle)/2. Default false.
    pub variable_polygon: bool,
    /// From the start of a stroke's command to laser on, in [−10⁵, 10⁵]. Default 0.
    #[serde(alias = "delay_laser_on_us", alias = "laser_on_tc_us")]
    pub laser_on_us: f64,
    /// From the end of a stroke's command to laser off, in [−10⁵, 10⁵]. Default 0.
    #[serde(alias = "delay_laser_off_us", alias = "laser_off_tc_us")]
    pub laser_off_us: f64,
}

impl Default for Delays {
    fn default() -> Self {
        Self {
            jump_us: 0.0,
            jump_short_us: 0.0,
            jump_threshold_um: 0.0,
            mark_us: 0.0,
            polygon_us: 0.0,
            variable_polygon: false,
            laser_on_us: 0.0,
            laser_off_us: 0.0,
        }
    }
}

impl Delays {
    /// What EZCAD and balor start with: laser on and off 100 µs, polygon 100 µs, end 300 µs, jumps
    /// 200 µs and below 10 mm 8 µs.
    #[must_use]
    pub fn ezcad() -> Self {
        Self {
            jump_us: 200.0,
            jump_short_us: 8.0,
            jump_threshold_um: 10_000.0,
            mark_us: 300.0,
            polygon_us: 100.0,
            variable_polygon: false,
            laser_on_us: 100.0,
            laser_off_us: 100.0,
        }
    }

    /// Accepts finite values within the ranges of their fields.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        for (name, value) in [
            ("jump_us", self.jump_us),
            ("jump_short_us", self.jump_short_us),
            ("jump_threshold_um", self.jump_threshold_um),
            ("mark_us", self.mark_us),
            ("polygon_us", self.polygon_us),
        ] {
            check_option(name, value, (0.0..=1e6).contains(&value), "in [0, 1e6]")?;
        }
        for (name, value) in
            [("laser_on_us", self.laser_on_us), ("laser_off_us", self.laser_off_us)]
        {
            check_option(name, value, value.abs() <= 1e5, "in [-1e5, 1e5] µs")?;
        }
        Ok(())
    }

    /// Wait after a jump of `length_um`, µs.
    #[must_use]
    pub fn after_jump_us(&self, length_um: f64) -> f64 {
        if length_um < self.jump_threshold_um { self.jump_short_us } else { self.jump_us }
    }

    /// Wait at a corner whose directions have the cosine `cosine`, µs.
    #[must_use]
    pub fn at_corner_us(&self, cosine: f64) -> f64 {
        let part = if self.variable_polygon { 0.5 * (1.0 - cosine) } else { 1.0 };
        self.polygon_us * part
    }
}

/// Which kind of sky writing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub enum SkyWritingMode {
    /// Mode 1: from the start back and forth again (20 × `n_prev` µs), at the end forth and back.
    Retrace,
    /// Mode 2: jumps lead straight to the run-in and from the run-out, at every corner.
    Direct,
    /// Mode 3: as mode 2, but only at corners sharper than the limit; polygon delay at the others.
    SharpCorners,
}

impl TryFrom<u8> for SkyWritingMode {
    type Error = GalvoError;

    fn try_from(mode: u8) -> Result<Self, GalvoError> {
        match mode {
            1 => Ok(Self::Retrace),
            2 => Ok(Self::Direct),
            3 => Ok(Self::SharpCorners),
            _ => Err(GalvoError::InvalidOption {
                name: "mode",
                value: f64::from(mode),
                expected: "1, 2 or 3",
            }),
        }
    }
}

impl From<SkyWritingMode> for u8 {
    fn from(mode: SkyWritingMode) -> Self {
        match mode {
            SkyWritingMode::Retrace => 1,
            SkyWritingMode::Direct => 2,
            SkyWritingMode::SharpCorners => 3,
        }
    }
}

/// Sky writing of an RTC: the controller itself adds run-ins and run-outs at constant speed. Laser
/// delays do not apply.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkyWriting {
    /// Which kind.
    pub mode: SkyWritingMode,
    /// From the start and end of the vector's command to laser on and off, µs, in [0, 10⁵]: the lag of
    /// the head.
    pub timelag_us: f64,
    /// Added to the switching on, µs, in [−10⁵, 10⁵]. Default 0.
    #[serde(default)]
    pub laser_on_shift_us: f64,
    /// Run-in, in 10 µs; mode 1 takes it twice. RTC's own choice: 1.5 × timelag (mode 1: 3 ×).
    pub n_prev: u32,
    /// Run-out, in 10 µs; mode 1 takes it twice. RTC's own choice: 1 × timelag (mode 1: 2 ×).
    pub n_post: u32,
    /// Cosine of the corner below which mode 3 breaks the stroke, in [−1, 1]. Default 0.9.
    #[serde(default = "default_limit")]
    pub limit: f64,
}

fn default_limit() -> f64 {
    0.9
}

impl SkyWriting {
    /// What an RTC chooses for a lag: run-in 1.5 × and run-out 1 × the lag.
    #[must_use]
    pub fn automatic(mode: SkyWritingMode, lag_us: f64) -> Self {
        Self {
            mode,
            timelag_us: lag_us,
            laser_on_shift_us: 0.0,
            n_prev: (0.15 * lag_us).ceil() as u32,
            n_post: (0.1 * lag_us).ceil() as u32,
            limit: default_limit(),
        }
    }

    /// Time of the straight run-in, µs.
    #[must_use]
    pub fn run_in_us(&self) -> f64 {
        10.0 * f64::from(self.n_prev)
    }

    /// Time of the straight run-out, µs.
    #[must_use]
    pub fn run_out_us(&self) -> f64 {
        10.0 * f64::from(self.n_post)
    }

    /// Whether a corner whose directions have the cosine `cosine` breaks a stroke.
    #[must_use]
    pub fn breaks_at(&self, cosine: f64) -> bool {
        self.mode != SkyWritingMode::SharpCorners || cosine < self.limit
    }

    /// Accepts finite values within the ranges of their fields.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        let lag = self.timelag_us;
        check_option("timelag_us", lag, (0.0..=1e5).contains(&lag), "in [0, 1e5] µs")?;
        let shift = self.laser_on_shift_us;
        check_option("laser_on_shift_us", shift, shift.abs() <= 1e5, "in [-1e5, 1e5] µs")?;
        for (name, count) in [("n_prev", self.n_prev), ("n_post", self.n_post)] {
            check_option(name, f64::from(count), count <= 10_000, "at most 10000")?;
        }
        check_option("limit", self.limit, self.limit.abs() <= 1.0, "in [-1, 1]")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ezcad_names_mean_the_same() {
        let text = "laser_on_tc_us = 100\nlaser_off_tc_us = 100\npolygon_tc_us = 100\n\
                    end_tc_us = 300\njump_long_tc_us = 200\njump_short_tc_us = 8\n\
                    delay_distance_long_um = 10000\n";
        assert_eq!(toml::from_str::<Delays>(text).unwrap(), Delays::ezcad());
        assert!(toml::from_str::<Delays>("laser_on_tc = 100").is_err());
    }

    #[test]
    fn short_jumps_wait_less() {
        let delays = Delays::ezcad();
        assert!((delays.after_jump_us(9_999.0) - 8.0).abs() < 1e-12);
        assert!((delays.after_jump_us(10_000.0) - 200.0).abs() < 1e-12);
    }

    #[test]
    fn a_variable_polygon_delay_grows_with_the_corner() {
        let delays = Delays { variable_polygon: true, ..Delays::ezcad() };
        for (cosine, expected) in [(1.0, 0.0), (0.0, 50.0), (-1.0, 100.0)] {
            assert!((delays.at_corner_us(cosine) - expected).abs() < 1e-12);
        }
        assert!((Delays::ezcad().at_corner_us(1.0) - 100.0).abs() < 1e-12);
    }

    #[test]
    fn sky_writing_modes_are_1_to_3() {
        let text = "mode = 3\ntimelag_us = 216\nn_prev = 33\nn_post = 22\n";
        let sky: SkyWriting = toml::from_str(text).unwrap();
        assert_eq!(sky.mode, SkyWritingMode::SharpCorners);
        assert!(sky.breaks_at(0.5) && !sky.breaks_at(0.95));
        assert!(toml::from_str::<SkyWriting>(&text.replace('3', "4")).is_err());
        let automatic = SkyWriting::automatic(SkyWritingMode::Direct, 216.4);
        assert_eq!((automatic.n_prev, automatic.n_post), (33, 22));
        assert!(automatic.breaks_at(0.99));
    }

    #[test]
    fn values_out_of_range_are_named() {
        let delays = Delays { mark_us: -1.0, ..Delays::default() };
        assert!(delays.validate().unwrap_err().to_string().starts_with("mark_us"));
        let delays = Delays { laser_on_us: f64::NAN, ..Delays::default() };
        assert!(delays.validate().unwrap_err().to_string().starts_with("laser_on_us"));
        let good = SkyWriting::automatic(SkyWritingMode::Direct, 200.0);
        for (name, sky) in [
            ("timelag_us", SkyWriting { timelag_us: -1.0, ..good }),
            ("n_post", SkyWriting { n_post: 1_000_000, ..good }),
            ("limit", SkyWriting { limit: 2.0, ..good }),
        ] {
            assert!(sky.validate().unwrap_err().to_string().starts_with(name));
        }
    }
}
