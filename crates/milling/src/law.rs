//! Removal laws: what the rate depends on besides the distance from the beam.

use crate::MillingError;
use crate::error::check_option;

/// The factor f of ∂Z/∂t = −E(r) f (equation 2.1 of the paper).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RemovalLaw {
    /// f = 1.
    Linear,
    /// f depends on the slope of the surface, as for a waterjet (2.2, 3.2).
    Slope(SlopeLaw),
    /// f depends on the feed speed, as for a pulsed laser (2.4, 3.3).
    FeedSpeed(FeedSpeedLaw),
}

/// f(θ) = 1 ∓ a₁ θ ∓ a₂ θ², at least 0, where θ is the angle between the beam, which is vertical,
/// and the normal of the surface.
///
/// f has a kink at flat ground, so θ is taken as arctan √(|∇z|² + ε²) − arctan ε.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlopeLaw {
    /// a₁, 1/rad, in [0, 10]. The paper's garnet jet: 0.5540.
    pub first_per_rad: f64,
    /// a₂, 1/rad², in [0, 10]. The paper's garnet jet: 0.1363.
    pub second_per_rad2: f64,
    /// Whether slopes are removed more slowly or faster. The paper's text does not say.
    pub sign: SlopeSign,
    /// ε, a slope, in [10⁻⁶, 1]. More is smoother and less exact on flat ground. Default 0.01.
    pub smoothing: f64,
}

/// Sign of the terms of [`SlopeLaw`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SlopeSign {
    /// f = 1 − a₁ θ − a₂ θ²: trenches saturate, as those of jets do.
    #[default]
    Minus,
    /// f = 1 + a₁ θ + a₂ θ²: oblique impact removes more, as on ductile material.
    Plus,
}

/// f(V) = α (V/V₀)^β.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeedSpeedLaw {
    /// α, in (0, 1000].
    pub factor: f64,
    /// β, in [−2, 0.95]. A pass removes ∝ V^(β − 1); 0 is the linear law.
    pub exponent: f64,
    /// V₀, mm/s, above 0.
    pub reference_mm_s: f64,
}

impl Default for SlopeLaw {
    fn default() -> Self {
        Self {
            first_per_rad: 0.5540,
            second_per_rad2: 0.1363,
            sign: SlopeSign::Minus,
            smoothing: 1e-2,
        }
    }
}

impl Default for FeedSpeedLaw {
    fn default() -> Self {
        Self { factor: 1.0, exponent: 0.3, reference_mm_s: 400.0 }
    }
}

impl RemovalLaw {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] names the first parameter outside its range.
    pub fn validate(&self) -> Result<(), MillingError> {
        match self {
            Self::Linear => Ok(()),
            Self::Slope(law) => {
                let first = law.first_per_rad;
                check_option("first_per_rad", first, (0.0..=10.0).contains(&first), "in [0, 10]")?;
                let second = law.second_per_rad2;
                let ok = (0.0..=10.0).contains(&second);
                check_option("second_per_rad2", second, ok, "in [0, 10]")?;
                let ok = (1e-6..=1.0).contains(&law.smoothing);
                check_option("smoothing", law.smoothing, ok, "in [1e-6, 1]")
            }
            Self::FeedSpeed(law) => {
                let ok = law.factor > 0.0 && law.factor <= 1e3;
                check_option("factor", law.factor, ok, "in (0, 1000]")?;
                let ok = (-2.0..=0.95).contains(&law.exponent);
                check_option("exponent", law.exponent, ok, "in [-2, 0.95]")?;
                let speed = law.reference_mm_s;
                let ok = speed > 0.0 && speed <= 1e9;
                check_option("reference_mm_s", speed, ok, "above 0 and at most 1e9 mm/s")
            }
        }
    }

    /// Dose of a unit of path, s/mm: how long flat ground would have to stay under a resting beam
    /// with f = 1 to lose what a pass with this dwell removes.
    #[must_use]
    pub fn dose_s_mm(&self, dwell_s_mm: f64) -> f64 {
        self.dose_and_slope(dwell_s_mm).0
    }

    /// The dwell of a dose: the inverse of [`RemovalLaw::dose_s_mm`], s/mm.
    #[must_use]
    pub fn dwell_of_dose_s_mm(&self, dose_s_mm: f64) -> f64 {
        match self {
            Self::Linear | Self::Slope(_) => dose_s_mm,
            Self::FeedSpeed(law) => {
                let scaled = dose_s_mm * law.reference_mm_s.powf(law.exponent) / law.factor;
                scaled.powf(1.0 / (1.0 - law.exponent))
            }
        }
    }

    /// Dose and its derivative with respect to the dwell: D f(1/D) and f(V) − V f'(V).
    pub(crate) fn dose_and_slope(&self, dwell_s_mm: f64) -> (f64, f64) {
        match self {
            Self::Linear | Self::Slope(_) => (dwell_s_mm, 1.0),
            Self::FeedSpeed(law) => {
                let f = law.factor * (dwell_s_mm * law.reference_mm_s).powf(-law.exponent);
                (dwell_s_mm * f, (1.0 - law.exponent) * f)
            }
        }
    }

    /// f(θ) for the slope law, f = 1 otherwise; θ in rad.
    #[must_use]
    pub fn angle_factor(&self, angle_rad: f64) -> f64 {
        match self {
            Self::Slope(law) => {
                let sign = law.sign.factor();
                let sum = law.first_per_rad * angle_rad + law.second_per_rad2 * angle_rad.powi(2);
                (1.0 + sign * sum).max(0.0)
            }
            Self::Linear | Self::FeedSpeed(_) => 1.0,
        }
    }

    /// Largest |∂f/∂|∇d||, which is |df/dθ| cos²θ: how fast a slope's effect travels under a beam of
    /// unit rate.
    pub(crate) fn steepest_per_slope(&self) -> f64 {
        match self {
            Self::Slope(law) => {
                let (first, second) = (law.first_per_rad, law.second_per_rad2);
                // It rises as long as this falling function of θ is positive.
                let rises = |angle: f64| {
                    second * angle.cos() - (first + 2.0 * second * angle) * angle.sin()
                };
                let (mut low, mut high) = (0.0, std::f64::consts::FRAC_PI_2);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if rises(middle) > 0.0 { low = middle } else { high = middle }
                }
                (first + 2.0 * second * low) * low.cos().powi(2)
            }
            Self::Linear | Self::FeedSpeed(_) => 0.0,
        }
    }
}

impl SlopeSign {
    /// −1 or 1.
    pub(crate) fn factor(self) -> f64 {
        match self {
            Self::Minus => -1.0,
            Self::Plus => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn dose_and_dwell_are_inverse_and_the_slope_is_right(
            exponent in -1.0..0.9_f64, dwell in 1e-4..1.0_f64
        ) {
            let law = RemovalLaw::FeedSpeed(FeedSpeedLaw { exponent, ..FeedSpeedLaw::default() });
            let dose = law.dose_s_mm(dwell);
            prop_assert!((law.dwell_of_dose_s_mm(dose) / dwell - 1.0).abs() < 1e-10);
            let step = dwell * 1e-5;
            let slope = (law.dose_s_mm(dwell + step) - law.dose_s_mm(dwell - step)) / (2.0 * step);
            prop_assert!((law.dose_and_slope(dwell).1 / slope - 1.0).abs() < 1e-7);
        }
    }

    proptest! {
        #[test]
        fn no_slope_changes_the_factor_faster_than_the_steepest(
            first in 0.0..10.0_f64, second in 0.0..10.0_f64, slopes in 0.0..30.0_f64
        ) {
            let law = SlopeLaw {
                first_per_rad: first,
                second_per_rad2: second,
                sign: SlopeSign::Plus,
                ..SlopeLaw::default()
            };
            let law = RemovalLaw::Slope(law);
            let steepest = law.steepest_per_slope();
            let derivative = |slope: f64| {
                let factor = |slope: f64| law.angle_factor(slope.atan());
                (factor(slope + 1e-5) - factor((slope - 1e-5).max(0.0))) / (slope.min(1e-5) + 1e-5)
            };
            prop_assert!(derivative(slopes) <= steepest * (1.0 + 1e-6) + 1e-9);
            let reached = (0..20_000).map(|k| derivative(f64::from(k) * 1e-4)).fold(0.0, f64::max);
            prop_assert!(reached >= steepest * (1.0 - 1e-3));
        }
    }

    #[test]
    fn the_slope_law_has_the_values_of_the_table() {
        let law = RemovalLaw::Slope(SlopeLaw::default());
        for (degrees, factor) in [(0.0, 1.0), (20.0, 0.790), (45.0, 0.481), (70.0, 0.120)] {
            assert!((law.angle_factor(f64::to_radians(degrees)) - factor).abs() < 6e-4);
        }
        assert!(law.angle_factor(1.5).abs() < 1e-15);
    }

    #[test]
    fn every_parameter_outside_its_range_is_named() {
        let slope = |change: fn(&mut SlopeLaw)| {
            let mut law = SlopeLaw::default();
            change(&mut law);
            RemovalLaw::Slope(law).validate()
        };
        let speed = |change: fn(&mut FeedSpeedLaw)| {
            let mut law = FeedSpeedLaw::default();
            change(&mut law);
            RemovalLaw::FeedSpeed(law).validate()
        };
        for (result, expected) in [
            (slope(|law| law.first_per_rad = -1.0), "first_per_rad"),
            (slope(|law| law.second_per_rad2 = f64::NAN), "second_per_rad2"),
            (slope(|law| law.smoothing = 0.0), "smoothing"),
            (speed(|law| law.factor = 0.0), "factor"),
            (speed(|law| law.exponent = 1.0), "exponent"),
            (speed(|law| law.reference_mm_s = 0.0), "reference_mm_s"),
        ] {
            match result {
                Err(MillingError::InvalidOption { name, .. }) => assert_eq!(name, expected),
                other => panic!("{expected}: {other:?}"),
            }
        }
    }
}
