//! Footprints: how fast the beam removes material at a distance from its centre.

#![allow(clippy::inline_always, reason = "kernels must be compiled with the caller's instructions")]

use crate::MillingError;
use crate::error::check_option;
use crate::footprint_table::FootprintTable;

/// Where a [`Footprint::gaussian`] ends, in units of its 1/e² radius.
pub const GAUSSIAN_REACH: f64 = 2.0;

/// Largest radius and rate that are accepted, µm and µm/s.
const LARGEST: f64 = 1e9;

/// Etching rate E(r), µm/s, of a beam at distance r from its centre. It is once continuously
/// differentiable and 0 from [`Footprint::reach_um`] on.
#[derive(Debug, Clone, PartialEq)]
pub enum Footprint {
    /// E₀ exp(−2 r²/w²), as of a laser, brought smoothly to 0 at r = 2 w.
    Gaussian(Gaussian),
    /// E₀ (1 − (r/a)²)² for r < a, as of a waterjet.
    Compact(Compact),
    /// Rates from a table, as [`crate::abel_inversion`] finds them from a trench.
    Table(FootprintTable),
}

/// See [`Footprint::Gaussian`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Rate in the centre, µm/s, above 0.
    pub peak_um_s: f64,
    /// Radius at which the rate has fallen to 1/e², w, µm, above 0.
    pub radius_um: f64,
}

/// See [`Footprint::Compact`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compact {
    /// Rate in the centre, µm/s, above 0.
    pub peak_um_s: f64,
    /// Radius at which the rate reaches 0, a, µm, above 0.
    pub radius_um: f64,
}

impl Footprint {
    /// A Gaussian footprint of the given peak and 1/e² radius.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] for a peak or radius that is not above 0 and finite.
    pub fn gaussian(peak_um_s: f64, radius_um: f64) -> Result<Self, MillingError> {
        check_shape(peak_um_s, radius_um)?;
        Ok(Self::Gaussian(Gaussian { peak_um_s, radius_um }))
    }

    /// A compact footprint of the given peak and outer radius.
    ///
    /// # Errors
    /// As [`Footprint::gaussian`].
    pub fn compact(peak_um_s: f64, radius_um: f64) -> Result<Self, MillingError> {
        check_shape(peak_um_s, radius_um)?;
        Ok(Self::Compact(Compact { peak_um_s, radius_um }))
    }

    /// Distance from the centre at which the rate is 0, µm.
    #[must_use]
    pub fn reach_um(&self) -> f64 {
        match self {
            Self::Gaussian(gaussian) => GAUSSIAN_REACH * gaussian.radius_um,
            Self::Compact(compact) => compact.radius_um,
            Self::Table(table) => table.reach_um(),
        }
    }

    /// Rate at the distance `distance_um` from the centre, µm/s.
    #[must_use]
    pub fn rate_um_s(&self, distance_um: f64) -> f64 {
        fn at(radial: impl Radial, distance_um: f64) -> f64 {
            radial.rate(distance_um * distance_um, radial.axis(distance_um), radial.axis(0.0))
        }
        match self {
            Self::Gaussian(gaussian) => at(gaussian.prepared(), distance_um),
            Self::Compact(compact) => at(*compact, distance_um),
            Self::Table(table) => at(table, distance_um),
        }
    }

    /// Rate in the centre, µm/s.
    #[must_use]
    pub fn peak_um_s(&self) -> f64 {
        self.rate_um_s(0.0)
    }

    /// Volume removed in a second from flat ground, Q = ∫∫ E dA, µm³/s.
    #[must_use]
    pub fn volume_rate_um3_s(&self) -> f64 {
        self.integral(|rate| rate)
    }

    /// ∫∫ E² dA, µm⁴/s².
    pub(crate) fn squared_rate_um4_s2(&self) -> f64 {
        self.integral(|rate| rate * rate)
    }

    /// ∫∫ g(E) dA = π ∫ g(E) ds with s = r², by the midpoint rule.
    fn integral(&self, of: impl Fn(f64) -> f64) -> f64 {
        const PARTS: usize = 4096;
        let width = self.reach_um().powi(2) / PARTS as f64;
        let rate = |k: usize| self.rate_um_s(((k as f64 + 0.5) * width).sqrt());
        std::f64::consts::PI * width * (0..PARTS).map(|k| of(rate(k))).sum::<f64>()
    }

    /// The same footprint with all radii times `radius_factor` and all rates times `rate_factor`.
    ///
    /// # Errors
    /// [`MillingError::InvalidOption`] for factors that are not above 0 and finite.
    pub fn scaled(&self, radius_factor: f64, rate_factor: f64) -> Result<Self, MillingError> {
        let usable = |factor: f64| factor > 0.0 && factor <= LARGEST;
        check_option("radius_factor", radius_factor, usable(radius_factor), "above 0")?;
        check_option("rate_factor", rate_factor, usable(rate_factor), "above 0")?;
        match self {
            Self::Gaussian(g) => {
                Self::gaussian(g.peak_um_s * rate_factor, g.radius_um * radius_factor)
            }
            Self::Compact(c) => {
                Self::compact(c.peak_um_s * rate_factor, c.radius_um * radius_factor)
            }
            Self::Table(table) => Ok(Self::Table(table.scaled(radius_factor, rate_factor)?)),
        }
    }
}

fn check_shape(peak_um_s: f64, radius_um: f64) -> Result<(), MillingError> {
    let usable = |value: f64| value > 0.0 && value <= LARGEST;
    check_option("peak_um_s", peak_um_s, usable(peak_um_s), "above 0 and at most 1e9 µm/s")?;
    check_option("radius_um", radius_um, usable(radius_um), "above 0 and at most 1e9 µm")
}

/// A footprint inside the loops over cells, as a function of s = r².
pub(crate) trait Radial: Copy {
    /// A factor of the rate that depends on the distance along one axis only.
    fn axis(&self, distance_um: f64) -> f64;

    /// E, µm/s, where r² = `square_um2` and the factors of the two axes are given.
    fn rate(&self, square_um2: f64, axis_x: f64, axis_y: f64) -> f64;

    /// E and dE/d(r²), µm/s and 1/(µm·s).
    fn rate_and_slope(&self, square_um2: f64, axis_x: f64, axis_y: f64) -> (f64, f64);
}

/// A Gaussian less its tangent at the end in r², so that rate and slope reach 0 together.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PreparedGaussian {
    last_um2: f64,
    exponent: f64,
    scale: f64,
    end_rate: f64,
    end_slope: f64,
}

impl Gaussian {
    /// Works out what does not depend on the distance.
    pub(crate) fn prepared(&self) -> PreparedGaussian {
        let last_um2 = (GAUSSIAN_REACH * self.radius_um).powi(2);
        let exponent = -2.0 / (self.radius_um * self.radius_um);
        let end_rate = (exponent * last_um2).exp();
        let end_slope = exponent * end_rate;
        let scale = self.peak_um_s / (1.0 - end_rate + end_slope * last_um2);
        PreparedGaussian { last_um2, exponent, scale, end_rate, end_slope }
    }
}

impl Radial for PreparedGaussian {
    #[inline(always)]
    fn axis(&self, distance_um: f64) -> f64 {
        (self.exponent * distance_um * distance_um).exp()
    }

    #[inline(always)]
    fn rate(&self, square_um2: f64, axis_x: f64, axis_y: f64) -> f64 {
        let inside =
            axis_x * axis_y - self.end_rate - self.end_slope * (square_um2 - self.last_um2);
        if square_um2 < self.last_um2 { self.scale * inside } else { 0.0 }
    }

    #[inline(always)]
    fn rate_and_slope(&self, square_um2: f64, axis_x: f64, axis_y: f64) -> (f64, f64) {
        let slope = self.scale * (self.exponent * axis_x * axis_y - self.end_slope);
        let slope = if square_um2 < self.last_um2 { slope } else { 0.0 };
        (self.rate(square_um2, axis_x, axis_y), slope)
    }
}

impl Radial for Compact {
    #[inline(always)]
    fn axis(&self, _distance_um: f64) -> f64 {
        0.0
    }

    #[inline(always)]
    fn rate(&self, square_um2: f64, _axis_x: f64, _axis_y: f64) -> f64 {
        let rest = 1.0 - square_um2 / (self.radius_um * self.radius_um);
        let rest = if rest > 0.0 { rest } else { 0.0 };
        self.peak_um_s * rest * rest
    }

    #[inline(always)]
    fn rate_and_slope(&self, square_um2: f64, _axis_x: f64, _axis_y: f64) -> (f64, f64) {
        let inverse = 1.0 / (self.radius_um * self.radius_um);
        let rest = 1.0 - square_um2 * inverse;
        let rest = if rest > 0.0 { rest } else { 0.0 };
        (self.peak_um_s * rest * rest, -2.0 * self.peak_um_s * rest * inverse)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn volumes_are_those_of_the_closed_forms() {
        let compact = Footprint::compact(7.0, 3.0).unwrap();
        assert!((compact.volume_rate_um3_s() / (7.0 * PI * 9.0 / 3.0) - 1.0).abs() < 1e-6);
        // Cutting the Gaussian at 2 w costs about (1 + 8 + 32) e⁻⁸ of its volume.
        let gaussian = Footprint::gaussian(7.0, 3.0).unwrap();
        assert!((gaussian.volume_rate_um3_s() / (7.0 * PI * 9.0 / 2.0) - 1.0).abs() < 0.015);
    }

    #[test]
    fn peaks_are_what_was_asked_for_and_ends_are_zero() {
        for footprint in
            [Footprint::gaussian(5.0, 2.0).unwrap(), Footprint::compact(5.0, 2.0).unwrap()]
        {
            assert!((footprint.peak_um_s() - 5.0).abs() < 1e-12);
            assert!(footprint.rate_um_s(footprint.reach_um() * 0.999) < 1e-4);
            assert!(footprint.rate_um_s(footprint.reach_um()).abs() < 1e-15);
        }
    }

    #[test]
    fn shapes_out_of_range_are_refused() {
        for (peak, radius) in [(0.0, 1.0), (1.0, 0.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            assert!(Footprint::gaussian(peak, radius).is_err());
            assert!(Footprint::compact(peak, radius).is_err());
        }
        assert!(Footprint::compact(1.0, 1.0).unwrap().scaled(0.0, 1.0).is_err());
    }
}
