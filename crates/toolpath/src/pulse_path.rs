//! Pulses in firing order.

use lasergym_geom::{PIXEL_UM, Point};

use crate::ToolpathError;
use crate::error::check_pulse_count;

/// Most pulses a path may have.
pub const MAX_PULSES: usize = 1_000_000;

/// Largest distance of a pulse from either workpiece axis, px: one metre at 1 µm per pixel.
pub const MAX_POSITION_PX: f64 = 1e6;

/// Largest pulse radius, px: a disc that covers the workpiece from any of its points.
pub const MAX_PULSE_RADIUS_PX: f64 = 200.0;

/// Pulses of one radius in firing order.
#[derive(Debug, Clone, PartialEq)]
pub struct PulsePath {
    positions_px: Vec<Point>,
    pulse_radius_px: f64,
}

impl PulsePath {
    /// The pulses at `positions_px`, in firing order; there may be none.
    ///
    /// # Errors
    /// [`ToolpathError::TooManyPulses`] above [`MAX_PULSES`], [`ToolpathError::Position`] when a
    /// position is not finite or beyond [`MAX_POSITION_PX`], [`ToolpathError::PulseRadius`] when the
    /// radius is not in (0, [`MAX_PULSE_RADIUS_PX`]].
    pub fn new(positions_px: Vec<Point>, pulse_radius_px: f64) -> Result<Self, ToolpathError> {
        check_pulse_count(positions_px.len())?;
        check_pulse_radius(pulse_radius_px)?;
        for (k, &position) in positions_px.iter().enumerate() {
            check_position(k + 1, position)?;
        }
        Ok(Self { positions_px, pulse_radius_px })
    }

    /// Centres of the pulses in firing order, px.
    #[must_use]
    pub fn positions_px(&self) -> &[Point] {
        &self.positions_px
    }

    /// Radius of every pulse, px.
    #[must_use]
    pub fn pulse_radius_px(&self) -> f64 {
        self.pulse_radius_px
    }

    /// Number of pulses.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions_px.len()
    }

    /// Whether there is no pulse.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions_px.is_empty()
    }

    /// Lengths of the moves from pulse to pulse, µm: one less than there are pulses.
    pub fn moves_um(&self) -> impl Iterator<Item = f64> + '_ {
        self.positions_px.windows(2).map(|pair| pair[0].distance(pair[1]) * PIXEL_UM)
    }

    /// Length of the way from the first pulse to the last, µm.
    #[must_use]
    pub fn travel_um(&self) -> f64 {
        self.moves_um().sum()
    }
}

/// Whether a position, px, is finite and within [`MAX_POSITION_PX`].
pub(crate) fn in_range(position: Point) -> bool {
    position.x.abs() <= MAX_POSITION_PX && position.y.abs() <= MAX_POSITION_PX
}

/// Accepts the position of pulse number `pulse`.
pub(crate) fn check_position(pulse: usize, position: Point) -> Result<(), ToolpathError> {
    if in_range(position) {
        return Ok(());
    }
    Err(ToolpathError::Position { pulse, x_px: position.x, y_px: position.y })
}

/// Accepts a radius in (0, [`MAX_PULSE_RADIUS_PX`]].
pub(crate) fn check_pulse_radius(radius_px: f64) -> Result<(), ToolpathError> {
    if radius_px > 0.0 && radius_px <= MAX_PULSE_RADIUS_PX {
        return Ok(());
    }
    Err(ToolpathError::PulseRadius { radius_px })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn travel_is_the_sum_of_the_moves() {
        let corners = [(0.0, 0.0), (3.0, 4.0), (3.0, 16.0)].map(|(x, y)| Point::new(x, y));
        let path = PulsePath::new(corners.to_vec(), 9.0).unwrap();
        assert_eq!(path.moves_um().collect::<Vec<_>>(), [5.0, 12.0]);
        assert!((path.travel_um() - 17.0).abs() < 1e-12);
    }

    #[test]
    fn fewer_than_two_pulses_travel_nowhere() {
        for pulses in 0..2 {
            let path = PulsePath::new(vec![Point::new(7.0, 8.0); pulses], 9.0).unwrap();
            assert_eq!(path.len(), pulses);
            assert!(path.travel_um().abs() < 1e-300);
        }
    }

    #[test]
    fn a_position_must_be_finite_and_in_range() {
        for x in [f64::NAN, f64::INFINITY, -2e6] {
            let positions = vec![Point::default(), Point::new(x, 1.0)];
            let error = PulsePath::new(positions, 9.0).unwrap_err();
            assert!(matches!(error, ToolpathError::Position { pulse: 2, .. }), "{error}");
        }
    }

    #[test]
    fn a_radius_must_be_positive_and_in_range() {
        for radius_px in [0.0, -1.0, f64::NAN, f64::INFINITY, 200.1] {
            let error = PulsePath::new(Vec::new(), radius_px).unwrap_err();
            assert!(matches!(error, ToolpathError::PulseRadius { .. }), "{error}");
        }
    }

    #[test]
    fn the_number_of_pulses_is_limited() {
        let positions = vec![Point::default(); MAX_PULSES + 1];
        let error = PulsePath::new(positions, 9.0).unwrap_err();
        assert_eq!(error, ToolpathError::TooManyPulses { limit: MAX_PULSES });
    }
}
