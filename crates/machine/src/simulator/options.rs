//! Every effect of the simulator, each a number with its unit.

use serde::{Deserialize, Serialize};

use super::SimulatedError;

/// Largest width and height of a simulated frame, px.
pub const MAX_FRAME_SIDE_PX: usize = 2048;

/// The errors of a rig. Distances are on the workpiece where they end in `_um`, in the frame where
/// they end in `_frame_px`. A contrast or fraction of 0.01 is 1 % of the brightness of pristine
/// ground. The presets are in [`Preset`](super::Preset).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorOptions {
    /// Play of the stage in x and in y, µm: the carriage follows the screw only when it is pushed.
    /// The encoders sit on the screw and do not see it.
    pub backlash_um: f64,
    /// How far the carriage creeps with each move, always the same way, µm. Unseen by the encoders.
    pub drift_um_per_move: f64,
    /// Vibration of the stage in x and in y at the instant of a pulse or frame: standard
    /// deviation, µm. Unseen by the encoders.
    pub vibration_um: f64,
    /// Probability that a pulse lands while the bench is knocked.
    pub impulse_probability: f64,
    /// How far a knock throws a pulse, µm; the direction is random.
    pub impulse_um: f64,
    /// How far from the commanded position the stage settles in x and in y: standard deviation,
    /// µm. The encoders see it.
    pub settling_error_um: f64,
    /// Top speed of the stage, µm/s.
    pub stage_speed_um_s: f64,
    /// Acceleration of the stage, µm/s².
    pub stage_acceleration_um_s2: f64,
    /// Time that the stage takes to settle, s.
    pub settle_s: f64,
    /// How far the stage goes beyond the pattern on each side, µm.
    pub stage_margin_um: f64,

    /// Radius of a mark, px of the pattern.
    pub pulse_radius_px: f64,
    /// Standard deviation of the radius by energy noise, px of the pattern.
    pub radius_noise_px: f64,
    /// Probability that the laser is told to fire and does not.
    pub misfire_probability: f64,
    /// Probability that it fires twice.
    pub double_fire_probability: f64,
    /// Time of a pulse with its shutter, s.
    pub pulse_s: f64,

    /// Columns of a frame, px.
    pub frame_width_px: usize,
    /// Rows of a frame, px.
    pub frame_height_px: usize,
    /// Scale of the camera, frame px per µm.
    pub scale_frame_px_per_um: f64,
    /// By how much the camera sees the stage turned, degrees; positive turns x towards y.
    pub rotation_deg: f64,
    /// How far the laser's axis lies to the right of the frame's centre, frame px.
    pub offset_x_frame_px: f64,
    /// How far the laser's axis lies below the frame's centre, frame px.
    pub offset_y_frame_px: f64,
    /// Blur of the optics in focus: standard deviation of its Gaussian, frame px.
    pub blur_frame_px: f64,
    /// Further blur of a frame by wandering focus: standard deviation, frame px.
    pub focus_jitter_frame_px: f64,
    /// Read noise: standard deviation, grey levels.
    pub read_noise_levels: f64,
    /// Photo-electrons per grey level, which sets the shot noise; 0 means no shot noise.
    pub electrons_per_level: f64,
    /// Standard deviation of the pixels' sensitivity, a fraction; always the same for a camera.
    pub fixed_pattern_fraction: f64,
    /// Brightness of pristine ground at the middle of the field, grey levels.
    pub brightness_levels: f64,
    /// How much darker the corners of the frame are, a fraction.
    pub vignetting_fraction: f64,
    /// Flicker of the lamp from frame to frame: standard deviation, a fraction.
    pub flicker_fraction: f64,
    /// Flicker across the frame: standard deviation of the difference between its middle and its
    /// right or lower edge, a fraction.
    pub flicker_tilt_fraction: f64,
    /// Exposure at which the ground has its brightness, s.
    pub exposure_s: f64,
    /// Time to read a frame out, s.
    pub readout_s: f64,

    /// Contrast of the pristine ground's texture: standard deviation.
    pub texture_contrast: f64,
    /// How much darker machined ground is.
    pub mark_contrast: f64,
    /// How much darker yet a second pulse makes machined ground, a fraction of `mark_contrast`;
    /// each further one half as much as the one before.
    pub rehit_fraction: f64,
    /// Contrast of the grain of machined ground: standard deviation. Every pulse renews it.
    pub grain_contrast: f64,
    /// Dust specks on the ground at the start, in the whole view.
    pub dust_specks: f64,
    /// Specks that settle between two frames, on average.
    pub dust_per_frame: f64,
    /// Fragments that a pulse scatters, on average.
    pub fragments_per_pulse: f64,
    /// Median radius of specks and fragments, µm.
    pub fragment_radius_um: f64,
    /// How far from a mark its fragments land, µm on average; and how far it moves specks.
    pub fragment_distance_um: f64,
    /// Probability that a pulse blows away a speck within `fragment_distance_um` of it.
    pub blown_probability: f64,
}

impl SimulatorOptions {
    /// Checks every option against its range.
    ///
    /// # Errors
    /// [`SimulatedError::InvalidOption`] for the first that lies outside.
    pub fn validate(&self) -> Result<(), SimulatedError> {
        let side = MAX_FRAME_SIDE_PX as f64;
        for (name, value, least, most) in [
            ("backlash_um", self.backlash_um, 0.0, 50.0),
            ("drift_um_per_move", self.drift_um_per_move, 0.0, 1.0),
            ("vibration_um", self.vibration_um, 0.0, 20.0),
            ("impulse_probability", self.impulse_probability, 0.0, 1.0),
            ("impulse_um", self.impulse_um, 0.0, 100.0),
            ("settling_error_um", self.settling_error_um, 0.0, 20.0),
            ("stage_speed_um_s", self.stage_speed_um_s, 1.0, 1e7),
            ("stage_acceleration_um_s2", self.stage_acceleration_um_s2, 1.0, 1e9),
            ("settle_s", self.settle_s, 0.0, 60.0),
            ("stage_margin_um", self.stage_margin_um, 0.0, 1e5),
            ("pulse_radius_px", self.pulse_radius_px, 1.0, 50.0),
            ("radius_noise_px", self.radius_noise_px, 0.0, 5.0),
            ("misfire_probability", self.misfire_probability, 0.0, 1.0),
            ("double_fire_probability", self.double_fire_probability, 0.0, 1.0),
            ("pulse_s", self.pulse_s, 0.0, 60.0),
            ("frame_width_px", self.frame_width_px as f64, 64.0, side),
            ("frame_height_px", self.frame_height_px as f64, 64.0, side),
            ("scale_frame_px_per_um", self.scale_frame_px_per_um, 1.0, 16.0),
            ("rotation_deg", self.rotation_deg, -180.0, 180.0),
            ("offset_x_frame_px", self.offset_x_frame_px, -side, side),
            ("offset_y_frame_px", self.offset_y_frame_px, -side, side),
            ("blur_frame_px", self.blur_frame_px, 0.0, 8.0),
            ("focus_jitter_frame_px", self.focus_jitter_frame_px, 0.0, 3.0),
            ("read_noise_levels", self.read_noise_levels, 0.0, 50.0),
            ("electrons_per_level", self.electrons_per_level, 0.0, 1e6),
            ("fixed_pattern_fraction", self.fixed_pattern_fraction, 0.0, 0.2),
            ("brightness_levels", self.brightness_levels, 1.0, 255.0),
            ("vignetting_fraction", self.vignetting_fraction, 0.0, 0.9),
            ("flicker_fraction", self.flicker_fraction, 0.0, 0.3),
            ("flicker_tilt_fraction", self.flicker_tilt_fraction, 0.0, 0.3),
            ("exposure_s", self.exposure_s, 1e-6, 10.0),
            ("readout_s", self.readout_s, 0.0, 10.0),
            ("texture_contrast", self.texture_contrast, 0.0, 0.3),
            ("mark_contrast", self.mark_contrast, 0.01, 1.0),
            ("rehit_fraction", self.rehit_fraction, 0.0, 0.5),
            ("grain_contrast", self.grain_contrast, 0.0, 0.3),
            ("dust_specks", self.dust_specks, 0.0, 1000.0),
            ("dust_per_frame", self.dust_per_frame, 0.0, 100.0),
            ("fragments_per_pulse", self.fragments_per_pulse, 0.0, 100.0),
            ("fragment_radius_um", self.fragment_radius_um, 0.1, 5.0),
            ("fragment_distance_um", self.fragment_distance_um, 1.0, 100.0),
            ("blown_probability", self.blown_probability, 0.0, 1.0),
        ] {
            if !(least..=most).contains(&value) {
                return Err(SimulatedError::InvalidOption { name, value, least, most });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Preset;
    use super::*;

    #[test]
    fn options_outside_their_range_are_refused_by_name() {
        type Change = fn(&mut SimulatorOptions);
        let changes: [(&str, Change); 5] = [
            ("backlash_um", |options| options.backlash_um = -1.0),
            ("vibration_um", |options| options.vibration_um = f64::NAN),
            ("misfire_probability", |options| options.misfire_probability = 1.1),
            ("frame_width_px", |options| options.frame_width_px = 5000),
            ("mark_contrast", |options| options.mark_contrast = f64::INFINITY),
        ];
        for (expected, change) in changes {
            let mut options = Preset::Lab.options();
            change(&mut options);
            match options.validate() {
                Err(SimulatedError::InvalidOption { name, .. }) => assert_eq!(name, expected),
                other => panic!("{expected}: {other:?}"),
            }
        }
    }

    #[test]
    fn options_survive_json_and_unknown_ones_are_refused() {
        let options = Preset::Harsh.options();
        let json = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<SimulatorOptions>(&json).unwrap(), options);
        let unknown = json.replacen("backlash_um", "backlash_mm", 1);
        assert!(serde_json::from_str::<SimulatorOptions>(&unknown).is_err());
    }
}
