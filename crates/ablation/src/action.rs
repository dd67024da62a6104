//! Actions and the positions they stand for.

use crate::AblationError;
use lasergym_geom::{Point, WORKPIECE_SIZE_PX};

/// One action: the pulse position scaled to [−1, 1] along x and y.
pub type Action = [f32; 2];

/// Half the workpiece, px: the scale between actions and positions.
const HALF_SIZE_PX: f64 = WORKPIECE_SIZE_PX as f64 / 2.0;

/// The position of an action, px: x = 50 (1 + a₀), y = 50 (1 + a₁), actions clipped to [−1, 1].
#[must_use]
#[inline]
pub fn position_px(action: Action) -> Point {
    let [x, y] = action.map(|a| HALF_SIZE_PX * (1.0 + f64::from(a.clamp(-1.0, 1.0))));
    Point::new(x, y)
}

/// The position nearest to `position` that an action stands for, px: actions are `f32`, which moves
/// a position by less than 4·10⁻⁶ px. Plans made of such positions score in an environment what
/// they score here, pixels exactly at the rim of a pulse included.
#[must_use]
pub fn reachable_position(position: Point) -> Point {
    let component = |coordinate: f64| (coordinate / HALF_SIZE_PX - 1.0) as f32;
    position_px([component(position.x), component(position.y)])
}

/// Whether both components are finite; `environment` is the index for the error.
#[inline]
pub(crate) fn check_finite(action: Action, environment: usize) -> Result<(), AblationError> {
    let [x, y] = action;
    if x.is_finite() && y.is_finite() {
        Ok(())
    } else {
        Err(AblationError::ActionNotFinite { environment, x, y })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn reachable_positions_are_near_and_stay(x in 0.0..=100.0, y in 0.0..=100.0) {
            let position = Point::new(x, y);
            let reachable = reachable_position(position);
            prop_assert!(reachable.distance(position) < 6e-6);
            prop_assert_eq!(reachable_position(reachable), reachable);
        }
    }
}
