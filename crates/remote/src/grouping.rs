//! Which subtasks share a line: the paper's greedy start, the same with every direction, and the
//! joint choice by dynamic programming.

use std::ops::Range;

use crate::line_functions::{LineFunctions, TOLERANCE_MM};
use crate::robot_line::{best_direction, common_speeds, least_time_s};
use crate::route::{RoutedLine, Router};
use crate::{DirectionSearch, RobotLine, ScanCircle};

/// How subtasks are shared out among lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LineChoice {
    /// The paper's initial path: each line begins at the centre of its first scan circle, points to
    /// the next, and takes up subtasks as long as the End Function is defined at the offset 0. The
    /// robot slows down until every subtask can be processed.
    Initial,
    /// The subtasks of the initial path, each line optimised in direction and offset.
    Greedy,
    /// Lines that take up subtasks as long as any direction and offset will do at full speed, then
    /// optimised.
    GreedyAnyDirection,
    /// The shares that give the shortest cycle time along the tour, by dynamic programming.
    #[default]
    Joint,
}

/// Ends (exclusive) of the shares of the paper's initial path.
pub(crate) fn greedy_shares(
    stops: &[ScanCircle],
    planes: &[usize],
    slowest_mm_s: f64,
    jump_s: f64,
) -> Vec<usize> {
    shares(stops, planes, |share| {
        let direction_rad = initial_direction(share);
        let functions = LineFunctions::new(share, direction_rad, jump_s);
        let offset_mm = LineFunctions::offset_of(direction_rad, share[0].center);
        functions.end_mm(offset_mm, largest_single_speed(share, slowest_mm_s)).is_some()
    })
}

/// Ends of shares for each of which there is a line in any direction.
pub(crate) fn any_direction_shares(
    stops: &[ScanCircle],
    planes: &[usize],
    slowest_mm_s: f64,
    jump_s: f64,
) -> Vec<usize> {
    let mut functions = LineFunctions::default();
    shares(stops, planes, |share| {
        let mut speeds = common_speeds(share, slowest_mm_s);
        // At full speed, or at that which the slowest of them needs.
        speeds.fastest_mm_s = largest_single_speed(share, slowest_mm_s);
        speeds.slowest_mm_s = speeds.fastest_mm_s;
        best_direction(share, speeds, jump_s, DirectionSearch::QUICK, &mut functions).is_some()
    })
}

/// Takes up stops as long as `fits` says so.
fn shares(
    stops: &[ScanCircle],
    planes: &[usize],
    mut fits: impl FnMut(&[ScanCircle]) -> bool,
) -> Vec<usize> {
    let mut ends = Vec::new();
    let mut first = 0;
    while first < stops.len() {
        let mut end = first + 1;
        while end < stops.len() && planes[end] == planes[first] && fits(&stops[first..=end]) {
            end += 1;
        }
        ends.push(end);
        first = end;
    }
    ends
}

/// Highest speed at which each of the stops alone can be processed, mm/s.
fn largest_single_speed(stops: &[ScanCircle], slowest_mm_s: f64) -> f64 {
    let alone = |stop: &ScanCircle| {
        let limit = if stop.time_s > 0.0 { 2.0 * stop.radius_mm / stop.time_s } else { f64::MAX };
        limit.min(stop.max_speed_mm_s)
    };
    stops.iter().map(alone).fold(f64::INFINITY, f64::min).max(slowest_mm_s)
}

/// From the centre of the first scan circle to that of the second; 0 where there is none.
fn initial_direction(stops: &[ScanCircle]) -> f64 {
    let Some(second) = stops.get(1) else { return 0.0 };
    let along = second.center - stops[0].center;
    along.y.atan2(along.x)
}

/// The line of the paper's initial path: from the centre of the first scan circle at offset 0, slow
/// enough for all.
pub(crate) fn initial_line(
    stops: &[ScanCircle],
    slowest_mm_s: f64,
    jump_s: f64,
) -> Option<RobotLine> {
    let direction_rad = initial_direction(stops);
    let offset_mm = LineFunctions::offset_of(direction_rad, stops[0].center);
    let speeds = common_speeds(stops, slowest_mm_s);
    let start_mm = LineFunctions::along_of(direction_rad, stops[0].center);
    let functions = LineFunctions::new(stops, direction_rad, jump_s);
    // Bisect for the highest speed at which a start at the first centre reaches every scan circle.
    let sections_from = |speed_mm_s: f64| {
        let sections = functions.sections_from_mm(offset_mm, speed_mm_s, start_mm, TOLERANCE_MM)?;
        Some((speed_mm_s, sections))
    };
    let mut best = sections_from(speeds.fastest_mm_s);
    if best.is_none() {
        let (mut low, mut high) = (speeds.slowest_mm_s, speeds.fastest_mm_s);
        best = sections_from(low);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            match sections_from(middle) {
                Some(found) => (low, best) = (middle, Some(found)),
                None => high = middle,
            }
        }
    }
    let Some((speed_mm_s, sections_mm)) = best else {
        // Not from the first centre: from where the Start Function says.
        return RobotLine::at(stops, direction_rad, offset_mm, speeds, jump_s);
    };
    Some(RobotLine {
        direction_rad,
        offset_mm,
        speed_mm_s,
        start_mm,
        end_mm: sections_mm[sections_mm.len() - 1].1,
        sections_mm,
    })
}

/// The best way to end before a stop: a line and the one before it.
struct Node {
    line: RoutedLine,
    first: usize,
    /// Which of the nodes that end where it begins.
    before: Option<usize>,
    total_s: f64,
}

/// A line and the stops that are processed on it.
#[derive(Debug, Clone)]
pub(crate) struct Share {
    /// The stops.
    pub(crate) stops: Range<usize>,
    /// The line.
    pub(crate) line: RoutedLine,
}

/// The lines of the shortest cycle time along the tour. `known` are lines to choose from besides, by the
/// end of their stops: where they make up a plan, the result is never slower.
pub(crate) fn joint_choice(
    stops: &[ScanCircle],
    planes: &[usize],
    router: &Router<'_>,
    most: usize,
    known: &[Share],
) -> Vec<Share> {
    let mut functions = LineFunctions::default();
    let mut nodes: Vec<Vec<Node>> = (0..=stops.len()).map(|_| Vec::new()).collect();
    for end in 1..=stops.len() {
        let mut found: Vec<Node> = Vec::new();
        let known_here = known.partition_point(|share| share.stops.end < end);
        for share in known[known_here..].iter().take_while(|share| share.stops.end == end) {
            found.extend(node(&nodes, router, share.stops.start, share.line.clone()));
        }
        // How much the place where the last line ends may matter to the way on.
        let slack_s = router.ptp_slack_s(&stops[end - 1]);
        for first in (end.saturating_sub(most)..end).rev() {
            if planes[first] != planes[end - 1] {
                break;
            }
            let share = &stops[first..end];
            let speeds = common_speeds(share, router.slowest_mm_s());
            let best_s = found.iter().map(|n| n.total_s).fold(f64::INFINITY, f64::min);
            let before_s = nodes[first].iter().map(|n| n.total_s).fold(f64::INFINITY, f64::min);
            let before_s = if first == 0 { 0.0 } else { before_s };
            let least_s = least_time_s(share, speeds.fastest_mm_s, router.jump_s());
            if before_s + least_s + router.line_overhead_s() > best_s + slack_s {
                continue;
            }
            let lines = if share.len() == 1 {
                router.single_lines(stops, first, speeds)
            } else {
                let search = DirectionSearch::QUICK;
                let best = best_direction(share, speeds, router.jump_s(), search, &mut functions);
                // Where there is no line for these, there is none for more of them.
                let Some((direction_rad, _)) = best else { break };
                RobotLine::along(share, direction_rad, speeds, router.jump_s())
                    .into_iter()
                    .collect()
            };
            for line in lines {
                let routed = router.route(line, planes[first]);
                found.extend(node(&nodes, router, first, routed));
            }
        }
        nodes[end] = found;
    }
    let mut chosen = Vec::new();
    let mut end = stops.len();
    let mut index = fastest(&nodes[end]);
    while let Some(at) = index {
        let node = &nodes[end][at];
        chosen.push(Share { stops: node.first..end, line: node.line.clone() });
        index = node.before;
        end = node.first;
    }
    chosen.reverse();
    chosen
}

/// A line after the best of the lines that end where it begins.
fn node(nodes: &[Vec<Node>], router: &Router<'_>, first: usize, line: RoutedLine) -> Option<Node> {
    if first == 0 {
        let total_s = line.time_s;
        return Some(Node { line, first, before: None, total_s });
    }
    let ways = nodes[first].iter().enumerate();
    let (before, total_s) = ways
        .map(|(index, node)| (index, node.total_s + router.ptp_s(&node.line, &line)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let total_s = total_s + line.time_s;
    Some(Node { line, first, before: Some(before), total_s })
}

fn fastest(nodes: &[Node]) -> Option<usize> {
    let by_time = nodes.iter().enumerate().min_by(|a, b| a.1.total_s.total_cmp(&b.1.total_s));
    by_time.map(|(index, _)| index)
}
