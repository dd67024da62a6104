//! Random smooth shapes: seven points joined by Bézier segments (Xie et al. 2022, section 3.3).

use crate::Stream;
use lasergym_geom::{Bitmap, CubicBezier, Point, WORKPIECE_SIZE_PX, fill_even_odd};

/// Points that a shape passes through.
const POINTS: usize = 7;

/// Length of a Bézier handle over the length of its chord.
const HANDLE_OVER_CHORD: f64 = 0.2;

/// Straight pieces that stand for one Bézier segment; its outline is off by less than 0.1 px.
const PIECES: usize = 16;

/// Shapes with fewer pixels are drawn again.
const MIN_AREA_PX: u32 = 3000;

/// A random shape and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct RandomShape {
    /// The filled shape.
    pub target: Bitmap,
    /// The points that its outline passes through, in order, px.
    pub points: [Point; POINTS],
    /// Shapes that were drawn until one was large enough, this one included.
    pub draws: u32,
}

/// Draws shapes until one has at least 3000 px; about 0.6 of them have.
///
/// Seven pixel centres, uniform on the workpiece, are sorted by angle about their centroid and
/// joined by cubic Bézier segments. The tangent at a point bisects its two chords, the handles are
/// 0.2 × chord, and the inside follows the even-odd rule.
pub fn random_shape(stream: &mut Stream) -> RandomShape {
    let mut draws = 0;
    loop {
        draws += 1;
        let points = random_points(stream);
        let target = fill_even_odd(&[outline(&points)]);
        if target.area_px() >= MIN_AREA_PX {
            return RandomShape { target, points, draws };
        }
    }
}

/// Seven pixel centres, uniform and independent, sorted by angle about their centroid.
fn random_points(stream: &mut Stream) -> [Point; POINTS] {
    let points: [Point; POINTS] = std::array::from_fn(|_| {
        let [column, row] = stream.integer_pair_below(WORKPIECE_SIZE_PX as u32);
        Point::new(f64::from(column) + 0.5, f64::from(row) + 0.5)
    });
    let sum = points.iter().fold(Point::default(), |sum, &point| sum + point);
    let centroid = Point::new(sum.x / POINTS as f64, sum.y / POINTS as f64);
    let mut order = points.map(|point| {
        let arm = point - centroid;
        (arm.y.atan2(arm.x), point)
    });
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.map(|(_, point)| point)
}

/// The closed outline through `points`.
fn outline(points: &[Point; POINTS]) -> [Point; POINTS * PIECES] {
    let next = |k: usize| (k + 1) % POINTS;
    let chords: [Point; POINTS] = std::array::from_fn(|k| points[next(k)] - points[k]);
    let directions = chords.map(Point::normalized);
    let tangents: [Point; POINTS] = std::array::from_fn(|k| {
        (directions[(k + POINTS - 1) % POINTS] + directions[k]).normalized()
    });
    let mut vertices = [Point::default(); POINTS * PIECES];
    for (k, piece) in vertices.chunks_exact_mut(PIECES).enumerate() {
        let handle_px = HANDLE_OVER_CHORD * chords[k].length();
        let segment = CubicBezier {
            control: [
                points[k],
                points[k] + tangents[k] * handle_px,
                points[next(k)] - tangents[next(k)] * handle_px,
                points[next(k)],
            ],
        };
        for (vertex, point) in piece.iter_mut().zip(segment.flatten(PIECES as u32)) {
            *vertex = point;
        }
    }
    vertices
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_large_enough_and_six_of_ten_are_kept() {
        let mut stream = Stream::from_seed(3);
        let (mut kept, mut drawn) = (0, 0);
        for _ in 0..3000 {
            let shape = random_shape(&mut stream);
            assert!(shape.target.area_px() >= MIN_AREA_PX);
            kept += 1;
            drawn += shape.draws;
        }
        let acceptance = f64::from(kept) / f64::from(drawn);
        assert!((0.55..0.65).contains(&acceptance), "{acceptance}");
    }

    #[test]
    fn the_outline_passes_through_its_points_and_turns_smoothly() {
        let mut stream = Stream::from_seed(5);
        for _ in 0..200 {
            let shape = random_shape(&mut stream);
            let vertices = outline(&shape.points);
            for (k, &point) in shape.points.iter().enumerate() {
                assert!(vertices[k * PIECES].distance(point) < 1e-12);
            }
        }
    }

    #[test]
    fn coinciding_points_are_no_special_case() {
        let point = Point::new(20.5, 30.5);
        assert!(fill_even_odd(&[outline(&[point; POINTS])]).is_empty());
    }
}
