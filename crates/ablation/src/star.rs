//! The five-pointed star of the paper's first two tasks.

use lasergym_geom::{Bitmap, Point, WORKPIECE_SIZE_PX, fill_even_odd};

/// Distance from the star's circumcentre to its tips, px. With it, the inner radius and the pulse
/// radius, the rewards of Table 1 (Xie et al. 2022) are reproduced.
pub const STAR_OUTER_RADIUS_PX: f64 = 55.28;

/// Inner radius over outer radius.
const INNER_OVER_OUTER: f64 = 0.54;

/// Number of tips.
const TIPS: u32 = 5;

/// The star turned by `angle_deg` about the centre of the workpiece, clockwise on the screen; one
/// tip points up at 0°. What leaves the workpiece is lost. The upright star has 4842 px.
///
/// Its circumcentre lies 5.28 px below the centre of the workpiece, so that the bounding box of the
/// upright star is centred.
#[must_use]
pub fn star(angle_deg: f64) -> Bitmap {
    let center = Point::new(WORKPIECE_SIZE_PX as f64 / 2.0, WORKPIECE_SIZE_PX as f64 / 2.0);
    let circumcenter =
        Point::new(center.x, center.y + STAR_OUTER_RADIUS_PX - WORKPIECE_SIZE_PX as f64 / 2.0);
    let outline: [Point; 2 * TIPS as usize] = std::array::from_fn(|k| {
        let inner = if k % 2 == 1 { INNER_OVER_OUTER } else { 1.0 };
        let tip = circumcenter + Point::new(0.0, -STAR_OUTER_RADIUS_PX * inner);
        let turn_rad = std::f64::consts::PI * k as f64 / f64::from(TIPS);
        tip.rotated_about(circumcenter, turn_rad).rotated_about(center, angle_deg.to_radians())
    });
    fill_even_odd(&[outline])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_upright_star_has_the_papers_area() {
        assert_eq!(star(0.0).area_px(), 4842);
    }

    #[test]
    fn turning_loses_tips_only() {
        for angle_deg in 0..360 {
            let area_px = star(f64::from(angle_deg)).area_px();
            assert!((4842 - 100..=4842 + 10).contains(&area_px), "{area_px} px at {angle_deg}°");
        }
    }

    #[test]
    fn a_full_turn_and_a_mirror_image_change_nothing() {
        for angle_deg in [0.0, 10.0, 33.3, 180.0] {
            assert_eq!(star(angle_deg), star(angle_deg + 360.0));
            let mirrored = star(-angle_deg);
            let expected = Bitmap::from_fn(|j, i| mirrored.contains(j, WORKPIECE_SIZE_PX - 1 - i));
            assert_eq!(star(angle_deg), expected);
        }
    }
}
