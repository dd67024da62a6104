//! Programs do on the workpiece what the task asks for, as the simulation sees it; the files in
//! `tests/golden/remote` are what the writers write.
//!
//! `LASERGYM_UPDATE_GOLDEN=1 cargo test -p lasergym-remote --test programs` writes them anew.

#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

use std::path::PathBuf;

use lasergym_geom::Point;
use lasergym_remote::{
    BeamPath, KrlOptions, LineChoice, PlanOptions, Plane, Process, ProcessKind, RemotePlan,
    RemoteTask, RobotMove, RobotProgram, ScannerProgram, SimulationReport, Subtask, simulate,
    write_krl,
};
use proptest::prelude::*;

fn asset(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests").join(name)
}

fn golden(name: &str, written: &str) -> String {
    let path = asset("golden/remote").join(name);
    if std::env::var_os("LASERGYM_UPDATE_GOLDEN").is_some_and(|value| value == "1") {
        std::fs::write(&path, written).unwrap();
    }
    std::fs::read_to_string(&path).unwrap().replace("\r\n", "\n")
}

fn heat_exchanger() -> RemoteTask {
    let text = std::fs::read_to_string(asset("assets/heat_exchanger.toml")).unwrap();
    RemoteTask::from_toml(&text, None).unwrap()
}

/// Two seams and a kerf, small enough to read.
fn small_task() -> RemoteTask {
    let weld = Process { kind: ProcessKind::Welding, speed_mm_s: 200.0, ..Process::default() };
    let cut = Process { exposures: 3, ..Process::default() };
    let point = |x: f64, y: f64| Point::new(x, y);
    let corner = [point(200.0, 0.0), point(230.0, 0.0), point(230.0, 30.0)];
    let subtasks = vec![
        ("seam", BeamPath::line(point(0.0, 0.0), point(40.0, 0.0)), weld),
        ("bracket", BeamPath::polyline(&corner), cut),
        ("hole", BeamPath::circle(point(420.0, 10.0), 5.0), cut),
    ];
    let subtask = |(name, path, process): (&str, Result<BeamPath, String>, Process)| Subtask {
        name: name.to_owned(),
        plane: 0,
        path: path.unwrap(),
        process,
    };
    let mut task = RemoteTask::new(subtasks.into_iter().map(subtask).collect());
    "small task".clone_into(&mut task.name);
    task.planes[0].origin_mm = [1000.0, -200.0, 500.0];
    task
}

/// Both programs, written, read and played.
fn played(task: &RemoteTask, plan: &RemotePlan) -> SimulationReport {
    let robot = RobotProgram::from_csv(&RobotProgram::of(task, plan).to_csv()).unwrap();
    let scanner = ScannerProgram::from_csv(&ScannerProgram::of(task, plan).to_csv()).unwrap();
    simulate(task, &robot, &scanner, 0.0).unwrap()
}

fn assert_good(task: &RemoteTask, choice: LineChoice) -> RemotePlan {
    let options = PlanOptions { choice, ..PlanOptions::default() };
    let plan = RemotePlan::new(task, &options).unwrap();
    let report = played(task, &plan);
    assert!(report.is_good(), "{choice:?} {:?}", report.problems);
    assert!(report.max_seam_error_mm < 0.01, "{}", report.max_seam_error_mm);
    // Every move may differ by a cycle from the closed form.
    let moves = 3.0 * plan.lines.len() as f64;
    assert!(
        (report.total_s - plan.cycle_time_s).abs() < 2.1e-3 * moves,
        "{} {}",
        report.total_s,
        plan.cycle_time_s
    );
    assert!((report.laser_s - plan.laser_s()).abs() < 1e-9);
    plan
}

#[test]
fn the_heat_exchanger_is_cut_as_planned() {
    let task = heat_exchanger();
    for choice in
        [LineChoice::Initial, LineChoice::Greedy, LineChoice::GreedyAnyDirection, LineChoice::Joint]
    {
        assert_good(&task, choice);
    }
}

#[test]
fn golden_programs() {
    let task = small_task();
    let plan = assert_good(&task, LineChoice::Joint);
    let robot = RobotProgram::of(&task, &plan);
    let scanner = ScannerProgram::of(&task, &plan);
    let module = write_krl(&task.name, &robot, &KrlOptions::default());
    assert_eq!(module.name, "SMALL_TASK");
    for (name, written) in [
        ("small_task.src", module.src),
        ("small_task.dat", module.dat),
        ("small_task.robot.csv", robot.to_csv()),
        ("small_task.scanner.csv", scanner.to_csv()),
        ("small_task.rtc", scanner.to_rtc(&task.scanner)),
    ] {
        assert_eq!(written, golden(name, &written), "{name}");
    }
}

/// Tasks of circles, lines and polylines, welded and cut, on up to two planes.
fn tasks() -> impl Strategy<Value = RemoteTask> {
    let shape = (
        0..3,
        -400.0..400.0,
        -300.0..300.0,
        6.0..60.0,
        0.0..6.2,
        1..8_u32,
        any::<bool>(),
        0..2_usize,
    );
    let subtask = shape.prop_map(|(kind, x, y, size, angle, exposures, weld, plane)| {
        let at = |radius: f64, turn: f64| {
            Point::new(x + radius * f64::cos(angle + turn), y + radius * f64::sin(angle + turn))
        };
        let path = match kind {
            0 => BeamPath::circle(Point::new(x, y), size),
            1 => BeamPath::line(at(size, 0.0), at(-size, 0.0)),
            _ => BeamPath::polyline(&[at(size, 0.0), at(size, 1.5), at(size, 3.0), at(size, 0.0)]),
        };
        let process = if weld {
            Process {
                kind: ProcessKind::Welding,
                speed_mm_s: 200.0,
                max_inclination_deg: 18.0,
                ..Process::default()
            }
        } else {
            Process { exposures, ..Process::default() }
        };
        Subtask { name: format!("shape {x}"), plane, path: path.unwrap(), process }
    });
    proptest::collection::vec(subtask, 1..9).prop_map(|subtasks| {
        let mut task = RemoteTask::new(subtasks);
        task.scanner.field_angle_deg = 30.0;
        task.planes = vec![
            Plane { name: "top".into(), ..Plane::default() },
            Plane {
                name: "side".into(),
                origin_mm: [0.0, 900.0, -300.0],
                abc_deg: [20.0, -30.0, 60.0],
            },
        ];
        task
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn every_plan_passes_the_simulation(task in tasks()) {
        let mut joint_s = 0.0;
        for choice in [LineChoice::Joint, LineChoice::Greedy, LineChoice::Initial, LineChoice::GreedyAnyDirection] {
            let plan = assert_good(&task, choice);
            if choice == LineChoice::Joint {
                joint_s = plan.cycle_time_s;
            }
            prop_assert!(joint_s <= plan.cycle_time_s + 1e-9, "{choice:?}");
        }
    }
}

/// The simulation must not pass everything: each fault is seen.
#[test]
fn faults_of_programs_are_found() {
    let task = small_task();
    let plan = assert_good(&task, LineChoice::Joint);
    let (robot, scanner) = (RobotProgram::of(&task, &plan), ScannerProgram::of(&task, &plan));
    let fault = |robot: &RobotProgram, scanner: &ScannerProgram, words: &str| {
        let report = simulate(&task, robot, scanner, 0.0).unwrap();
        assert!(
            report.problems.iter().any(|p| p.contains(words)),
            "{words}: {:?}",
            report.problems
        );
    };
    let changed_robot = |change: &dyn Fn(&mut RobotMove)| {
        let mut changed = robot.clone();
        changed.moves.iter_mut().for_each(change);
        changed
    };
    // Started a millimetre late, too fast, or never.
    let late = changed_robot(&|one| {
        if let RobotMove::Line { trigger_mm, .. } = one {
            *trigger_mm += 1.0;
        }
    });
    fault(&late, &scanner, "beside");
    let fast = changed_robot(&|one| {
        if let RobotMove::Line { speed_mm_s, .. } = one {
            *speed_mm_s *= 1.2;
        }
    });
    fault(&fast, &scanner, "beside");
    fault(&fast, &scanner, "200 are allowed");
    let never = changed_robot(&|one| {
        if let RobotMove::Line { list, .. } = one {
            *list += 70;
        }
    });
    fault(&never, &scanner, "never started");
    fault(&never, &scanner, "exposures");
    let changed_scanner = |change: &dyn Fn(&mut lasergym_remote::ScanVector)| {
        let mut changed = scanner.clone();
        changed.lists.iter_mut().flat_map(|list| &mut list.vectors).for_each(change);
        changed
    };
    let moved = changed_scanner(&|vector| vector.to_mm = vector.to_mm + Point::new(0.06, 0.0));
    fault(&robot, &moved, "beside");
    let out = changed_scanner(&|vector| vector.to_mm = vector.to_mm + Point::new(200.0, 0.0));
    fault(&robot, &out, "from the centre of the field");
    let slow = changed_scanner(&|vector| vector.cycles += vector.cycles / 20);
    fault(&robot, &slow, "the speed on");
    let off = changed_scanner(&|vector| vector.laser = false);
    fault(&robot, &off, "exposures");
    let nothing = changed_scanner(&|vector| vector.subtask = None);
    fault(&robot, &nothing, "no subtask");
}

#[test]
fn malformed_programs_are_refused_by_line() {
    let task = small_task();
    let plan = RemotePlan::new(&task, &PlanOptions::default()).unwrap();
    let robot = RobotProgram::of(&task, &plan).to_csv();
    for (from, to, words) in [
        ("move,", "moves,", "header"),
        ("LIN", "CIRC", "no move"),
        ("WAIT,", "WAIT,,", "columns"),
        ("0.500000", "half", "no number"),
        ("0.500000", "nan", "out of range"),
        ("1000.000000,2000", "-1000.000000,2000", "0.000001 or above"),
        ("1000.000000,2000", "0.0000002,2000", "0.000001 or above"),
    ] {
        let changed = robot.replacen(from, to, 1);
        assert_ne!(changed, robot, "{from}");
        let message = RobotProgram::from_csv(&changed).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("line"), "{message}");
    }
    let scanner = ScannerProgram::of(&task, &plan).to_csv();
    for (from, to, words) in [
        ("list,", "lists,", "header"),
        ("\n1,0,", "\n1,0,0,", "columns"),
        ("\n1,0,", "\n1,none,", "no count"),
        (",0,\n", ",maybe,\n", "laser"),
        ("\n1,0,", "\n1,0,x", "no number"),
    ] {
        let changed = scanner.replacen(from, to, 1);
        assert_ne!(changed, scanner, "{from}");
        let message = ScannerProgram::from_csv(&changed).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("line"), "{message}");
    }
}
