//! Curves of DXF entities as polylines, drawing units, y up.
//!
//! Arcs are cut into chords of 1° and at least [`MIN_CHORDS`], spline spans into [`SPAN_CHORDS`].
//! On a drawing fitted to the workpiece the chords leave their curve by less than 0.02 px.

use std::f64::consts::PI;

/// Fewest chords of an arc: shallow arcs of large radius stay round.
const MIN_CHORDS: f64 = 32.0;

/// Chords of each span of a spline.
const SPAN_CHORDS: u32 = 128;

/// Highest degree of a spline.
pub(crate) const MAX_DEGREE: usize = 25;

/// The arc of an ellipse about `centre` with half axes `major` and `minor` (vectors), from
/// parameter `start` to `end`, rad: `centre + cos t · major + sin t · minor`.
pub(crate) fn ellipse_arc(
    centre: [f64; 2],
    major: [f64; 2],
    minor: [f64; 2],
    start: f64,
    end: f64,
) -> Vec<[f64; 2]> {
    let chords = (end - start).abs().to_degrees().min(360.0).ceil().max(MIN_CHORDS) as u32;
    (0..=chords)
        .map(|k| {
            let (sin, cos) = (start + (end - start) * f64::from(k) / f64::from(chords)).sin_cos();
            [0, 1].map(|axis| centre[axis] + cos * major[axis] + sin * minor[axis])
        })
        .collect()
}

/// A polyline whose vertices are (x, y, bulge). A bulge is the tangent of a quarter of the angle of
/// the arc to the next vertex, positive counterclockwise, 0 for a straight line.
pub(crate) fn bulged_polyline(vertices: &[[f64; 3]], closed: bool) -> Vec<[f64; 2]> {
    let mut points = Vec::with_capacity(vertices.len() + 1);
    let ends = vertices.iter().skip(1).chain(vertices.first().filter(|_| closed));
    for (&[x, y, bulge], &[end_x, end_y, _]) in vertices.iter().zip(ends) {
        points.push([x, y]);
        let (dx, dy) = (end_x - x, end_y - y);
        // Below this the arc leaves its chord by less than its length / 10⁹.
        if bulge.abs() > 1e-9 && dx.hypot(dy) > 0.0 {
            // The centre lies on the chord's bisector, (1 − b²) / (4 b) chords to its left.
            let aside = (1.0 - bulge * bulge) / (4.0 * bulge);
            let centre = [x + 0.5 * dx - aside * dy, y + 0.5 * dy + aside * dx];
            let arm = [x - centre[0], y - centre[1]];
            let arc = ellipse_arc(centre, arm, [-arm[1], arm[0]], 0.0, 4.0 * bulge.atan());
            points.extend(&arc[1..arc.len() - 1]);
        }
    }
    let last = if closed { vertices.first() } else { vertices.last() };
    points.extend(last.map(|&[x, y, _]| [x, y]));
    points
}

/// A non-uniform rational B-spline.
#[derive(Debug, Clone)]
pub(crate) struct Spline {
    /// Degree, 1…[`MAX_DEGREE`].
    pub(crate) degree: usize,
    /// Knots in ascending order; one more than control points and degree together.
    pub(crate) knots: Vec<f64>,
    /// Control points (x, y) with their weight, more than the degree.
    pub(crate) control: Vec<[f64; 3]>,
}

impl Spline {
    /// The reason for which this is no spline, if there is one.
    pub(crate) fn problem(&self) -> Option<&'static str> {
        if !(1..=MAX_DEGREE).contains(&self.degree) {
            return Some("has a degree outside 1 to 25");
        }
        if self.control.len() <= self.degree {
            return Some("has no more control points than its degree");
        }
        if self.knots.len() != self.control.len() + self.degree + 1 {
            return Some("has not as many knots as control points and degree ask for");
        }
        if self.knots.windows(2).any(|pair| pair[0] > pair[1]) {
            return Some("has knots that descend");
        }
        if self.control.iter().any(|control| control[2] <= 0.0) {
            return Some("has a weight that is not positive");
        }
        None
    }

    /// Number of points that [`Self::flatten`] gives, at most.
    pub(crate) fn points(&self) -> usize {
        (self.control.len() - self.degree) * SPAN_CHORDS as usize + 1
    }

    /// The points of a spline without [`Self::problem`].
    pub(crate) fn flatten(&self) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        for span in self.degree..self.control.len() {
            let (start, end) = (self.knots[span], self.knots[span + 1]);
            if end <= start {
                continue;
            }
            let first = u32::from(!points.is_empty());
            points.extend((first..=SPAN_CHORDS).map(|k| {
                let share = f64::from(k) / f64::from(SPAN_CHORDS);
                self.at(span, start + (end - start) * share)
            }));
        }
        points
    }

    /// The point at parameter `t` of the span that begins at knot `span`, by de Boor's algorithm.
    fn at(&self, span: usize, t: f64) -> [f64; 2] {
        let degree = self.degree;
        let mut level: Vec<[f64; 3]> = self.control[span - degree..=span]
            .iter()
            .map(|&[x, y, weight]| [x * weight, y * weight, weight])
            .collect();
        for step in 1..=degree {
            for k in (step..=degree).rev() {
                let left = self.knots[span - degree + k];
                let right = self.knots[span + 1 + k - step];
                let share = if right > left { (t - left) / (right - left) } else { 0.0 };
                level[k] = [0, 1, 2]
                    .map(|axis| level[k - 1][axis] * (1.0 - share) + level[k][axis] * share);
            }
        }
        let [x, y, weight] = level[degree];
        [x / weight, y / weight]
    }
}

/// The angle from `start` counterclockwise to `end`, in (0, 2π], rad.
pub(crate) fn counterclockwise(start: f64, end: f64) -> f64 {
    let sweep = (end - start).rem_euclid(2.0 * PI);
    if sweep > 1e-9 { sweep } else { 2.0 * PI }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bulges_lie_on_the_arc_of_their_angle(
            x in -5.0..5.0, y in -5.0..5.0, bulge in prop_oneof![-3.0..-0.01, 0.01..3.0]
        ) {
            prop_assume!(f64::hypot(x, y) > 0.1);
            let points = bulged_polyline(&[[0.0, 0.0, bulge], [x, y, 0.0]], false);
            // Height of the arc over its chord: half the chord times the bulge, to its right.
            let chord = f64::hypot(x, y);
            let apex = [
                0.5 * x + 0.5 * bulge * y,
                0.5 * y - 0.5 * bulge * x,
            ];
            let sagitta = 0.5 * chord * bulge.abs();
            let radius = (0.25 * chord * chord + sagitta * sagitta) / (2.0 * sagitta);
            let closest = points
                .iter()
                .map(|p| (p[0] - apex[0]).hypot(p[1] - apex[1]))
                .fold(f64::INFINITY, f64::min);
            prop_assert!(closest < 0.05 * radius, "{closest}");
        }

        #[test]
        fn a_bezier_spline_agrees_with_the_bernstein_form(
            control in proptest::array::uniform4((-9.0..9.0, -9.0..9.0))
        ) {
            let spline = Spline {
                degree: 3,
                knots: vec![0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0],
                control: control.iter().map(|&(x, y)| [x, y, 1.0]).collect(),
            };
            prop_assert_eq!(spline.problem(), None);
            let curve =
                crate::CubicBezier { control: control.map(|(x, y)| crate::Point::new(x, y)) };
            for (k, point) in spline.flatten().iter().enumerate() {
                let expected = curve.at(k as f64 / f64::from(SPAN_CHORDS));
                prop_assert!((point[0] - expected.x).hypot(point[1] - expected.y) < 1e-9);
            }
        }
    }

    #[test]
    fn a_rational_quadratic_draws_a_quarter_circle() {
        let spline = Spline {
            degree: 2,
            knots: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            control: vec![[1.0, 0.0, 1.0], [1.0, 1.0, 0.5_f64.sqrt()], [0.0, 1.0, 1.0]],
        };
        for [x, y] in spline.flatten() {
            assert!((x.hypot(y) - 1.0).abs() < 1e-12);
        }
    }
}
