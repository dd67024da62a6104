//! Lines with what lies between them: lead-in, lead-out and the moves from line to line.

use lasergym_geom::Point;

use crate::plane::distance_mm;
use crate::{Plane, RemoteTask, RobotLine, ScanCircle, SpeedRange};

/// A line with its place in space and the time it takes with lead-in, lead-out and restart.
#[derive(Debug, Clone, PartialEq)]
pub struct RoutedLine {
    /// The line.
    pub line: RobotLine,
    /// Index of its plane.
    pub plane: usize,
    /// Where the lead-in begins, in the frame of the robot, mm.
    pub from_mm: [f64; 3],
    /// Where the lead-out ends, mm.
    pub to_mm: [f64; 3],
    /// Time between the two and of the restart before, in whole cycles of the robot, s.
    pub time_s: f64,
}

/// Puts lines into space and times the ways between them.
#[derive(Debug)]
pub(crate) struct Router<'a> {
    task: &'a RemoteTask,
}

impl<'a> Router<'a> {
    pub(crate) fn new(task: &'a RemoteTask) -> Self {
        Self { task }
    }

    pub(crate) fn slowest_mm_s(&self) -> f64 {
        self.task.robot.min_speed_mm_s
    }

    /// Time between processes on a line, in whole cycles of the scanner, s.
    pub(crate) fn jump_s(&self) -> f64 {
        let scanner = &self.task.scanner;
        scanner.jump_cycles() as f64 * scanner.cycle_s()
    }

    /// Least time that every line takes besides its own, s.
    pub(crate) fn line_overhead_s(&self) -> f64 {
        self.task.robot.restart_s
    }

    pub(crate) fn route(&self, line: RobotLine, plane: usize) -> RoutedLine {
        let robot = &self.task.robot;
        let lead_mm = robot.lead_mm(line.speed_mm_s);
        let flat = |y_mm: f64, planes: &[Plane]| planes[plane].to_space(line.place(y_mm));
        let from_mm = flat(line.start_mm - lead_mm, &self.task.planes);
        let run_s = robot.whole_cycles_s(line.time_s());
        let to_mm = flat(line.start_mm + run_s * line.speed_mm_s + lead_mm, &self.task.planes);
        let lead_s = robot.lead_s(line.speed_mm_s);
        let time_s = robot.whole_cycles_s(robot.restart_s) + run_s + 2.0 * lead_s;
        RoutedLine { line, plane, from_mm, to_mm, time_s }
    }

    /// Time from the end of one line to the start of the next, s.
    pub(crate) fn ptp_s(&self, from: &RoutedLine, to: &RoutedLine) -> f64 {
        self.task.robot.ptp_s(distance_mm(from.to_mm, to.from_mm))
    }

    /// How much the end of a line within the last scan circle can matter to the way on, s.
    pub(crate) fn ptp_slack_s(&self, last: &ScanCircle) -> f64 {
        let robot = &self.task.robot;
        let room_mm = 2.0 * last.radius_mm + 2.0 * robot.lead_mm(last.max_speed_mm_s);
        2.0 * robot.smooth_ptp_s(room_mm)
    }

    /// Lines for a stop of its own: through the centre, along the ways there and on.
    pub(crate) fn single_lines(
        &self,
        stops: &[ScanCircle],
        index: usize,
        speeds: SpeedRange,
    ) -> Vec<RobotLine> {
        let here = stops[index].center;
        let before = index.checked_sub(1).map(|k| stops[k].center);
        let after = stops.get(index + 1).map(|stop| stop.center);
        let ways = [
            Some((before.unwrap_or(here), after.unwrap_or(here))),
            before.map(|before| (before, here)),
            after.map(|after| (here, after)),
        ];
        let direction = |(from, to): (Point, Point)| {
            let along = to - from;
            along.y.atan2(along.x)
        };
        let stop = &stops[index..=index];
        let jump_s = self.jump_s();
        let mut lines: Vec<RobotLine> = Vec::with_capacity(3);
        for way in ways.into_iter().flatten() {
            let direction_rad = direction(way);
            let known = lines.iter().any(|l| (l.direction_rad - direction_rad).abs() < 1e-9);
            if !known {
                lines.extend(RobotLine::along(stop, direction_rad, speeds, jump_s));
            }
        }
        lines
    }
}
