//! Paths of the beam: nearly straight passes with the controls of the paper (equation 4.1).

use crate::error::check_option;
use crate::{MillingError, RemovalLaw};

/// Most control points of a path.
pub const MAX_CONTROL_POINTS: usize = 1 << 24;

/// Where straight passes lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RasterLayout {
    /// x of the first point of every pass, µm.
    pub first_x_um: f64,
    /// Distance between points along x, µm, above 0.
    pub spacing_um: f64,
    /// Points of a pass, at least 2.
    pub points: usize,
    /// y of the first pass, µm.
    pub first_y_um: f64,
    /// Distance between passes, µm, above 0.
    pub pitch_um: f64,
    /// Number of passes, at least 1.
    pub passes: usize,
}

/// Passes along x, one after the other, every second one from right to left. Point i of pass j is
/// entry j × `points` + i; its x is `first_x_um` + i `spacing_um`.
///
/// Between points y and dwell are linear; the beam may be off between two points.
#[derive(Debug, Clone, PartialEq)]
pub struct BeamPath {
    /// x of the first point of every pass, µm.
    pub first_x_um: f64,
    /// Distance between points along x, µm, above 0.
    pub spacing_um: f64,
    /// Points of a pass, at least 2.
    pub points: usize,
    /// y of each point, µm; shape (passes, points).
    pub y_um: Vec<f64>,
    /// Time per length at each point, s/mm: one over the feed speed; shape (passes, points).
    pub dwell_s_mm: Vec<f64>,
    /// Whether the beam is on between point i and point i + 1; shape (passes, points − 1).
    pub beam_on: Vec<bool>,
}

/// A piece of path over which the beam is taken to stand in its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BeamStep {
    /// Index of the point before the step, in its pass.
    pub(crate) point: usize,
    /// Place between that point and the next, λ in (0, 1).
    pub(crate) fraction: f64,
    pub(crate) x_um: f64,
    pub(crate) y_um: f64,
    /// W: length × dose, s.
    pub(crate) dose_s: f64,
    /// dW/dD, mm.
    pub(crate) dose_per_dwell_mm: f64,
    /// dW/dΔs × dΔs/dY of the next point (minus that for this point), s/µm.
    pub(crate) dose_per_rise_s_um: f64,
}

impl BeamPath {
    /// Straight passes with the beam on and the same dwell everywhere.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] for a layout out of range.
    pub fn raster(layout: &RasterLayout, dwell_s_mm: f64) -> Result<Self, MillingError> {
        let positive = |value: f64| value > 0.0 && value <= 1e9;
        let (spacing, pitch) = (layout.spacing_um, layout.pitch_um);
        check_option("spacing_um", spacing, positive(spacing), "above 0 and at most 1e9 µm")?;
        check_option("pitch_um", pitch, positive(pitch), "above 0 and at most 1e9 µm")?;
        let count = layout.points.saturating_mul(layout.passes);
        let ok = layout.points >= 2 && count <= MAX_CONTROL_POINTS;
        check_option("points", layout.points as f64, ok, "at least 2, and 2²⁴ in all passes")?;
        check_option("passes", layout.passes as f64, layout.passes >= 1, "at least 1")?;
        let path = Self {
            first_x_um: layout.first_x_um,
            spacing_um: layout.spacing_um,
            points: layout.points,
            y_um: (0..count)
                .map(|k| layout.first_y_um + (k / layout.points) as f64 * layout.pitch_um)
                .collect(),
            dwell_s_mm: vec![dwell_s_mm; count],
            beam_on: vec![true; layout.passes * (layout.points - 1)],
        };
        path.validate()?;
        Ok(path)
    }

    /// Number of passes.
    #[must_use]
    pub fn passes(&self) -> usize {
        self.y_um.len().checked_div(self.points).unwrap_or(0)
    }

    /// x of the point `point` of every pass, µm.
    #[must_use]
    pub fn x_um(&self, point: usize) -> f64 {
        self.first_x_um + point as f64 * self.spacing_um
    }

    /// Checks lengths and values.
    ///
    /// # Errors
    /// [`MillingError::WrongLength`] for arrays that do not fit together,
    /// [`MillingError::Control`] for a y that is not finite or a dwell that is not above 0.
    pub fn validate(&self) -> Result<(), MillingError> {
        let check_len = |name, actual, expected| {
            if actual == expected {
                Ok(())
            } else {
                Err(MillingError::WrongLength { name, actual, expected })
            }
        };
        let ok = self.points >= 2;
        check_option("points", self.points as f64, ok, "at least 2")?;
        let (x, spacing) = (self.first_x_um, self.spacing_um);
        check_option("first_x_um", x, x.abs() <= 1e9, "within ±1e9 µm")?;
        let ok = spacing > 0.0 && spacing <= 1e9;
        check_option("spacing_um", spacing, ok, "above 0 and at most 1e9 µm")?;
        let passes = self.passes();
        check_len("y_um", self.y_um.len(), passes.max(1) * self.points)?;
        check_len("dwell_s_mm", self.dwell_s_mm.len(), self.y_um.len())?;
        check_len("beam_on", self.beam_on.len(), passes * (self.points - 1))?;
        let bad = |name, index: usize, value, expected| {
            let (pass, point) = (index / self.points, index % self.points);
            Err(MillingError::Control { name, pass, point, value, expected })
        };
        if let Some(k) = self.y_um.iter().position(|y| y.is_nan() || y.abs() > 1e9) {
            return bad("y_um", k, self.y_um[k], "finite and within ±1e9 µm");
        }
        if let Some(k) = self.dwell_s_mm.iter().position(|&d| !(d > 0.0 && d <= 1e9)) {
            return bad("dwell_s_mm", k, self.dwell_s_mm[k], "above 0 and at most 1e9 s/mm");
        }
        Ok(())
    }

    /// The passes before `pass`, and those from it on.
    ///
    /// Passes alternate in direction from the first of each part on.
    #[must_use]
    pub fn split_at_pass(&self, pass: usize) -> (Self, Self) {
        let pass = pass.min(self.passes());
        let (points, stretches) = (pass * self.points, pass * (self.points - 1));
        let part = |y_um: &[f64], dwell: &[f64], beam_on: &[bool]| Self {
            first_x_um: self.first_x_um,
            spacing_um: self.spacing_um,
            points: self.points,
            y_um: y_um.to_vec(),
            dwell_s_mm: dwell.to_vec(),
            beam_on: beam_on.to_vec(),
        };
        (
            part(&self.y_um[..points], &self.dwell_s_mm[..points], &self.beam_on[..stretches]),
            part(&self.y_um[points..], &self.dwell_s_mm[points..], &self.beam_on[stretches..]),
        )
    }

    /// Whether the pass `pass` runs from right to left.
    #[must_use]
    pub fn is_reversed(&self, pass: usize) -> bool {
        pass % 2 == 1
    }

    /// Time with the beam on, s.
    #[must_use]
    pub fn exposure_s(&self) -> f64 {
        self.time_s(|on| on)
    }

    /// Time of all passes, s. Where the beam is off the machine moves at the speed of the points;
    /// the way from pass to pass is not counted.
    #[must_use]
    pub fn machining_time_s(&self) -> f64 {
        self.time_s(|_| true)
    }

    fn time_s(&self, counts: impl Fn(bool) -> bool) -> f64 {
        let mut sum = 0.0;
        for (k, &on) in self.beam_on.iter().enumerate() {
            if counts(on) {
                let first = k / (self.points - 1) * self.points + k % (self.points - 1);
                let rise = self.y_um[first + 1] - self.y_um[first];
                let dwell = self.dwell_s_mm[first].midpoint(self.dwell_s_mm[first + 1]);
                sum += self.spacing_um.hypot(rise) * 1e-3 * dwell;
            }
        }
        sum
    }

    /// Dose of the stretch with the largest dose, s, where it has the longer dwell of its two ends.
    pub(crate) fn largest_dose_s(&self, law: &RemovalLaw) -> f64 {
        let stretches = self.points - 1;
        let dose = |k: usize| {
            let first = k / stretches * self.points + k % stretches;
            let rise = self.y_um[first + 1] - self.y_um[first];
            let dwell = self.dwell_s_mm[first].max(self.dwell_s_mm[first + 1]);
            self.spacing_um.hypot(rise) * 1e-3 * law.dose_s_mm(dwell)
        };
        (0..self.beam_on.len()).filter(|&k| self.beam_on[k]).map(dose).fold(0.0, f64::max)
    }

    /// Writes the steps of a pass, in the order in which the beam makes them, to `steps`.
    pub(crate) fn steps(
        &self,
        pass: usize,
        substeps: usize,
        law: &RemovalLaw,
        steps: &mut Vec<BeamStep>,
    ) {
        steps.clear();
        let first = pass * self.points;
        let y = &self.y_um[first..first + self.points];
        let dwell = &self.dwell_s_mm[first..first + self.points];
        let on = &self.beam_on[pass * (self.points - 1)..(pass + 1) * (self.points - 1)];
        let parts = substeps as f64;
        for point in (0..self.points - 1).filter(|&point| on[point]) {
            let rise = y[point + 1] - y[point];
            let length_mm = self.spacing_um.hypot(rise) * 1e-3;
            for part in 0..substeps {
                let fraction = (part as f64 + 0.5) / parts;
                let mean = |a: f64, b: f64| (1.0 - fraction) * a + fraction * b;
                let (dose, slope) = law.dose_and_slope(mean(dwell[point], dwell[point + 1]));
                steps.push(BeamStep {
                    point,
                    fraction,
                    x_um: self.x_um(point) + fraction * self.spacing_um,
                    y_um: mean(y[point], y[point + 1]),
                    dose_s: length_mm / parts * dose,
                    dose_per_dwell_mm: length_mm / parts * slope,
                    dose_per_rise_s_um: dose * rise * 1e-6 / (parts * length_mm),
                });
            }
        }
        if self.is_reversed(pass) {
            steps.reverse();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout() -> RasterLayout {
        RasterLayout {
            first_x_um: 10.0,
            spacing_um: 5.0,
            points: 4,
            first_y_um: 20.0,
            pitch_um: 8.0,
            passes: 2,
        }
    }

    #[test]
    fn steps_cover_the_pass_and_skip_where_the_beam_is_off() {
        let mut path = BeamPath::raster(&layout(), 0.5).unwrap();
        path.beam_on[4] = false;
        let mut steps = Vec::new();
        path.steps(0, 3, &RemovalLaw::Linear, &mut steps);
        assert_eq!(steps.len(), 9);
        let dose: f64 = steps.iter().map(|step| step.dose_s).sum();
        assert!((dose - 0.015 * 0.5).abs() < 1e-15);
        path.steps(1, 3, &RemovalLaw::Linear, &mut steps);
        assert_eq!(steps.len(), 6);
        assert!(steps[0].x_um > steps[5].x_um && steps.iter().all(|step| step.point != 1));
        assert!((path.machining_time_s() - 0.015).abs() < 1e-15);
        assert!((path.exposure_s() - 0.0125).abs() < 1e-15);
    }

    #[test]
    fn bad_layouts_and_controls_are_refused() {
        assert!(BeamPath::raster(&RasterLayout { points: 1, ..layout() }, 1.0).is_err());
        assert!(BeamPath::raster(&RasterLayout { passes: 0, ..layout() }, 1.0).is_err());
        assert!(BeamPath::raster(&RasterLayout { pitch_um: 0.0, ..layout() }, 1.0).is_err());
        assert!(BeamPath::raster(&layout(), 0.0).is_err());
        let mut path = BeamPath::raster(&layout(), 1.0).unwrap();
        path.y_um[5] = f64::NAN;
        assert!(matches!(
            path.validate(),
            Err(MillingError::Control { name: "y_um", pass: 1, point: 1, .. })
        ));
        path.y_um.pop();
        assert!(matches!(path.validate(), Err(MillingError::WrongLength { .. })));
    }
}
