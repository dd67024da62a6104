//! Lines of the robot, and the search for the best one.

use std::f64::consts::{PI, TAU};

use lasergym_geom::Point;

use crate::ScanCircle;
use crate::line_functions::{LineFunctions, Merit, SpeedRange, golden_section};

/// Iterations of offset searches that compare directions.
const COARSE: u32 = 26;

/// Iterations of the search between sampled directions.
const BETWEEN: u32 = 22;

/// A line whose time exceeds its lower bound by no more than this part is not improved further.
const GOOD_ENOUGH: f64 = 1e-9;

/// How directions are searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DirectionSearch {
    /// Directions of a full turn that are tried, at least 4: the systematic sampling of the paper.
    /// Those that cannot cross the scan circles in order are passed over.
    pub samples: u32,
    /// Most of them that are tried, evenly spread, at least 2.
    pub most: u32,
    /// Whether to try the direction from the first centre to the last, and to search between the best
    /// sample and its neighbours.
    pub refine: bool,
}

impl Default for DirectionSearch {
    /// Every degree, and between them.
    fn default() -> Self {
        Self { samples: 360, most: 360, refine: true }
    }
}

impl DirectionSearch {
    /// Few directions: what the choice of lines goes by before each is searched in full.
    pub const QUICK: Self = Self { samples: 360, most: 9, refine: true };
}

/// A straight line of the robot with constant speed, on which stops are processed in order.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotLine {
    /// Direction, from x towards y, rad.
    pub direction_rad: f64,
    /// Offset from the origin to the right of the direction, mm.
    pub offset_mm: f64,
    /// Speed, mm/s.
    pub speed_mm_s: f64,
    /// Where the first process begins, along the direction, mm.
    pub start_mm: f64,
    /// Where the last one ends, along the direction, mm.
    pub end_mm: f64,
    /// Where each process begins and ends, along the direction, mm.
    pub sections_mm: Vec<(f64, f64)>,
}

impl RobotLine {
    /// The line of a direction and an offset at its highest possible speed; none where the stops
    /// cannot be processed on it.
    #[must_use]
    pub fn at(
        stops: &[ScanCircle],
        direction_rad: f64,
        offset_mm: f64,
        speeds: SpeedRange,
        jump_s: f64,
    ) -> Option<Self> {
        let functions = LineFunctions::new(stops, direction_rad, jump_s);
        let feasible = functions.merit(offset_mm, speeds).is_feasible();
        let speed_mm_s = functions.speed_mm_s(offset_mm, speeds);
        let sections_mm = functions.sections_mm(offset_mm, speed_mm_s).filter(|_| feasible)?;
        Some(Self {
            direction_rad,
            offset_mm,
            speed_mm_s,
            start_mm: functions.start_mm(offset_mm, speed_mm_s)?,
            end_mm: functions.end_mm(offset_mm, speed_mm_s)?,
            sections_mm,
        })
    }

    /// The best line of a direction.
    #[must_use]
    pub fn along(
        stops: &[ScanCircle],
        direction_rad: f64,
        speeds: SpeedRange,
        jump_s: f64,
    ) -> Option<Self> {
        let functions = LineFunctions::new(stops, direction_rad, jump_s);
        let offset_mm = functions.best_offset_mm(speeds)?;
        Self::at(stops, direction_rad, offset_mm, speeds, jump_s)
    }

    /// The best line for `stops` in this order; none where there is no line for all of them.
    #[must_use]
    pub fn best(
        stops: &[ScanCircle],
        speeds: SpeedRange,
        jump_s: f64,
        search: DirectionSearch,
    ) -> Option<Self> {
        let mut functions = LineFunctions::default();
        let direction_rad = best_direction(stops, speeds, jump_s, search, &mut functions)?.0;
        Self::along(stops, direction_rad, speeds, jump_s)
    }

    /// Its length, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.end_mm - self.start_mm
    }

    /// Its time, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.length_mm() / self.speed_mm_s
    }

    /// The place at y along the line, mm.
    #[must_use]
    pub fn place(&self, y_mm: f64) -> Point {
        LineFunctions::place(self.direction_rad, self.offset_mm, y_mm)
    }
}

/// Speeds that all `stops` allow.
#[must_use]
pub fn common_speeds(stops: &[ScanCircle], slowest_mm_s: f64) -> SpeedRange {
    let fastest_mm_s = stops.iter().map(|s| s.max_speed_mm_s).fold(f64::INFINITY, f64::min);
    SpeedRange { slowest_mm_s, fastest_mm_s: fastest_mm_s.max(slowest_mm_s) }
}

/// A time below which no line for `stops` gets, s: the laser's, and that of the way between the scan
/// circles of any two.
pub(crate) fn least_time_s(stops: &[ScanCircle], fastest_mm_s: f64, jump_s: f64) -> f64 {
    let mut total_s = 0.0;
    let mut least_s = 0.0_f64;
    let mut begins_s = Vec::with_capacity(stops.len());
    for (k, stop) in stops.iter().enumerate() {
        let begin_s: f64 = if k == 0 { 0.0 } else { total_s + jump_s };
        total_s = begin_s + stop.time_s;
        begins_s.push(begin_s);
        for (earlier, &earlier_s) in stops[..k].iter().zip(&begins_s) {
            let apart_mm =
                stop.center.distance(earlier.center) - stop.radius_mm - earlier.radius_mm;
            // From the end of the earlier one's process to the start of this one, if both are at the
            // rims that face each other.
            let between_s = apart_mm / fastest_mm_s;
            let processed_s = earlier_s + earlier.time_s - begin_s;
            least_s = least_s.max(between_s + processed_s);
        }
    }
    total_s + least_s.max(0.0)
}

/// The direction of the best line and its merit.
pub(crate) fn best_direction(
    stops: &[ScanCircle],
    speeds: SpeedRange,
    jump_s: f64,
    search: DirectionSearch,
    functions: &mut LineFunctions,
) -> Option<(f64, Merit)> {
    let (low, high) = direction_window(stops, speeds.slowest_mm_s, jump_s)?;
    let mut evaluate = |direction_rad: f64| {
        functions.set(stops, direction_rad, jump_s);
        functions.search(speeds, COARSE).map_or(Merit::WORST, |(_, merit)| merit)
    };
    let least_s = least_time_s(stops, speeds.fastest_mm_s, jump_s) * (1.0 + GOOD_ENOUGH);
    let good = |merit: Merit| merit.is_feasible() && merit.time_s <= least_s;
    // From the first centre to the last: mostly near the best.
    let along = stops[stops.len() - 1].center - stops[0].center;
    let seed_rad = if along.length() > 0.0 { along.y.atan2(along.x) } else { 0.5 * (low + high) };
    let mut best = (seed_rad, Merit::WORST);
    if search.refine {
        best.1 = evaluate(seed_rad);
        if good(best.1) {
            return Some(best);
        }
    }
    let step_rad = TAU / f64::from(search.samples.max(4));
    let (first, last) = ((low / step_rad).ceil() as i64, (high / step_rad).floor() as i64);
    let count = (last - first + 1).max(0);
    let stride = (count / i64::from(search.most.max(2))).max(1);
    let mut index = first + (count - 1).rem_euclid(stride) / 2;
    while index <= last {
        let direction_rad = index as f64 * step_rad;
        let merit = evaluate(direction_rad);
        if merit < best.1 {
            best = (direction_rad, merit);
            if good(merit) {
                return Some(best);
            }
        }
        index += stride;
    }
    if search.refine {
        let around_rad = (step_rad * stride as f64).min(high - low);
        let found =
            golden_section(best.0 - around_rad, best.0 + around_rad, BETWEEN, &mut evaluate);
        if found.1 < best.1 {
            best = found;
        }
    }
    best.1.is_feasible().then_some(best)
}

/// Directions in which a line can cross the scan circles of every two stops in order, as an interval
/// (low, high) of at most a turn, rad; none where there is no such direction. It holds every
/// direction that is possible.
fn direction_window(stops: &[ScanCircle], slowest_mm_s: f64, jump_s: f64) -> Option<(f64, f64)> {
    let mut narrowest = (0.0, PI);
    let mut arcs = Vec::with_capacity(stops.len() * (stops.len() + 1) / 2);
    for (i, first) in stops.iter().enumerate() {
        let mut time_s = 0.0;
        for (k, last) in stops[i..].iter().enumerate() {
            time_s += last.time_s + if k > 0 { jump_s } else { 0.0 };
            let (center, half) = pair_window(first, last, slowest_mm_s * time_s)?;
            if half < narrowest.1 {
                narrowest = (center, half);
            }
            arcs.push((center, half));
        }
    }
    let (mut low, mut high) = (narrowest.0 - narrowest.1, narrowest.0 + narrowest.1);
    for (center, half) in arcs {
        if half >= PI {
            continue;
        }
        // The turn of the arc that lies nearest; where two turns meet the window, both count.
        let near = center + ((narrowest.0 - center) / TAU).round() * TAU;
        let meets = |turn: f64| {
            let (from, to) = (near + turn - half, near + turn + half);
            (from <= high && to >= low).then_some((from.max(low), to.min(high)))
        };
        let parts = [-TAU, 0.0, TAU].map(meets);
        let mut hull: Option<(f64, f64)> = None;
        for part in parts.into_iter().flatten() {
            hull = Some(hull.map_or(part, |h| (h.0.min(part.0), h.1.max(part.1))));
        }
        (low, high) = hull?;
    }
    Some((low, high))
}

/// Directions of unit vectors û for which a place in the first scan circle and one in the last lie
/// `way_mm` or more apart along û, as centre and half-width, rad.
fn pair_window(first: &ScanCircle, last: &ScanCircle, way_mm: f64) -> Option<(f64, f64)> {
    let apart = last.center - first.center;
    let (distance, reach) = (apart.length(), first.radius_mm + last.radius_mm);
    let angle = apart.y.atan2(apart.x);
    if distance <= reach && way_mm <= reach - distance {
        return Some((angle, PI));
    }
    if way_mm > distance + reach + 1e-9 || reach < 0.0 {
        return None;
    }
    // |D − m û| ≤ R_1 + R_2 for some m ≥ way.
    let half = if distance > reach && way_mm * way_mm <= distance * distance - reach * reach {
        (reach / distance).min(1.0).asin()
    } else {
        let cosine = (distance * distance + way_mm * way_mm - reach * reach)
            / (2.0 * distance * way_mm).max(f64::MIN_POSITIVE);
        cosine.clamp(-1.0, 1.0).acos()
    };
    // Rounding must not close a window of tangent circles.
    Some((angle, half + 1e-9))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn stops() -> impl Strategy<Value = Vec<ScanCircle>> {
        let stop = (-200.0..200.0, -200.0..600.0, 20.0..120.0, 0.0..0.6).prop_map(
            |(x, y, radius_mm, time_s)| ScanCircle {
                center: Point::new(x, y),
                radius_mm,
                time_s,
                max_speed_mm_s: 200.0,
            },
        );
        proptest::collection::vec(stop, 1..5)
    }

    const SPEEDS: SpeedRange = SpeedRange { slowest_mm_s: 1.0, fastest_mm_s: 200.0 };

    proptest! {
        #[test]
        fn every_possible_direction_lies_in_the_window(stops in stops()) {
            let window = direction_window(&stops, 1.0, 0.02);
            for degree in 0..360 {
                let direction_rad = f64::from(degree).to_radians();
                if let Some(line) = RobotLine::along(&stops, direction_rad, SPEEDS, 0.02) {
                    let (low, high) = window.expect("there is a direction");
                    let inside = (-2..=2).any(|turn| {
                        let turned = direction_rad + f64::from(turn) * TAU;
                        turned >= low - 1e-9 && turned <= high + 1e-9
                    });
                    prop_assert!(inside, "{degree}° {window:?} {line:?}");
                    let least_s = least_time_s(&stops, 200.0, 0.02);
                    prop_assert!(line.time_s() >= least_s - 1e-9, "{} {least_s}", line.time_s());
                }
            }
        }

        #[test]
        fn the_best_line_is_as_good_as_any_sampled_one(stops in stops()) {
            let best = RobotLine::best(&stops, SPEEDS, 0.02, DirectionSearch::default());
            for degree in (0..360).step_by(5) {
                let direction_rad = f64::from(degree).to_radians();
                if let Some(line) = RobotLine::along(&stops, direction_rad, SPEEDS, 0.02) {
                    let best = best.as_ref().expect("there is a line");
                    prop_assert!(best.time_s() <= line.time_s() * (1.0 + 1e-5));
                }
            }
        }
    }
}
