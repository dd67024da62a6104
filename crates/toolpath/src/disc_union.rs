//! The outline of overlapping discs.

use std::f64::consts::{PI, TAU};

use lasergym_geom::Point;

use crate::Pulse;

/// A piece of a circle, in the sense from x to y (clockwise on the screen).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Arc {
    /// Centre, px.
    pub(crate) center: Point,
    /// Radius, px.
    pub(crate) radius_px: f64,
    /// Direction from the centre to the start, rad.
    pub(crate) start_rad: f64,
    /// Angle from start to end, rad, in (0, 2π]; 2π is the whole circle.
    pub(crate) sweep_rad: f64,
}

impl Arc {
    /// The point after `sweep_rad` from the start, px.
    pub(crate) fn point(&self, sweep_rad: f64) -> Point {
        let (sin, cos) = (self.start_rad + sweep_rad).sin_cos();
        self.center + Point::new(cos, sin) * self.radius_px
    }
}

/// The parts of the discs' circles that lie inside no other disc.
pub(crate) fn outline(discs: &[Pulse]) -> Vec<Arc> {
    let mut arcs = Vec::new();
    for (k, disc) in discs.iter().enumerate() {
        let Some(mut covered) = covered_intervals(discs, k) else { continue };
        covered.sort_by(|a, b| a.0.total_cmp(&b.0));
        let arc = |start_rad: f64, sweep_rad: f64| Arc {
            center: disc.position_px,
            radius_px: disc.radius_px,
            start_rad,
            sweep_rad,
        };
        if covered.is_empty() {
            arcs.push(arc(0.0, TAU));
        }
        // The interval that ends last may reach round to the first ones.
        let mut end = covered.iter().fold(f64::NEG_INFINITY, |last, &(_, end)| last.max(end)) - TAU;
        for (start, next_end) in covered {
            if start - end > 1e-9 {
                arcs.push(arc(end, start - end));
            }
            end = end.max(next_end);
        }
    }
    arcs
}

/// Intervals of direction (start in [−π, π), end at most 2π later), rad, in which the circle of disc
/// `k` lies inside another disc; none when the whole disc does.
fn covered_intervals(discs: &[Pulse], k: usize) -> Option<Vec<(f64, f64)>> {
    let Pulse { position_px: center, radius_px: radius } = discs[k];
    let mut intervals = Vec::new();
    for (other_k, other) in discs.iter().enumerate().filter(|&(other_k, _)| other_k != k) {
        let arm = other.position_px - center;
        let distance = arm.length();
        if distance + radius <= other.radius_px && (radius < other.radius_px || other_k < k) {
            return None;
        }
        if distance >= radius + other.radius_px
            || distance + other.radius_px <= radius
            || distance <= 0.0
        {
            continue;
        }
        let cos = (distance * distance + radius * radius - other.radius_px * other.radius_px)
            / (2.0 * distance * radius);
        let half = cos.clamp(-1.0, 1.0).acos();
        let mut start = arm.y.atan2(arm.x) - half;
        if start < -PI {
            start += TAU;
        }
        intervals.push((start, start + 2.0 * half));
    }
    Some(intervals)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn disc(x: f64, y: f64, radius_px: f64) -> Pulse {
        Pulse { position_px: Point::new(x, y), radius_px }
    }

    /// Area enclosed by the arcs by Green's theorem, ½ ∮ x dy − y dx, px².
    fn enclosed_area(arcs: &[Arc]) -> f64 {
        let area = |arc: &Arc| {
            let (start, end) = (arc.point(0.0) - arc.center, arc.point(arc.sweep_rad) - arc.center);
            let chord = end - start;
            0.5 * (arc.center.x * chord.y - arc.center.y * chord.x
                + arc.radius_px * arc.radius_px * arc.sweep_rad)
        };
        arcs.iter().map(area).sum()
    }

    /// Area of the union by counting points of a grid, px².
    fn counted_area(discs: &[Pulse]) -> f64 {
        let step = 0.1;
        let inside = |x: f64, y: f64| {
            discs.iter().any(|d| d.position_px.distance(Point::new(x, y)) <= d.radius_px)
        };
        let at = |k: i32| -15.0 + (f64::from(k) + 0.5) * step;
        let count =
            (0..700).map(|j| (0..700).filter(|&i| inside(at(i), at(j))).count()).sum::<usize>();
        count as f64 * step * step
    }

    fn any_discs() -> impl Strategy<Value = Vec<Pulse>> {
        let position = prop_oneof![0.0..40.0, (0_u8..9).prop_map(|k| 5.0 * f64::from(k))];
        let radius = prop_oneof![Just(9.0), 1.0..12.0];
        proptest::collection::vec((position.clone(), position, radius), 1..12)
            .prop_map(|discs| discs.into_iter().map(|(x, y, r)| disc(x, y, r)).collect())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn the_outline_encloses_the_union(discs in any_discs()) {
            let enclosed = enclosed_area(&outline(&discs));
            let counted = counted_area(&discs);
            prop_assert!((enclosed - counted).abs() < 0.01 * counted + 1.0, "{enclosed} {counted}");
        }

        #[test]
        fn no_arc_runs_inside_a_disc(discs in any_discs()) {
            for arc in outline(&discs) {
                for part in [0.1, 0.5, 0.9] {
                    let point = arc.point(part * arc.sweep_rad);
                    for other in &discs {
                        prop_assert!(
                            other.position_px.distance(point) >= other.radius_px - 1e-9
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn discs_apart_keep_their_whole_circles() {
        let arcs = outline(&[disc(0.0, 0.0, 9.0), disc(20.0, 0.0, 9.0)]);
        assert!(arcs.len() == 2 && arcs.iter().all(|arc| arc.sweep_rad >= TAU));
    }

    #[test]
    fn equal_discs_are_outlined_once() {
        assert_eq!(outline(&[disc(3.0, 4.0, 9.0); 3]).len(), 1);
        assert_eq!(outline(&[disc(3.0, 4.0, 9.0), disc(3.0 + 1e-16, 4.0, 9.0)]).len(), 1);
        assert_eq!(outline(&[]), []);
    }

    #[test]
    fn a_disc_within_another_is_hidden() {
        let arcs = outline(&[disc(1.0, 0.0, 2.0), disc(0.0, 0.0, 9.0)]);
        assert_eq!(arcs.len(), 1);
        assert!(arcs[0].radius_px > 8.0);
    }
}
