//! Firing orders of short travel.

use lasergym_geom::Point;

use crate::PlanError;
use crate::job::check_positions;

/// The indices of `positions` in an order of short travel. Where `start` says where the stage is,
/// the way from there to the first pulse counts too. The same positions always give the same order.
///
/// # Errors
/// [`PlanError::PositionNotFinite`].
pub fn shortest_order(positions: &[Point], start: Option<Point>) -> Result<Vec<usize>, PlanError> {
    check_positions(positions)?;
    if let Some(start) = start {
        check_positions(&[start])?;
    }
    // Every position is finite, which is all that a tour needs.
    Ok(lasergym_toolpath::shortest_order(positions, start).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_that_is_not_finite_is_refused() {
        let stops = [Point::new(1.0, 1.0), Point::new(f64::NAN, 1.0)];
        let error = shortest_order(&stops, None).unwrap_err();
        assert!(matches!(error, PlanError::PositionNotFinite { index: 1, .. }), "{error}");
    }

    #[test]
    fn a_start_that_is_not_finite_is_refused() {
        let start = Some(Point::new(1.0, f64::INFINITY));
        let error = shortest_order(&[Point::new(1.0, 1.0)], start).unwrap_err();
        assert!(matches!(error, PlanError::PositionNotFinite { .. }), "{error}");
    }
}
