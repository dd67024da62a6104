//! The border of a bitmap as closed polygons.

use lasergym_geom::{Bitmap, Point, WORKPIECE_SIZE_PX};

/// Number of pixel corners along one side.
const CORNERS: usize = WORKPIECE_SIZE_PX + 1;

/// Directions along the border as (columns, rows): right, down, left, up; each a right turn (on the
/// screen) from the one before.
const STEPS: [(isize, isize); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];

/// Polygons along pixel edges, the set on their right (clockwise around the set, counterclockwise
/// around a hole), which [`lasergym_geom::fill_even_odd`] fills to `bitmap` again.
///
/// Vertices lie at corners only. Pixels that touch at a corner only get polygons of their own.
pub(crate) fn outlines(bitmap: &Bitmap) -> Vec<Vec<Point>> {
    let mut border = Border::of(bitmap);
    let mut outlines = Vec::new();
    for corner in 0..CORNERS * CORNERS {
        while let Some(direction) = (0..4).find(|&direction| border.leaves(corner, direction)) {
            outlines.push(border.trace(corner, direction));
        }
    }
    outlines
}

/// For each pixel corner, row by row, the directions in which border edges leave it, one bit each.
struct Border(Vec<u8>);

impl Border {
    fn of(bitmap: &Bitmap) -> Self {
        let mut border = Self(vec![0; CORNERS * CORNERS]);
        for (j, i) in bitmap.pixels() {
            let corner = j * CORNERS + i;
            let right = bitmap.contains(j, i + 1);
            let below = bitmap.contains(j + 1, i);
            let left = i > 0 && bitmap.contains(j, i - 1);
            let above = j > 0 && bitmap.contains(j - 1, i);
            // Clockwise: along the top to the right, down the right side, and so on.
            border.0[corner] |= u8::from(!above);
            border.0[corner + 1] |= u8::from(!right) << 1;
            border.0[corner + CORNERS + 1] |= u8::from(!below) << 2;
            border.0[corner + CORNERS] |= u8::from(!left) << 3;
        }
        border
    }

    fn leaves(&self, corner: usize, direction: usize) -> bool {
        self.0[corner] >> direction & 1 == 1
    }

    /// Follows the border from `start` back to `start`, taking its edges away.
    fn trace(&mut self, start: usize, mut direction: usize) -> Vec<Point> {
        let mut outline = Vec::new();
        let mut corner = start;
        let first_direction = direction;
        loop {
            self.0[corner] &= !(1 << direction);
            let (columns, rows) = STEPS[direction];
            corner = corner.wrapping_add_signed(rows * CORNERS.cast_signed() + columns);
            // The right turn first keeps pixels apart that touch at a corner only.
            let turns = [1, 0, 3].map(|turn| (direction + turn) % 4);
            let next = turns.into_iter().find(|&turn| self.leaves(corner, turn));
            if next != Some(direction) && (next.is_some() || direction != first_direction) {
                outline.push(Point::new((corner % CORNERS) as f64, (corner / CORNERS) as f64));
            }
            match next {
                Some(turn) => direction = turn,
                None => return outline,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_geom::fill_even_odd;
    use proptest::prelude::*;

    fn perimeter(bitmap: &Bitmap) -> usize {
        let inside = |j: isize, i: isize| {
            j >= 0 && i >= 0 && bitmap.contains(j.unsigned_abs(), i.unsigned_abs())
        };
        let neighbours = |(j, i): (usize, usize)| {
            let (j, i) = (j.cast_signed(), i.cast_signed());
            [(j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)]
        };
        bitmap.pixels().flat_map(neighbours).filter(|&(j, i)| !inside(j, i)).count()
    }

    fn check(bitmap: &Bitmap) {
        let outlines = outlines(bitmap);
        assert!(fill_even_odd(&outlines) == *bitmap);
        let mut length = 0.0;
        for outline in &outlines {
            for (k, &end) in outline.iter().enumerate() {
                let start = outline[(k + outline.len() - 1) % outline.len()];
                let after = outline[(k + 1) % outline.len()];
                // Every edge is axis-parallel and every vertex a corner.
                let vertical = |from: Point, to: Point| (from.x - to.x).abs() < 0.5;
                let horizontal = |from: Point, to: Point| (from.y - to.y).abs() < 0.5;
                assert!(vertical(start, end) != horizontal(start, end));
                assert!(vertical(start, end) == horizontal(end, after));
                length += start.distance(end);
            }
        }
        assert_eq!(length as usize, perimeter(bitmap));
    }

    proptest! {
        #[test]
        fn filling_the_outlines_gives_the_bitmap(
            pixels in proptest::collection::hash_set((0_usize..100, 0_usize..100), 0..300),
            holes in any::<bool>()
        ) {
            check(&Bitmap::from_fn(|j, i| pixels.contains(&(j, i)) != holes));
        }

        #[test]
        fn crowded_pixels_are_followed_too(bits in any::<[u8; 8]>()) {
            check(&Bitmap::from_fn(|j, i| j < 8 && i < 8 && bits[j] >> i & 1 == 1));
        }
    }

    #[test]
    fn a_rectangle_has_four_vertices() {
        let outlines = outlines(&Bitmap::full());
        assert_eq!(outlines.len(), 1);
        assert_eq!(outlines[0].len(), 4);
    }
}
