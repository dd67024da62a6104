//! Cubic Bézier segments.

use crate::Point;

/// A cubic Bézier segment with control points in order, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CubicBezier {
    /// Start, two handles, end.
    pub control: [Point; 4],
}

impl CubicBezier {
    /// The point at parameter `t` in [0, 1], by the Bernstein form.
    #[must_use]
    #[inline]
    pub fn at(&self, t: f64) -> Point {
        let s = 1.0 - t;
        let [p0, p1, p2, p3] = self.control;
        p0 * (s * s * s) + p1 * (3.0 * s * s * t) + p2 * (3.0 * s * t * t) + p3 * (t * t * t)
    }

    /// The points at `t = 0, 1/n, …, (n − 1)/n`: a polyline without its last point, so that closed
    /// outlines are joined segment by segment.
    pub fn flatten(&self, n: u32) -> impl Iterator<Item = Point> + '_ {
        let step = f64::from(n).recip();
        (0..n).map(move |k| self.at(f64::from(k) * step))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_segment_stays_on_its_chord() {
        let at = |k: f64| Point::new(3.0 * k, 6.0 * k);
        let curve = CubicBezier { control: [at(0.0), at(1.0), at(2.0), at(3.0)] };
        for (k, point) in curve.flatten(8).enumerate() {
            assert!(point.distance(at(3.0 * k as f64 / 8.0)) < 1e-12);
        }
    }
}
