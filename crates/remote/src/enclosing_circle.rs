//! The smallest circle round a path.
//!
//! Source: E. Welzl, "Smallest enclosing disks (balls and ellipsoids)", 1991, in the iterative form
//! that restarts at every point outside.

use lasergym_geom::Point;

use crate::BeamPath;
use crate::beam_path::PathPiece;

/// Points by which an arc of a full turn is represented.
const POINTS_PER_TURN: f64 = 360.0;

/// Points nearer to a circle than this part of its radius count as inside.
const TOLERANCE: f64 = 1e-12;

/// A circle on the workpiece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Centre, mm.
    pub center: Point,
    /// Radius, mm, at least 0.
    pub radius_mm: f64,
}

impl Circle {
    /// The smallest circle with all of `path`. Exact for straight pieces and whole circles; where
    /// arcs matter, its radius is at most 1e-4 of itself above the smallest. No point of the path lies
    /// outside.
    #[must_use]
    pub fn enclosing(path: &BeamPath) -> Self {
        if let [PathPiece::Arc { center, radius_mm, sweep_rad, .. }] = *path.pieces()
            && sweep_rad.abs() >= std::f64::consts::TAU - 1e-9
        {
            return Self { center, radius_mm };
        }
        let mut points = vec![path.start()];
        for piece in path.pieces() {
            if let PathPiece::Arc { sweep_rad, .. } = *piece {
                let count = (sweep_rad.abs() / std::f64::consts::TAU * POINTS_PER_TURN).ceil();
                points.extend((1..count as u32).map(|k| piece.at(f64::from(k) / count)));
            }
            points.push(piece.at(1.0));
        }
        let mut circle = Self::of_points(&points);
        for piece in path.pieces() {
            circle.radius_mm = circle.radius_mm.max(piece.farthest_mm(circle.center));
        }
        circle
    }

    /// The smallest circle with all `points`; of radius 0 about the origin where there is none.
    #[must_use]
    pub fn of_points(points: &[Point]) -> Self {
        let mut shuffled = points.to_vec();
        shuffle(&mut shuffled);
        let mut circle =
            Self { center: shuffled.first().copied().unwrap_or_default(), radius_mm: 0.0 };
        for (i, &p) in shuffled.iter().enumerate() {
            if circle.contains(p) {
                continue;
            }
            circle = Self { center: p, radius_mm: 0.0 };
            for (j, &q) in shuffled[..i].iter().enumerate() {
                if circle.contains(q) {
                    continue;
                }
                circle = Self::across(p, q);
                for &r in &shuffled[..j] {
                    if !circle.contains(r) {
                        circle =
                            Self::through(p, q, r).unwrap_or_else(|| Self::spanning([p, q, r]));
                    }
                }
            }
        }
        circle
    }

    fn contains(&self, point: Point) -> bool {
        self.center.distance(point) <= self.radius_mm * (1.0 + TOLERANCE) + f64::MIN_POSITIVE
    }

    /// The circle with `p` and `q` at the ends of a diameter.
    fn across(p: Point, q: Point) -> Self {
        Self { center: (p + q) * 0.5, radius_mm: 0.5 * p.distance(q) }
    }

    /// The circle through three points; none where they lie on a line.
    fn through(p: Point, q: Point, r: Point) -> Option<Self> {
        let (a, b) = (q - p, r - p);
        let twice_area = 2.0 * (a.x * b.y - a.y * b.x);
        let (aa, bb) = (a.x * a.x + a.y * a.y, b.x * b.x + b.y * b.y);
        let arm = Point::new(b.y * aa - a.y * bb, a.x * bb - b.x * aa) * twice_area.recip();
        let radius_mm = arm.length();
        radius_mm.is_finite().then_some(Self { center: p + arm, radius_mm })
    }

    /// The circle across the two of three points that are farthest apart.
    fn spanning([p, q, r]: [Point; 3]) -> Self {
        [Self::across(p, q), Self::across(q, r), Self::across(p, r)]
            .into_iter()
            .max_by(|a, b| a.radius_mm.total_cmp(&b.radius_mm))
            .unwrap_or_else(|| Self::across(p, q))
    }
}

/// Puts points in an order that depends on their number only: in random order the expected time is
/// in proportion to their number.
fn shuffle(points: &mut [Point]) {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    for last in (1..points.len()).rev() {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        points.swap(last, ((state >> 33) as usize) % (last + 1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points() -> impl Strategy<Value = Vec<Point>> {
        let point = (-50.0..50.0, -50.0..50.0).prop_map(|(x, y)| Point::new(x, y));
        proptest::collection::vec(point, 1..14)
    }

    /// The smallest of all circles across two and through three points that hold every point.
    fn brute_force_mm(points: &[Point]) -> f64 {
        let mut candidates = vec![Circle { center: points[0], radius_mm: 0.0 }];
        for (i, &p) in points.iter().enumerate() {
            for (j, &q) in points[..i].iter().enumerate() {
                candidates.push(Circle::across(p, q));
                candidates.extend(points[..j].iter().filter_map(|&r| Circle::through(p, q, r)));
            }
        }
        let holds = |circle: &Circle| {
            points.iter().all(|&p| circle.center.distance(p) <= circle.radius_mm + 1e-7)
        };
        candidates.iter().filter(|c| holds(c)).map(|c| c.radius_mm).fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #[test]
        fn the_circle_is_the_smallest(points in points()) {
            let circle = Circle::of_points(&points);
            for &p in &points {
                prop_assert!(circle.center.distance(p) <= circle.radius_mm + 1e-9);
            }
            let smallest = brute_force_mm(&points);
            prop_assert!((circle.radius_mm - smallest).abs() < 1e-6, "{} {smallest}", circle.radius_mm);
        }

        #[test]
        fn an_arc_lies_within(start_rad in 0.0..6.0, sweep_rad in -6.0..6.0) {
            let center = Point::new(3.0, 4.0);
            let piece = PathPiece::Arc { center, radius_mm: 10.0, start_rad, sweep_rad };
            let circle = Circle::enclosing(&BeamPath::new(vec![piece]).unwrap());
            prop_assert!(piece.farthest_mm(circle.center) <= circle.radius_mm + 1e-9);
            // Up to half a turn the chord is the diameter.
            let half = 0.5 * f64::min(sweep_rad.abs(), std::f64::consts::PI);
            prop_assert!(circle.radius_mm <= 10.0 * half.sin() * (1.0 + 1e-4) + 1e-9);
        }
    }

    #[test]
    fn coinciding_and_collinear_points_are_no_special_case() {
        let same = vec![Point::new(2.0, 3.0); 5];
        assert_eq!(Circle::of_points(&same), Circle { center: same[0], radius_mm: 0.0 });
        let line: Vec<Point> =
            (0..9).map(|k| Point::new(f64::from(k), 2.0 * f64::from(k))).collect();
        let circle = Circle::of_points(&line);
        assert!((circle.radius_mm - 0.5 * line[0].distance(line[8])).abs() < 1e-9);
    }
}
