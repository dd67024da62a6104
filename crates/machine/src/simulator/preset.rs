//! Ready-made rigs.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{SimulatedError, SimulatorOptions};

/// A ready-made rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// Stage and laser without error, a camera without noise; the ground has its texture.
    Ideal,
    /// A rig like that of Xie et al. 2022, section 2.1: a motorised stage with leadscrews, single
    /// 190 fs pulses on fused silica, and a Thorlabs DCC1645C CMOS camera (3.6 µm pixels, 8 bit)
    /// behind a 20× objective of NA 0.4.
    #[default]
    Lab,
    /// A worn stage on a shaking table, an unsteady laser, a dirty workpiece, and a camera with
    /// wandering focus and a flickering lamp.
    Harsh,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 3] = [Self::Ideal, Self::Lab, Self::Harsh];

    /// The name of the preset.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Lab => "lab",
            Self::Harsh => "harsh",
        }
    }

    /// Its options.
    #[must_use]
    pub fn options(self) -> SimulatorOptions {
        match self {
            Self::Ideal => ideal(),
            Self::Lab => lab(),
            Self::Harsh => harsh(),
        }
    }
}

impl FromStr for Preset {
    type Err = SimulatedError;

    fn from_str(name: &str) -> Result<Self, SimulatedError> {
        Self::ALL.into_iter().find(|preset| preset.name() == name).ok_or_else(|| {
            SimulatedError::UnknownPreset {
                name: name.to_owned(),
                accepted: Self::ALL.map(Self::name).join(", "),
            }
        })
    }
}

fn ideal() -> SimulatorOptions {
    SimulatorOptions {
        backlash_um: 0.0,
        drift_um_per_move: 0.0,
        vibration_um: 0.0,
        impulse_probability: 0.0,
        impulse_um: 0.0,
        settling_error_um: 0.0,
        stage_speed_um_s: 1000.0,
        stage_acceleration_um_s2: 10_000.0,
        settle_s: 0.05,
        stage_margin_um: 25.0,
        pulse_radius_px: 9.0,
        radius_noise_px: 0.0,
        misfire_probability: 0.0,
        double_fire_probability: 0.0,
        pulse_s: 0.01,
        frame_width_px: 640,
        frame_height_px: 480,
        scale_frame_px_per_um: 4.0,
        rotation_deg: 0.0,
        offset_x_frame_px: 0.0,
        offset_y_frame_px: 0.0,
        blur_frame_px: 0.8,
        focus_jitter_frame_px: 0.0,
        read_noise_levels: 0.0,
        electrons_per_level: 0.0,
        fixed_pattern_fraction: 0.0,
        brightness_levels: 180.0,
        vignetting_fraction: 0.0,
        flicker_fraction: 0.0,
        flicker_tilt_fraction: 0.0,
        exposure_s: 0.02,
        readout_s: 0.02,
        texture_contrast: 0.01,
        mark_contrast: 0.4,
        rehit_fraction: 0.1,
        grain_contrast: 0.0,
        dust_specks: 0.0,
        dust_per_frame: 0.0,
        fragments_per_pulse: 0.0,
        fragment_radius_um: 0.5,
        fragment_distance_um: 15.0,
        blown_probability: 0.0,
    }
}

fn lab() -> SimulatorOptions {
    SimulatorOptions {
        // A leadscrew stage on an optical table.
        backlash_um: 0.4,
        drift_um_per_move: 0.01,
        vibration_um: 0.1,
        impulse_probability: 0.005,
        impulse_um: 5.0,
        settling_error_um: 0.05,
        // Near the ablation threshold 1 % of energy is 1 to 2 % of radius.
        radius_noise_px: 0.15,
        misfire_probability: 0.002,
        double_fire_probability: 0.001,
        // 20× with a tube lens of 150 mm instead of 200 mm: 3.6 µm / 15 = 0.24 µm per pixel.
        scale_frame_px_per_um: 4.17,
        rotation_deg: 1.5,
        offset_x_frame_px: 6.0,
        offset_y_frame_px: -4.0,
        // 0.21 λ / NA = 0.29 µm at 550 nm.
        blur_frame_px: 1.25,
        focus_jitter_frame_px: 0.3,
        // A full well of 12 000 electrons at level 255.
        read_noise_levels: 0.5,
        electrons_per_level: 47.0,
        fixed_pattern_fraction: 0.005,
        brightness_levels: 160.0,
        vignetting_fraction: 0.15,
        flicker_fraction: 0.01,
        flicker_tilt_fraction: 0.005,
        // A polished slide.
        texture_contrast: 0.012,
        mark_contrast: 0.35,
        rehit_fraction: 0.08,
        grain_contrast: 0.02,
        dust_specks: 30.0,
        dust_per_frame: 0.02,
        fragments_per_pulse: 2.0,
        blown_probability: 0.1,
        ..ideal()
    }
}

fn harsh() -> SimulatorOptions {
    SimulatorOptions {
        backlash_um: 2.0,
        drift_um_per_move: 0.03,
        vibration_um: 0.4,
        impulse_probability: 0.02,
        impulse_um: 12.0,
        settling_error_um: 0.2,
        radius_noise_px: 0.4,
        misfire_probability: 0.02,
        double_fire_probability: 0.01,
        scale_frame_px_per_um: 3.93,
        rotation_deg: -6.0,
        offset_x_frame_px: -14.0,
        offset_y_frame_px: 8.0,
        blur_frame_px: 2.2,
        focus_jitter_frame_px: 0.8,
        read_noise_levels: 1.5,
        electrons_per_level: 20.0,
        fixed_pattern_fraction: 0.01,
        brightness_levels: 140.0,
        vignetting_fraction: 0.35,
        flicker_fraction: 0.05,
        flicker_tilt_fraction: 0.02,
        texture_contrast: 0.025,
        mark_contrast: 0.25,
        rehit_fraction: 0.05,
        grain_contrast: 0.03,
        dust_specks: 80.0,
        dust_per_frame: 0.2,
        fragments_per_pulse: 6.0,
        fragment_radius_um: 0.7,
        fragment_distance_um: 20.0,
        blown_probability: 0.25,
        ..lab()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_valid_and_found_by_its_name() {
        for preset in Preset::ALL {
            preset.options().validate().unwrap();
            assert_eq!(preset.name().parse::<Preset>(), Ok(preset));
        }
    }

    #[test]
    fn an_unknown_preset_lists_those_there_are() {
        let error = "factory".parse::<Preset>().unwrap_err();
        assert!(error.to_string().contains("ideal, lab, harsh"), "{error}");
    }
}
