//! Jobs of a laser as vectors: jumps, marks and arcs.

use lasergym_geom::Point;

/// Largest coordinate of a vector, µm: ten metres.
pub const MAX_VECTOR_UM: f64 = 1e7;

/// One step of a job. Positions are µm, x right and y up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VectorStep {
    /// To a place with the laser off.
    Jump {
        /// The place.
        to_um: Point,
    },
    /// Straight to a place with the laser on.
    Mark {
        /// The place.
        to_um: Point,
        /// Speed, m/s, above 0; none where the job gives none.
        speed_m_s: Option<f64>,
    },
    /// Along an arc with the laser on.
    Arc {
        /// Its end; where it is the start, the arc is a full circle.
        to_um: Point,
        /// Its centre.
        center_um: Point,
        /// Whether it turns from x towards y, with y up.
        counterclockwise: bool,
        /// Speed, m/s, above 0; none where the job gives none.
        speed_m_s: Option<f64>,
    },
    /// One pulse at a place.
    Pulse {
        /// The place.
        at_um: Point,
    },
    /// To another height; the head stands still.
    Layer {
        /// The height, µm.
        z_um: f64,
    },
}

/// The ends of chords that follow an arc from `from` to `to` about `center`, none farther from it
/// than `tolerance_um` (above 0); the last is exactly `to`.
pub fn arc_chords(
    from: Point,
    to: Point,
    center: Point,
    counterclockwise: bool,
    tolerance_um: f64,
) -> impl Iterator<Item = Point> {
    let (begin, end) = (from - center, to - center);
    let radius = begin.length();
    let mut sweep = end.y.atan2(end.x) - begin.y.atan2(begin.x);
    let full = std::f64::consts::TAU;
    // Ends closer than a nanometre are one: a full circle.
    if from.distance(to) < 1e-3 {
        sweep = full;
    } else if counterclockwise {
        sweep = sweep.rem_euclid(full);
    } else {
        sweep = (-sweep).rem_euclid(full);
    }
    let sign = if counterclockwise { 1.0 } else { -1.0 };
    // A chord over the angle a stays within r (1 − cos(a/2)) of its arc.
    let cosine = (1.0 - tolerance_um / radius.max(tolerance_um)).clamp(-1.0, 1.0);
    let widest = 2.0 * cosine.acos().max(1e-4);
    let count = (sweep / widest).ceil().clamp(1.0, 1e6) as u32;
    (1..=count).map(move |k| {
        if k == count {
            return to;
        }
        let angle = sign * sweep * f64::from(k) / f64::from(count);
        // Radii that differ by rounding at both ends are blended.
        let scale =
            1.0 + (end.length() / radius.max(1e-12) - 1.0) * f64::from(k) / f64::from(count);
        center + begin.rotated_about(Point::default(), angle) * scale
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn chords_stay_near_their_arc(
            radius in 1.0..1e4_f64, start in 0.0..6.2_f64, sweep in 0.01..6.27_f64,
            counterclockwise: bool, tolerance in 0.01..1.0_f64,
        ) {
            let center = Point::new(7.0, -3.0);
            let on = |angle: f64| center + Point::new(angle.cos(), angle.sin()) * radius;
            let end = if counterclockwise { start + sweep } else { start - sweep };
            let (from, to) = (on(start), on(end));
            prop_assume!(from.distance(to) > 0.01);
            let ends: Vec<Point> =
                arc_chords(from, to, center, counterclockwise, tolerance).collect();
            prop_assert_eq!(ends[ends.len() - 1], to);
            let (mut at, mut length) = (from, 0.0);
            for &next in &ends {
                let middle = (at + next) * 0.5;
                prop_assert!((middle.distance(center) - radius).abs() <= tolerance + 1e-6);
                length += at.distance(next);
                at = next;
            }
            prop_assert!(length <= radius * sweep + 1e-6);
            prop_assert!(length > 0.6 * radius * sweep);
        }
    }

    #[test]
    fn an_arc_that_ends_where_it_starts_is_a_circle() {
        let from = Point::new(10.0, 0.0);
        let length: f64 = arc_chords(from, from, Point::default(), true, 1e-3)
            .scan(from, |at, next| {
                let step = at.distance(next);
                *at = next;
                Some(step)
            })
            .sum();
        assert!((length - std::f64::consts::TAU * 10.0).abs() < 0.1);
    }
}
