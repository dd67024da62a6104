//! Filling closed outlines by the pixel-centre rule.

use crate::{Bitmap, Point, WORKPIECE_SIZE_PX, row_mask};

/// The pixels whose centre lies inside `outlines` by the even-odd rule.
///
/// Each outline is a closed polygon (the last vertex joins the first), px. A pixel centre exactly on
/// an edge counts as inside when the interior lies to its right. What leaves the workpiece is lost.
/// Every vertex must be finite; an edge with a vertex that is not finite is left out.
#[must_use]
pub fn fill_even_odd(outlines: &[impl AsRef<[Point]>]) -> Bitmap {
    let mut bitmap = Bitmap::EMPTY;
    for outline in outlines {
        let outline = outline.as_ref();
        let Some(&last) = outline.last() else { continue };
        let mut start = last;
        for &end in outline {
            toggle_right_of_edge(&mut bitmap, start, end);
            start = end;
        }
    }
    bitmap
}

/// Toggles, in every row whose centre line the edge crosses, all pixels whose centre is at or to the
/// right of the crossing. Done for every edge of a closed outline, this leaves the interior set.
#[inline]
fn toggle_right_of_edge(bitmap: &mut Bitmap, start: Point, end: Point) {
    let (upper, lower) = if start.y <= end.y { (start, end) } else { (end, start) };
    let height = lower.y - upper.y;
    if !(height > 0.0 && height < f64::INFINITY) {
        return;
    }
    // The first pixel whose centre is at or beyond `position`; a `u8` takes one instruction.
    let first_beyond =
        |position: f64| (position - 0.5).ceil().clamp(0.0, WORKPIECE_SIZE_PX as f64) as u8;
    // Rows with upper.y <= j + 0.5 < lower.y, so that a shared vertex counts once.
    let (first, end) = (first_beyond(upper.y), first_beyond(lower.y));
    if first >= end {
        return;
    }
    let slope = (lower.x - upper.x) / height;
    let rows = &mut bitmap.rows_mut()[usize::from(first)..usize::from(end)];
    for (row, j) in rows.iter_mut().zip(first..end) {
        let crossing = upper.x + (f64::from(j) + 0.5 - upper.y) * slope;
        *row ^= row_mask(usize::from(first_beyond(crossing)), WORKPIECE_SIZE_PX);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Even-odd rule at one point, by counting crossings of the ray to the left.
    fn inside(polygon: &[Point], x: f64, y: f64) -> bool {
        let mut odd = false;
        for (k, &a) in polygon.iter().enumerate() {
            let b = polygon[(k + 1) % polygon.len()];
            if (a.y <= y) != (b.y <= y) && a.x + (y - a.y) * (b.x - a.x) / (b.y - a.y) <= x {
                odd = !odd;
            }
        }
        odd
    }

    proptest! {
        #[test]
        fn fill_agrees_with_the_ray_test(
            vertices in proptest::collection::vec((-30.0..130.0, -30.0..130.0), 3..12)
        ) {
            let polygon: Vec<Point> = vertices.iter().map(|&(x, y)| Point::new(x, y)).collect();
            let filled = fill_even_odd(&[&polygon]);
            let expected =
                Bitmap::from_fn(|j, i| inside(&polygon, i as f64 + 0.5, j as f64 + 0.5));
            // Rounding may move a centre that lies on an edge to the other side.
            let differing = (0..100)
                .map(|j| (filled.rows()[j] ^ expected.rows()[j]).count_ones())
                .sum::<u32>();
            prop_assert!(differing <= 1, "{differing} pixels differ");
        }
    }

    #[test]
    fn a_hole_is_left_out() {
        let square = |a: f64, b: f64| {
            vec![Point::new(a, a), Point::new(b, a), Point::new(b, b), Point::new(a, b)]
        };
        let ring = fill_even_odd(&[square(10.0, 50.0), square(20.0, 30.0)]);
        assert_eq!(ring.area_px(), 40 * 40 - 10 * 10);
        assert!(!ring.contains(25, 25));
    }

    #[test]
    fn vertices_that_are_not_finite_fill_nothing() {
        let broken = [Point::new(0.0, f64::NAN), Point::new(10.0, 0.0), Point::new(0.0, 10.0)];
        let _ = fill_even_odd(&[broken]);
        assert!(
            fill_even_odd(&[[Point::new(0.0, f64::INFINITY), Point::new(5.0, 0.0)]]).is_empty()
        );
    }
}
