//! Settings of the milling environment.

use crate::error::check_option;
use crate::{MillingError, Profile};

/// Pixels along a side of the workpiece of an environment.
pub const SIZE_PX: usize = 100;

/// Reach of the footprint in pixels, where the size of a pixel is not given: then the beam is about
/// as wide as a pulse of the ablation environments.
const REACH_PX: f64 = 15.0;

/// Settings of the milling environment. Lengths that are not given follow from the footprint.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentOptions {
    /// Process whose footprint and law mill; its speeds and pitch do not matter to spots.
    pub profile: Profile,
    /// Side of a pixel, µm, above 0; by default a fifteenth of the footprint's reach.
    pub pixel_um: Option<f64>,
    /// Depth of the deepest place of random reliefs, and full scale of observations, µm, above 0; by
    /// default half of the footprint's reach, or the deepest place of a given target.
    pub depth_um: Option<f64>,
    /// Longest dwell of a spot, s, above 0; by default what `depth_um` takes in the centre of a spot
    /// on flat ground.
    pub longest_dwell_s: Option<f64>,
    /// Spots after which the episode terminates, at least 1.
    pub max_spots: u32,
    /// Tracking error, %, in [0, 100), at which the episode terminates as a success.
    pub tolerance_percent: f64,
    /// Standard deviation of the displacement of each spot along x and along y, µm, at least 0.
    pub pointing_error_um: f64,
    /// Relative standard deviation of the dwell, in [0, 0.5]. It never leaves [0, longest].
    pub dwell_error: f64,
    /// The target, µm, 100 × 100 depths row by row; by default a new random relief every episode.
    pub target_um: Option<Vec<f64>>,
}

impl EnvironmentOptions {
    /// The defaults for a process.
    #[must_use]
    pub fn new(profile: Profile) -> Self {
        Self {
            profile,
            pixel_um: None,
            depth_um: None,
            longest_dwell_s: None,
            max_spots: 200,
            tolerance_percent: 2.0,
            pointing_error_um: 0.0,
            dwell_error: 0.0,
            target_um: None,
        }
    }

    /// Side of a pixel, µm.
    #[must_use]
    pub fn pixel_um(&self) -> f64 {
        self.pixel_um.unwrap_or_else(|| self.profile.process.footprint.reach_um() / REACH_PX)
    }

    /// Depth of the deepest place, µm.
    #[must_use]
    pub fn depth_um(&self) -> f64 {
        let deepest = |target: &Vec<f64>| target.iter().copied().fold(0.0, f64::max);
        self.depth_um
            .or_else(|| self.target_um.as_ref().map(deepest))
            .unwrap_or_else(|| 0.5 * self.profile.process.footprint.reach_um())
    }

    /// Longest dwell of a spot, s.
    #[must_use]
    pub fn longest_dwell_s(&self) -> f64 {
        self.longest_dwell_s
            .unwrap_or_else(|| self.depth_um() / self.profile.process.footprint.peak_um_s())
    }

    /// Checks every setting against its range.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] names the first setting outside its range.
    pub fn validate(&self) -> Result<(), MillingError> {
        self.profile.validate()?;
        let positive = |value: f64, most: f64| value > 0.0 && value <= most;
        let pixel = self.pixel_um();
        check_option("pixel_um", pixel, positive(pixel, 1e9), "above 0 and at most 1e9 µm")?;
        let depth = self.depth_um();
        check_option("depth_um", depth, positive(depth, 1e6), "above 0 and at most 1e6 µm")?;
        let dwell = self.longest_dwell_s();
        check_option("longest_dwell_s", dwell, positive(dwell, 1e9), "above 0 and at most 1e9 s")?;
        let spots = self.max_spots;
        check_option("max_spots", f64::from(spots), spots >= 1, "at least 1")?;
        let tolerance = self.tolerance_percent;
        let ok = (0.0..100.0).contains(&tolerance);
        check_option("tolerance_percent", tolerance, ok, "in [0, 100)")?;
        let pointing = self.pointing_error_um;
        let ok = (0.0..=1e9).contains(&pointing);
        check_option("pointing_error_um", pointing, ok, "in [0, 1e9] µm")?;
        let ok = (0.0..=0.5).contains(&self.dwell_error);
        check_option("dwell_error", self.dwell_error, ok, "in [0, 0.5]")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_outside_its_range_is_named() {
        let base = EnvironmentOptions::new(Profile::shipped("laser-graphite").unwrap());
        assert_eq!(base.validate(), Ok(()));
        let rejected = |change: fn(&mut EnvironmentOptions)| {
            let mut options = base.clone();
            change(&mut options);
            match options.validate() {
                Err(MillingError::InvalidOption { name, .. }) => name,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(rejected(|o| o.pixel_um = Some(0.0)), "pixel_um");
        assert_eq!(rejected(|o| o.depth_um = Some(f64::NAN)), "depth_um");
        assert_eq!(rejected(|o| o.longest_dwell_s = Some(-1.0)), "longest_dwell_s");
        assert_eq!(rejected(|o| o.max_spots = 0), "max_spots");
        assert_eq!(rejected(|o| o.tolerance_percent = 100.0), "tolerance_percent");
        assert_eq!(rejected(|o| o.pointing_error_um = f64::INFINITY), "pointing_error_um");
        assert_eq!(rejected(|o| o.dwell_error = 0.6), "dwell_error");
    }
}
