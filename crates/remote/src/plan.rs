//! The plan of a task: the order of its subtasks, the lines, and the sections on them.

use std::ops::Range;

use lasergym_geom::Point;
use lasergym_toolpath::{shortest_order, tour_length};

use crate::grouping::{Share, any_direction_shares, greedy_shares, initial_line, joint_choice};
use crate::placement::place_between;
use crate::plane::distance_mm;
use crate::robot_line::common_speeds;
use crate::route::Router;
use crate::{
    DirectionSearch, LineChoice, RemoteError, RemoteTask, RobotLine, RoutedLine, ScanCircle, Stop,
    stops_of,
};

/// How a plan is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlanOptions {
    /// Which subtasks share a line.
    pub choice: LineChoice,
    /// Directions that are tried for each line.
    pub directions: DirectionSearch,
    /// Most subtasks on a line that the joint choice considers, at least 1; 24 by default. The time
    /// that it takes grows with it.
    pub longest_line: usize,
    /// Whether the subtasks keep the order of the task; otherwise a short tour orders those of each
    /// plane.
    pub keep_order: bool,
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self {
            choice: LineChoice::default(),
            directions: DirectionSearch::default(),
            longest_line: 24,
            keep_order: false,
        }
    }
}

/// A line of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedLine {
    /// The line and its place in space.
    pub routed: RoutedLine,
    /// Index of its first stop in the plan.
    pub first_stop: usize,
    /// Cycle of the scanner, from the start of the line on, at which each of its stops begins.
    pub begin_cycles: Vec<u64>,
    /// Time of the move from the line before, s; 0 for the first.
    pub approach_s: f64,
}

impl PlannedLine {
    /// Indices of its stops in the plan.
    #[must_use]
    pub fn stops(&self) -> Range<usize> {
        self.first_stop..self.first_stop + self.begin_cycles.len()
    }
}

/// The plan of a task.
#[derive(Debug, Clone, PartialEq)]
pub struct RemotePlan {
    /// The subtasks, or their pieces, in the order in which they are processed.
    pub stops: Vec<Stop>,
    /// The lines in order.
    pub lines: Vec<PlannedLine>,
    /// Length of the tour through the centres of the scan circles, mm, without the ways between
    /// planes.
    pub tour_mm: f64,
    /// Time from the first restart to the end of the last lead-out, s.
    pub cycle_time_s: f64,
}

impl RemotePlan {
    /// Plans `task`.
    ///
    /// # Errors
    /// As [`stops_of`]; [`RemoteError::NoLine`] where rounding leaves no line for a subtask at the very
    /// limit of what is possible.
    pub fn new(task: &RemoteTask, options: &PlanOptions) -> Result<Self, RemoteError> {
        let mut stops = stops_of(task)?;
        if !options.keep_order {
            stops = ordered(task, stops)?;
        }
        let circles: Vec<ScanCircle> = stops.iter().map(|stop| stop.scan_circle).collect();
        let planes: Vec<usize> =
            stops.iter().map(|stop| task.subtasks[stop.subtask].plane).collect();
        let router = Router::new(task);
        let shares = shares(&circles, &planes, &router, options);
        let mut processed = 0;
        for share in &shares {
            if share.stops.start != processed {
                break;
            }
            processed = share.stops.end;
        }
        if let Some(stop) = stops.get(processed) {
            return Err(RemoteError::NoLine { subtask: stop.name.clone() });
        }
        let tour_mm = tour_mm(&circles, &planes);
        let lines = planned(task, &stops, &router, shares);
        let cycle_time_s = lines.iter().map(|line| line.approach_s + line.routed.time_s).sum();
        Ok(Self { stops, lines, tour_mm, cycle_time_s })
    }

    /// Time with the laser on, s.
    #[must_use]
    pub fn laser_s(&self) -> f64 {
        self.stops.iter().map(|stop| stop.scan_circle.time_s).sum()
    }

    /// Time on the lines themselves, without lead-in, lead-out and moves between, s.
    #[must_use]
    pub fn line_s(&self) -> f64 {
        self.lines.iter().map(|line| line.routed.line.time_s()).sum()
    }
}

/// The lines of the choice that is asked for.
fn shares(
    circles: &[ScanCircle],
    planes: &[usize],
    router: &Router<'_>,
    options: &PlanOptions,
) -> Vec<Share> {
    let (slowest, jump_s) = (router.slowest_mm_s(), router.jump_s());
    let with_ends = |ends: Vec<usize>, line: &dyn Fn(&[ScanCircle]) -> Option<RobotLine>| {
        let mut first = 0;
        let mut shares = Vec::with_capacity(ends.len());
        for end in ends {
            let mut add = |stops: Range<usize>| {
                let found = line(&circles[stops.clone()]);
                let routed = found.map(|found| router.route(found, planes[first]));
                shares.extend(routed.map(|line| Share { line, stops: stops.clone() }));
                shares.last().is_some_and(|share| share.stops.end == stops.end)
            };
            // Where a share has no line, each of its stops has one of its own.
            if !add(first..end) {
                for stop in first..end {
                    add(stop..stop + 1);
                }
            }
            first = end;
        }
        shares
    };
    let optimised = |share: &[ScanCircle]| {
        RobotLine::best(share, common_speeds(share, slowest), jump_s, options.directions)
    };
    let initial = |share: &[ScanCircle]| initial_line(share, slowest, jump_s);
    let greedy = || greedy_shares(circles, planes, slowest, jump_s);
    let any_direction = || any_direction_shares(circles, planes, slowest, jump_s);
    match options.choice {
        LineChoice::Initial => with_ends(greedy(), &initial),
        LineChoice::Greedy => with_ends(greedy(), &optimised),
        LineChoice::GreedyAnyDirection => with_ends(any_direction(), &optimised),
        LineChoice::Joint => {
            let mut known = with_ends(greedy(), &optimised);
            known.extend(with_ends(any_direction(), &optimised));
            known.extend(with_ends(greedy(), &initial));
            known.sort_by_key(|share| share.stops.end);
            let most = options.longest_line.max(1);
            let mut chosen = joint_choice(circles, planes, router, most, &known);
            place_between(&mut chosen, circles, router, options.directions);
            chosen
        }
    }
}

/// Puts the stops of each plane in the order of a short tour.
fn ordered(task: &RemoteTask, stops: Vec<Stop>) -> Result<Vec<Stop>, RemoteError> {
    let mut by_plane: Vec<Vec<Stop>> = task.planes.iter().map(|_| Vec::new()).collect();
    for stop in stops {
        by_plane[task.subtasks[stop.subtask].plane].push(stop);
    }
    let mut ordered: Vec<Stop> = Vec::new();
    let mut here: Option<[f64; 3]> = None;
    for (plane, stops) in task.planes.iter().zip(by_plane) {
        let centers: Vec<Point> = stops.iter().map(|stop| stop.scan_circle.center).collect();
        let mut order = shortest_order(&centers, None)?;
        let end = |index: Option<&usize>| index.map(|&k| plane.to_space(centers[k]));
        if let (Some(here), Some(first), Some(last)) = (here, end(order.first()), end(order.last()))
            && distance_mm(here, last) < distance_mm(here, first)
        {
            order.reverse();
        }
        here = end(order.last()).or(here);
        let mut stops: Vec<Option<Stop>> = stops.into_iter().map(Some).collect();
        ordered.extend(order.into_iter().filter_map(|index| stops[index].take()));
    }
    Ok(ordered)
}

fn tour_mm(circles: &[ScanCircle], planes: &[usize]) -> f64 {
    let mut length_mm = 0.0;
    let mut first = 0;
    for end in 1..=circles.len() {
        if end == circles.len() || planes[end] != planes[first] {
            let centers: Vec<Point> = circles[first..end].iter().map(|c| c.center).collect();
            length_mm += tour_length(&centers);
            first = end;
        }
    }
    length_mm
}

/// The lines with the cycles at which their stops begin.
fn planned(
    task: &RemoteTask,
    stops: &[Stop],
    router: &Router<'_>,
    shares: Vec<Share>,
) -> Vec<PlannedLine> {
    let cycle_s = task.scanner.cycle_s();
    let mut lines: Vec<PlannedLine> = Vec::with_capacity(shares.len());
    for share in shares {
        let line = &share.line.line;
        let mut free = 0;
        let mut begin_cycles = Vec::with_capacity(share.stops.len());
        for (&(begin_mm, _), stop) in line.sections_mm.iter().zip(&stops[share.stops.clone()]) {
            let begin_s = (begin_mm - line.start_mm) / line.speed_mm_s;
            let begin = ((begin_s / cycle_s - 1e-6).ceil().max(0.0) as u64).max(free);
            begin_cycles.push(begin);
            free = begin + stop.motion.cycles() + task.scanner.jump_cycles();
        }
        let approach_s =
            lines.last().map_or(0.0, |before| router.ptp_s(&before.routed, &share.line));
        lines.push(PlannedLine {
            routed: share.line,
            first_stop: share.stops.start,
            begin_cycles,
            approach_s,
        });
    }
    lines
}
