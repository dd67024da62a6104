//! What vision expects to see.

use crate::ObserverError;

/// What vision expects to see. Lengths are px of the pattern.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VisionOptions {
    /// Radius of a mark, px, in [2, 50]. Default 9.
    pub radius_px: f64,
    /// How far the radius may be from that, px, above 0 and below half the radius. More finds
    /// stranger marks and takes more dust for marks. Default 2.
    pub radius_range_px: f64,
    /// Standard deviation of the radius, px, above 0: decides where only a short arc is visible.
    /// Default 0.3.
    pub radius_spread_px: f64,
    /// How far from its aim a pulse usually lands, px, above 0. Decides where too little of a mark
    /// is new to tell; a mark that is seen well is where it is. Default 1.
    pub aim_spread_px: f64,
    /// How much darker machined ground is at least, a fraction of the brightness of pristine
    /// ground in (0, 1). Default 0.12.
    pub least_contrast: f64,
    /// How far the workpiece may move in the view, px, in [0, 40]. Default 8.
    pub max_shift_px: f64,
}

impl Default for VisionOptions {
    fn default() -> Self {
        Self {
            radius_px: 9.0,
            radius_range_px: 2.0,
            radius_spread_px: 0.3,
            aim_spread_px: 1.0,
            least_contrast: 0.12,
            max_shift_px: 8.0,
        }
    }
}

impl VisionOptions {
    /// Checks every option against its range.
    ///
    /// # Errors
    /// [`ObserverError::InvalidOption`].
    pub fn validate(&self) -> Result<(), ObserverError> {
        let refuse =
            |name, value, expected| Err(ObserverError::InvalidOption { name, value, expected });
        if !(2.0..=50.0).contains(&self.radius_px) {
            return refuse("radius_px", self.radius_px, "in [2, 50]");
        }
        if !(self.radius_range_px > 0.0 && self.radius_range_px < 0.5 * self.radius_px) {
            let expected = "above 0 and below half the radius";
            return refuse("radius_range_px", self.radius_range_px, expected);
        }
        if !(self.radius_spread_px > 0.0 && self.radius_spread_px.is_finite()) {
            return refuse("radius_spread_px", self.radius_spread_px, "above 0");
        }
        if !(self.aim_spread_px > 0.0 && self.aim_spread_px.is_finite()) {
            return refuse("aim_spread_px", self.aim_spread_px, "above 0");
        }
        if !(self.least_contrast > 0.0 && self.least_contrast < 1.0) {
            return refuse("least_contrast", self.least_contrast, "in (0, 1)");
        }
        if !(0.0..=40.0).contains(&self.max_shift_px) {
            return refuse("max_shift_px", self.max_shift_px, "in [0, 40]");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_outside_their_range_are_refused_by_name() {
        type Change = fn(&mut VisionOptions);
        let changes: [(&str, Change); 6] = [
            ("radius_px", |options| options.radius_px = f64::NAN),
            ("radius_range_px", |options| options.radius_range_px = 4.5),
            ("radius_spread_px", |options| options.radius_spread_px = 0.0),
            ("aim_spread_px", |options| options.aim_spread_px = f64::INFINITY),
            ("least_contrast", |options| options.least_contrast = 1.0),
            ("max_shift_px", |options| options.max_shift_px = -1.0),
        ];
        for (expected, change) in changes {
            let mut options = VisionOptions::default();
            change(&mut options);
            match options.validate() {
                Err(ObserverError::InvalidOption { name, .. }) => assert_eq!(name, expected),
                other => panic!("{expected}: {other:?}"),
            }
        }
    }
}
