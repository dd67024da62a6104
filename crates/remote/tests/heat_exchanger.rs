//! The heat exchanger of the paper: eight holes of 120 mm in two plates, to four digits.
//!
//! The positions are assumed; the figures follow from them in closed form.

#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

use std::f64::consts::{FRAC_PI_2, PI};

use lasergym_geom::Point;
use lasergym_remote::{
    BeamPath, DirectionSearch, LineChoice, LineFunctions, PlanOptions, Process, RemotePlan,
    RemoteTask, RobotLine, ScanCircle, SpeedRange, Subtask,
};

/// Exposures at 100, 70 and 50 µm of ablation.
const EXPOSURES: [u32; 3] = [7, 10, 14];

const SPEEDS: SpeedRange = SpeedRange { slowest_mm_s: 1.0, fastest_mm_s: 200.0 };

/// Four digits.
fn assert_digits(found: f64, expected: &str) {
    let decimals = expected.split_once('.').map_or(0, |(_, digits)| digits.len());
    let slack = 0.5 * 0.1_f64.powf(decimals as f64);
    let value: f64 = expected.parse().unwrap();
    assert!((found - value).abs() <= slack * (1.0 + 1e-9), "{found} is not {expected}");
}

/// Exact scan circles of holes: radius 150 − 60 mm, time l n / v.
fn circles(centers: &[(f64, f64)], exposures: u32) -> Vec<ScanCircle> {
    let circle = |&(x, y): &(f64, f64)| ScanCircle {
        center: Point::new(x, y),
        radius_mm: 90.0,
        time_s: 120.0 * PI * f64::from(exposures) / 6000.0,
        max_speed_mm_s: 200.0,
    };
    centers.iter().map(circle).collect()
}

const ROW: [(f64, f64); 4] = [(155.0, 250.0), (385.0, 250.0), (615.0, 250.0), (845.0, 250.0)];

const DISPLACED: [(f64, f64); 4] = [(40.0, 155.0), (-30.0, 385.0), (20.0, 615.0), (-50.0, 845.0)];

fn task(centers: &[(f64, f64)], exposures: u32) -> RemoteTask {
    let process = Process { exposures, ..Process::default() };
    let subtask = |(index, &(x, y)): (usize, &(f64, f64))| Subtask {
        name: format!("hole {}", index + 1),
        plane: 0,
        path: BeamPath::circle(Point::new(x, y), 60.0).unwrap(),
        process,
    };
    RemoteTask::new(centers.iter().enumerate().map(subtask).collect())
}

fn plan(task: &RemoteTask, choice: LineChoice) -> RemotePlan {
    RemotePlan::new(task, &PlanOptions { choice, ..PlanOptions::default() }).unwrap()
}

#[test]
fn sections_offsets_and_speeds_of_one_row() {
    let figures = [
        (0.4398, "87.96", "78.5", "409"),
        (0.6283, "125.66", "64.4", "286"),
        (0.8796, "175.93", "19.0", "204.6"),
    ];
    for (exposures, (time_s, section, offset, speed)) in EXPOSURES.into_iter().zip(figures) {
        let row = circles(&ROW, exposures);
        assert!((row[0].time_s - time_s).abs() < 5e-5);
        let length_mm = row[0].time_s * 200.0;
        assert_digits(length_mm, section);
        let functions = LineFunctions::new(&row, 0.0, 0.0);
        // The row lies at y = 250: along +x the offset is −250.
        assert_digits(functions.feasible_speed_mm_s(-250.0), speed);
        let largest: f64 = offset.parse().unwrap();
        assert!(functions.end_mm(-250.0 + largest - 0.05, 200.0).is_some());
        assert!(functions.end_mm(-250.0 + largest + 0.05, 200.0).is_none());
    }
}

#[test]
fn optimised_lines_of_one_row() {
    let figures = [
        ("685.9", "157.04", "842.96"),
        ("761.3", "119.34", "880.66"),
        ("861.9", "69.07", "930.93"),
    ];
    for (exposures, (length, start, end)) in EXPOSURES.into_iter().zip(figures) {
        let row = circles(&ROW, exposures);
        let line = RobotLine::best(&row, SPEEDS, 0.0, DirectionSearch::default()).unwrap();
        assert_digits(line.length_mm(), length);
        assert_digits(line.start_mm, start);
        assert_digits(line.end_mm, end);
        assert!((line.offset_mm + 250.0).abs() < 1e-6 && (line.speed_mm_s - 200.0).abs() < 1e-9);
        // Identical circles in a row: pitch (N − 1) − 2 R + 2 l.
        let closed_mm = 230.0 * 3.0 - 180.0 + 2.0 * row[0].time_s * 200.0;
        assert!((line.length_mm() - closed_mm).abs() < 1e-6);
    }
}

#[test]
fn the_plan_has_two_lines_and_a_tour_of_1930_mm() {
    let mut centers = ROW.to_vec();
    centers.extend(ROW.map(|(x, _)| (x, 800.0)));
    // Out of order, so that the tour has something to do.
    centers.swap(1, 6);
    centers.swap(0, 3);
    let initial =
        [("688.0", "200.0", "3.440"), ("690.0", "143.2", "4.817"), ("690.0", "102.3", "6.744")];
    let optimised = ["3.430", "3.807", "4.309"];
    let savings = ["0.3", "21.0", "36.1"];
    for (k, exposures) in EXPOSURES.into_iter().enumerate() {
        let task = task(&centers, exposures);
        let start = plan(&task, LineChoice::Initial);
        assert_digits(start.tour_mm, "1930");
        assert_eq!(start.lines.len(), 2);
        for line in &start.lines {
            let line = &line.routed.line;
            let (length, speed, time) = initial[k];
            assert_digits(line.length_mm(), length);
            assert_digits(line.speed_mm_s, speed);
            assert_digits(line.time_s(), time);
        }
        let joint = plan(&task, LineChoice::Joint);
        assert_eq!(joint.lines.len(), 2);
        for choice in [LineChoice::Greedy, LineChoice::GreedyAnyDirection] {
            let best = plan(&task, choice);
            assert!(joint.cycle_time_s <= best.cycle_time_s + 1e-9, "{choice:?}");
            assert_eq!(best.lines.len(), 2, "{choice:?}");
            for (line, initial) in best.lines.iter().zip(&start.lines) {
                let (time_s, initial_s) = (line.routed.line.time_s(), initial.routed.line.time_s());
                assert_digits(time_s, optimised[k]);
                assert_digits(100.0 * (1.0 - time_s / initial_s), savings[k]);
            }
        }
    }
}

#[test]
fn the_laser_is_on_for_as_long_as_the_process_takes() {
    for (exposures, time_s) in EXPOSURES.into_iter().zip(["1.76", "2.51", "3.52"]) {
        assert_digits(plan(&task(&ROW, exposures), LineChoice::Joint).laser_s(), time_s);
    }
}

#[test]
fn displaced_holes_along_plus_y() {
    let line = RobotLine::along(&circles(&DISPLACED, 7), FRAC_PI_2, SPEEDS, 0.0).unwrap();
    assert_digits(line.length_mm(), "710.0");
    // The best offset is midway between the first hole and the last, to which only they are near: -5.
    // A tenth beside it the length is the same to six digits.
    assert!((line.offset_mm + 5.0).abs() < 1e-5, "{}", line.offset_mm);
    let functions = LineFunctions::new(&circles(&DISPLACED, 7), FRAC_PI_2, 0.0);
    assert_digits(functions.length_mm(-5.1, 200.0).unwrap(), "710.0");
    assert_digits(functions.start_mm(-5.1, 200.0).unwrap(), "144.9");
    assert_digits(functions.end_mm(-5.1, 200.0).unwrap(), "855.0");
    let line = RobotLine::along(&circles(&DISPLACED, 10), FRAC_PI_2, SPEEDS, 0.0).unwrap();
    assert_digits(line.length_mm(), "785.4");
    assert!((line.offset_mm + 5.0).abs() < 1e-5, "{}", line.offset_mm);
    let functions = LineFunctions::new(&circles(&DISPLACED, 10), FRAC_PI_2, 0.0);
    assert_digits(functions.length_mm(-5.3, 200.0).unwrap(), "785.4");
    // 50 µm of ablation take too long for one line at full speed.
    let full = SpeedRange { slowest_mm_s: 200.0, ..SPEEDS };
    assert!(RobotLine::along(&circles(&DISPLACED, 14), FRAC_PI_2, full, 0.0).is_none());
    assert!(
        RobotLine::best(&circles(&DISPLACED, 14), full, 0.0, DirectionSearch::default()).is_none()
    );
}

#[test]
fn displaced_holes_in_the_best_direction() {
    let sampled = DirectionSearch { refine: false, ..DirectionSearch::default() };
    for (exposures, length) in [(7, "691.8"), (10, "767.2")] {
        let line = RobotLine::best(&circles(&DISPLACED, exposures), SPEEDS, 0.0, sampled).unwrap();
        assert_digits(line.length_mm(), length);
        assert!((line.direction_rad.to_degrees() - 97.0).abs() < 1e-9, "{}", line.direction_rad);
        let refined = RobotLine::best(
            &circles(&DISPLACED, exposures),
            SPEEDS,
            0.0,
            DirectionSearch::default(),
        );
        assert!(refined.unwrap().length_mm() <= line.length_mm());
    }
}

#[test]
fn optimisation_joins_what_the_greedy_start_separates() {
    let task = task(&DISPLACED, 7);
    assert_eq!(plan(&task, LineChoice::Initial).lines.len(), 2);
    assert_eq!(plan(&task, LineChoice::Greedy).lines.len(), 2);
    assert_eq!(plan(&task, LineChoice::GreedyAnyDirection).lines.len(), 1);
    let joint = plan(&task, LineChoice::Joint);
    assert_eq!(joint.lines.len(), 1);
    assert!(joint.cycle_time_s < plan(&task, LineChoice::Greedy).cycle_time_s);
}
