//! End, Start and Length Function of a robot line in a given direction.
//!
//! In the rotated frame the robot moves along +y at the offset x. Stop `i` has the scan circle
//! `(x_i, y_i, R_i)` with lower half `lSC_i(x)` and upper half `uSC_i(x)`; its process begins `b_i`
//! after that of the first and ends `e_i` after it, where all follow each other at once (with the
//! scanner's jump between them). With `v` the speed of the robot and `E` the last `e_i`,
//!
//! - `A(x) = max_i (lSC_i − v b_i)` is where the line begins at the latest of the earliest starts,
//!   `EF(x) = A + v E`: eqs. (3)–(5) with `Arch_i = max(Arch_{i−1}, lSC_i) + l_i`;
//! - `SF(x) = min(A, B)` with `B(x) = min_i (uSC_i − v e_i)`;
//! - `LF(x) = EF − SF = v E + max(0, A − B)`: eq. (6).
//!
//! Stops can be processed in order when `lSC_i − v b_i ≤ uSC_k − v e_k` for all `i ≤ k`. All that is
//! convex in x, so that golden-section search finds the best offset.

use lasergym_geom::Point;

use crate::ScanCircle;

/// Sections may leave a scan circle by this much, mm: rounding of numbers.
pub(crate) const TOLERANCE_MM: f64 = 1e-9;

/// Iterations of a golden-section search to the last digits.
const FINE: u32 = 72;

const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A scan circle in the rotated frame.
#[derive(Debug, Clone, Copy)]
struct RotatedCircle {
    x_mm: f64,
    y_mm: f64,
    radius_mm: f64,
    begin_s: f64,
    end_s: f64,
}

/// Limits of the robot's speed on a line, mm/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedRange {
    /// Lowest, above 0.
    pub slowest_mm_s: f64,
    /// Highest, at least the lowest.
    pub fastest_mm_s: f64,
}

/// What an offset is worth: first how far it is from possible, then the time of its line.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub(crate) struct Merit {
    /// Most that a section leaves its scan circle by at the lowest speed, mm; 0 where none does.
    pub(crate) missing_mm: f64,
    /// Time of the line at the highest speed that is possible, s.
    pub(crate) time_s: f64,
}

impl Merit {
    pub(crate) const WORST: Self = Self { missing_mm: f64::INFINITY, time_s: f64::INFINITY };

    pub(crate) fn is_feasible(self) -> bool {
        self.missing_mm <= 0.0
    }
}

/// Stops in the frame of a direction.
#[derive(Debug, Clone, Default)]
pub struct LineFunctions {
    circles: Vec<RotatedCircle>,
    total_s: f64,
    domain_mm: (f64, f64),
}

impl LineFunctions {
    /// The functions of `stops`, in this order, for a line in the direction `direction_rad` (from x
    /// towards y), with `jump_s` between processes.
    #[must_use]
    pub fn new(stops: &[ScanCircle], direction_rad: f64, jump_s: f64) -> Self {
        let mut functions = Self::default();
        functions.set(stops, direction_rad, jump_s);
        functions
    }

    /// As [`Self::new`], in the same memory.
    pub(crate) fn set(&mut self, stops: &[ScanCircle], direction_rad: f64, jump_s: f64) {
        let (sin, cos) = direction_rad.sin_cos();
        self.circles.clear();
        self.domain_mm = (f64::NEG_INFINITY, f64::INFINITY);
        let mut begin_s = 0.0;
        for stop in stops {
            // y along the direction, x to its right.
            let Point { x, y } = stop.center;
            let (x_mm, y_mm) = (x * sin - y * cos, x * cos + y * sin);
            let end_s = begin_s + stop.time_s;
            let radius_mm = stop.radius_mm;
            self.circles.push(RotatedCircle { x_mm, y_mm, radius_mm, begin_s, end_s });
            self.domain_mm.0 = self.domain_mm.0.max(x_mm - radius_mm);
            self.domain_mm.1 = self.domain_mm.1.min(x_mm + radius_mm);
            self.total_s = end_s;
            begin_s = end_s + jump_s;
        }
    }

    /// The place of (offset, y) on the workpiece.
    #[must_use]
    pub fn place(direction_rad: f64, offset_mm: f64, y_mm: f64) -> Point {
        let (sin, cos) = direction_rad.sin_cos();
        Point::new(offset_mm * sin + y_mm * cos, y_mm * sin - offset_mm * cos)
    }

    /// The offset of a place.
    #[must_use]
    pub fn offset_of(direction_rad: f64, place: Point) -> f64 {
        let (sin, cos) = direction_rad.sin_cos();
        place.x * sin - place.y * cos
    }

    /// How far along the direction a place lies, mm.
    #[must_use]
    pub fn along_of(direction_rad: f64, place: Point) -> f64 {
        let (sin, cos) = direction_rad.sin_cos();
        place.x * cos + place.y * sin
    }

    /// Offsets that cross every scan circle, mm; none where there is no such line.
    #[must_use]
    pub fn domain_mm(&self) -> Option<(f64, f64)> {
        let (low, high) = self.domain_mm;
        // Tangent circles share one offset.
        if low <= high {
            Some((low, high))
        } else if low <= high + TOLERANCE_MM {
            Some((0.5 * (low + high), 0.5 * (low + high)))
        } else {
            None
        }
    }

    /// The End Function: the lowest y at which all can be done, mm; none where a process does not fit
    /// into its scan circle.
    #[must_use]
    pub fn end_mm(&self, offset_mm: f64, speed_mm_s: f64) -> Option<f64> {
        let (begin, _) = self.ends(offset_mm, speed_mm_s)?;
        Some(begin + speed_mm_s * self.total_s)
    }

    /// The Start Function: the highest y from which the End Function can be reached, mm.
    #[must_use]
    pub fn start_mm(&self, offset_mm: f64, speed_mm_s: f64) -> Option<f64> {
        let (begin, latest) = self.ends(offset_mm, speed_mm_s)?;
        Some(begin.min(latest))
    }

    /// The Length Function, mm.
    #[must_use]
    pub fn length_mm(&self, offset_mm: f64, speed_mm_s: f64) -> Option<f64> {
        let (begin, latest) = self.ends(offset_mm, speed_mm_s)?;
        Some(speed_mm_s * self.total_s + (begin - latest).max(0.0))
    }

    /// Highest speed at which all fit into their scan circles, mm/s; infinite where nothing takes
    /// time, at most 0 where no speed will do.
    #[must_use]
    pub fn feasible_speed_mm_s(&self, offset_mm: f64) -> f64 {
        let mut speed_mm_s = f64::INFINITY;
        for (i, first) in self.circles.iter().enumerate() {
            let Some(lower_mm) = first.half_chord_mm(offset_mm).map(|half| first.y_mm - half)
            else {
                return f64::NEG_INFINITY;
            };
            for last in &self.circles[i..] {
                let Some(half_mm) = last.half_chord_mm(offset_mm) else {
                    return f64::NEG_INFINITY;
                };
                let room_mm = last.y_mm + half_mm - lower_mm;
                let time_s = last.end_s - first.begin_s;
                if time_s > 0.0 {
                    speed_mm_s = speed_mm_s.min(room_mm / time_s);
                } else if room_mm < -TOLERANCE_MM {
                    return f64::NEG_INFINITY;
                }
            }
        }
        speed_mm_s
    }

    /// Sections (begin, end) along y, mm, each as early as possible on the line that begins at
    /// [`Self::start_mm`]; none where that is undefined.
    #[must_use]
    pub fn sections_mm(&self, offset_mm: f64, speed_mm_s: f64) -> Option<Vec<(f64, f64)>> {
        let start_mm = self.start_mm(offset_mm, speed_mm_s)?;
        // The start is the latest: rounding may end a section on the rim just outside.
        self.sections_from_mm(offset_mm, speed_mm_s, start_mm, 1e3 * TOLERANCE_MM)
    }

    /// Sections as early as possible on a line that begins at `start_mm`; none where one would end
    /// more than `tolerance_mm` beyond its scan circle.
    pub(crate) fn sections_from_mm(
        &self,
        offset_mm: f64,
        speed_mm_s: f64,
        start_mm: f64,
        tolerance_mm: f64,
    ) -> Option<Vec<(f64, f64)>> {
        let mut free_mm = start_mm;
        let mut sections = Vec::with_capacity(self.circles.len());
        for (k, circle) in self.circles.iter().enumerate() {
            let half_mm = circle.half_chord_mm(offset_mm)?;
            let begin_mm = free_mm.max(circle.y_mm - half_mm);
            let end_mm = begin_mm + speed_mm_s * (circle.end_s - circle.begin_s);
            if end_mm > circle.y_mm + half_mm + tolerance_mm {
                return None;
            }
            sections.push((begin_mm, end_mm));
            if let Some(next) = self.circles.get(k + 1) {
                free_mm = end_mm + speed_mm_s * (next.begin_s - circle.end_s);
            }
        }
        Some(sections)
    }

    /// A and B of the module's text, where everything fits.
    fn ends(&self, offset_mm: f64, speed_mm_s: f64) -> Option<(f64, f64)> {
        let (mut begin, mut latest) = (f64::NEG_INFINITY, f64::INFINITY);
        for circle in &self.circles {
            let half_mm = circle.half_chord_mm(offset_mm)?;
            begin = begin.max(circle.y_mm - half_mm - speed_mm_s * circle.begin_s);
            let room = circle.y_mm + half_mm - speed_mm_s * circle.end_s;
            if room < begin - TOLERANCE_MM {
                return None;
            }
            latest = latest.min(room);
        }
        Some((begin, latest))
    }

    /// How good the offset is.
    pub(crate) fn merit(&self, offset_mm: f64, speeds: SpeedRange) -> Merit {
        // First at the highest speed, which mostly will do.
        if let Some((begin, latest)) = self.ends(offset_mm, speeds.fastest_mm_s) {
            let wait_s = (begin - latest).max(0.0) / speeds.fastest_mm_s;
            return Merit { missing_mm: 0.0, time_s: self.total_s + wait_s };
        }
        let missing_mm = self.missing_mm(offset_mm, speeds.slowest_mm_s);
        if missing_mm > TOLERANCE_MM {
            return Merit { missing_mm, time_s: f64::INFINITY };
        }
        let speed_mm_s = self.speed_mm_s(offset_mm, speeds);
        let time_s = self
            .length_mm(offset_mm, speed_mm_s)
            .map_or(f64::INFINITY, |length_mm| length_mm / speed_mm_s);
        Merit { missing_mm: 0.0, time_s }
    }

    /// The highest speed within limits.
    pub(crate) fn speed_mm_s(&self, offset_mm: f64, speeds: SpeedRange) -> f64 {
        self.feasible_speed_mm_s(offset_mm).clamp(speeds.slowest_mm_s, speeds.fastest_mm_s)
    }

    /// Most that a section leaves its scan circle by, mm; convex in the offset.
    fn missing_mm(&self, offset_mm: f64, speed_mm_s: f64) -> f64 {
        let (mut begin, mut missing) = (f64::NEG_INFINITY, 0.0_f64);
        for circle in &self.circles {
            let half_mm = circle.half_chord_mm(offset_mm).unwrap_or(0.0);
            begin = begin.max(circle.y_mm - half_mm - speed_mm_s * circle.begin_s);
            missing = missing.max(begin - (circle.y_mm + half_mm - speed_mm_s * circle.end_s));
        }
        missing
    }

    /// The best offset of this direction by golden-section search with `iterations`, and its merit;
    /// none where no offset crosses all scan circles.
    pub(crate) fn search(&self, speeds: SpeedRange, iterations: u32) -> Option<(f64, Merit)> {
        let (low, high) = self.domain_mm()?;
        let merit = |offset_mm: f64| self.merit(offset_mm, speeds);
        Some(golden_section(low, high, iterations, merit))
    }

    /// The best offset to the last digits. Where several are equally good, the middle of them.
    #[must_use]
    pub fn best_offset_mm(&self, speeds: SpeedRange) -> Option<f64> {
        if let [only] = self.circles[..] {
            // Through the centre there is most room.
            return self.merit(only.x_mm, speeds).is_feasible().then_some(only.x_mm);
        }
        let (offset_mm, merit) = self.search(speeds, FINE)?;
        if !merit.is_feasible() {
            return None;
        }
        let (low, high) = self.domain_mm()?;
        let as_good = |at: f64| {
            let there = self.merit(at, speeds);
            there.is_feasible() && there.time_s <= merit.time_s * (1.0 + 1e-12)
        };
        let edge = |mut inside: f64, mut outside: f64| {
            if as_good(outside) {
                return outside;
            }
            for _ in 0..FINE {
                let middle = 0.5 * (inside + outside);
                *(if as_good(middle) { &mut inside } else { &mut outside }) = middle;
            }
            inside
        };
        Some(0.5 * (edge(offset_mm, low) + edge(offset_mm, high)))
    }
}

impl RotatedCircle {
    /// Half the chord that the offset cuts from the circle, mm; the ends of the domain count as within.
    fn half_chord_mm(&self, offset_mm: f64) -> Option<f64> {
        let away_mm = (offset_mm - self.x_mm).abs();
        if away_mm > self.radius_mm + TOLERANCE_MM {
            return None;
        }
        Some((self.radius_mm * self.radius_mm - away_mm * away_mm).max(0.0).sqrt())
    }
}

/// The smallest value of a function that falls and then rises between `low` and `high`.
pub(crate) fn golden_section(
    low: f64,
    high: f64,
    iterations: u32,
    mut value: impl FnMut(f64) -> Merit,
) -> (f64, Merit) {
    let (mut low, mut high) = (low, high);
    let mut left = high - GOLDEN * (high - low);
    let mut right = low + GOLDEN * (high - low);
    let (mut at_left, mut at_right) = (value(left), value(right));
    for _ in 0..iterations {
        if at_left <= at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - GOLDEN * (high - low);
            at_left = value(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + GOLDEN * (high - low);
            at_right = value(right);
        }
    }
    if at_left <= at_right { (left, at_left) } else { (right, at_right) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn circle(x: f64, y: f64, radius_mm: f64, time_s: f64) -> ScanCircle {
        ScanCircle { center: Point::new(x, y), radius_mm, time_s, max_speed_mm_s: 200.0 }
    }

    const SPEEDS: SpeedRange = SpeedRange { slowest_mm_s: 1.0, fastest_mm_s: 200.0 };

    fn circles() -> impl Strategy<Value = Vec<ScanCircle>> {
        let circle = (-60.0..60.0, -40.0..400.0, 20.0..120.0, 0.0..0.6)
            .prop_map(|(x, y, radius, time)| circle(x, y, radius, time));
        proptest::collection::vec(circle, 1..7)
    }

    /// Arch after arch as the paper computes them, with the maximum where it belongs.
    fn arches(stops: &[ScanCircle], x: f64, speed: f64, jump_s: f64) -> Option<(f64, f64)> {
        let halves: Vec<f64> =
            stops.iter().map(|s| (s.radius_mm.powi(2) - (x - s.center.x).powi(2)).sqrt()).collect();
        let jump = speed * jump_s;
        let mut arch = f64::NEG_INFINITY;
        for (stop, half) in stops.iter().zip(&halves) {
            arch = (arch + jump).max(stop.center.y - half) + speed * stop.time_s;
            if arch > stop.center.y + half + TOLERANCE_MM {
                return None;
            }
        }
        let mut start = arch + jump;
        for (stop, half) in stops.iter().zip(&halves).rev() {
            start = (start - jump).min(stop.center.y + half) - speed * stop.time_s;
        }
        Some((start, arch))
    }

    proptest! {
        #[test]
        fn closed_forms_equal_the_recursions(
            stops in circles(), part in 0.0..1.0, speed in 5.0..200.0, jump_s in 0.0..0.1,
        ) {
            let functions = LineFunctions::new(&stops, FRAC_PI_2, jump_s);
            if let Some((low, high)) = functions.domain_mm() {
                let x = low + part * (high - low);
                let expected = arches(&stops, x, speed, jump_s);
                let end = functions.end_mm(x, speed);
                prop_assert_eq!(end.is_some(), expected.is_some());
                if let (Some((start, arch)), Some(end)) = (expected, end) {
                    prop_assert!((end - arch).abs() < 1e-7);
                    let found = functions.start_mm(x, speed).unwrap();
                    prop_assert!((found - start).abs() < 1e-7, "{} {}", found, start);
                    let length = functions.length_mm(x, speed).unwrap();
                    prop_assert!((length - (arch - start)).abs() < 1e-7);
                    let sections = functions.sections_mm(x, speed).unwrap();
                    prop_assert!((sections[0].0 - start).abs() < 1e-6);
                    prop_assert!((sections[sections.len() - 1].1 - arch).abs() < 1e-6);
                    for (section, stop) in sections.iter().zip(&stops) {
                        let half = (stop.radius_mm.powi(2) - (x - stop.center.x).powi(2)).sqrt();
                        prop_assert!(section.0 >= stop.center.y - half - 1e-6);
                        prop_assert!(section.1 <= stop.center.y + half + 1e-6);
                    }
                }
            }
        }

        #[test]
        fn the_feasible_speed_is_the_limit(stops in circles(), part in 0.0..1.0) {
            let functions = LineFunctions::new(&stops, FRAC_PI_2, 0.01);
            if let Some((low, high)) = functions.domain_mm() {
                let x = low + part * (high - low);
                let limit = functions.feasible_speed_mm_s(x);
                if limit > 0.1 && limit < 1e5 {
                    prop_assert!(functions.end_mm(x, 0.999 * limit).is_some());
                    prop_assert!(functions.end_mm(x, 1.001 * limit + 1e-3).is_none());
                }
            }
        }

        #[test]
        fn no_offset_is_better_than_the_best(stops in circles(), direction in 0.0..6.3) {
            let functions = LineFunctions::new(&stops, direction, 0.0);
            if let Some((low, high)) = functions.domain_mm() {
                let best = functions.best_offset_mm(SPEEDS).map(|x| functions.merit(x, SPEEDS));
                for k in 0..=400 {
                    let x = low + f64::from(k) / 400.0 * (high - low);
                    let merit = functions.merit(x, SPEEDS);
                    if merit.is_feasible() {
                        let best = best.expect("an offset is feasible");
                        prop_assert!(best.time_s <= merit.time_s + 1e-9, "{best:?} {merit:?}");
                    }
                }
            }
        }

        #[test]
        fn a_faster_robot_never_takes_longer(stops in circles(), part in 0.0..1.0) {
            let functions = LineFunctions::new(&stops, FRAC_PI_2, 0.01);
            if let Some((low, high)) = functions.domain_mm() {
                let x = low + part * (high - low);
                let time = |v: f64| functions.length_mm(x, v).map(|length| length / v);
                let limit = functions.feasible_speed_mm_s(x).min(200.0);
                if limit > 1.0 {
                    let (fast, slow) = (time(0.999 * limit), time(0.7 * limit));
                    prop_assert!(fast.unwrap() <= slow.unwrap() + 1e-9);
                }
            }
        }
    }

    #[test]
    fn places_and_offsets_belong_together() {
        let place = LineFunctions::place(0.7, 12.0, -5.0);
        assert!((LineFunctions::offset_of(0.7, place) - 12.0).abs() < 1e-12);
        // Upwards, the offset is x.
        let up = LineFunctions::place(FRAC_PI_2, 3.0, 4.0);
        assert!(up.distance(Point::new(3.0, 4.0)) < 1e-12);
    }
}
