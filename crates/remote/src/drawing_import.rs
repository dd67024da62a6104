//! Curves of drawings as beam paths.

use std::f64::consts::TAU;

use lasergym_geom::Point;

use crate::enclosing_circle::Circle;
use crate::{BeamPath, PathPiece};

/// A closed curve whose points are this near to a circle, as a part of its radius, is that circle:
/// Bézier circles of drawings leave theirs by 0.03 %.
const ROUND: f64 = 5e-4;

/// Fewest points of such a curve.
const FEWEST_ROUND: usize = 16;

/// The path of a polyline; a circle where it is one.
///
/// # Errors
/// As [`BeamPath::new`].
pub(crate) fn beam_path_of(points: &[Point]) -> Result<BeamPath, String> {
    match as_circle(points) {
        Some(circle) => circle,
        None => BeamPath::polyline(points),
    }
}

fn as_circle(points: &[Point]) -> Option<Result<BeamPath, String>> {
    let (&first, &last) = points.first().zip(points.last())?;
    if points.len() < FEWEST_ROUND {
        return None;
    }
    let circle = Circle::of_points(points);
    let radius_mm = circle.radius_mm;
    let near = |p: &Point| (p.distance(circle.center) - radius_mm).abs() <= ROUND * radius_mm;
    if !(first.distance(last) <= ROUND * radius_mm && points.iter().all(near)) {
        return None;
    }
    // Once round, always the same way.
    let turns: Vec<f64> = points
        .windows(2)
        .map(|pair| {
            let (a, b) = (pair[0] - circle.center, pair[1] - circle.center);
            (a.x * b.y - a.y * b.x).atan2(a.x * b.x + a.y * b.y)
        })
        .collect();
    let sweep: f64 = turns.iter().sum();
    let forward = sweep.signum();
    let steady = turns.iter().all(|turn| turn * forward > -1e-6);
    if !steady || (sweep.abs() - TAU).abs() > 0.01 {
        return None;
    }
    let arm = first - circle.center;
    Some(BeamPath::new(vec![PathPiece::Arc {
        center: circle.center,
        radius_mm,
        start_rad: arm.y.atan2(arm.x),
        sweep_rad: forward * TAU,
    }]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(count: u32, ratio: f64) -> Vec<Point> {
        let at = |k: u32| {
            let (sin, cos) = (TAU * f64::from(k % count) / f64::from(count)).sin_cos();
            Point::new(50.0 + 10.0 * cos, 20.0 - 10.0 * ratio * sin)
        };
        (0..=count).map(at).collect()
    }

    #[test]
    fn a_ring_of_points_is_a_circle() {
        let path = beam_path_of(&ring(90, 1.0)).unwrap();
        assert_eq!(path.pieces().len(), 1);
        assert!((path.length_mm() - 10.0 * TAU).abs() < 1e-9);
        assert!(path.is_closed());
    }

    #[test]
    fn an_ellipse_and_a_polygon_stay_what_they_are() {
        assert_eq!(beam_path_of(&ring(90, 0.9)).unwrap().pieces().len(), 90);
        assert_eq!(beam_path_of(&ring(6, 1.0)).unwrap().pieces().len(), 6);
    }
}
