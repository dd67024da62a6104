//! Orders of short travel.
//!
//! Which order pulses are fired in, or subtasks are done in, does not matter to the workpiece, but it
//! does to the stage or robot. The tour is open: it ends where it ends. Sources: nearest neighbour
//! and 2-opt, Croes 1958; Or-opt, Or 1976; double-bridge kicks, Martin, Otto and Felten 1991.

use lasergym_geom::Point;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::ToolpathError;

/// Nearest-neighbour tours from different pulses that are improved.
const STARTS: usize = 8;

/// Longest chain of pulses that is moved elsewhere as one.
const MAX_CHAIN: usize = 3;

/// Kicks for each pulse: 40 pulses take about 10 ms.
const KICKS_PER_PULSE: usize = 4;

/// Stops up to which all tours are tried.
const MAX_EXHAUSTIVE: usize = 9;

/// Pulses above which there are no kicks and only one start, since improving a tour takes time in
/// proportion to the square of its pulses.
const MAX_KICKED: usize = 300;

/// Pulses above which tours are only built.
const MAX_IMPROVED: usize = 1000;

/// A shorter tour is shorter by more than this: rounding must not keep the search going.
const TOLERANCE: f64 = 1e-9;

/// The indices of `positions` in an order of short travel. Where `start` says where the machine is,
/// the way from there to the first position counts too. The same positions always give the same
/// order. Positions may have any unit of length.
///
/// # Errors
/// [`ToolpathError::StopNotFinite`].
pub fn shortest_order(
    positions: &[Point],
    start: Option<Point>,
) -> Result<Vec<usize>, ToolpathError> {
    for (stop, &Point { x, y }) in positions.iter().chain(&start).enumerate() {
        if !(x.is_finite() && y.is_finite()) {
            return Err(ToolpathError::StopNotFinite { stop, x, y });
        }
    }
    if positions.is_empty() {
        return Ok(Vec::new());
    }
    let mut stops = positions.to_vec();
    // The place to start from is one more stop, which stays the first.
    stops.extend(start);
    let distances = Distances::new(stops);
    let fixed = start.map(|_| positions.len());
    let mut tour = shortest_tour(&distances, fixed);
    tour.retain(|&stop| stop < positions.len());
    Ok(tour)
}

/// Length of the way through `positions` from the first to the last.
#[must_use]
pub fn tour_length(positions: &[Point]) -> f64 {
    positions.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

/// Distances between stops.
struct Distances {
    stops: Vec<Point>,
    /// All of them, if the tour is to be improved: row a, column b.
    table_px: Vec<f64>,
}

impl Distances {
    fn new(stops: Vec<Point>) -> Self {
        let in_table = if stops.len() > MAX_IMPROVED { &[] } else { &stops[..] };
        let table_px =
            in_table.iter().flat_map(|a| in_table.iter().map(|b| a.distance(*b))).collect();
        Self { stops, table_px }
    }

    #[inline]
    fn between(&self, a: usize, b: usize) -> f64 {
        match self.table_px.get(a * self.stops.len() + b) {
            Some(&distance_px) => distance_px,
            None => self.stops[a].distance(self.stops[b]),
        }
    }

    /// As [`Self::between`]; nothing where the tour ends.
    #[inline]
    fn link(&self, a: Option<&usize>, b: Option<&usize>) -> f64 {
        a.zip(b).map_or(0.0, |(&a, &b)| self.between(a, b))
    }

    fn length(&self, tour: &[usize]) -> f64 {
        tour.windows(2).map(|pair| self.between(pair[0], pair[1])).sum()
    }
}

/// The shortest tour found, which for few stops is the shortest; it begins at `fixed` if that is
/// given.
fn shortest_tour(distances: &Distances, fixed: Option<usize>) -> Vec<usize> {
    let stops = distances.stops.len();
    if stops <= MAX_EXHAUSTIVE {
        let mut tour: Vec<usize> = fixed.into_iter().collect();
        let mut best = (f64::INFINITY, Vec::new());
        try_all(distances, &mut tour, 0.0, &mut best);
        return best.1;
    }
    let count = if fixed.is_some() || stops > MAX_KICKED { 1 } else { STARTS.min(stops) };
    let firsts = (0..count).map(|k| fixed.unwrap_or(k * stops / count));
    let mut best = (f64::INFINITY, Vec::new());
    for first in firsts {
        let mut tour = nearest_neighbours(distances, first);
        if stops <= MAX_IMPROVED {
            improve(distances, &mut tour, usize::from(fixed.is_some()));
        }
        let length_px = distances.length(&tour);
        if length_px < best.0 {
            best = (length_px, tour);
        }
    }
    if stops <= MAX_KICKED {
        kick(distances, &mut best.1, usize::from(fixed.is_some()));
    }
    best.1
}

/// Goes on with `tour`, `length_px` long so far, in every way that can still be shorter than `best`.
fn try_all(
    distances: &Distances,
    tour: &mut Vec<usize>,
    length_px: f64,
    best: &mut (f64, Vec<usize>),
) {
    if length_px >= best.0 {
        return;
    }
    if tour.len() == distances.stops.len() {
        *best = (length_px, tour.clone());
        return;
    }
    for stop in 0..distances.stops.len() {
        if !tour.contains(&stop) {
            let step_px = distances.link(tour.last(), Some(&stop));
            tour.push(stop);
            try_all(distances, tour, length_px + step_px, best);
            tour.pop();
        }
    }
}

/// From `first` always on to the nearest stop not visited yet.
fn nearest_neighbours(distances: &Distances, first: usize) -> Vec<usize> {
    let mut left: Vec<usize> = (0..distances.stops.len()).filter(|&stop| stop != first).collect();
    let mut tour = vec![first];
    let mut here = first;
    while let Some(nearest) = (0..left.len()).min_by(|&a, &b| {
        distances.between(here, left[a]).total_cmp(&distances.between(here, left[b]))
    }) {
        here = left.swap_remove(nearest);
        tour.push(here);
    }
    tour
}

/// 2-opt and Or-opt until neither shortens the tour; its first `fixed` stops stay.
fn improve(distances: &Distances, tour: &mut [usize], fixed: usize) {
    while two_opt(distances, tour, fixed) || or_opt(distances, tour, fixed) {}
}

/// Reverses one part of the tour after another where that shortens it; whether it did.
fn two_opt(distances: &Distances, tour: &mut [usize], fixed: usize) -> bool {
    let mut improved = false;
    for i in fixed..tour.len() {
        for j in i + 1..tour.len() {
            let before = i.checked_sub(1).map(|k| &tour[k]);
            let after = tour.get(j + 1);
            let saved = distances.link(before, Some(&tour[i]))
                + distances.link(Some(&tour[j]), after)
                - distances.link(before, Some(&tour[j]))
                - distances.link(Some(&tour[i]), after);
            if saved > TOLERANCE {
                tour[i..=j].reverse();
                improved = true;
            }
        }
    }
    improved
}

/// Moves chains of up to [`MAX_CHAIN`] stops elsewhere, either way round, where that shortens the
/// tour; whether it did.
fn or_opt(distances: &Distances, tour: &mut [usize], fixed: usize) -> bool {
    let mut improved = false;
    for chain in 1..=MAX_CHAIN {
        for first in fixed..(tour.len() + 1).saturating_sub(chain) {
            improved |= move_chain(distances, tour, fixed, first, chain);
        }
    }
    improved
}

/// Moves the chain of `chain` stops from `first` on to where it shortens the tour most, if anywhere.
fn move_chain(
    distances: &Distances,
    tour: &mut [usize],
    fixed: usize,
    first: usize,
    chain: usize,
) -> bool {
    let end = first + chain;
    let (head, tail) = (tour[first], tour[end - 1]);
    let before = first.checked_sub(1).map(|k| &tour[k]);
    let removed = distances.link(before, Some(&head)) + distances.link(Some(&tail), tour.get(end))
        - distances.link(before, tour.get(end));
    let mut best = (TOLERANCE, None);
    // Between the stops `gap − 1` and `gap`, which are not in the chain.
    for gap in (fixed..first).chain(end + 1..=tour.len()) {
        let (left, right) = (gap.checked_sub(1).map(|k| &tour[k]), tour.get(gap));
        let open = removed + distances.link(left, right);
        let forward = open - distances.link(left, Some(&head)) - distances.link(Some(&tail), right);
        let backward =
            open - distances.link(left, Some(&tail)) - distances.link(Some(&head), right);
        for (saved, reversed) in [(forward, false), (backward, true)] {
            if saved > best.0 {
                best = (saved, Some((gap, reversed)));
            }
        }
    }
    let Some((gap, reversed)) = best.1 else { return false };
    if reversed {
        tour[first..end].reverse();
    }
    if gap < first {
        tour[gap..end].rotate_right(chain);
    } else {
        tour[first..gap].rotate_left(chain);
    }
    true
}

/// Exchanges two neighbouring parts of the tour at random, improves again and keeps what is
/// shorter.
fn kick(distances: &Distances, best: &mut [usize], fixed: usize) {
    let mut rng = Pcg64Mcg::seed_from_u64(distances.stops.len() as u64);
    let free = best.len() - fixed;
    let mut best_px = distances.length(best);
    let mut tour = best.to_vec();
    for _ in 0..KICKS_PER_PULSE * best.len() {
        tour.copy_from_slice(best);
        let mut cuts: [usize; 3] = std::array::from_fn(|_| {
            fixed + (((rng.next_u64() >> 32) * (free as u64 + 1)) >> 32) as usize
        });
        cuts.sort_unstable();
        tour[cuts[0]..cuts[2]].rotate_left(cuts[1] - cuts[0]);
        improve(distances, &mut tour, fixed);
        let length_px = distances.length(&tour);
        if length_px < best_px - TOLERANCE {
            best_px = length_px;
            best.copy_from_slice(&tour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(
        count: impl Into<proptest::collection::SizeRange>,
    ) -> impl Strategy<Value = Vec<Point>> {
        let point = (0.0..100.0, 0.0..100.0).prop_map(|(x, y)| Point::new(x, y));
        proptest::collection::vec(point, count)
    }

    /// The shortest open tour, by dynamic programming over sets of stops (Held and Karp 1962).
    fn exact_px(stops: &[Point], start: Option<Point>) -> f64 {
        let n = stops.len();
        let mut lengths = vec![vec![f64::INFINITY; n]; 1 << n];
        for k in 0..n {
            lengths[1 << k][k] = start.map_or(0.0, |start| start.distance(stops[k]));
        }
        for set in 1..1_usize << n {
            for last in (0..n).filter(|&k| set >> k & 1 == 1) {
                let here = lengths[set][last];
                for next in (0..n).filter(|&k| set >> k & 1 == 0) {
                    let there = &mut lengths[set | 1 << next][next];
                    *there = there.min(here + stops[last].distance(stops[next]));
                }
            }
        }
        lengths[(1 << n) - 1].iter().copied().fold(f64::INFINITY, f64::min)
    }

    fn ordered_px(stops: &[Point], start: Option<Point>) -> f64 {
        let order = shortest_order(stops, start).unwrap();
        let mut way: Vec<Point> = start.into_iter().collect();
        way.extend(order.iter().map(|&k| stops[k]));
        tour_length(&way)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn short_tours_are_the_shortest(
            stops in points(1..11),
            start in proptest::option::of((0.0..100.0, 0.0..100.0)),
        ) {
            let start = start.map(|(x, y)| Point::new(x, y));
            let (found_px, exact_px) = (ordered_px(&stops, start), exact_px(&stops, start));
            let all_tried = stops.len() + usize::from(start.is_some()) <= MAX_EXHAUSTIVE;
            let tolerance = if all_tried { 1e-9 } else { 0.05 };
            prop_assert!(found_px <= exact_px * (1.0 + tolerance), "{found_px} against {exact_px}");
        }

        #[test]
        fn every_pulse_is_fired_once(stops in points(0..60)) {
            let mut order = shortest_order(&stops, None).unwrap();
            prop_assert_eq!(&order, &shortest_order(&stops, None).unwrap());
            order.sort_unstable();
            prop_assert_eq!(order, (0..stops.len()).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_shuffled_line_is_walked_from_end_to_end() {
        let stops: Vec<Point> = (0..40).map(|k| Point::new(f64::from(k * 17 % 40), 3.0)).collect();
        assert!((ordered_px(&stops, None) - 39.0).abs() < 1e-9);
        assert!((ordered_px(&stops, Some(Point::new(0.0, 0.0))) - 42.0).abs() < 1e-9);
    }

    #[test]
    fn long_paths_are_ordered_too() {
        for count in [350, 1200] {
            let side = f64::from(count).sqrt().ceil() as i32;
            let shuffled = (0..count).map(|k| k * 7919 % count);
            let stops: Vec<Point> =
                shuffled.map(|k| Point::new(f64::from(k % side), f64::from(k / side))).collect();
            // On a grid the shortest step is 1; nearest neighbours alone need about a quarter more.
            assert!(ordered_px(&stops, None) < 1.4 * f64::from(count));
        }
    }

    #[test]
    fn coinciding_pulses_are_no_special_case() {
        let stops = vec![Point::new(5.0, 5.0); 12];
        assert_eq!(shortest_order(&stops, None).unwrap().len(), 12);
    }

    #[test]
    fn a_position_that_is_not_finite_is_refused() {
        let stops = [Point::new(1.0, 1.0), Point::new(f64::NAN, 1.0)];
        let error = shortest_order(&stops, None).unwrap_err();
        assert!(matches!(error, ToolpathError::StopNotFinite { stop: 1, .. }), "{error}");
    }

    #[test]
    fn a_start_that_is_not_finite_is_refused() {
        let start = Some(Point::new(1.0, f64::INFINITY));
        let error = shortest_order(&[Point::new(1.0, 1.0)], start).unwrap_err();
        assert!(matches!(error, ToolpathError::StopNotFinite { .. }), "{error}");
    }
}
