//! Random smooth shapes: seven points joined by Bézier segments (Xie et al. 2022, section 3.3).

use crate::Stream;
use lasergym_geom::{Bitmap, Point, WORKPIECE_SIZE_PX, fill_even_odd};

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

/// Comparators that sort seven values (a sorting network).
const COMPARATORS: [(usize, usize); 16] = [
    (0, 6),
    (2, 3),
    (4, 5),
    (0, 2),
    (1, 4),
    (3, 6),
    (0, 1),
    (2, 5),
    (3, 4),
    (1, 2),
    (4, 6),
    (2, 3),
    (4, 5),
    (1, 2),
    (3, 4),
    (5, 6),
];

/// Bernstein weights of the control points at t = 0, 1/16, …, 15/16.
const WEIGHTS: [[f64; 4]; PIECES] = {
    let mut weights = [[0.0; 4]; PIECES];
    let mut k = 0;
    while k < PIECES {
        let t = k as f64 / PIECES as f64;
        let s = 1.0 - t;
        weights[k] = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
        k += 1;
    }
    weights
};

/// Seven pixel centres, uniform and independent, sorted by angle about their centroid; points at
/// the same angle stay in the order drawn.
fn random_points(stream: &mut Stream) -> [Point; POINTS] {
    let columns_rows: [[i32; 2]; POINTS] = std::array::from_fn(|_| {
        stream.integer_pair_below(WORKPIECE_SIZE_PX as u32).map(u32::cast_signed)
    });
    let sum = |axis: usize| columns_rows.iter().map(|point| point[axis]).sum::<i32>();
    let (sum_x, sum_y) = (sum(0), sum(1));
    let mut order: [u64; POINTS] = std::array::from_fn(|k| {
        let [column, row] = columns_rows[k];
        let count = i32::from(POINTS as u8);
        angle_key(count * column - sum_x, count * row - sum_y) << 3 | k as u64
    });
    for (a, b) in COMPARATORS {
        (order[a], order[b]) = (order[a].min(order[b]), order[a].max(order[b]));
    }
    order.map(|key| {
        let [column, row] = columns_rows[(key & 7) as usize];
        Point::new(f64::from(column) + 0.5, f64::from(row) + 0.5)
    })
}

/// An integer that grows with the angle of (x, y) from −π to π, and is the same for the same angle
/// only. |x| and |y| are below 1000; the angle of (0, 0) is that of (0, 1).
///
/// The angle is measured along a square instead of a circle. Two of these differ by more than
/// 10⁻⁷, and the key has 40 binary places.
#[inline]
fn angle_key(x: i32, y: i32) -> u64 {
    let along = f64::from(x) / f64::from((x.abs() + y.abs()).max(1));
    let angle = if y < 0 { along - 1.0 } else { 1.0 - along };
    ((angle + 2.0) * (1_u64 << 40) as f64) as u64
}

/// The closed outline through `points`.
fn outline(points: &[Point; POINTS]) -> [Point; POINTS * PIECES] {
    let next = |k: usize| (k + 1) % POINTS;
    let chords: [Point; POINTS] = std::array::from_fn(|k| points[next(k)] - points[k]);
    let lengths = chords.map(length);
    let directions: [Point; POINTS] = std::array::from_fn(|k| direction(chords[k], lengths[k]));
    let tangents: [Point; POINTS] = std::array::from_fn(|k| {
        let bisector = directions[(k + POINTS - 1) % POINTS] + directions[k];
        direction(bisector, length(bisector))
    });
    let mut vertices = [Point::default(); POINTS * PIECES];
    for (k, piece) in vertices.chunks_exact_mut(PIECES).enumerate() {
        let handle_px = HANDLE_OVER_CHORD * lengths[k];
        let control = [
            points[k],
            points[k] + tangents[k] * handle_px,
            points[next(k)] - tangents[next(k)] * handle_px,
            points[next(k)],
        ];
        for (vertex, weights) in piece.iter_mut().zip(&WEIGHTS) {
            *vertex = control[0] * weights[0]
                + control[1] * weights[1]
                + control[2] * weights[2]
                + control[3] * weights[3];
        }
    }
    vertices
}

/// Length of a vector by operations that are rounded alike on every machine, px.
#[inline]
fn length(vector: Point) -> f64 {
    (vector.x * vector.x + vector.y * vector.y).sqrt()
}

/// The vector of length 1 in the same direction, or zero for the zero vector.
#[inline]
fn direction(vector: Point, length: f64) -> Point {
    if length > 0.0 { vector * length.recip() } else { Point::default() }
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
    fn vertices_are_those_of_the_bezier_segments() {
        use lasergym_geom::CubicBezier;
        let mut stream = Stream::from_seed(8);
        let points = random_shape(&mut stream).points;
        let vertices = outline(&points);
        for k in 0..POINTS {
            let (start, end) = (points[k], points[(k + 1) % POINTS]);
            let handle_px = HANDLE_OVER_CHORD * start.distance(end);
            let tangent = |k: usize| {
                let before = (points[k] - points[(k + POINTS - 1) % POINTS]).normalized();
                (before + (points[(k + 1) % POINTS] - points[k]).normalized()).normalized()
            };
            let handles = [tangent(k) * handle_px, tangent((k + 1) % POINTS) * handle_px];
            let segment =
                CubicBezier { control: [start, start + handles[0], end - handles[1], end] };
            for (vertex, point) in vertices[k * PIECES..].iter().zip(segment.flatten(16)) {
                assert!(vertex.distance(point) < 1e-12);
            }
        }
    }

    #[test]
    fn keys_order_like_angles() {
        let mut stream = Stream::from_seed(4);
        let mut arm = || stream.integer_pair_below(1401).map(|k| k.cast_signed() - 700);
        for _ in 0..20_000 {
            let ([ax, ay], [bx, by]) = (arm(), arm());
            let angle = |x: i32, y: i32| f64::from(y).atan2(f64::from(x));
            let expected = angle(ax, ay).total_cmp(&angle(bx, by));
            assert_eq!(angle_key(ax, ay).cmp(&angle_key(bx, by)), expected);
            assert_eq!(angle_key(ax / 7, ay / 7), angle_key(ax / 7 * 7, ay / 7 * 7));
        }
    }

    #[test]
    fn the_comparators_sort() {
        // A network that sorts all sequences of 0 and 1 sorts everything.
        for bits in 0..128_u32 {
            let mut values: [u32; POINTS] = std::array::from_fn(|k| bits >> k & 1);
            for (a, b) in COMPARATORS {
                (values[a], values[b]) = (values[a].min(values[b]), values[a].max(values[b]));
            }
            assert!(values.is_sorted());
        }
    }

    #[test]
    fn coinciding_points_are_no_special_case() {
        let point = Point::new(20.5, 30.5);
        assert!(fill_even_odd(&[outline(&[point; POINTS])]).is_empty());
    }
}
