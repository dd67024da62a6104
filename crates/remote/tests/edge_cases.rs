//! The degenerate cases that a planner must have an answer for.

#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

use std::f64::consts::FRAC_PI_2;

use lasergym_geom::Point;
use lasergym_remote::{
    BeamPath, DirectionSearch, LineChoice, LineFunctions, PlanOptions, Plane, Process, ProcessKind,
    RemoteError, RemotePlan, RemoteTask, RobotLine, RobotProgram, ScanCircle, ScannerProgram,
    SpeedRange, Subtask, simulate,
};

const SPEEDS: SpeedRange = SpeedRange { slowest_mm_s: 1.0, fastest_mm_s: 200.0 };
const FULL: SpeedRange = SpeedRange { slowest_mm_s: 200.0, fastest_mm_s: 200.0 };

fn circle(x: f64, y: f64, radius_mm: f64, time_s: f64) -> ScanCircle {
    ScanCircle { center: Point::new(x, y), radius_mm, time_s, max_speed_mm_s: 200.0 }
}

fn up(stops: &[ScanCircle], speeds: SpeedRange) -> Option<RobotLine> {
    RobotLine::along(stops, FRAC_PI_2, speeds, 0.0)
}

fn hole(x: f64, y: f64, radius_mm: f64, exposures: u32) -> Subtask {
    Subtask {
        name: format!("hole at {x}, {y}"),
        plane: 0,
        path: BeamPath::circle(Point::new(x, y), radius_mm).unwrap(),
        process: Process { exposures, ..Process::default() },
    }
}

/// A plan whose programs the simulation accepts.
fn good_plan(task: &RemoteTask) -> RemotePlan {
    let plan = RemotePlan::new(task, &PlanOptions::default()).unwrap();
    let (robot, scanner) = (RobotProgram::of(task, &plan), ScannerProgram::of(task, &plan));
    let report = simulate(task, &robot, &scanner, 0.0).unwrap();
    assert!(report.is_good(), "{:?}", report.problems);
    plan
}

#[test]
fn a_subtask_as_large_as_the_field_is_split_or_refused() {
    let mut whole = hole(0.0, 0.0, 150.0, 1);
    good_plan(&RemoteTask::new(vec![whole.clone()]));
    whole.process.split = false;
    let error =
        RemotePlan::new(&RemoteTask::new(vec![whole]), &PlanOptions::default()).unwrap_err();
    let message = error.to_string();
    for words in ["hole at 0, 0", "150.0 mm", "split"] {
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn a_scan_circle_of_radius_zero_allows_no_time() {
    assert!(up(&[circle(0.0, 0.0, 0.0, 0.1)], SPEEDS).is_none());
    // Without time, its centre is the line.
    let line = up(&[circle(7.0, 5.0, 0.0, 0.0)], SPEEDS).unwrap();
    assert!((line.offset_mm - 7.0).abs() < 1e-9 && (line.start_mm - 5.0).abs() < 1e-9);
}

#[test]
fn a_section_longer_than_the_circle_slows_the_robot_down() {
    let stop = [circle(0.0, 0.0, 90.0, 1.8)];
    assert!(up(&stop, FULL).is_none());
    let line = up(&stop, SPEEDS).unwrap();
    assert!((line.speed_mm_s - 100.0).abs() < 1e-6 && line.offset_mm.abs() < 1e-3);
    assert!((line.time_s() - 1.8).abs() < 1e-9);
}

#[test]
fn a_section_as_long_as_the_circle_has_a_single_offset() {
    let functions = LineFunctions::new(&[circle(3.0, 0.0, 90.0, 0.9)], FRAC_PI_2, 0.0);
    assert!(functions.end_mm(3.0, 200.0).is_some());
    assert!(functions.end_mm(3.001, 200.0).is_none());
    let line = up(&[circle(3.0, 0.0, 90.0, 0.9)], FULL).unwrap();
    assert!((line.offset_mm - 3.0).abs() < 1e-4);
}

#[test]
fn a_single_subtask_goes_through_its_centre() {
    for direction_rad in [0.0, 1.0, 4.0] {
        let stop = [circle(40.0, -20.0, 90.0, 0.4)];
        let line = RobotLine::along(&stop, direction_rad, SPEEDS, 0.0).unwrap();
        let center = LineFunctions::offset_of(direction_rad, stop[0].center);
        assert!((line.offset_mm - center).abs() < 1e-6);
        assert!((line.length_mm() - 80.0).abs() < 1e-9);
    }
    let plan = good_plan(&RemoteTask::new(vec![hole(5.0, 5.0, 60.0, 7)]));
    assert_eq!((plan.lines.len(), plan.stops.len()), (1, 1));
    // The offsets that are possible reach as far as the chord holds the section.
    let functions = LineFunctions::new(&[circle(0.0, 0.0, 90.0, 0.4)], FRAC_PI_2, 0.0);
    let widest = f64::sqrt(90.0 * 90.0 - 40.0 * 40.0);
    assert!(functions.end_mm(widest - 1e-6, 200.0).is_some());
    assert!(functions.end_mm(widest + 1e-6, 200.0).is_none());
}

#[test]
fn a_subtask_at_the_limit_of_the_slowest_robot_is_planned() {
    let mut task = RemoteTask::new(vec![hole(0.0, 0.0, 149.0, 30), hole(300.0, 0.0, 60.0, 7)]);
    let error = lasergym_remote::stops_of(&task).unwrap_err();
    let RemoteError::TooSlow { needed_mm_s, .. } = error else { panic!("{error}") };
    task.robot.min_speed_mm_s = needed_mm_s;
    task.robot.min_speed_mm_s *= 1.0 - 1e-12;
    good_plan(&task);
    task.robot.min_speed_mm_s *= 1.0 + 1e-9;
    let error = RemotePlan::new(&task, &PlanOptions::default()).unwrap_err();
    assert!(matches!(error, RemoteError::TooSlow { .. }), "{error}");
}

#[test]
fn coincident_circles_are_processed_one_after_the_other() {
    let same = [circle(0.0, 0.0, 90.0, 0.2), circle(0.0, 0.0, 90.0, 0.3)];
    let line = up(&same, SPEEDS).unwrap();
    assert!((line.length_mm() - 100.0).abs() < 1e-9);
    assert!(line.sections_mm[1].0 >= line.sections_mm[0].1 - 1e-9);
    let plan = good_plan(&RemoteTask::new(vec![hole(0.0, 0.0, 30.0, 5), hole(0.0, 0.0, 30.0, 5)]));
    assert_eq!(plan.lines.len(), 1);
}

#[test]
fn nested_circles_keep_their_order() {
    let outer_first = [circle(0.0, 0.0, 100.0, 0.5), circle(0.0, 60.0, 20.0, 0.1)];
    let line = up(&outer_first, SPEEDS).unwrap();
    assert!(line.sections_mm[1].0 >= line.sections_mm[0].1 - 1e-9);
    let inner_first = [outer_first[1], outer_first[0]];
    // Beginning with the inner one at its upper end, the outer one has no room at full speed.
    assert!(up(&inner_first, FULL).is_none());
    assert!(up(&inner_first, SPEEDS).is_some_and(|line| line.speed_mm_s < 200.0));
}

#[test]
fn the_robot_may_pass_idle_gaps() {
    let line = up(&[circle(0.0, 0.0, 50.0, 0.1), circle(0.0, 1000.0, 50.0, 0.1)], SPEEDS).unwrap();
    assert!(line.sections_mm[1].0 - line.sections_mm[0].1 > 800.0);
    assert!((line.length_mm() - (1000.0 - 100.0 + 40.0)).abs() < 1e-6);
}

#[test]
fn tangent_circles_share_one_offset_and_have_no_time_there() {
    let tangent = [circle(0.0, 0.0, 50.0, 0.1), circle(100.0, 300.0, 50.0, 0.1)];
    let functions = LineFunctions::new(&tangent, FRAC_PI_2, 0.0);
    let (low, high) = functions.domain_mm().unwrap();
    assert!((low - 50.0).abs() < 1e-9 && (high - 50.0).abs() < 1e-9);
    assert!(up(&tangent, SPEEDS).is_none());
    let apart = [tangent[0], circle(101.0, 300.0, 50.0, 0.1)];
    assert!(LineFunctions::new(&apart, FRAC_PI_2, 0.0).domain_mm().is_none());
    // In another direction there is a line.
    assert!(RobotLine::best(&apart, SPEEDS, 0.0, DirectionSearch::default()).is_some());
}

#[test]
fn a_line_ends_before_the_subtask_that_does_not_fit() {
    let mut subtasks: Vec<Subtask> =
        (0..3).map(|k| hole(230.0 * f64::from(k), 0.0, 60.0, 7)).collect();
    subtasks.push(hole(460.0, 500.0, 60.0, 7));
    let task = RemoteTask::new(subtasks);
    for choice in [LineChoice::Greedy, LineChoice::GreedyAnyDirection] {
        let options = PlanOptions { choice, keep_order: true, ..PlanOptions::default() };
        let plan = RemotePlan::new(&task, &options).unwrap();
        let counts: Vec<usize> = plan.lines.iter().map(|line| line.stops().len()).collect();
        assert_eq!(counts, [3, 1], "{choice:?}");
    }
}

#[test]
fn of_many_best_offsets_the_middle_is_taken() {
    // Overlapping circles: between −40 and 40 any line is as long as the laser is on.
    let stops = [circle(0.0, 0.0, 90.0, 0.2), circle(20.0, 10.0, 90.0, 0.2)];
    let functions = LineFunctions::new(&stops, FRAC_PI_2, 0.0);
    let middle = functions.best_offset_mm(SPEEDS).unwrap();
    let length = |x: f64| functions.length_mm(x, 200.0);
    let plateau: Vec<f64> = (-900..=1100)
        .map(|k| f64::from(k) * 0.1)
        .filter(|&x| length(x).is_some_and(|l| l < 80.0 + 1e-9))
        .collect();
    let ends = [plateau[0], plateau[plateau.len() - 1]];
    assert!((middle - 0.5 * (ends[0] + ends[1])).abs() < 0.2, "{middle} {ends:?}");
    assert!(ends[1] - ends[0] > 40.0);
}

#[test]
fn the_rims_of_the_domain_are_part_of_it() {
    let functions = LineFunctions::new(&[circle(10.0, 0.0, 50.0, 0.0)], FRAC_PI_2, 0.0);
    for x in [-40.0, 60.0] {
        assert!((functions.end_mm(x, 200.0).unwrap()).abs() < 1e-9);
        assert!((functions.length_mm(x, 200.0).unwrap()).abs() < 1e-9);
    }
    assert!(functions.end_mm(60.1, 200.0).is_none());
}

#[test]
fn planes_have_lines_of_their_own() {
    let mut task = RemoteTask::new(vec![
        hole(0.0, 0.0, 30.0, 5),
        Subtask { plane: 1, ..hole(0.0, 0.0, 30.0, 5) },
        hole(50.0, 0.0, 30.0, 5),
    ]);
    task.planes = vec![
        Plane { name: "top".into(), ..Plane::default() },
        Plane { name: "step".into(), origin_mm: [0.0, 0.0, -80.0], abc_deg: [0.0, 25.0, 0.0] },
    ];
    let plan = good_plan(&task);
    assert_eq!(plan.lines.len(), 2);
    for line in &plan.lines {
        for stop in line.stops() {
            assert_eq!(task.subtasks[plan.stops[stop].subtask].plane, line.routed.plane);
        }
    }
}

#[test]
fn welding_slows_the_robot_where_it_must() {
    let mut weld = hole(0.0, 0.0, 60.0, 1);
    weld.process = Process { kind: ProcessKind::Welding, speed_mm_s: 200.0, ..Process::default() };
    let plan = good_plan(&RemoteTask::new(vec![weld.clone(), hole(230.0, 0.0, 60.0, 7)]));
    let stop = plan.stops.iter().find(|stop| stop.subtask == 0).unwrap();
    assert!((stop.scan_circle.time_s - 1.885).abs() < 1e-3);
    let line =
        plan.lines.iter().find(|line| line.stops().any(|index| plan.stops[index].subtask == 0));
    // 180 mm of scan circle in 1.885 s.
    assert!(line.unwrap().routed.line.speed_mm_s <= 95.6);
    // The limit of a process holds for every line that it shares.
    weld.process.max_robot_speed_mm_s = 40.0;
    let slow = good_plan(&RemoteTask::new(vec![weld, hole(10.0, 0.0, 60.0, 7)]));
    for line in &slow.lines {
        let shares = line.stops().any(|index| slow.stops[index].subtask == 0);
        assert!(!shares || line.routed.line.speed_mm_s <= 40.0 + 1e-9);
    }
}

#[test]
fn both_clocks_are_kept() {
    let mut task =
        RemoteTask::new((0..4).map(|k| hole(180.0 * f64::from(k), 0.0, 60.0, 7)).collect());
    task.robot.cycle_ms = 4.0;
    let plan = good_plan(&task);
    let whole = |time_s: f64, cycle_s: f64| {
        let cycles = time_s / cycle_s;
        (cycles - cycles.round()).abs() < 1e-6
    };
    for line in &plan.lines {
        assert!(whole(line.routed.time_s, 4e-3) && whole(line.approach_s, 4e-3));
    }
    assert!(plan.stops.iter().all(|stop| whole(stop.scan_circle.time_s, 1e-5)));
}

#[test]
fn duplicates_and_closed_rounds_are_tours_like_others() {
    let round: Vec<Subtask> = (0..9)
        .map(|k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k % 8) / 8.0).sin_cos();
            hole((300.0 * cos).round(), (300.0 * sin).round(), 40.0, 5)
        })
        .collect();
    let plan = good_plan(&RemoteTask::new(round));
    let mut visited: Vec<usize> = plan.stops.iter().map(|stop| stop.subtask).collect();
    visited.sort_unstable();
    assert_eq!(visited, (0..9).collect::<Vec<_>>());
}

#[test]
fn a_subtask_without_length_takes_no_time() {
    let spot = Point::new(100.0, 0.0);
    let mut subtask = hole(0.0, 0.0, 30.0, 5);
    subtask.path = BeamPath::line(spot, spot).unwrap();
    let plan = good_plan(&RemoteTask::new(vec![subtask.clone(), hole(0.0, 0.0, 30.0, 5)]));
    assert_eq!(plan.stops.len(), 2);
    let alone = good_plan(&RemoteTask::new(vec![subtask]));
    assert!(alone.lines[0].routed.line.length_mm().abs() < 1e-9);
}

#[test]
fn a_task_of_nothing_is_refused() {
    let error = RemotePlan::new(&RemoteTask::new(Vec::new()), &PlanOptions::default()).unwrap_err();
    assert!(matches!(error, RemoteError::NoSubtasks), "{error}");
}

#[test]
fn values_out_of_range_name_their_subtask() {
    let good = hole(1.0, 2.0, 30.0, 5);
    for (field, process) in [
        ("speed_mm_s", Process { speed_mm_s: f64::NAN, ..good.process }),
        ("exposures", Process { exposures: 0, ..good.process }),
        ("max_robot_speed_mm_s", Process { max_robot_speed_mm_s: 0.0, ..good.process }),
        ("max_inclination_deg", Process { max_inclination_deg: 91.0, ..good.process }),
    ] {
        let task = RemoteTask::new(vec![Subtask { process, ..good.clone() }]);
        let message = RemotePlan::new(&task, &PlanOptions::default()).unwrap_err().to_string();
        assert!(message.contains(field) && message.contains("hole at 1, 2"), "{message}");
    }
    let task = RemoteTask::new(vec![Subtask { plane: 3, ..good }]);
    let message = RemotePlan::new(&task, &PlanOptions::default()).unwrap_err().to_string();
    assert!(message.contains("plane of hole at 1, 2"), "{message}");
}
